"""What the camera adds to the angle it sees: slots of the kind `sensor` whose device is a camera.

Rules of this file: one function an effect; its equation stands above the line that computes it.
"""

from __future__ import annotations

from math import pi
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter, Point, Values, geometric
from hoopd.plants.effects.usual_sizes import named, of_kind, scaled, time_scale


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every camera."""
    return tuple(
        effect
        for name, slot in of_kind(plant, "sensor")
        if slot.device == "camera"
        for effect in (
            latency(plant, name, slot),
            *((_angle_offset(plant, name, slot), _center_offset(plant, name, slot)) if slot.turns else ()),
            _late_frames(name, slot),
            _outliers(name, slot),
        )
    )


def latency(plant: Plant, name: str, slot: Slot) -> Effect:
    """Any sensor's: all its channels are late."""
    by = time_scale(plant)
    return Effect(
        f"{name}.latency",
        (EffectParameter("d", "s", 0.0, 0.0, 0.3 * by, "shape", scaled(geometric(0.005, 0.1, 8), by)),),
        # measured at t - d
        latency=dict.fromkeys(slot.channels, "d"),
        depends_on=("t",),
        formula=f"{', '.join(slot.channels)} at t - d",
        statement="what it measures is d seconds old",
        signature="the reading is late in proportion to the rate",
        sign="d >= 0",
        best_experiment="fast motion seen by both sensors",
        write_back="the estimator takes the reading at its own time, d earlier",
    )


def _angle_offset(plant: Plant, name: str, slot: Slot) -> Effect:
    return Effect(
        f"{name}.angle_offset",
        (EffectParameter("d", "rad", 0.0, -0.5, 0.5, grid=(0.02,), least=-pi, most=pi),),
        # psi + d
        sensor=lambda s, e: dict.fromkeys(slot.channels, e.d),
        same_as=named(plant, "frame", "tilt", slot.coordinate),
        near=(f"{name}.center_offset",),
        formula=f"{slot.coordinate} + d",
        statement="the camera's zero angle is wrong by d",
        signature="the ball seems to rest at d, not at zero",
        sign="either",
        best_experiment="turn the whole frame round by half a turn: a lean changes its sign, a camera's zero does not",
        write_back="calibrate the camera's zero by d",
    )


def _center_offset(plant: Plant, name: str, slot: Slot) -> Effect:
    def moved(s: Point, e: Values) -> dict[str, Any]:
        angle = getattr(s, slot.coordinate)
        sine, cosine = ca.sin(angle), ca.cos(angle)
        # atan2(sin psi + dx, cos psi + dy) - psi, unwrapped: the angle between the two directions
        change = ca.atan2(e.dx * cosine - e.dy * sine, 1 + e.dx * sine + e.dy * cosine)
        return dict.fromkeys(slot.channels, change)

    return Effect(
        f"{name}.center_offset",
        (
            # a centre inside the circle of the ball
            EffectParameter("dx", "-", 0.0, -0.5, 0.5, grid=(0.03,), least=-0.9, most=0.9),
            EffectParameter("dy", "-", 0.0, -0.5, 0.5, grid=(0.05,), least=-0.9, most=0.9),
        ),
        sensor=moved,
        depends_on=(slot.coordinate,),
        near=(f"{name}.angle_offset", *named(plant, "frame", "tilt", slot.coordinate)),
        formula=f"atan2(sin {slot.coordinate} + dx, cos {slot.coordinate} + dy)",
        statement="the camera takes a wrong point for the hoop's centre",
        signature="the angle's error changes with the angle, once a turn",
        sign="either; fractions of the ball's distance from the centre",
        best_experiment="ball angles as large as possible, at best whole turns",
        write_back="calibrate the hoop's centre in the picture",
    )


def _late_frames(name: str, slot: Slot) -> Effect:
    return Effect(
        f"{name}.late_frames",
        (EffectParameter("share", "-", 0.0, 0.0, 1.0, grid=(0.05,)),),
        found_by="quality",
        depends_on=("t",),
        near=(f"{name}.latency",),
        formula="a share of the samples is the frame before",
        statement="a share of the samples repeats the frame before",
        signature="single readings equal to the one before while the ball moves",
        sign="0 <= share <= 1",
        best_experiment="fast motion of the ball",
        write_back="a repeated frame is no new measurement: the estimator skips it",
    )


def _outliers(name: str, slot: Slot) -> Effect:
    return Effect(
        f"{name}.outliers",
        (EffectParameter("share", "-", 0.0, 0.0, 1.0, grid=(0.02,)),),
        found_by="quality",
        depends_on=("t",),
        formula="a share of the samples is false",
        statement="a share of the samples is a false detection",
        signature="single readings far from those around them",
        sign="0 <= share <= 1",
        best_experiment="any; better light and threshold",
        write_back="the estimator refuses readings that are too far off; the detection is set up again",
    )
