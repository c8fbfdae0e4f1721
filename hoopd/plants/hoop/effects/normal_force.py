"""The normal force between hoop and ball, from which rolling resistance, slip and lift-off follow.

Rules of this file: one formula.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hoopd.plants.effects.base import Point


def signed_normal_force(s: Point) -> Any:
    """N = m ((Ro-Rb) psi'^2 + g cos psi), N; below zero the hoop would have to hold the ball back.

    In a frame that leans by d and is shaken by a: N = m ((Ro-Rb) psi'^2 + g cos(psi - d) + a sin psi).
    """
    p = s.p
    # of symbols, and of arrays along a recording
    sin, cos = (np.sin, np.cos) if isinstance(s.psi, np.ndarray) else (ca.sin, ca.cos)
    force = p["mb"] * ((p["Ro"] - p["Rb"]) * s.dpsi**2 + p["g"] * cos(s.to_gravity("psi")))
    return force if s.shaken is None else force + p["mb"] * s.shaken * sin(s.psi)


def normal_force(s: Point) -> Any:
    """The same where hoop and ball press on each other, else zero."""
    return ca.fmax(signed_normal_force(s), 0.0)
