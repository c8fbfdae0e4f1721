"""The search for the likeliest model where outputs are missing, or where many short experiments start anywhere.

The sum of squares is that of the exact likelihood (`hoopd.ident.gaplikelihood`), its derivatives are differences. The
covariance is the inverse of the observed information, N/2 times the second derivatives of the logarithm of that sum.

Rules of this file: coefficients are numbers of about one; what forgets nothing is refused by an infinite cost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.damped_least_squares import Damping, Ends, NormalEquations, minimise
from hoopd.ident.gaplikelihood import LikelihoodErrors, MeasuredStretch, likelihood_errors
from hoopd.ident.models import Innovations

Array = NDArray[np.float64]

# Of the differences, relative to a coefficient of about one.
STEP = 1e-6
# Of the second differences, in standard errors.
WIDE = 0.1
ITERATIONS = 60
# The search ends when the next step would be so many standard errors long (squared).
SETTLED = 1e-7
DAMPING = Damping(first=0.0, easier=0.1, harder=10.0, again=1e-4, most=1e9)


@dataclass(frozen=True)
class GapOptimum:
    """Coefficients, scale of R, samples that count, covariance, errors of all stretches, how the search ended.

    `errors` (rows,) and `jacobian` (m, rows): with what is missing eliminated.
    """

    x: Array
    variance: float
    count: int
    covariance: Array
    errors: Array
    jacobian: Array
    steps: int
    settled: bool


@dataclass(frozen=True)
class GapProblem:
    """A model of coefficients x (its R but for the scale), what was measured, states that start freely."""

    made: Callable[[Array], Innovations]
    data: Sequence[MeasuredStretch]
    free_start: bool
    states: int

    @property
    def count(self) -> int:
        """Outputs that were measured."""
        return sum(one.count for one in self.data)

    @property
    def free(self) -> int:
        """Outputs measured less the starts that are eliminated."""
        return self.count - len(self.data) * self.states * self.free_start

    def at(self, x: Array) -> LikelihoodErrors:
        """Errors for coefficients x."""
        return likelihood_errors(self.made(x), self.data, free_start=self.free_start)

    def cost(self, x: Array) -> float:
        """The scaled sum of squares; infinite where the predictor forgets nothing."""
        try:
            with np.errstate(all="ignore"):
                errors = self.at(x).scaled(self.free)[0]
                cost = float(errors @ errors)
        except (np.linalg.LinAlgError, ValueError):
            return np.inf
        return cost if np.isfinite(cost) else np.inf


@dataclass(frozen=True)
class _Point:
    x: Array
    cost: float


def likeliest(
    problem: GapProblem, candidates: Sequence[Array], allowed: Callable[[Array], Array] = lambda x: x
) -> GapOptimum:  # fmt: skip
    """The likeliest coefficients from the likeliest of the candidates; `allowed` brings coefficients inside a range."""

    def linearised(point: _Point) -> NormalEquations:
        errors, slopes = _slopes(problem, point.x)
        return NormalEquations(slopes @ slopes.T, slopes @ errors)

    def moved(point: _Point, step: Array) -> _Point:
        x = allowed(point.x + step)
        return _Point(x, problem.cost(x))

    points = [_Point(x, problem.cost(x)) for x in map(allowed, candidates)]
    ends = Ends(ITERATIONS, gain=0.0, promise=SETTLED / problem.free, stuck=SETTLED / problem.free)
    best = minimise(min(points, key=lambda one: one.cost), linearised, moved, DAMPING, ends)
    return _reported(problem, best.point.x, best.steps, best.converged)


def _slopes(problem: GapProblem, x: Array) -> tuple[Array, Array]:
    """Scaled errors (rows,) and their derivatives (size, rows)."""
    errors = problem.at(x).scaled(problem.free)[0]
    slopes = np.empty((len(x), len(errors)))
    for i, h in enumerate(STEP * np.maximum(np.abs(x), 1.0)):
        aside = x.copy()
        aside[i] += h
        slopes[i] = (problem.at(aside).scaled(problem.free)[0] - errors) / h
    return errors, slopes


def _reported(problem: GapProblem, x: Array, steps: int, settled: bool) -> GapOptimum:
    found = problem.at(x)
    errors, slopes = _slopes(problem, x)
    factor = found.scaled(problem.free)[1]
    spare = max(problem.free - len(x), 1)
    variance = float(errors @ errors) / factor**2 / spare
    first = _inverse(slopes @ slopes.T * spare / float(errors @ errors))
    return GapOptimum(
        x, variance, problem.count, _observed(problem, x, first), errors / factor, slopes / factor, steps, settled
    )  # fmt: skip


def _observed(problem: GapProblem, x: Array, first: Array) -> Array:
    """Inverse of the second derivatives of N/2 log(cost) along the axes of a first guess of it; that where it fails."""
    spare = max(problem.free - len(x), 1)
    values, axes = np.linalg.eigh(first)
    if not (values > 0.0).all():
        return first
    along = axes * np.sqrt(values)

    def at(*steps: Array) -> float:
        return 0.5 * spare * float(np.log(problem.cost(x + WIDE * np.sum(steps, axis=0))))

    m, middle = len(x), at(np.zeros(len(x)))
    hessian = np.empty((m, m))
    sides = [(at(along[:, i]), at(-along[:, i])) for i in range(m)]
    for i in range(m):
        hessian[i, i] = (sides[i][0] - 2.0 * middle + sides[i][1]) / WIDE**2
        for j in range(i):
            up, down = at(along[:, i], along[:, j]), at(-along[:, i], -along[:, j])
            across = 0.5 * (up + down - sum(sides[i]) - sum(sides[j]) + 2.0 * middle) / WIDE**2
            hessian[i, j] = hessian[j, i] = across
    if not np.isfinite(hessian).all() or np.linalg.eigvalsh(hessian).min() < 0.05:
        return first
    return np.asarray(along @ np.linalg.inv(hessian) @ along.T)


def _inverse(m: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(m), 1e-300))
    return np.asarray(np.linalg.pinv(m / np.outer(scale, scale), rcond=1e-14, hermitian=True) / np.outer(scale, scale))
