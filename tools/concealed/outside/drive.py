"""Drives that the library lacks: one that warms up, one whose supply sags, one that is late for small torques.

Rules of this file: a map is `(p, torque, s) -> torque` in N m, arrays (B,), after the maps of the library; `dead_time`
works on what was demanded, before them. What is remembered lies in `s.memory`.
"""

from __future__ import annotations

import numpy as np

from concealed.forces import Moment, Parameters
from concealed.plant import Array

WARMING_NM = 0.1  # torque whose square is the unit of heating
LEAST_SUPPLY = 0.2  # of the nominal voltage: below it a drive switches off


def motor_heating(p: Parameters, torque: Array, s: Moment) -> Array:
    """Torque constant that falls as the winding warms up: u/(1 + a H), T H' = (u/0.1 N m)^2 - H, cold at first.

    Source: Joule's heat and Newton's law of cooling: one thermal time constant; magnets and resistance lose with H.
    """
    heat = s.memory["motor_heating"]
    told = torque / (1 + p["a"] * heat)
    heat += ((torque / WARMING_NM) ** 2 - heat) * -np.expm1(-s.h / p["T"])
    return told


def supply_sag(p: Parameters, torque: Array, s: Moment) -> Array:
    """Torque in proportion to the supply, u V, that motoring loads and braking does not feed:
    T V' = 1 - V - r max(u theta', 0), V at least 0.2.

    Source: a capacitor behind a resistance and a diode, loaded with the drive's mechanical power.
    """
    supply = s.memory["supply_sag"]
    told = torque * supply
    wanted = np.maximum(1.0 - p["r"] * np.maximum(torque * s.dtheta, 0.0), LEAST_SUPPLY)
    supply += (wanted - supply) * -np.expm1(-s.h / p["T"])
    return told


def dead_time(p: Parameters, now: Array, before: Array, end_s: float, h: float) -> Array:
    """Dead time that depends on the torque: u takes effect d exp(-abs(u)/u0) late, the torque before it until then.

    end_s: from the sample's beginning to the end of this substep. Mean over the substep.
    Source: a valve or a current loop that opens the later the less is asked of it; d is at most one sample.
    """
    late_s = p["d"] * np.exp(-np.abs(now) / p["u0"])
    there = np.minimum(np.maximum((end_s - late_s) / h, 0.0), 1.0)
    return before + there * (now - before)
