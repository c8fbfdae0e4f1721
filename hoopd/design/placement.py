"""Poles where they are wanted: PI on a plant of first or second order, state feedback on any.

Rules of this file: python-control's systems and numpy's matrices in, gains out; what cannot be placed is a ValueError
that says why.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.pid import Parallel

Array = NDArray[Any]

# Poles of an n-fold root move by eps^(1/n), 6e-6 for three: further off the placing has failed.
PLACED_WITHIN = 1e-3
SAME_POLE = 1e-9


def place_pi(plant: control.TransferFunction, w0: float, zeta: float) -> Parallel:
    """PI that gives the loop the poles of s^2 + 2 zeta w0 s + w0^2, as `placePI` of ControlSystems.jl; w0 in rad/s.

    first order   P = (b1 s + b0)/(s + a0): both gains from
                  s (s + a0) + (b1 s + b0)(kp s + ki) = (1 + b1 kp)(s^2 + 2 zeta w0 s + w0^2)
    second order  P = b0/(s^2 + a1 s + a0): a third pole -p is left, and the sum of the poles stays -a1:
                  p = a1 - 2 zeta w0, which must be above 0: a PI adds no damping
    """
    if plant.isdtime(strict=True):
        raise ValueError("takes a continuous plant")
    num, den = np.trim_zeros(plant.num[0][0], "f"), plant.den[0][0]
    num, den = num / den[0], den / den[0]
    middle, last = 2.0 * zeta * w0, w0**2
    if len(den) == 2 and len(num) <= 2:
        b1, b0 = (0.0, num[0]) if len(num) == 1 else num
        kp, ki = np.linalg.solve([[b0 - middle * b1, b1], [-last * b1, b0]], [middle - den[1], last])
        return Parallel(float(kp), float(ki))
    if len(den) == 3 and len(num) == 1:
        third = den[1] - middle
        if third <= 0.0:
            reason = f"2 zeta w0 = {middle:.4g} must be below {den[1]:.4g}, the plant's own damping"
            raise ValueError(f"a PI adds no damping to a plant of second order: {reason}")
        return Parallel(float((last + middle * third - den[2]) / num[0]), float(last * third / num[0]))
    raise ValueError("a PI places the poles of a plant of first order, or of second order without a zero")


def place(a: Array, b: Array, poles: Sequence[complex]) -> Array:
    """K (1, n) of u = -K x with eig(A - B K) = poles, for one input; a (n, n), b (n, 1).

    python-control has three functions, each with a trap: `place` (Tits and Yang, scipy) refuses a pole asked for
    twice, `place_varga` needs slycot, `place_acker` loses digits with the order and gives a gain of one dimension.
    Poles that differ go to `place`, repeated ones to Ackermann's formula, and the result is checked.
    """
    wanted = np.asarray(poles, complex)
    if wanted.shape != (len(a),):
        raise ValueError(f"{len(a)} poles are to be placed, not {wanted.size}")
    _check_pairs(wanted)
    if np.linalg.matrix_rank(control.ctrb(a, b)) < len(a):
        raise ValueError("the input does not reach every state: not all poles can be moved")
    gaps = np.abs(wanted[:, None] - wanted) + np.eye(len(wanted))
    gain = control.place(a, b, wanted) if gaps.min() > SAME_POLE else control.place_acker(a, b, wanted)
    gain = np.atleast_2d(gain)
    missed = np.abs(np.poly(a - b @ gain) - np.poly(wanted)).max() / np.abs(np.poly(wanted)).max()
    if missed > PLACED_WITHIN:
        raise ValueError(f"the poles cannot be placed to better than {missed:.1g} of their polynomial")
    return gain


def _check_pairs(poles: Array) -> None:
    """ValueError unless the poles are those of a real system."""
    there, mirrored = np.sort_complex(poles), np.sort_complex(poles.conj())
    if not np.allclose(there, mirrored, atol=SAME_POLE):
        raise ValueError("complex poles come in pairs a + bj, a - bj")
