"""Sensors that the library lacks: an encoder behind an elastic shaft, a speed with a gain of its own, a camera whose
age beats, a lens beside the axis.

Rules of this file: a map takes what the sensor before it says and gives what is said; a size of 0 changes no bit.
"""

from __future__ import annotations

import numpy as np

from concealed.forces import Moment, Parameters
from concealed.plant import Array

USUAL_RAD_S = 20.0  # speed at which the gain is off by a


def wind(p: Parameters, torque: Array, s: Moment) -> None:
    """Shaft between motor and hoop that winds up: T w' = c tau - w; the hoop gets tau whatever w is.

    Source: a spring 1/c beside a damper T/c (Kelvin and Voigt) that carries the torque; the rotor without inertia.
    """
    twist, rate = s.memory["shaft_twist"], s.memory["shaft_twist.rate"]
    twist += (p["c"] * torque - twist) * -np.expm1(-s.h / p["T"])
    rate[...] = (p["c"] * torque - twist) / p["T"]


def shaft_twist(p: Parameters, theta: Array, dtheta: Array, s: Moment) -> tuple[Array, Array]:
    """An encoder on the motor's end of the shaft: theta + w and theta' + w'."""
    return theta + s.memory["shaft_twist"], dtheta + s.memory["shaft_twist.rate"]


def speed_gain(p: Parameters, theta: Array, dtheta: Array, s: Moment) -> tuple[Array, Array]:
    """A speed that is read with an error of gain in proportion to itself: theta' (1 + a abs(theta')/20 rad/s).

    Source: a period measured by a timer with a fixed dead time: 1/(period - t0) is f (1 + t0 f) to first order.
    """
    return theta, dtheta * (1 + p["a"] * np.abs(dtheta) / USUAL_RAD_S)


def beat_age_s(p: Parameters, t: Array | float) -> Array:
    """Age of the camera's picture, a saw-tooth d frac(t/P + phi/2 pi): its clock beats against that of the record.

    Source: two free-running clocks; the newest picture ages by their difference until one more fits between.
    """
    return p["d"] * np.mod(t / p["P"] + p["phi"] / (2 * np.pi), 1.0)


def distortion(p: Parameters, psi: Array) -> Array:
    """A lens whose axis is beside the hoop's: c + (x - c)(1 + k abs(x - c)^2), x = (sin psi, cos psi), seen from 0.

    Source: D. C. Brown, Decentering distortion of lenses, Photogrammetric Engineering 32 (1966) 444-462.
    """
    x, y = np.sin(psi), np.cos(psi)
    right, up = x - p["cx"], y - p["cy"]
    out = p["k"] * (right**2 + up**2)
    # the angle between x and where it is seen: of nothing added it is exactly 0
    dx, dy = out * right, out * up
    return psi + np.arctan2(y * dx - x * dy, 1 + x * dx + y * dy)
