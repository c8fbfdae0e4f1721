"""Lift-off: the hoop can push the ball but not hold it, so that it flies where the normal force would be negative.

While it flies, hoop, path and spin go their own ways; the plant of that time has two coordinates more, `spin` (rad) and
`distance` (m, of the ball's centre from the axis), and psi is the direction in which the ball is seen.

Rules of this file: one effect and its plant; when it begins and ends, `physics.flight` decides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.hoop.normal_force import signed_normal_force
from hoopd.plants.hoop.slip import ContactOf

# A ball that flies through the axis has no direction: nearer than this (m) it keeps the one it had.
NEAREST_M = 1e-3


class FlyingPlant(NamedTuple):
    """What a flight needs: the plant in the air, the contact that ended and the force that ends it (N)."""

    plant: Plant
    contact: ContactOf
    normal_force: Any
    through_contact: tuple[str, ...]  # effects that act through the contact


def lift_off(name: str, contact: ContactOf) -> Effect:
    """The effect of a rolling ball's slot; a switch: in a set of effects it is on."""
    gone = tuple(f"{name}.{effect}" for effect in ("coulomb_friction", "rolling_resistance", "slip", "lift_off"))
    return Effect(
        f"{name}.lift_off",
        (),
        flight=lambda plant: FlyingPlant(_in_the_air(plant, contact), contact, signed_normal_force, gone),
        found_by="switch",
        depends_on=("psi", "dpsi"),
        near=(f"{name}.slip",),
        statement="the ball leaves the hoop where the normal force would be negative, and flies until it touches again",
        signature="above the axis at low speed the ball falls faster than it could roll",
        sign="on or off",
        best_experiment="large swings beyond a quarter turn",
        write_back="keep the ball below the axis: no control law holds it in the air",
    )


def _in_the_air(plant: Plant, contact: ContactOf) -> Plant:
    bodies = [slot for slot in plant.slots.values() if slot.kind == "body" and slot.coordinate == "theta"]

    def accelerations(s: Point, force: Any) -> Any:
        c, on = contact(s), dict(zip(plant.coordinates, ca.vertsplit(force)[: len(plant.coordinates)], strict=True))
        r = ca.fmax(s.distance, NEAREST_M)
        # Ih theta'' = tau - bh theta';  m r^2 psi'' = -m g r sin psi - 2 m r r' psi';  r'' = r psi'^2 + g cos psi
        found = []
        if "theta" in on:
            drag = sum(slot.viscous(s) for slot in bodies if slot.viscous is not None)
            found.append((on["theta"] - drag * s.dtheta) / c.theta_inertia)
        found.append(on["psi"] / (s.p["mb"] * r**2) - (s.p["g"] * ca.sin(s.psi) + 2 * s.ddistance * s.dpsi) / r)
        return ca.vertcat(*found, 0.0, s.distance * s.dpsi**2 + s.p["g"] * ca.cos(s.psi))

    return replace(plant, coordinates=(*plant.coordinates, "spin", "distance"), accelerations=accelerations)
