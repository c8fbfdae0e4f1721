"""Readings as they would be without the known errors of their sensors.

Rules of this file: the errors come from the effects' declarations; one function a set of effects.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from hoopd.plants.compiled import Call
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.found_effects import FoundEffects

# (theta, dtheta, psi) as read -> as they are
Correction = Callable[[float, float, float], tuple[float, float, float]]
# An error changes by half of what it is the error of at the most, so that this many steps leave 2^-12 of it.
STEPS = 12
CHANNELS = ("theta", "dtheta", "psi")


class CompiledCorrection:
    """A `Correction` of compiled expressions."""

    def __init__(self, call: Call) -> None:
        self._call = call

    def __call__(self, theta: float, dtheta: float, psi: float) -> tuple[float, float, float]:
        """(theta, dtheta, psi) as they are."""
        first, second, third = self._call.vector((theta, dtheta, psi)).tolist()
        return first, second, third


def correction(found: FoundEffects) -> Correction | None:
    """What undoes the errors of the sensors; None where there are none.

    q <- reading - error(q). A frame that leans by d is a camera that reads d too much: the two are never told apart,
    and a ball at rest is then at zero in either case.
    """
    wrong = [one for one in found.effects() if misleads(one)]
    if not wrong:
        return None
    read, values = ca.SX.sym("read", 3), found.values
    true: Any = read
    for _ in range(STEPS):
        point = found.plant.point(ca.vertcat(true[0], true[1], true[2], 0.0), found.base)
        true = read - sum((_error(one, point, values) for one in wrong), ca.SX.zeros(3))
    return CompiledCorrection(Call(ca.Function("correct", [read], [ca.densify(true)], {"cse": True})))


def misleads(effect: Effect) -> bool:
    """Whether a reading is wrong by it, so that it can be corrected."""
    return effect.sensor is not None or effect.shift is not None


def _error(effect: Effect, point: Point, values: dict[str, float]) -> Any:
    """(3,) of theta, dtheta, psi."""
    e = effect.values(values)
    error: dict[str, Any] = {}
    if effect.sensor is not None:
        error = dict(effect.sensor(point, e))
    if effect.shift is not None:
        error["psi"] = -effect.shift(point, e)["psi"]
    return ca.vertcat(*(ca.SX(error.get(name, 0.0)) for name in CHANNELS))
