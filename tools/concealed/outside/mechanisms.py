"""Which law is whose, and what each remembers at first.

Rules of this file: tables only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from concealed.forces import Force, Moment, Parameters
from concealed.outside import bodies, contact, drive, friction, sensing
from concealed.plant import Array

PREFIX = "outside."

FORCES: Mapping[str, Callable[[Parameters, Moment], Force]] = {
    "outside.dahl": friction.dahl,
    "outside.eddy_brake": friction.eddy_brake,
    "outside.play": bodies.play,
    "outside.appendage": bodies.appendage,
    "outside.bouc_wen": contact.bouc_wen,
    "outside.flat_spot": contact.flat_spot,
    "outside.magnet": contact.magnet,
    "outside.rim_magnets": contact.rim_magnets,
    "outside.wobble": contact.wobble,
}
# Limits in N m of dry friction against theta'.
ON_HOOP: Mapping[str, Callable[[Parameters, Moment], Array]] = {
    "outside.running_in": friction.running_in,
    "outside.dwell": friction.dwell,
    "outside.ratchet": friction.ratchet,
    "outside.bearing_load": friction.bearing_load,
}
MAPS: Mapping[str, Callable[[Parameters, Array, Moment], Array]] = {
    "outside.motor_heating": drive.motor_heating,
    "outside.supply_sag": drive.supply_sag,
}
ENCODERS: Mapping[str, Callable[[Parameters, Array, Array, Moment], tuple[Array, Array]]] = {
    "outside.shaft_twist": sensing.shaft_twist,
    "outside.speed_gain": sensing.speed_gain,
}
DEAD_TIME, SHAFT, BEAT, LENS = "outside.dead_time", "outside.shaft_twist", "outside.camera_beat", "outside.distortion"

# States and their first values; "theta'" stands for the hoop's own speed: a loose part turns with it.
_STATES: Mapping[str, Mapping[str, float | str]] = {
    "outside.dahl": {"dahl": 0.0},
    "outside.play": {"play.angle": 0.0, "play.speed": "theta'"},
    "outside.appendage": {"appendage.angle": 0.0, "appendage.speed": "theta'"},
    "outside.bouc_wen": {"bouc_wen": 0.0},
    "outside.running_in": {"running_in": 0.0},
    "outside.dwell": {"dwell": friction.AGED_S},
    "outside.motor_heating": {"motor_heating": 0.0},
    "outside.supply_sag": {"supply_sag": 1.0},
    "outside.shaft_twist": {"shaft_twist": 0.0, "shaft_twist.rate": 0.0},
}


def states(names: Iterable[str]) -> dict[str, float | str]:
    """States of those of `names` that remember, and their first values."""
    return {state: first for name in names for state, first in _STATES.get(name, {}).items()}


def memory(names: Iterable[str], dtheta: Array) -> dict[str, Array]:
    """First states (B,) of those of `names` that remember."""
    return {
        state: dtheta.copy() if first == "theta'" else np.full(dtheta.shape, float(first))
        for state, first in states(names).items()
    }
