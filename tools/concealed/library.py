"""Candidates of the rival methods: forces and sensor changes as columns, linear in their sizes.

Rules of this file: numpy only; a force is (on theta, on psi) in units of its own size, arrays of the states' shape.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from concealed.plant import Array


class Sample(NamedTuple):
    """States and torque, arrays of one shape; `du` is the torque's change from sample to sample."""

    theta: Array
    dtheta: Array
    psi: Array
    dpsi: Array
    u: Array
    du: Array


def _sign(x: Array) -> Array:
    """A sign that is soft within what speed noise hides."""
    return np.tanh(x / 0.1)


# On the hoop: one column each, or two for a phase.
HOOP: Mapping[str, Callable[[Sample], tuple[Array, ...]]] = {
    "actuator.torque_bias": lambda s: (np.ones_like(s.u),),
    "actuator.deadzone": lambda s: (np.sign(s.u),),
    "actuator.saturation": lambda s: (s.u * np.abs(s.u),),
    "actuator.delay": lambda s: (s.du,),
    "actuator.cogging": lambda s: tuple(f(n * s.theta) for n in (2, 3, 4, 6, 8, 12) for f in (np.sin, np.cos)),
    "actuator.ripple": lambda s: tuple(s.u * f(n * s.theta) for n in (1, 2, 4, 6) for f in (np.sin, np.cos)),
    "hoop.coulomb_friction": lambda s: (_sign(s.dtheta),),
    "hoop.quadratic_drag": lambda s: (s.dtheta * np.abs(s.dtheta),),
    "hoop.imbalance": lambda s: (np.sin(s.theta), np.cos(s.theta)),
}
BALL: Mapping[str, Callable[[Sample], tuple[Array, ...]]] = {
    "ball.quadratic_drag": lambda s: (s.dpsi * np.abs(s.dpsi),),
    "ball.coulomb_friction": lambda s: (_sign(s.dtheta - s.dpsi),),
    "frame.tilt": lambda s: (np.cos(s.psi),),
}
FORCES = (*HOOP, *BALL)
# By channel theta, theta', psi: (column, axis).
SENSORS: Mapping[str, Callable[[Sample, Array], tuple[tuple[Array, int], ...]]] = {
    "camera.latency": lambda s, a: ((s.dpsi, 2),),
    "camera.center_offset": lambda s, a: ((np.sin(s.psi), 2),),
    "encoder.speed_lag": lambda s, a: ((a, 1),),
    "encoder.eccentricity": lambda s, a: ((np.sin(s.theta), 0), (np.cos(s.theta), 0)),
}


def forces_of(name: str, s: Sample) -> list[tuple[Array, Array]]:
    """Columns of a force candidate as (on theta, on psi)."""
    zero = np.zeros_like(s.u)
    if name in HOOP:
        return [(column, zero) for column in HOOP[name](s)]
    return [(zero, column) for column in BALL[name](s)]
