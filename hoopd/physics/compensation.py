"""What cancels an effect: the torque to demand so that the hoop moves as if the effect were not there.

A force on the driven body is taken off the torque, dry friction is added in the direction of the motion (at rest: of
the torque), a map of the torque is undone by its declared inverse. Everything is a mean over the tick for which the
torque will be held, the plant moving on at its rates.

Rules of this file: equations come from the effects' declarations, whatever they are called.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.physics.declared import DeclaredPlant
from hoopd.physics.effectplant import acts_now
from hoopd.physics.effects.base import DryFriction, Effect, Point
from hoopd.physics.found import Found
from hoopd.physics.plant import Call

Array = NDArray[np.float64]
Demand = Callable[[Array, float], float]

# Points of the mean over a tick: 7 times a turn at 20 rad/s, 2.8 rad a tick, is met within 4 %.
POINTS = 3
# Of a friction's level, the wanted torque at rest at which three quarters of it are given: less would turn a law's noise
# into a rattle, more would leave the hoop stuck.
REST_SHARE = 0.5
# So many standard deviations of the estimated speed are a motion: at rest its noise must not rattle the drive.
MOTION_SIGMAS = 3.0


def cancels(found: Found, effect: Effect) -> bool:
    """Whether a torque on the driven body can undo the effect."""
    driven = found.plant.driven
    if driven is None or not acts_now(effect) or effect.shift is not None:
        return False
    if effect.torque is not None:
        return effect.undo is not None
    if effect.friction is not None:
        return effect.friction.needed is None and set(effect.friction.along(_anywhere(found))) == {driven}
    return effect.force is not None and set(effect.force(_anywhere(found), effect.values(found.values))) == {driven}


def demands(found: Found, tick_s: float, wire_s: float, speed_noise_rad_s: float) -> list[tuple[str, Demand]]:
    """(effect, its demand), against the signal path; `speed_noise_rad_s`: of the estimate that they are given."""
    chosen = [effect for effect in found.effects() if cancels(found, effect)]
    # forces on the body first, then the drive's maps from the last one back
    chosen.sort(key=lambda one: -one.order if one.torque is not None else -100)
    return [(one.name, _demand(found, one, tick_s, wire_s, speed_noise_rad_s)) for one in chosen]


def _demand(found: Found, effect: Effect, tick_s: float, wire_s: float, noise_rad_s: float) -> Demand:
    plant, x, wanted = found.plant, ca.SX.sym("x", 4), ca.SX.sym("wanted")
    ages = [wire_s + tick_s * (index + 0.5) / POINTS for index in range(POINTS)]
    points = [plant.point(_moved(x, age), _constants(found), wanted) for age in ages]
    mean = sum(_one(found, effect, s, noise_rad_s) for s in points) / POINTS
    call = Call(ca.Function("demand", [x, wanted], [ca.densify(mean)], {"cse": True}))
    return lambda state, torque: float(call.vector(state, torque)[0])


def _one(found: Found, effect: Effect, s: Point, noise_rad_s: float) -> Any:
    """Torque to demand at one point."""
    e, driven = effect.values(found.values), str(found.plant.driven)
    if effect.undo is not None:
        return effect.undo(s, e)
    if effect.force is not None:
        return s.u - effect.force(s, e)[driven]
    assert effect.friction is not None
    return s.u + _friction(found.plant, effect.friction, s, e, noise_rad_s)


def _friction(plant: DeclaredPlant, friction: DryFriction, s: Point, e: Any, noise_rad_s: float) -> Any:
    """level * direction: of the motion beyond the estimate's noise, of the wanted torque at rest."""
    level = friction.level(s, e)
    motion = ca.tanh(getattr(s, f"d{plant.driven}") / (MOTION_SIGMAS * noise_rad_s))
    torque = ca.tanh(s.u / (REST_SHARE * ca.fmax(level, 1e-9)))
    return level * (motion + (1 - ca.fabs(motion)) * torque)


def _moved(x: Any, age_s: float) -> Any:
    return ca.vertcat(x[0] + age_s * x[1], x[1], x[2] + age_s * x[3], x[3])


def _constants(found: Found) -> dict[str, Any]:
    return {name: ca.SX(value) for name, value in found.base.items()}


def _anywhere(found: Found) -> Point:
    return found.plant.point(np.zeros(4), found.base)
