"""Recordings made up with the composite model and a coloured disturbance: what a search is tried on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import tau
from pathlib import Path

import numpy as np

from hoopd.diagnose.quality import recording_quality
from hoopd.diagnose.quality.recording_quality import Quality
from hoopd.files.shipped import or_shipped
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.stretches import Array, Held, Stretch
from hoopd.plants.model_file import load_model
from hoopd.plants.plant_with_effects import Composite
from hoopd.recording.recording import Recording

STEP_S = 0.02
# Noise of encoder (a count), its rate and the camera; a disturbance on hoop and ball.
NOISE = Noise(np.array([2e-3, 1e-3]), np.array([0.15, 0.1]), np.array([tau / 4096 / np.sqrt(12.0), 0.1, 0.002]))


def shipped_plant() -> Plant:
    """The hoop and its ball with the shipped entries."""
    return hoop_plant("entries", load_model(or_shipped(Path("models/thesis.yaml"))).values())


def assess(recording: Recording) -> Quality:
    """A recording of the shipped hoop, judged by itself."""
    return recording_quality.assess(recording, shipped_plant())


def stretch_with(
    plant: Plant,
    name: str,
    seed: int,
    seconds: float,
    effects: Sequence[Effect] = (),
    values: Mapping[str, float] | None = None,
    torque: float = 0.15,
    noise: Noise = NOISE,
    u: Array | None = None,
) -> Stretch:
    """A torque of several levels, each held for 0.12 s (or `u`), from a random angle at rest."""
    random, n = np.random.default_rng(seed), (int(seconds / STEP_S) if u is None else len(u)) + 1
    t, composite = np.arange(n) * STEP_S, Composite(plant, effects)
    levels = np.repeat(random.choice([-1.0, -0.6, -0.4, 0.4, 0.6, 1.0], n // 6 + 1), 6)[: n - 1] * torque
    u = levels if u is None else u
    x = random.uniform(-0.4, 0.4, composite.nx) * [1.0 - i % 2 for i in range(composite.nx)]
    w = _coloured(random, n, noise)
    z = _run(composite, composite.beginning(x, u[0]), t, u, w, {**composite.values, **(values or {})})
    p = composite.vector({**composite.values, **(values or {})})
    y = np.array([composite.reading_function(z[k], t[k], p).full().ravel() for k in range(n)])
    return Stretch(name, plant, t, u, y + random.normal(size=y.shape) * noise.reading)


def _run(composite: Composite, z: Array, t: Array, u: Array, w: Array, values: Mapping[str, float]) -> Array:
    torques, p, out = Held(t, u).substeps(composite.substeps), composite.vector(values), [z]
    for k in range(len(u)):
        z = np.asarray(composite.step_function(z, torques[:, k], w[k], t[k + 1] - t[k], t[k], p)).ravel()
        out.append(z)
    return np.array(out)


def _coloured(random: np.random.Generator, n: int, noise: Noise) -> Array:
    """(n, coordinates) first-order noise of the disturbance's level and time."""
    keep, out = np.exp(-STEP_S / noise.time_s), np.zeros((n, len(noise.force)))
    white = random.normal(size=out.shape) * noise.force
    out[0] = white[0]
    for k in range(1, n):
        out[k] = keep * out[k - 1] + np.sqrt(1.0 - keep**2) * white[k]
    return out
