"""A filter's state and covariance, corrected by what was measured.

For four states the products are written out in plain numbers: with matrices this small an array library takes
nine times as long in calls as in arithmetic. The covariance is symmetric: its upper triangle is all there is to know.

Rules of this file: pure; arguments stay as they are; either way has the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from hoopd.core.records import Vector

# One state as a sensor has it: its number, the value, the variance.
Measured: TypeAlias = tuple[int, float, float]

# Of a symmetric matrix of four rows as ten numbers, row by row from the diagonal on: where each of its columns stands.
_COLUMNS = ((0, 1, 2, 3), (1, 4, 5, 6), (2, 5, 7, 8), (3, 6, 8, 9))


def corrected(x: Vector, p: Vector, measured: Sequence[Measured]) -> tuple[Vector, Vector]:
    """State and covariance with measurements taken in, one after the other.

    h = P[:, state],  s = h[state] + r:  x += h e / s,  P -= h h' / s
    """
    if len(x) != len(_COLUMNS):
        for one in measured:
            x, p = _corrected_any(x, p, one)
        return x, p
    x0, x1, x2, x3 = x.tolist()
    (p00, p01, p02, p03), (_, p11, p12, p13), (_, _, p22, p23), (_, _, _, p33) = p.tolist()
    for state, value, variance in measured:
        triangle = (p00, p01, p02, p03, p11, p12, p13, p22, p23, p33)
        i0, i1, i2, i3 = _COLUMNS[state]
        h0, h1, h2, h3 = triangle[i0], triangle[i1], triangle[i2], triangle[i3]
        s = (h0, h1, h2, h3)[state] + variance
        gain = (value - (x0, x1, x2, x3)[state]) / s
        x0, x1, x2, x3 = x0 + h0 * gain, x1 + h1 * gain, x2 + h2 * gain, x3 + h3 * gain
        p00, p01, p02, p03 = p00 - h0 * h0 / s, p01 - h0 * h1 / s, p02 - h0 * h2 / s, p03 - h0 * h3 / s
        p11, p12, p13 = p11 - h1 * h1 / s, p12 - h1 * h2 / s, p13 - h1 * h3 / s
        p22, p23, p33 = p22 - h2 * h2 / s, p23 - h2 * h3 / s, p33 - h3 * h3 / s
    rows = ((p00, p01, p02, p03), (p01, p11, p12, p13), (p02, p12, p22, p23), (p03, p13, p23, p33))
    return np.array((x0, x1, x2, x3)), np.array(rows)


def _corrected_any(x: Vector, p: Vector, one: Measured) -> tuple[Vector, Vector]:
    state, value, variance = one
    column = p[:, state]
    s = float(column[state]) + variance
    return x + column * ((value - float(x[state])) / s), p - column[:, None] * column / s
