"""Hundreds of whitened columns as screens keep them: in single precision, each in one piece of memory.

What free parameters do is out of them before, so that no difference of two that are nearly equal is left to be taken;
what is computed with them is computed in double precision, some columns at a time.

Rules of this file: numbers in, numbers out; no model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# (rows, m), kept or as they are worked with.
KeptColumns = NDArray[np.float32] | Array

# Rows of many columns that stay near the processor.
ROWS_AT_ONCE = 256


def free_of(basis: Array, x: Array) -> Array:
    """x (rows, m) itself, the directions of an orthonormal basis (rows, k) taken out; large ones are not copied."""
    along = basis.T @ x
    for first in range(0, len(x), ROWS_AT_ONCE):
        some = slice(first, first + ROWS_AT_ONCE)
        x[some] -= basis[some] @ along
    return x


def kept_columns(x: Array) -> KeptColumns:
    """Columns (rows, m) as they are kept."""
    return np.asarray(x, dtype=np.float32, order="F")


def joined(parts: Sequence[KeptColumns], rows: int) -> KeptColumns:
    """(rows, m) the columns of all parts."""
    return np.asarray(np.concatenate(parts, axis=1)) if parts else kept_columns(np.zeros((rows, 0)))


def exact(columns: KeptColumns) -> Array:
    """In double precision."""
    return np.asarray(columns, dtype=float)
