"""Least squares for one set of parameters and many runs with starts of their own, under a loss that bears outliers.

    min over p, s_1 ... s_R of  sum_r rho(e_r(p, s_r)) + |W (p - p0)|^2

The search is `hoopd.ident.damped_least_squares`. Losses as weights: Huber (1964); soft_l1 and cauchy as in
scipy.optimize.least_squares.

Rules of this file: numbers in units of sigma; no model here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.damped_least_squares import Damping, Ends, Starts, StartsEliminated, minimise as least_squares

Array = NDArray[np.float64]

# Where a robust loss begins to count less: 1.345 sigma keeps 95 % of the efficiency under normal errors (Huber).
ROBUST_SIGMA = 1.345
# A step that gains less than this share of the cost is the last one.
SMALLEST_GAIN = 1e-9
# Where no step helps although the linearisation promises more than this share, the search is stuck, not at its end.
REMAINING_GAIN = 1e-5
DAMPING = Damping(least=1e-12)


class Block(NamedTuple):
    """Residuals of one run and their derivatives, in units of sigma."""

    e: Array  # (k,)
    by_p: Array  # (k, m)
    by_s: Array  # (k, n)


class Found(NamedTuple):
    """Where the search ended."""

    p: Array
    starts: list[Array]
    cost: float  # half the sum
    steps: int
    converged: bool


Residuals = Callable[[Array, list[Array]], list[Array]]
Blocks = Callable[[Array, list[Array]], list[Block]]


def loss_value(e: Array, loss: str) -> Array:
    """rho(e), e^2 near zero."""
    z = (e / ROBUST_SIGMA) ** 2
    if loss == "linear":
        return np.asarray(e**2)
    if loss == "huber":
        rho = np.where(z <= 1.0, z, 2.0 * np.sqrt(z) - 1.0)
    elif loss == "soft_l1":
        rho = 2.0 * (np.sqrt(1.0 + z) - 1.0)
    elif loss == "cauchy":
        rho = np.log1p(z)
    else:
        raise ValueError(f"unknown loss {loss!r}; known: {', '.join(LOSSES)}")
    return np.asarray(rho * ROBUST_SIGMA**2)


LOSSES = ("linear", "huber", "soft_l1", "cauchy")


def loss_weight(e: Array, loss: str) -> Array:
    """d rho / d (e^2): how much a residual counts."""
    z = (e / ROBUST_SIGMA) ** 2
    if loss == "linear":
        return np.ones_like(e)
    if loss == "huber":
        return np.asarray(1.0 / np.sqrt(np.maximum(z, 1.0)))
    return np.asarray(1.0 / np.sqrt(1.0 + z) if loss == "soft_l1" else 1.0 / (1.0 + z))


@dataclass(frozen=True)
class _Point:
    """Parameters, starts and twice the cost."""

    p: Array
    s: list[Array]
    cost: float


def minimise(
    p: Array,
    starts: Sequence[Array],
    residuals: Residuals,
    blocks: Blocks,
    prior: tuple[Array, Array] | None = None,
    loss: str = "linear",
    smallest_gain: float = SMALLEST_GAIN,
) -> Found:
    """Parameters (m,) and starts of least cost; prior: centre (m,) and weights (m,) = 1 / sigma, 0 for none.

    The search ends with the step that gains less than `smallest_gain` of the cost.
    """
    centre, weight = prior if prior is not None else (np.zeros_like(p), np.zeros_like(p))

    def at(p: Array, s: list[Array]) -> _Point:
        squares = sum(float(loss_value(e, loss).sum()) for e in residuals(p, s))
        return _Point(p, s, squares + float(np.sum((weight * (p - centre)) ** 2)))

    def moved(point: _Point, step: tuple[Array, list[Array]]) -> _Point:
        return at(point.p + step[0], [a + b[0] for a, b in zip(point.s, step[1], strict=True)])

    def linearised(point: _Point) -> StartsEliminated:
        return _equations(blocks(point.p, point.s), weight**2, weight**2 * (point.p - centre), loss)

    ends = Ends(gain=smallest_gain, stuck=REMAINING_GAIN)
    found = least_squares(at(p, [start.copy() for start in starts]), linearised, moved, DAMPING, ends)
    return Found(found.point.p, found.point.s, found.point.cost / 2, found.steps, found.converged)


def _equations(blocks: list[Block], prior: Array, prior_slope: Array, loss: str) -> StartsEliminated:
    """Normal equations of one linearisation, a robust loss as weights."""
    pp, slope, groups = np.diag(prior), prior_slope, []
    for e, by_p, by_s in blocks:
        w = loss_weight(e, loss)[:, None]
        wp, ws = w * by_p, w * by_s
        pp, slope = pp + by_p.T @ wp, slope + wp.T @ e
        groups.append(Starts((by_s.T @ ws)[None], (by_s.T @ wp)[None], (ws.T @ e)[None]))
    return StartsEliminated(pp, slope, groups)
