"""Losses of standardised errors: rho and rho' of the squared error, as they weigh outliers.

Rules of this file: every rho starts as its argument, so that small errors count as squares.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Loss = Callable[[Array], tuple[Array, Array]]

# Huber's bound in standard deviations: 95 % efficiency on normal errors (Huber, 1981).
HUBER = 1.345
CAUCHY = 2.385  # the same efficiency


def huber(squared: Array) -> tuple[Array, Array]:
    """e^2 inside the bound, 2 k |e| - k^2 beyond."""
    size = np.sqrt(squared)
    outside = size > HUBER
    safe = np.maximum(size, HUBER)
    return np.where(outside, 2.0 * HUBER * size - HUBER**2, squared), np.where(outside, HUBER / safe, 1.0)


def soft_l1(squared: Array) -> tuple[Array, Array]:
    """2 (sqrt(1 + e^2) - 1)."""
    root = np.sqrt(1.0 + squared)
    return 2.0 * (root - 1.0), 1.0 / root


def cauchy(squared: Array) -> tuple[Array, Array]:
    """c^2 log(1 + (e / c)^2)."""
    scaled = squared / CAUCHY**2
    return CAUCHY**2 * np.log1p(scaled), 1.0 / (1.0 + scaled)


NAMED: dict[str, Loss] = {"huber": huber, "soft_l1": soft_l1, "cauchy": cauchy}


def named(loss: str | Loss | None) -> Loss | None:
    """A loss by name or as it is; none for "squared"."""
    if loss is None or loss == "squared":
        return None
    if callable(loss):
        return loss
    if loss not in NAMED:
        raise ValueError(f"loss is squared, {', '.join(NAMED)} or a function, not {loss!r}")
    return NAMED[loss]


def spread(errors: Array, known: NDArray[np.bool_]) -> Array:
    """Standard deviation (ny,) of errors (ny, n), by the median: outliers do not count."""
    return np.array([
        1.4826 * np.median(np.abs(row[seen])) if seen.any() else 1.0 for row, seen in zip(errors, known, strict=True)
    ])  # fmt: skip
