"""A plant as the search for missing physics knows it: coordinates, accelerations, channels and slots.

The state is (q1, q1', q2, q2', ...); the rate of a coordinate `theta` is called `dtheta`. The hoop with its ball is one
such plant; another one is declared in a few lines (docs/reference/effects.md).

Rules of this file: declarations only; nothing here knows a particular plant or effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca

from hoopd.plants.effects.base import Point


class Slot(NamedTuple):
    """Where an effect may sit: `actuator`, `body`, `sensor`, `push`; the hoop's own are `rolling_ball` and `frame`."""

    kind: str
    coordinate: str = ""
    channels: tuple[str, ...] = ()
    turns: bool = False  # the body (or the sensor's wheel) turns: an angle comes back after a turn
    device: str = ""  # of a sensor: encoder, camera, or anything else
    speed: float = 10.0  # usual rate of the coordinate, rad/s or m/s: the sizes that a search tries follow it
    viscous: Callable[[Point], Any] | None = None  # the base's viscous coefficient of the body, where it has one
    contact: Callable[[Point], Any] | None = None  # of a rolling ball: `hoop.declaration.Contact`


@dataclass(frozen=True)
class DeclaredPlant:
    """Everything the engine has to know of a plant."""

    name: str
    coordinates: tuple[str, ...]
    # q'' (n,) at a point under generalised forces (n,); the torque of the drive is among the forces
    accelerations: Callable[[Point, ca.SX], ca.SX]
    values: Mapping[str, float]  # base parameters
    free: tuple[str, ...]  # those that are fitted
    driven: str | None  # the coordinate the drive acts on
    channels: Mapping[str, str]  # what is measured -> the coordinate or rate it reads
    slots: Mapping[str, Slot]
    held: Mapping[str, float] = field(default_factory=dict)  # names that effects may use and that do not move
    units: Mapping[str, str] = field(default_factory=dict)
    least: Mapping[str, float] = field(default_factory=dict)  # below it there is no such plant: a mass
    force_unit: str = "N m"
    limit: float = 0.7  # of the drive, in force_unit

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the state in its order."""
        return tuple(name for q in self.coordinates for name in (q, f"d{q}"))

    def point(self, x: Any, p: Mapping[str, Any], u: Any = 0.0, t: Any = 0.0) -> Point:
        """Named view of a state."""
        return Point({**self.held, **{name: x[i] for i, name in enumerate(self.states)}}, p, u, t)
