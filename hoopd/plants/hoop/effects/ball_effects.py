"""Forces on the ball that rolls in the hoop: slots of the kind `rolling_ball`.

Rules of this file: one function an effect; its equation stands above the line that computes it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import DryFriction, Effect, EffectParameter, Point
from hoopd.plants.effects.usual_sizes import named, of_kind
from hoopd.plants.hoop.effects.ball_track import INNER_TRACK, OUTER_TRACK, BallTrack
from hoopd.plants.hoop.effects.inner_hoop import inner_contact, inner_hoop
from hoopd.plants.hoop.effects.lift_off import lift_off
from hoopd.plants.hoop.effects.slip import slip


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every rolling ball."""
    found = []
    for name, slot in of_kind(plant, "rolling_ball"):
        found += [*_of_slot(plant, name, slot)]
    return tuple(found)


def _of_slot(plant: Plant, name: str, slot: Slot) -> tuple[Effect, ...]:
    every = (_coulomb(plant, name, OUTER_TRACK), _rolling_resistance(name, OUTER_TRACK), _drag(name))
    if slot.data is None:
        return every
    on_inner = (
        _coulomb(plant, name, INNER_TRACK),
        _rolling_resistance(name, INNER_TRACK),
        slip(plant, name, inner_contact(slot.data), INNER_TRACK),
    )
    return (*every, slip(plant, name, slot.data), lift_off(name, slot.data, on_inner), inner_hoop(name))


def _along(track: BallTrack) -> Callable[[Point], dict[str, Any]]:
    def along(s: Point) -> dict[str, Any]:
        # phi' = (radius/Rb) (theta' - psi')
        ratio = track.radius(s) / s.p["Rb"]
        return {"theta": ratio, "psi": -ratio}

    return along


def _coulomb(plant: Plant, name: str, track: BallTrack) -> Effect:
    return Effect(
        f"{name}.coulomb_friction",
        (EffectParameter("Fc", "N m", 0.0, 0.0, 1e-3, grid=(3e-5,)),),
        # torque -Fc sign(phi') conjugate to the rolling rate
        friction=DryFriction(lambda s, e: e.Fc, _along(track)),
        depends_on=("dtheta", "dpsi"),
        near=(f"{name}.rolling_resistance", *named(plant, "body", "coulomb_friction", "theta")),
        formula="-Fc sign(phi'), phi' = (Ro/Rb) (theta' - psi')",
        statement="dry friction of the rolling ball: a constant torque against the rolling",
        signature="the missing force on the ball jumps with the sign of the rolling rate, free swings die out linearly",
        sign="Fc >= 0: it takes energy away",
        best_experiment="free swings of the ball from large angles with the hoop held",
        write_back="the estimator knows the friction; a small steady angle error is expected",
    )


def _rolling_resistance(name: str, track: BallTrack) -> Effect:
    return Effect(
        f"{name}.rolling_resistance",
        (EffectParameter("r", "m", 0.0, 0.0, 2e-3, grid=(5e-5,)),),
        # Fc = r N
        friction=DryFriction(lambda s, e: e.r * track.normal_force(s), _along(track)),
        depends_on=("dtheta", "dpsi", "psi"),
        near=(f"{name}.coulomb_friction",),
        formula="-r N sign(phi'), N = m ((Ro-Rb) psi'^2 + g cos psi)",
        statement="rolling resistance: a torque against the rolling, in proportion to the normal force",
        signature="the missing force jumps with the sign of the rolling rate and grows with the normal force",
        sign="r >= 0: it takes energy away",
        best_experiment="free swings from the largest angle: the normal force changes along the swing",
        write_back="the estimator knows the resistance; a small steady angle error is expected",
    )


def _drag(name: str) -> Effect:
    return Effect(
        f"{name}.quadratic_drag",
        (EffectParameter("c", "N m s2", 0.0, 0.0, 1e-3, grid=(2e-5,)),),
        # -c psi' |psi'| on psi
        force=lambda s, e: {"psi": -e.c * s.dpsi * ca.fabs(s.dpsi)},
        depends_on=("dpsi",),
        near=(f"{name}.coulomb_friction",),
        formula="-c psi' |psi'|",
        statement="drag of the ball that grows with the square of its speed",
        signature="the missing force on the ball is against psi' and grows with its square",
        sign="c >= 0: it takes energy away",
        best_experiment="free swings from the largest angle, and from small ones to compare",
        write_back="the estimator knows the drag",
    )
