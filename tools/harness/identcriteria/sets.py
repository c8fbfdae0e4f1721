"""Data sets of the comparison with other toolboxes: known systems, seeded noise.

A = 1 - 1.5 q^-1 + 0.7 q^-2, B = q^-1 + 0.5 q^-2, C = 1 - q^-1 + 0.2 q^-2; the input is white with deviation one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata

Array = NDArray[np.float64]

A = np.array([1.0, -1.5, 0.7])
B = np.array([0.0, 1.0, 0.5])
C = np.array([1.0, -1.0, 0.2])
NOISE = 0.5  # deviation of e in arx2 and armax2
OE_NOISE = 0.2  # of the clean output's deviation in oe2


def arx2(n: int = 10_000, seed: int = 0) -> tuple[Data, Array]:
    """A y = B u + e, e of 0.5; data and the true [a1, a2, b1, b2]."""
    u, e = _signals(n, seed)
    return iddata(lfilter(B, A, u) + lfilter([1.0], A, NOISE * e), u), np.concatenate([A[1:], B[1:]])


def armax2(n: int = 5_000, seed: int = 0) -> tuple[Data, Array]:
    """A y = B u + C e, e of 0.5; data and the true [a1, a2, b1, b2, c1, c2]."""
    u, e = _signals(n, seed)
    return iddata(lfilter(B, A, u) + lfilter(C, A, NOISE * e), u), np.concatenate([A[1:], B[1:], C[1:]])


def oe2(n: int = 5_000, seed: int = 0) -> tuple[Data, Array]:
    """y = B/A u + e, e white with a fifth of the clean output's deviation; data and the true [b1, b2, f1, f2]."""
    u, e = _signals(n, seed)
    clean = lfilter(B, A, u)
    return iddata(clean + OE_NOISE * clean.std() * e, u), np.concatenate([B[1:], A[1:]])


def _signals(n: int, seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((2, n))
