"""The contact of the ball that rolls in the hoop.

Rules of this file: equations only; nothing here knows an effect.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca

from hoopd.plants.effects.base import Point


class Contact(NamedTuple):
    """How a rolling ball is held by the hoop: spin w = by_theta theta' + by_psi psi', and what moves when it is not."""

    by_theta: Any
    by_psi: Any
    theta_inertia: Any  # kg m^2; of the hoop without its ball
    psi_inertia: Any  # kg m^2; of the ball's path without its spin, m (Ro-Rb)^2
    spin_inertia: Any  # kg m^2; Ib
    damping: Any  # N m s; bb


ContactOf = Callable[[Point], Contact]


def contact_of(structure: str) -> ContactOf:
    """The contact of a structure."""
    # w = phi' + psi' (rolling) or phi' + theta' (published),  phi' = (Ro/Rb) (theta' - psi')
    more = 1.0 if structure == "published" else 0.0

    def physical(s: Point) -> Contact:
        p, ratio = s.p, s.p["Ro"] / s.p["Rb"] + more
        return Contact(ratio, 1.0 - ratio, p["Ih"], p["mb"] * (p["Ro"] - p["Rb"]) ** 2, p["Ib"], p["bb"])

    return _implied_contact if structure == "entries" else physical


# Of an inertia, what at least belongs to the body itself: entries may be such that nothing would be left of it.
LEAST_SHARE = 0.1


def _implied_contact(s: Point) -> Contact:
    """That of the entries: their mobility's inverse M, taken apart as the rolling ball's (table in `entries`)."""
    p, ratio = s.p, s.p["Ro"] / s.p["Rb"]
    corner = -p["K2"] / (p["mb"] * p["g"] * (p["Ro"] - p["Rb"]))
    # M = [[L1, L2], [L2, n]]^-1
    det = p["L1"] * corner - p["L2"] ** 2
    m11, m12, m22 = corner / det, -p["L2"] / det, p["L1"] / det
    # M12 = -Ib (Ro/Rb) (Ro/Rb - 1),  M11 = Ih + Ib (Ro/Rb)^2,  M22 = m (Ro-Rb)^2 + Ib (Ro/Rb - 1)^2
    most = (1.0 - LEAST_SHARE) * ca.fmin(m11 / ratio**2, m22 / (ratio - 1.0) ** 2)
    spin = ca.fmin(ca.fmax(-m12 / (ratio * (ratio - 1.0)), LEAST_SHARE * most), most)
    # J12 = bb (Ro/Rb)^2 (L1 - L2)
    damping = ca.fmax(p["J12"] / (p["L1"] - p["L2"]) / ratio**2, 0.0)
    return Contact(ratio, 1.0 - ratio, m11 - spin * ratio**2, m22 - spin * (ratio - 1.0) ** 2, spin, damping)
