"""Slip of the ball in the hoop: the contact holds it as long as the force that this needs is below mu N.

The plant gets one coordinate more, `slip`, whose rate is what the spin lacks: slip' = c1 theta' + c2 psi' - w, where
w = c1 theta' + c2 psi' is the rolling ball's spin. Its accelerations stay those of the rolling ball, in which slip'
does not change; a contact force g beyond the one that holds it moves hoop, ball and spin freely. Dry friction with
the limit mu N on their sum then sticks (g = 0: the rolling ball, bit for bit) or slips.

Rules of this file: one effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import DryFriction, Effect, EffectParameter, Point, Values, geometric
from hoopd.plants.hoop.contact import Contact, ContactOf
from hoopd.plants.hoop.effects.ball_track import OUTER_TRACK, BallTrack

# A contact that never slips, and the least force (N) of a ball on the hoop: their product is beyond any force.
NO_SLIP, LEAST_FORCE = 1e9, 1e-6


def slip(plant: Plant, name: str, contact: ContactOf, track: BallTrack = OUTER_TRACK) -> Effect:
    """The effect of a rolling ball's slot."""
    grid = geometric(0.02, 0.5, 8)

    def grip(s: Point) -> Any:
        return _needed_grip(plant, s, contact(s), track)

    def limit(s: Point, e: Values) -> Any:
        return e.mu * ca.fmax(track.normal_force(s), LEAST_FORCE)

    return Effect(
        f"{name}.slip",
        (EffectParameter("mu", "-", NO_SLIP, 0.005, 2.0, "shape", grid, touched=grip),),
        plant=lambda plant: slipping_plant(plant, contact, track),
        # |f| <= mu N
        friction=DryFriction(limit, lambda s: {"slip": 1.0}, lambda s, a: holding_force(s, contact(s), a, track)),
        depends_on=("u", "psi", "dpsi"),
        formula="|f| <= mu N",
        statement="the ball slips where the contact would need more than mu times the normal force",
        signature="the ball is left behind only where the torque is high or the normal force low",
        sign="mu > 0",
        best_experiment="steps of torque of growing size",
        write_back="limit the torque to what the contact can hold",
    )


def slipping_plant(plant: Plant, contact: ContactOf, track: BallTrack = OUTER_TRACK) -> Plant:
    """The same plant with the slip as its last coordinate (rad; its force is the contact's, N)."""

    def accelerations(s: Point, force: Any) -> Any:
        c, p = contact(s), s.p
        # the rolling friction follows the ball's own rate, phi' - slip'
        less = c.damping * s.dslip * track.radius(s) / p["Rb"]
        extra = {"theta": less, "psi": -less}
        forces = ca.vertcat(*(force[i] + extra[q] for i, q in enumerate(plant.coordinates)))
        rolling, g = plant.accelerations(s, forces), force[len(plant.coordinates)]
        # Ih theta'' += c1 Rb g,  m (Ro-Rb)^2 psi'' += c2 Rb g,  Ib w' -= Rb g
        free = {"theta": c.by_theta / c.theta_inertia, "psi": c.by_psi / c.psi_inertia}
        moved = [rolling[i] + free[q] * p["Rb"] * g for i, q in enumerate(plant.coordinates)]
        by_theta = c.by_theta * free["theta"] if "theta" in plant.coordinates else 0.0
        return ca.vertcat(*moved, (by_theta + c.by_psi * free["psi"] + 1.0 / c.spin_inertia) * p["Rb"] * g)

    return replace(plant, coordinates=(*plant.coordinates, "slip"), accelerations=accelerations)


def _needed_grip(plant: Plant, s: Point, c: Contact, track: BallTrack) -> Any:
    """Of the ball that rolls: |f|/N that its contact needs."""
    driven = [getattr(s, one.name) if one.coordinate == q else 0.0 for one in plant.inputs for q in plant.coordinates]
    rolling = plant.accelerations(s, ca.sum2(ca.reshape(ca.vertcat(*driven), len(plant.coordinates), -1)))
    a = {q: rolling[i] for i, q in enumerate(plant.coordinates)}
    return ca.fabs(holding_force(s, c, a, track)) / ca.fmax(track.normal_force(s), LEAST_FORCE)


def holding_force(s: Point, c: Contact, a: Mapping[str, Any], track: BallTrack = OUTER_TRACK) -> Any:
    """Force (N) of the contact that keeps the ball rolling: Ib w' = -Rb f - bb phi'."""
    p = s.p
    spin = c.by_psi * a["psi"] + (c.by_theta * a["theta"] if "theta" in a else 0.0)
    rolling_rate = track.radius(s) / p["Rb"] * (s.dtheta - s.dpsi) - (s.dslip if "dslip" in s else 0.0)
    return -(c.spin_inertia * spin + c.damping * rolling_rate) / p["Rb"]
