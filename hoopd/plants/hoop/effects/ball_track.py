"""What the ball rolls on, as its frictions need it: how fast it rolls there, and what presses it on.

    phi' = (radius/Rb) (theta' - psi'),   radius = Ro within the hoop, -Ri on the outside of an inner one

Rules of this file: formulas; frictions stand with their effects.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca

from hoopd.plants.effects.base import Point
from hoopd.plants.hoop.effects.inner_hoop import RADIUS, inner_normal_force
from hoopd.plants.hoop.effects.normal_force import normal_force


class BallTrack(NamedTuple):
    """One of the two that a ball may roll on."""

    radius: Callable[[Point], Any]  # m, below zero of a ball outside
    normal_force: Callable[[Point], Any]  # N, never negative


OUTER_TRACK = BallTrack(lambda s: s.p["Ro"], normal_force)
INNER_TRACK = BallTrack(lambda s: -s.p[RADIUS], lambda s: ca.fmax(inner_normal_force(s), 0.0))
