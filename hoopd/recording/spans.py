"""Runs of rows of which something holds.

Rules of this file: numpy only; every room may use it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def spans(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First row and the row after the last of every run of True in mask (n,), in order."""
    held: NDArray[Any] = np.concatenate([[False], mask, [False]])
    edges = np.flatnonzero(np.diff(held.astype(int))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
