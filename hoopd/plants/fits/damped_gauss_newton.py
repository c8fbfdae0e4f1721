"""Damped Gauss-Newton for one set of parameters and many runs with starts of their own.

    min over p, s_1 ... s_R of  sum_r rho(e_r(p, s_r)) + |W (p - p0)|^2

Each run's start appears in its own residuals only, so the normal equations are solved run by run (Schur complement):
the effort grows with the number of runs, not with its cube. Damping: Marquardt (1963), the diagonal scaled.
Losses as weights: Huber (1964); soft_l1 and cauchy as in scipy.optimize.least_squares, of which this is the special
case that a dense solver is too slow for (100 runs: 400 starts).

Rules of this file: linear algebra on numbers in units of sigma; no model here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Where a robust loss begins to count less: 1.345 sigma keeps 95 % of the efficiency under normal errors (Huber).
ROBUST_SIGMA = 1.345
MOST_STEPS = 100
MOST_DAMPING = 1e12
# A step that gains less than this share of the cost is the last one.
SMALLEST_GAIN = 1e-9
# Where no step helps although the linearisation promises more than this share, the search is stuck, not at its end.
REMAINING_GAIN = 1e-5


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
    s = [start.copy() for start in starts]

    def cost_of(p: Array, s: list[Array]) -> float:
        total = sum(float(loss_value(e, loss).sum()) for e in residuals(p, s))
        return total / 2 + float(np.sum((weight * (p - centre)) ** 2)) / 2

    cost, damping = cost_of(p, s), 1e-3
    if not np.isfinite(cost):  # else no step would ever be better, and the search would end as converged
        raise ArithmeticError("the model runs away before the search begins")
    for step in range(1, MOST_STEPS + 1):
        equations = _Equations(blocks(p, s), weight**2, weight**2 * (p - centre), loss)
        while True:
            dp, ds = equations.solve(damping)
            new_p, new_s = p + dp, [a + b for a, b in zip(s, ds, strict=True)]
            new = cost_of(new_p, new_s)
            if new <= cost:
                break
            damping *= 5.0
            if damping > MOST_DAMPING:  # no step is better: the end, if none was to be expected
                return Found(p, s, cost, step, equations.expected_gain() <= REMAINING_GAIN * cost)
        gain, p, s, cost, damping = cost - new, new_p, new_s, new, max(damping / 5.0, 1e-12)
        if gain <= smallest_gain * cost:
            return Found(p, s, cost, step, True)
    return Found(p, s, cost, MOST_STEPS, False)


class _Equations:
    """Normal equations of one linearisation."""

    def __init__(self, blocks: list[Block], prior: Array, prior_slope: Array, loss: str) -> None:
        self.pp, self.p_slope = np.diag(prior), -prior_slope
        self.runs = []
        for e, by_p, by_s in blocks:
            w = loss_weight(e, loss)[:, None]
            wp, ws = w * by_p, w * by_s
            self.pp = self.pp + by_p.T @ wp
            self.p_slope = self.p_slope - wp.T @ e
            self.runs.append((by_s.T @ ws, by_s.T @ wp, -(ws.T @ e)))

    def solve(self, damping: float) -> tuple[Array, list[Array]]:
        """The step: starts eliminated run by run, then put back."""
        reduced, slope = _damped(self.pp, damping), self.p_slope.copy()
        kept = []
        for ss, sp, s_slope in self.runs:
            solved = np.asarray(np.linalg.solve(_damped(ss, damping), np.column_stack([sp, s_slope])), dtype=float)
            reduced = reduced - sp.T @ solved[:, :-1]
            slope = slope - sp.T @ solved[:, -1]
            kept.append(solved)
        if not (np.isfinite(reduced).all() and np.isfinite(slope).all()):
            raise ArithmeticError("the derivatives of the run leave every bound")
        dp = np.asarray(np.linalg.lstsq(reduced, slope, rcond=None)[0], dtype=float)
        return dp, [solved[:, -1] - solved[:, :-1] @ dp for solved in kept]

    def expected_gain(self) -> float:
        """What the undamped step would gain if the residuals were straight lines: g' H^-1 g / 2."""
        dp, ds = self.solve(0.0)
        own = sum(float(slope @ step) for (_, _, slope), step in zip(self.runs, ds, strict=True))
        return 0.5 * (float(self.p_slope @ dp) + own)


def _damped(a: Array, damping: float) -> Array:
    diagonal = np.diag(a)
    floor = max(float(diagonal.max(initial=0.0)) * 1e-14, 1e-300)  # a direction that nothing sees stays where it is
    return np.asarray(a + np.diag(damping * diagonal + floor))
