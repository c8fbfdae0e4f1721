"""The same plant and the same recording in other units: what a tool finds must not depend on what a second is called.

A recording in milliseconds and kilometres is the same numbers times powers of ten, and so are the plant's parameters;
verdict and names must be the same, and sizes transform as their units do.

Rules of this file: a simulator of its own; nothing here is taken from the package but its containers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.plant_file import parse_plant
from hoopd.recording.recording import Recording, from_signals

Array = NDArray[np.float64]

STEP_S, SUBSTEPS, LEVELS_HELD = 0.02, 20, 15
# Disturbing force: share of the input's size, correlation time; noise of the sensor, share of the motion's spread.
PUSH, PUSH_S, NOISE = 0.02, 0.1, 5e-4


class Scale(NamedTuple):
    """How many new units are one old unit."""

    time: float = 1.0
    length: float = 1.0
    force: float = 1.0


class Truth(NamedTuple):
    """A mechanical system of one coordinate: inertia q'' = u - damping q' - stiffness f(q) - friction sign(q')."""

    name: str
    turns: bool
    inertia: float
    damping: float
    stiffness: float
    size: float  # of the input
    friction: float = 0.0


CART = Truth("cart", False, 2.0, 3.0, 8.0, 5.0)
SWING = Truth("swing", True, 0.02, 0.01, 0.4, 0.3)


def recorded(truth: Truth, seconds: float = 40.0, seed: int = 1) -> tuple[Array, Array, Array]:
    """Times (n,), held inputs (n,) and readings (n,) in SI units."""
    random, n = np.random.default_rng(seed), round(seconds / STEP_S)
    u = truth.size * np.repeat(random.choice([-1.0, -0.4, 0.0, 0.4, 1.0], n // LEVELS_HELD + 1), LEVELS_HELD)[:n]
    q = rate = push = 0.0
    seen, keep, h = np.zeros(n), np.exp(-STEP_S / PUSH_S), STEP_S / SUBSTEPS
    for k in range(n):
        seen[k] = q
        push = keep * push + np.sqrt(1.0 - keep**2) * PUSH * truth.size * random.normal()
        for _ in range(SUBSTEPS):
            spring = truth.stiffness * (np.sin(q) if truth.turns else q)
            free = rate + h / truth.inertia * (u[k] + push - truth.damping * rate - spring)
            most = h / truth.inertia * truth.friction
            rate = free - min(max(free, -most), most)
            q += h * rate
    return STEP_S * np.arange(n), u, seen + NOISE * float(np.std(seen)) * random.normal(size=n)


def plant_in(truth: Truth, scale: Scale, *, declared: bool = True) -> Plant:
    """The declaration, a few per cent off the truth; `declared`: with its usual sizes and its sample time."""
    unit, length = ("rad", 1.0) if truth.turns else ("m", scale.length)
    rate = {"cart": 2.0, "swing": 8.0}[truth.name] * length / scale.time
    usual = f", usual: {length!r}, usual_rate: {rate!r}" if declared else ""
    limit = f", limit: {2.0 * truth.size * scale.force!r}" if declared else ""
    inertia = 1.05 * truth.inertia * scale.force * scale.time**2 / length
    damping = 0.9 * truth.damping * scale.force * scale.time / length
    stiffness = 1.03 * truth.stiffness * scale.force / length
    spring = "sin(q)" if truth.turns else "q"
    force, drag, stiff = ("N m", "N m s", "N m") if truth.turns else ("N", "N s/m", "N/m")
    mass = "kg m2" if truth.turns else "kg"
    return parse_plant(
        f"""
schema: hoopd.plant/1
name: {truth.name}
coordinates: {{q: {{unit: {unit}{usual}}}}}
inputs: {{F: {{unit: {force}{limit}}}}}
parameters:
  J: {{value: {inertia!r}, unit: {mass}, bounds: [{inertia / 100.0!r}, {inertia * 100.0!r}]}}
  c: {{value: {damping!r}, unit: {drag}, bounds: [0, .inf]}}
  k: {{value: {stiffness!r}, unit: {stiff}, bounds: [0, .inf]}}
equations: {{q: "J*q'' = F - c*q' - k*{spring}"}}
channels: {{q: {{reads: q, sensor: encoder}}}}
sample_time_s: {STEP_S * scale.time!r}
""",
        "made",
    )


def recording_in(truth: Truth, scale: Scale, data: tuple[Array, Array, Array]) -> Recording:
    """What was recorded, in other units."""
    t, u, q = data
    length = 1.0 if truth.turns else scale.length
    return from_signals(t * scale.time, {"F": u * scale.force}, {"q": q * length}, source=truth.name)
