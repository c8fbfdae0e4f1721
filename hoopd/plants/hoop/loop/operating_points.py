"""Where the plant can stay: at the bottom, at the top, or with the ball held up the side of a hoop that turns.

Rules of this file: an operating point is checked in the plant's own equations before it is given out.

A hoop at constant speed w carries the ball by rolling friction alone, (Ro/Rb)^2 bb w = m g (Ro-Rb) sin psi: one speed
to each angle. The torque pays for that and for the bearing, (Ro/Rb)^2 bb w + bh w, all the time: with the thesis's
entries 7.4 rad/s and 6.2 mN m for each degree. Without rolling friction only a hoop that speeds up for ever holds it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from hoopd.plants.hoop.plant import HoopPlant

Array = NDArray[Any]

# Accelerations count as zero below this part of the terms that they are the sum of.
RESIDUAL = 1e-9
# A hoop faster than this (rad/s) is no answer but a division by next to nothing.
FASTEST_RAD_S = 1e6


class NoEquilibriumError(ValueError):
    """The plant cannot stay where it is asked to."""


class HeldBall(TypedDict, total=False):
    """Where the hoop is linearised, as the Python interface is told it; neither: at rest."""

    psi: float | None  # rad, at which the ball is held
    hoop_speed: float | None  # rad/s, at which the hoop turns


def told(point: HeldBall) -> tuple[float | None, float | None]:
    """The ball's angle (rad) and the hoop's speed (rad/s)."""
    return point.get("psi"), point.get("hoop_speed")


class OperatingPoint(NamedTuple):
    """A state that the torque `u` keeps: theta'' = psi'' = psi' = 0."""

    x: Array  # (4,): theta, dtheta, psi, dpsi
    u: float  # N m
    notes: tuple[str, ...]


def operating_point(
    plant: HoopPlant,
    *,
    psi_rad: float | None = None,
    dtheta_rad_s: float | None = None,
    torque_limit_nm: float = math.inf,
) -> OperatingPoint:
    """Equilibrium with the ball at `psi_rad` or the hoop turning at `dtheta_rad_s` (ball on the lower half).

    Neither: the bottom at rest. NoEquilibriumError when the plant has none there.
    """
    if psi_rad is not None and dtheta_rad_s is not None:
        raise NoEquilibriumError("the ball's angle fixes the hoop's speed: give one of them, not both")
    if dtheta_rad_s is not None:
        x, u = _at_speed(plant, dtheta_rad_s)
    else:
        x, u = _at_angle(plant, psi_rad or 0.0)
    _check(plant, x, u)
    return OperatingPoint(x, u, tuple(_notes(x, u, torque_limit_nm)))


def _at_angle(plant: HoopPlant, psi: float) -> tuple[Array, float]:
    """theta''(w, u) = psi''(w, u) = 0 solved for hoop speed and torque by Newton's method."""
    if math.sin(psi) == 0.0 or abs(psi) == math.pi:
        return _at_rest(plant, psi)
    none = (
        f"no steady turning holds the ball at {psi:g} rad: at constant speed rolling friction alone carries it, and "
        "the model has none"
    )
    w, u = _solved(plant, lambda z: (np.array([0.0, z[0], psi, 0.0]), z[1]), 1, none)
    if abs(w) > FASTEST_RAD_S:
        raise NoEquilibriumError(none)
    return np.array([0.0, w, psi, 0.0]), u


def _at_rest(plant: HoopPlant, psi: float) -> tuple[Array, float]:
    """The bottom or the top; with an effect that pushes at rest, where it and the torque against it leave the ball."""
    x = np.array([0.0, 0.0, psi, 0.0])
    if _vanishes(plant, x, 0.0):
        return x, 0.0
    none = "the model's effects leave no rest near there"
    moved, u = _solved(plant, lambda z: (np.array([0.0, 0.0, psi + z[0], 0.0]), z[1]), 2, none)
    # the search ends somewhere near nothing where there is nothing
    psi, u = psi + (moved if abs(moved) > RESIDUAL else 0.0), u if abs(u) > RESIDUAL else 0.0
    return np.array([0.0, 0.0, psi, 0.0]), u


def _at_speed(plant: HoopPlant, w: float) -> tuple[Array, float]:
    """The same with the speed given, solved for the ball's angle and the torque."""
    if w == 0.0:
        return np.zeros(4), 0.0
    side, _ = _at_angle(plant, math.pi / 2)
    fastest = abs(side[1])
    none = f"no equilibrium at {w:g} rad/s: the ball at 90 deg, where it pulls most, holds {fastest:.4g} rad/s"
    if abs(w) > fastest * (1.0 + RESIDUAL):
        raise NoEquilibriumError(none)
    psi, u = _solved(plant, lambda z: (np.array([0.0, w, z[0], 0.0]), z[1]), 2, none)
    return np.array([0.0, w, psi, 0.0]), u


def _solved(plant: HoopPlant, place: Any, unknown: int, none: str) -> tuple[float, float]:
    """The unknown state entry and the torque for which both accelerations vanish."""

    def accelerations(z: Array) -> Array:
        return plant.derivative(*place(z))[[1, 3]]

    def jacobian(z: Array) -> Array:
        a, b = plant.linearize(*place(z))
        return np.hstack([a[[1, 3]][:, [unknown]], b[[1, 3]]])

    with np.errstate(all="ignore"):
        found = root(accelerations, np.zeros(2), jac=jacobian, method="hybr", options={"xtol": 1e-13})
    if not np.isfinite(found.x).all() or not _vanishes(plant, *place(found.x)):
        raise NoEquilibriumError(none)
    return float(found.x[0]), float(found.x[1])


def _vanishes(plant: HoopPlant, x: Array, u: float) -> bool:
    a, b = plant.linearize(x, u)
    size = np.abs(a) @ np.abs(x) + np.abs(b[:, 0] * u) + abs(plant.derivative(np.array([0, 0, x[2], 0.0]), 0.0))
    rate = plant.derivative(x, u)
    return bool((np.abs(rate[[1, 3]]) <= RESIDUAL * (size[[1, 3]] + 1.0)).all())


def _check(plant: HoopPlant, x: Array, u: float) -> None:
    if not _vanishes(plant, x, u):
        raise NoEquilibriumError(f"the plant does not stay at {x[2]:g} rad: its accelerations are not zero there")


def _notes(x: Array, u: float, torque_limit_nm: float) -> list[str]:
    notes = []
    if x[1] != 0.0:
        notes.append(
            f"the ball stays at {math.degrees(x[2]):.4g} deg while the hoop turns at {x[1]:.4g} rad/s: at constant "
            f"speed rolling friction alone carries it; {u:.4g} N m pay for that and for the bearing, all the time"
        )
    if math.cos(x[2]) <= 0.0:
        notes.append("outside the model: the ball leaves the outer hoop where g cos psi + (Ro-Rb) psi'^2 <= 0")
    if abs(u) > torque_limit_nm:
        notes.append(f"the drive gives at most {torque_limit_nm:g} N m: this point cannot be held")
    return notes
