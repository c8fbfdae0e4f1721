"""Polynomials of linear systems in state space: numerator, denominator, zeros.

Rules of this file: python-control's systems in, coefficients out; written here is what
python-control lacks without slycot.
"""

from __future__ import annotations

from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

# A coefficient this small beside the terms it is a sum of is rounding (64-bit floats carry 2e-16).
ROUNDING = 1e-12


def numerator_and_denominator(system: control.StateSpace) -> tuple[Array, Array]:
    """Coefficients, highest power first, of one input to one output; the denominator is monic, order n in full.

    Source: Faddeev and LeVerrier. adj(sI - A) = sum_k M_k s^(n-k) with M_1 = I, M_k+1 = A M_k + c_k I,
    c_k = -tr(A M_k)/k. Without slycot python-control takes scipy's ss2tf, poly(A - B C) - poly(A), whose differences
    leave rounding as leading coefficients (zeros at 1e13); here cB = 0 stays 0.
    """
    a, b, c, d = system.A, system.B[:, 0], system.C[0], float(system.D[0, 0])
    n = len(a)
    term, size, den, num = np.eye(n), np.eye(n), [1.0], []
    for k in range(1, n + 1):
        num.append(_sum(float(c @ term @ b), float(abs(c) @ size @ abs(b))))
        moved, moved_size = a @ term, abs(a) @ size
        den.append(_sum(-float(np.trace(moved)) / k, float(np.trace(moved_size)) / k))
        term, size = moved + den[-1] * np.eye(n), moved_size + abs(den[-1]) * np.eye(n)
    denominator = np.array(den)
    return np.concatenate([[0.0], num]) + d * denominator, denominator


def _sum(value: float, size: float) -> float:
    """The value, or 0 when it is rounding beside the terms it is a sum of."""
    return value if abs(value) > ROUNDING * size else 0.0


def transfer_function(system: control.StateSpace) -> control.TransferFunction:
    """One input to one output as a python-control object, in full (nothing cancelled), no leading zeros."""
    num, den = numerator_and_denominator(system)
    first = int(np.flatnonzero(num)[0]) if num.any() else len(num) - 1
    return control.tf(num[first:], den, system.dt, inputs=system.input_labels, outputs=system.output_labels)


def zeros(system: control.StateSpace) -> Array:
    """Zeros of one input to one output: roots of the cleaned numerator."""
    num, _ = numerator_and_denominator(system)
    return np.roots(np.trim_zeros(num, "f"))
