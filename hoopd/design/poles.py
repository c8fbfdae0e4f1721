"""Poles of a sampled loop, as a person reads them.

Rules of this file: python-control's systems in, plain numbers out.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import control
import numpy as np

from hoopd.design import margins


class Pole(NamedTuple):
    """A pole of the closed loop."""

    z: complex
    natural_rad_s: float  # |ln z|/h
    damping: float


def closed_loop_poles(loop: control.StateSpace) -> list[Pole]:
    """Poles of the loop closed, the least damped radius first."""
    found = sorted(margins.closed_loop_poles(loop), key=lambda z: (-round(abs(z), 12), z.real, z.imag))
    return [_pole(complex(z), loop.dt) for z in found]


def unstable(poles: list[Pole]) -> Pole | None:
    """The pole that is furthest outside the unit circle; None when all are inside."""
    return poles[0] if poles and abs(poles[0].z) >= 1.0 - 1e-9 else None


def _pole(z: complex, h: float) -> Pole:
    if abs(z) < 1e-6:  # a torque or a picture on its way
        return Pole(z, inf, 1.0)
    s = np.log(z) / h
    return Pole(z, float(abs(s)), float(-s.real / abs(s)) if abs(s) > 0.0 else 0.0)
