"""Damped least squares: the one search of Levenberg and Marquardt that every fit here takes.

    min over x of  |e(x)|^2,   (J'J + d diag(J'J)) step = -J'e

The caller linearises and moves; this file damps, compares and ends. What a fit asks for beside (a prior, bounds, a
robust loss as weights, starts of many experiments, coordinates renewed at every step, a point that is not allowed) is
in the caller's `linearise` and `move`: a cost that is infinite turns a step back. `scipy.optimize.least_squares` has
one dense Jacobian in fixed coordinates: a hundred experiments with starts of their own cost it the cube of their
number, and a model in local coordinates has none that stay. Where neither is needed (`structured`, `rationalfit`), it
is used.

Sources: Marquardt, An algorithm for least-squares estimation of nonlinear parameters, SIAM J. 11 (1963); More, The
Levenberg-Marquardt algorithm, Lecture Notes in Mathematics 630 (1978); starts eliminated: Golub and Pereyra, SIAM J.
Numer. Anal. 10 (1973).

Rules of this file: linear algebra and the order of trials; no model. Costs are sums of squares, not halved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A solution longer than this share of the right side is the inverse of rounding: the least solution instead.
LONGEST = 1e12


class Costed(Protocol):
    """A point of a search: whatever the caller has to know of it, and its sum of squares."""

    @property
    def cost(self) -> float:
        """Sum of squares; infinite where the point is not allowed."""


P = TypeVar("P", bound=Costed)
S = TypeVar("S")
S_co = TypeVar("S_co", covariant=True)


class Linearised(Protocol[S_co]):
    """A least-squares problem at a point, its residuals taken for straight lines."""

    def step(self, damping: float) -> S_co:
        """The damped step to the minimum."""

    def promised(self, damping: float) -> float:
        """By how much that step lowers the squares, to first order."""


class Damping(NamedTuple):
    """How damping, relative to the diagonal of J'J, follows success and failure."""

    first: float = 1e-3
    easier: float = 0.2  # factor after a step that was taken
    harder: float = 5.0  # factor after one that was turned back
    least: float = 0.0  # not below this after a success
    again: float = 0.0  # from this at least after a failure
    most: float = 1e12  # beyond it no step is better
    trials: int = 60  # of one linearisation


class Ends(NamedTuple):
    """When a search has come to its end; shares are of the cost."""

    steps: int = 100
    gain: float = 1e-9  # a step that gains less is the last one
    promise: float = 0.0  # as is one that promises less
    exact: float = 0.0  # a cost this small is rounding
    stuck: float = np.inf  # no step helps: an end where no more than this was promised, else the search is stuck


@dataclass(frozen=True)
class Result(Generic[P]):
    """Where a search ended, after how many linearisations, and whether by its rules."""

    point: P
    steps: int
    converged: bool


def minimise(
    point: P,
    linearise: Callable[[P], Linearised[S]],
    move: Callable[[P, S], P],
    damping: Damping | None = None,
    ends: Ends | None = None,
) -> Result[P]:
    """Least squares from a point by damped steps.

    Parameters
    ----------
    point
        Where the search begins; its cost is finite.
    linearise
        Gives the problem linearised at a point.
    move
        Gives the point a step away; one that is not allowed has an infinite cost.
    damping
        How the damping moves.
    ends
        When the search ends.

    Returns
    -------
    Result
        The best point, the number of linearisations, whether the search ended by its rules.

    Raises
    ------
    ArithmeticError
        The cost of the first point is not finite, so that no step could be called better or worse.

    Examples
    --------
    The decay e^(-2 t) of a line that is nearly straight, from a rate that is too low:

    >>> import numpy as np
    >>> from typing import NamedTuple
    >>> t = np.linspace(0.0, 1.0, 20)
    >>> class Rate(NamedTuple):
    ...     x: np.ndarray
    ...     cost: float
    >>> def at(x):
    ...     return Rate(x, float(np.sum((np.exp(-x[0] * t) - np.exp(-2.0 * t)) ** 2)))
    >>> def linearise(point):
    ...     e, j = np.exp(-point.x[0] * t) - np.exp(-2.0 * t), (-t * np.exp(-point.x[0] * t))[:, None]
    ...     return NormalEquations(j.T @ j, j.T @ e)
    >>> found = minimise(at(np.array([0.1])), linearise, lambda point, step: at(point.x + step))
    >>> found.converged, round(float(found.point.x[0]), 6)
    (True, 2.0)
    """
    rule, end = damping or Damping(), ends or Ends()
    if not np.isfinite(point.cost):
        raise ArithmeticError("the model runs away before the search begins")
    strength = rule.first
    for steps in range(1, end.steps + 1):
        equations, before = linearise(point), point.cost
        better, strength, last = _better(point, equations, move, strength, rule, end)
        if better is None:
            return Result(point, steps, last or equations.promised(0.0) <= end.stuck * point.cost)
        point = better
        if last or before - point.cost <= end.gain * point.cost or point.cost <= end.exact:
            return Result(point, steps, True)
    return Result(point, end.steps, False)


