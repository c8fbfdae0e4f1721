"""Sums of floats that are the same bits in every version of Python.

Rules of this file: one number after the other, rounded each time. The built-in `sum` does so up to Python 3.11 and
carries the rounding error along from 3.12 on, so that a recording of one would not replay in the other.
"""

from __future__ import annotations

from collections.abc import Iterable


def dot(a: Iterable[float], b: Iterable[float]) -> float:
    """Sum of products, from the first on; both are of one length."""
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total
