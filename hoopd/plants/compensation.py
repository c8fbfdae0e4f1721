"""What cancels an effect: the torque to demand so that the driven body moves as if the effect were not there.

A force on the driven body is taken off the torque, dry friction is added in the direction of the motion (at rest: of
the torque), a map of the torque is undone by its declared inverse. Everything is a mean over the tick for which the
torque will be held, the plant moving on at its rates.

Rules of this file: equations come from the effects' declarations, whatever they are called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.compiled import Call
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import DryFriction, Effect, Point
from hoopd.plants.found_effects import FoundEffects

Array = NDArray[np.float64]
# (x (nx,), wanted torque N m, 1 or 0 for every effect: it is cancelled or not) -> torque to demand, N m
Demand = Callable[[Array, float, Sequence[float]], float]

# Beyond the order of any map of the torque.
LAST_ORDER = 100
# Points of the mean over a tick: 7 times a turn at 20 rad/s, 2.8 rad a tick, is met within 4 %.
POINTS = 3
# Of a friction's level, the wanted torque at rest at which three quarters of it are given: less would turn a law's
# noise into a rattle, more would leave the body stuck.
REST_SHARE = 0.5
# So many standard deviations of the estimated speed are a motion: at rest its noise must not rattle the drive.
MOTION_SIGMAS = 3.0


def cancels(found: FoundEffects, effect: Effect) -> bool:
    """Whether a torque on the driven body can undo the effect."""
    driven = found.plant.driven
    if driven is None or not effect.acts_now or effect.shift is not None:
        return False
    if effect.torque is not None:
        return effect.undo is not None
    if effect.friction is not None:
        return effect.friction.needed is None and set(effect.friction.along(_anywhere(found))) == {driven}
    return effect.force is not None and set(effect.force(_anywhere(found), effect.values(found.values))) == {driven}


def in_order(found: FoundEffects) -> tuple[Effect, ...]:
    """Those that can be cancelled, against the signal path: forces on the body first, then the drive's maps from its
    end."""
    chosen = [effect for effect in found.effects() if cancels(found, effect)]
    return tuple(sorted(chosen, key=lambda one: -one.order if one.torque is not None else -LAST_ORDER))


class CompiledDemand:
    """A `Demand` of compiled expressions."""

    def __init__(self, call: Call) -> None:
        self._call = call

    def __call__(self, x: Array, wanted_nm: float, acting: Sequence[float]) -> float:
        """Torque to demand, N m."""
        return float(self._call.vector(x, wanted_nm, *acting)[0])


def demand_of(found: FoundEffects, tick_s: float, wire_s: float, speed_noise_rad_s: float) -> Demand:
    """All effects of `in_order` in one call; `speed_noise_rad_s`: of the estimate that it is given."""
    effects, wanted = in_order(found), ca.SX.sym("wanted")
    x = ca.SX.sym("x", len(found.plant.states))
    ages = [wire_s + tick_s * (index + 0.5) / POINTS for index in range(POINTS)]
    states, constants = [_moved(found.plant, x, age) for age in ages], _constants(found)
    flags, torque = [ca.SX.sym(f"on{index}") for index in range(len(effects))], wanted
    for effect, on in zip(effects, flags, strict=True):
        points = [found.plant.point(state, constants, torque) for state in states]
        mean = sum(_one(found, effect, s, speed_noise_rad_s) for s in points) / POINTS
        torque = ca.if_else(on > 0.5, mean, torque)
    return CompiledDemand(Call(ca.Function("demand", [x, wanted, *flags], [ca.densify(torque)], {"cse": True})))


def _one(found: FoundEffects, effect: Effect, s: Point, noise_rad_s: float) -> Any:
    """Torque to demand at one point."""
    e, driven = effect.values(found.values), str(found.plant.driven)
    if effect.undo is not None:
        return effect.undo(s, e)
    if effect.force is not None:
        return s.u - effect.force(s, e)[driven]
    assert effect.friction is not None
    return s.u + _friction(found.plant, effect.friction, s, e, noise_rad_s)


def _friction(plant: Plant, friction: DryFriction, s: Point, e: Any, noise_rad_s: float) -> Any:
    """level * direction: of the motion beyond the estimate's noise, of the wanted torque at rest."""
    level = friction.level(s, e)
    motion = ca.tanh(getattr(s, f"d{plant.driven}") / (MOTION_SIGMAS * noise_rad_s))
    torque = ca.tanh(s.u / (REST_SHARE * ca.fmax(level, 1e-9)))
    return level * (motion + (1 - ca.fabs(motion)) * torque)


def _moved(plant: Plant, x: Any, age_s: float) -> Any:
    """The state when every coordinate has gone on at its rate."""
    places = range(0, 2 * len(plant.coordinates), 2)
    moved = [part for i in places for part in (x[i] + age_s * x[i + 1], x[i + 1])]
    return ca.vertcat(*moved, x[2 * len(plant.coordinates) :])


def _constants(found: FoundEffects) -> dict[str, Any]:
    return {name: ca.SX(value) for name, value in found.base.items()}


def _anywhere(found: FoundEffects) -> Point:
    return found.plant.point(np.zeros(len(found.plant.states)), found.base)
