"""Energy and angular momentum of hoop and ball, of a mode's own state, right before and after each change of mode."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.effects.contact_modes import AIR, INNER, ContactCourse, ContactModes

Array = NDArray[np.float64]


class Change(NamedTuple):
    """One change of mode: the energy (J) and the angular momentum about the axis (kg m2/s) on both its sides."""

    source: str
    target: str
    energies: tuple[float, float]
    momenta: tuple[float, float]


def changes_of(found: FoundEffects, x0: Array, torque_nm: float, until_s: float) -> list[Change]:
    """Every change of a run that begins on the outer hoop, driven in its first flight."""
    modes = ContactModes(found.plant, found.effects())
    course = ContactCourse(modes, found.values, modes.rolling.beginning(x0))
    hybrid, changes = course._course, list[Change]()
    change = hybrid._change

    def kept(z: Array, t: float) -> None:
        source, before = hybrid.mode, _of(modes, found, hybrid.mode, z)
        change(z, t)
        after = _of(modes, found, hybrid.mode, hybrid.z)
        changes.append(Change(source, hybrid.mode, (before[0], after[0]), (before[1], after[1])))

    hybrid._change = kept  # type: ignore[method-assign]
    for k in range(round(until_s / 0.02)):
        first = course.flies and len(changes) == 1
        course.advance(torque_nm if first else 0.0, 0.02, 0.02 * k)
    return changes


def _of(modes: ContactModes, found: FoundEffects, mode: str, z: Array) -> tuple[float, float]:
    """Energy and momentum: those of hoop, of the ball's path and of its spin, which on a track is that of rolling."""
    v, plant = found.values, modes.hybrid.modes[mode].plant
    s = plant.point(ca.DM(z[: len(plant.states)]), v)
    slip = float(s.dslip) if "slip" in s else 0.0
    inner = v.get("ball.inner_hoop.radius", 0.0)
    if mode == AIR:
        distance, across, spin = float(s.distance), float(s.ddistance), float(s.dspin)
    elif mode == INNER:  # Rb w = (Ri+Rb) psi' - Ri theta' - Rb slip'
        distance, across = inner + v["Rb"], 0.0
        spin = float(distance * s.dpsi - inner * s.dtheta) / v["Rb"] - slip
    else:  # Rb w = Ro theta' - (Ro-Rb) psi' - Rb slip'
        distance, across = v["Ro"] - v["Rb"], 0.0
        spin = float(v["Ro"] * s.dtheta - distance * s.dpsi) / v["Rb"] - slip
    dtheta, along = float(s.dtheta), distance * float(s.dpsi)
    kinetic = v["Ih"] * dtheta**2 + v["mb"] * (along**2 + across**2) + v["Ib"] * spin**2
    height = -distance * float(np.cos(float(s.psi)))
    return kinetic / 2 + v["mb"] * v["g"] * height, v["Ih"] * dtheta + v["mb"] * distance * along + v["Ib"] * spin
