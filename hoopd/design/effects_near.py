"""A model's effects near an operating point: what enters the linear model, what delays it, what it cannot have.

Rules of this file: equations come from the effects; sentences are made here, nothing is read or written.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hoopd.plants.effects.base import Effect
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.writeback import delays_of
from hoopd.plants.hoop.plant import HoopPlant

# Amplitude of a rate (rad/s) at which dry friction's describing function is told: a slow motion of hoop or ball.
RATE_RAD_S = 1.0
# A map of the torque passes nothing of a small demand when its slope there is below this.
NO_SLOPE = 1e-6


class Near(NamedTuple):
    """Effects at an operating point."""

    plant: HoopPlant  # with the smooth ones
    included: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...]  # name, why
    delay_s: float  # from a demanded torque to the readings of all outputs
    notes: tuple[str, ...]


def effects_near(base: HoopPlant, found: FoundEffects, outputs: Sequence[str], *, turning: bool) -> Near:
    """`turning`: the hoop does not rest, so that what comes back with its angle counts by its mean, nothing."""
    left = [(effect.name, why) for effect in found.effects() if (why := _why_not(found, effect, turning))]
    names = {name for name, _ in left}
    smooth = found.only(lambda one: one.acts_now and one.name not in names)
    plant = HoopPlant.with_effects(smooth) if smooth else base
    delay, notes = _delay(found, outputs)
    fixed = [one.name for one in smooth.effects() if "theta" in one.depends_on]
    notes += [f"{name} depends on the hoop's angle: it is taken at theta = 0" for name in fixed]
    notes += [f"{one.name} counts as a delay of its time" for one in found.effects() if one.lag]
    return Near(plant, smooth.names, tuple(left), delay, tuple(notes))


def _why_not(found: FoundEffects, effect: Effect, turning: bool) -> str:
    """The first reason against it; empty: it enters."""
    if effect.friction is not None:
        return _describing(found, effect)
    acts = effect.force is not None or effect.torque is not None
    reasons = {
        "it is another plant": effect.plant is not None,
        "it follows a time of its own": acts and "t" in effect.depends_on,
        "it is an error of the reading, not of the motion": effect.sensor is not None,
        "it is a matter of single samples": effect.found_by == "quality",
        "no small torque gets through it": effect.torque is not None and _slope(found, effect) < NO_SLOPE,
        "its mean over the turns of the hoop is nothing": turning and "theta" in effect.depends_on,
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def _describing(found: FoundEffects, effect: Effect) -> str:
    """Dry friction f under a rate A sin(w t) takes as much energy as a viscous friction 4 f / (pi A)."""
    friction = effect.friction
    assert friction is not None
    point = found.plant.point(np.array([0.0, RATE_RAD_S, 0.0, 0.0]), found.base)
    level = float(ca.DM(friction.level(point, effect.values(found.values))))
    if friction.needed is not None:
        return "it begins beyond a force: near rest there is none of it"
    if effect.contains:
        return f"dry friction has no slope at rest; {_viscous(level)} (falling with the rate)"
    return f"dry friction has no slope at rest; {_viscous(level)}"


def _viscous(level: float) -> str:
    return (
        f"a rate of amplitude A sees a viscous friction of 4 f/(pi A): {4.0 * level / (pi * RATE_RAD_S):.3g} N m s "
        f"at {RATE_RAD_S:g} rad/s"
    )


def _slope(found: FoundEffects, effect: Effect) -> float:
    """d torque/d demand at rest."""
    assert effect.torque is not None
    u = ca.SX.sym("u")
    point = found.plant.point(ca.SX.zeros(4), {name: ca.SX(value) for name, value in found.base.items()}, u)
    gain = ca.Function("slope", [u], [ca.jacobian(effect.torque(point, effect.values(found.values)), u)])
    return abs(float(gain(0.0)))


def _delay(found: FoundEffects, outputs: Sequence[str]) -> tuple[float, list[str]]:
    """What all outputs share, and what is to be said of the rest."""
    late = delays_of(found)
    own: dict[str, float] = {"theta": late.encoder_s, "dtheta": late.encoder_s, "psi": late.camera_s}
    sensors: set[Any] = {own.get(name, 0.0) for name in outputs}
    if len(sensors) == 1:
        return late.torque_s + sensors.pop(), []
    told = ", ".join(f"{name} by {1e3 * own[name]:g} ms" for name in outputs if own.get(name))
    return late.torque_s, [f"outputs are late by different times ({told}): in none of them here; ask for one alone"]
