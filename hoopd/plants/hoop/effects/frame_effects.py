"""The frame that carries the plant: how it stands to gravity and whether it shakes; slots of the kind `frame`.

Rules of this file: one function an effect; its equation stands above the line that computes it.
"""

from __future__ import annotations

from math import pi
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, EffectParameter, Point, Values, geometric, phase
from hoopd.plants.effects.usual_sizes import named, of_kind


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every frame."""
    return tuple(
        effect
        for name, slot in of_kind(plant, "frame")
        for effect in (_tilt(plant, name, slot.coordinate), _vibration(name))
    )


def _tilt(plant: Plant, name: str, q: str) -> Effect:
    return Effect(
        f"{name}.tilt",
        (EffectParameter("d", "rad", 0.0, -0.5, 0.5, grid=(0.02,), least=-pi / 2, most=pi / 2),),
        # sin(psi - d)
        shift=lambda s, e: {q: -e.d},
        depends_on=(q,),
        same_as=named(plant, "sensor", "angle_offset", q, "camera"),
        near=named(plant, "sensor", "center_offset", q, "camera"),
        formula=f"sin({q} - d) in place of sin({q})",
        statement="the frame leans: the ball's lowest point is at the angle d",
        signature="the ball rests at d, not at zero",
        sign="either",
        best_experiment="turn the whole frame round by half a turn: a lean changes its sign, a camera's zero does not",
        write_back="the model's zero moves to d: demand angles from there",
    )


def _vibration(name: str) -> Effect:
    def push(s: Point, e: Values) -> dict[str, Any]:
        p = s.p
        # base acceleration A sin(w t + phi) along the horizontal: + m (Ro-Rb) A cos psi on psi
        return {"psi": p["mb"] * (p["Ro"] - p["Rb"]) * e.A * ca.cos(s.psi) * ca.sin(e.w * s.t + e.phi)}

    return Effect(
        f"{name}.vibration",
        (
            EffectParameter("A", "m/s2", 0.0, 0.0, 10.0, grid=(0.1,)),
            EffectParameter("w", "rad/s", 10.0, 2.0, 60.0, "shape", geometric(2.0, 60.0, 14)),
            phase(per_recording=True),
        ),
        force=push,
        shaking=lambda s, e: e.A * ca.sin(e.w * s.t + e.phi),
        found_by="scan",
        depends_on=("t",),
        formula="m (Ro-Rb) A sin(w t + phi) cos psi",
        statement="the frame shakes sideways at one frequency",
        signature="the missing force on the ball is a sine of time, whatever plant and drive do",
        sign="A >= 0, the phase takes the sign; t from each recording's start",
        best_experiment="a recording with the drive off and the ball at rest",
        write_back="find what shakes the frame; the estimator may carry an oscillator of that frequency",
    )
