"""The plant while the ball flies: hoop, path and spin go their own ways.

It has two coordinates more, `spin` (rad) and `distance` (m, of the ball's centre from the axis), and psi is the
direction in which the ball is seen.

Rules of this file: equations only; when a flight begins and ends, `flight` decides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.hoop.contact import ContactOf

# A ball that flies through the axis has no direction: nearer than this (m) these equations do not hold
# (`flight_motion` follows a run there).
NEAREST_M = 1e-3
# What a ball in the air has beyond one that rolls.
FREE = ("spin", "distance")


class FlyingPlant(NamedTuple):
    """What a flight needs: the plant in the air, the contact that ended and the force that ends it (N)."""

    plant: Plant
    contact: ContactOf
    normal_force: Any
    through_contact: tuple[str, ...]  # effects that act through the contact
    on_inner: tuple[Effect, ...]  # those of them that a contact with an inner hoop has, too, by its own formulas


def in_the_air(plant: Plant, contact: ContactOf) -> Plant:
    """The flying plant of a rolling one."""
    bodies = [slot for slot in plant.slots.values() if slot.kind == "body" and slot.coordinate == "theta"]

    def accelerations(s: Point, force: Any) -> Any:
        c, on = contact(s), dict(zip((*plant.coordinates, *FREE), ca.vertsplit(force), strict=True))
        r = ca.fmax(s.distance, NEAREST_M)
        # Ih theta'' = tau - bh theta';  m r^2 psi'' = -m g r sin psi - 2 m r r' psi';
        # r'' = r psi'^2 + g cos psi + F/m
        found = []
        if "theta" in on:
            drag = sum(slot.viscous(s) for slot in bodies if slot.viscous is not None)
            found.append((on["theta"] - drag * s.dtheta) / c.theta_inertia)
        found.append(on["psi"] / (s.p["mb"] * r**2) - (s.p["g"] * ca.sin(s.psi) + 2 * s.ddistance * s.dpsi) / r)
        outwards = s.distance * s.dpsi**2 + s.p["g"] * ca.cos(s.psi) + on["distance"] / s.p["mb"]
        return ca.vertcat(*found, 0.0, outwards)

    return replace(plant, coordinates=(*plant.coordinates, *FREE), accelerations=accelerations)
