"""A linear recursion over many nodes and many columns in one call of LAPACK.

d_k+1 = A_k d_k + b_k with d_0 = b_0' is L d = b, where L has ones on its diagonal and -A_k below it: a triangular
matrix of 2 size - 1 bands. The adjoint recursion r_k = s_k + A_k' r_k+1 is L' r = s.

Rules of this file: numbers in, numbers out; the same sums as one step after the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

Array = NDArray[np.float64]


def bands_of(steps: Array) -> Array:
    """(2 size, n size) bands of L for the matrices A (n-1, size, size)."""
    count, size = len(steps) + 1, steps.shape[1]
    bands = np.zeros((2 * size, count * size), order="F")
    for row in range(size):
        for column in range(size):
            bands[size + row - column, column : (count - 1) * size : size] = -steps[:, row, column]
    return bands


def forward(bands: Array, right: Array) -> Array:
    """d (n, size, m) of the right side (n, size, m), whose first node is where the recursion starts."""
    return _solved(bands, right, "N")


def backward(bands: Array, source: Array) -> Array:
    """r (n, size, m) of the sources (n, size, m)."""
    return _solved(bands, source, "T")


def _solved(bands: Array, right: Array, way: str) -> Array:
    count, size, columns = right.shape
    if columns == 0:
        return right
    b = np.asfortranarray(right.reshape(count * size, columns))
    found, trouble = dtbtrs(bands, b, uplo="L", trans=way, diag="U", overwrite_b=columns > 1)
    if trouble:
        raise ValueError(f"triangular solve: argument {-trouble} is none")
    return np.ascontiguousarray(found).reshape(right.shape)