def _better(
    point: P, equations: Linearised[S], move: Callable[[P, S], P], strength: float, rule: Damping, end: Ends
) -> tuple[P | None, float, bool]:
    """The first damped step that does not raise the cost, the damping to go on with, and whether it is the last."""
    for _ in range(rule.trials):
        try:
            step = equations.step(strength)
        except np.linalg.LinAlgError:
            step = None
        if step is not None:
            last = end.promise > 0.0 and equations.promised(strength) <= end.promise * point.cost
            trial = move(point, step)
            if trial.cost <= point.cost:
                return trial, max(strength * rule.easier, rule.least), last
            if last:
                return None, strength, True
        strength = max(strength, rule.again) * rule.harder
        if strength > rule.most:
            break
    return None, strength, False


# ---------------------------------------------------------------------------------------------- equations


class NormalEquations:
    """J'J (m, m) and J'e (m,) in coordinates scaled by the columns' lengths.

    Examples
    --------
    >>> import numpy as np
    >>> NormalEquations(np.diag([4.0, 1e6]), np.array([2.0, 1e3])).step(0.0).tolist()
    [-0.5, -0.001]
    """

    def __init__(self, gram: Array, gradient: Array) -> None:
        diagonal = np.diag(gram)
        # a direction that nothing sees is not made as long as the others
        self.scale = np.sqrt(np.maximum(diagonal, 1e-300))
        self.gram, self.gradient = gram / np.outer(self.scale, self.scale), gradient / self.scale

    def step(self, damping: float) -> Array:
        """(m,)"""
        return np.asarray(-solved(self.gram + damping * np.eye(len(self.gram)), self.gradient) / self.scale)

    def promised(self, damping: float) -> float:
        """Step' J'J step: with the undamped step, what it would gain."""
        step = self.step(damping) * self.scale
        return float(step @ (self.gram @ step))


def solved(m: Array, right: Array) -> Array:
    """m^-1 right (m symmetric, of unit diagonal); the least solution where m is singular."""
    try:
        found = np.linalg.solve(m, right)
    except np.linalg.LinAlgError:
        found = np.full(len(right), np.inf)
    # a step as long as the inverse of the rounding is no step: the least one instead
    if np.abs(found).max(initial=0.0) < LONGEST * max(np.abs(right).max(initial=0.0), 1e-300):
        return np.asarray(found)
    return np.asarray(np.linalg.lstsq(m, right, rcond=1e-12)[0])


class Starts(NamedTuple):
    """Share of b experiments with n unknowns of their own each: what starts need of J'J, and J'e."""

    ss: Array  # (b, n, n)
    sp: Array  # (b, n, m)
    s: Array  # (b, n)


class StartsEliminated:
    """Normal equations of m parameters common to all experiments, and of starts that belong to one of them each.

    The starts are eliminated experiment by experiment (Schur complement) and put back: the effort grows with the number
    of experiments, not with its cube. A step is (m,) and, by group, (b, n).
    """

    def __init__(self, pp: Array, p: Array, groups: Sequence[Starts]) -> None:
        self.pp, self.p, self.groups = pp, p, list(groups)

    def step(self, damping: float) -> tuple[Array, list[Array]]:
        """Parameters' step (m,), starts' steps by group (b, n)."""
        reduced, right, m = self.pp, -self.p, len(self.p)
        kept: list[Array] = []
        for ss, sp, s in self.groups:
            gain: Array = np.linalg.solve(_damped(ss, damping), np.concatenate([sp, -s[..., None]], axis=2))
            reduced = reduced - np.einsum("bim,bin->mn", sp, gain[..., :m])
            right = right - np.einsum("bim,bi->m", sp, gain[..., m])
            kept.append(gain)
        if not (np.isfinite(reduced).all() and np.isfinite(right).all()):
            raise ArithmeticError("the derivatives of the run leave every bound")
        reduced = _damped((reduced + reduced.T)[None] / 2, damping)[0]
        step = np.asarray(np.linalg.lstsq(reduced, right, rcond=None)[0], dtype=float)
        return step, [np.asarray(gain[..., m] - gain[..., :m] @ step) for gain in kept]

    def promised(self, damping: float) -> float:
        """-J'e step: of the undamped step, what it would gain."""
        step, moves = self.step(damping)
        own = sum(float(np.sum(group.s * move)) for group, move in zip(self.groups, moves, strict=True))
        return -(float(self.p @ step) + own)


def _damped(a: Array, damping: float) -> Array:
    """(b, n, n) with its diagonals raised; a direction that nothing sees stays where it is."""
    i = np.arange(a.shape[1])
    diagonal = a[:, i, i]
    floor = np.maximum(diagonal.max(axis=1, initial=0.0) * 1e-14, 1e-300)[:, None]
    out = a.copy()
    out[:, i, i] = diagonal + damping * diagonal + floor
    return out
