"""Readings that repeat: of a sensor at rest, and of one that has nothing new.

Rules of this file: numbers only; a reading is judged by its neighbours, never by a model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# A camera that has lost its target repeats its last value to the bit; so many equal ones are no measurement.
STUCK = 5
# What stayed within so many encoder counts was held.
HELD_COUNTS = 2.5


def once_at_rest(values: Array) -> NDArray[np.bool_]:
    """Of equal encoder readings in a row (STUCK or more) only the one in the middle.

    The error of a moving encoder, evenly spread over a count, is new in every sample; at rest it is one and the same,
    and fifty of it would pull fifty times. In the middle, because that of a wheel that creeps is the count's mean
    there.
    """
    edges, lengths = equal_stretches(values)
    good = np.repeat(lengths < STUCK, lengths)
    good[edges[:-1] + lengths // 2] |= lengths >= STUCK
    return good


def not_stuck(values: Array) -> NDArray[np.bool_]:
    """False where a value repeats and repeats (STUCK or more equal ones): the first of them counts."""
    edges, lengths = equal_stretches(values)
    good = np.repeat(lengths < STUCK, lengths)
    good[edges[:-1]] = True
    return good


def equal_stretches(values: Array) -> tuple[Index, Index]:
    """Edges (k+1,) and lengths (k,) of stretches of equal values."""
    if len(values) == 0:
        return np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64)
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0, [True]]))
    return edges, np.diff(edges)
