"""Scheduling signals of models whose coefficients follow them.

Rules of this file: rows are samples; a schedule is known everywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def schedule_of(p: ArrayLike, n: int) -> Array:
    """Rows (n, np) of finite numbers; ValueError for others."""
    found = np.asarray(p, dtype=float)
    found = found[:, None] if found.ndim == 1 else found
    if found.ndim != 2 or len(found) != n or not np.isfinite(found).all():
        raise ValueError(f"the schedule has the shape {found.shape}: {n} rows of finite numbers are wanted")
    return found


def with_one(schedule: Array) -> Array:
    """A one before the signals of each row: what the constant part is multiplied by."""
    return np.hstack([np.ones((len(schedule), 1)), schedule])
