"""Damped least squares of state-space models' prediction errors, in local coordinates that are renewed at every step.

Rules of this file: the cost is the sum of squared weighted errors plus the regulariser's; a step to a predictor that
is not stable (or to a model that is not, where that is asked) is refused; same data, same answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.damped_least_squares import Damping, Ends, NormalEquations, minimise as least_squares
from hoopd.ident.models import Innovations
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.sensitivities import Piece, PredictionTrajectory, sensitivities, trajectory

Array = NDArray[np.float64]
Loss = Callable[[Array], tuple[Array, Array]]  # squared errors -> (rho, rho')

# A predictor may be this near to the unit circle; beyond it the recursion does not forget its start within any data.
EDGE = 1.0 - 1e-9
DAMPING = Damping(first=1e-6, easier=0.1, harder=10.0, again=1e-6, trials=12)


@dataclass(frozen=True)
class PemProblem:
    """What is minimised: errors `horizon` ahead times `weight` (ny, ny), through `loss`, plus |`regulariser`|^2."""

    pieces: Sequence[Piece]
    weight: Array
    free: Freedom = field(default_factory=Freedom)
    horizon: int = 1
    start: bool = True  # initial states are estimated
    loss: Loss | None = None
    regulariser: Callable[[Innovations], Array] | None = None
    within: float = np.inf  # no pole of A beyond


@dataclass(frozen=True)
class PemPoint:
    """A model, its initial states by experiment, its paths and its cost; whether the search for it came to an end."""

    model: Innovations
    starts: tuple[Array, ...]
    paths: tuple[PredictionTrajectory, ...]
    cost: float
    ended: bool = True


@dataclass(frozen=True)
class Normal:
    """Gradient and Gram of the errors in the local coordinates `columns`, then the initial states."""

    gradient: Array
    gram: Array
    columns: Array


def evaluate(problem: PemProblem, model: Innovations, starts: Sequence[Array]) -> PemPoint:
    """The point; its cost is infinite where the predictor or the model is not allowed."""
    if radius(model.a - model.k @ model.c) > max(EDGE, _open(problem, model)) or radius(model.a) > problem.within:
        return PemPoint(model, tuple(starts), (), np.inf)
    paths = tuple(trajectory(model, p, x, problem.horizon) for p, x in zip(problem.pieces, starts, strict=True))
    squared = sum(_cost(problem, path.ahead) for path in paths)
    if problem.regulariser is not None:
        squared += float(np.sum(np.square(problem.regulariser(model))))
    return PemPoint(model, tuple(starts), paths, squared if np.isfinite(squared) else np.inf)


def with_best_starts(problem: PemProblem, model: Innovations) -> PemPoint:
    """The point with the initial states of least squared errors; the errors are linear in them."""
    zero = tuple(np.zeros(model.nx) for _ in problem.pieces)
    point = evaluate(problem, model, zero)
    if not (problem.start and np.isfinite(point.cost) and model.nx):
        return point
    along = coordinates.starts(model)
    starts: list[Array] = []
    for data, path in zip(problem.pieces, point.paths, strict=True):
        change = np.tensordot(problem.weight, sensitivities(model, data, path, along, problem.horizon), 1)
        j = change.transpose(0, 2, 1).reshape(-1, model.nx)
        found = np.linalg.lstsq(j, (problem.weight @ path.ahead).ravel(), rcond=1e-10)[0]
        starts.append(np.asarray(-found, dtype=float))
    return evaluate(problem, model, starts)


def minimise(problem: PemProblem, point: PemPoint, steps: int, tolerance: float = 1e-9) -> PemPoint:
    """At most so many steps; ends when one lowers the cost by less than the tolerance (relative)."""

    def linearised(point: PemPoint) -> _Equations:
        return _Equations(normal_equations(problem, point))

    def away(point: PemPoint, step: tuple[Normal, Array]) -> PemPoint:
        return moved(problem, point, *step)

    found = least_squares(point, linearised, away, DAMPING, Ends(steps, gain=tolerance))
    return replace(found.point, ended=found.converged)


class _Equations:
    """A step goes with the coordinates that it is made of."""

    def __init__(self, normal: Normal) -> None:
        self.normal, self.equations = normal, NormalEquations(normal.gram, normal.gradient)

    def step(self, damping: float) -> tuple[Normal, Array]:
        return self.normal, self.equations.step(damping)

    def promised(self, damping: float) -> float:
        return self.equations.promised(damping)


def normal_equations(problem: PemProblem, point: PemPoint) -> Normal:
    """Of the errors at a point."""
    columns = coordinates.basis(point.model, problem.free)
    along = coordinates.directions(point.model, columns)
    m, nx = columns.shape[1], point.model.nx if problem.start else 0
    total = m + nx * len(problem.pieces)
    gradient, gram = np.zeros(total), np.zeros((total, total))
    both = coordinates.joined(along, coordinates.starts(point.model)) if problem.start else along
    for i, (data, path) in enumerate(zip(problem.pieces, point.paths, strict=True)):
        e, j = _weighted(problem, path.ahead, sensitivities(point.model, data, path, both, problem.horizon))
        own = np.concatenate([np.arange(m), m + i * nx + np.arange(nx)])
        gradient[own] += j @ e
        gram[np.ix_(own, own)] += j @ j.T
    if problem.regulariser is not None:
        _add_regulariser(problem, point, columns, gradient, gram)
    return Normal(gradient, gram, columns)


def moved(problem: PemProblem, point: PemPoint, normal: Normal, step: Array) -> PemPoint:
    """The point a step away."""
    m, nx = normal.columns.shape[1], point.model.nx
    full = coordinates.values(point.model) + normal.columns @ step[:m]
    starts = point.starts
    if problem.start:
        starts = tuple(x + step[m + i * nx : m + (i + 1) * nx] for i, x in enumerate(starts))
    return evaluate(problem, coordinates.with_values(point.model, full), starts)


def _open(problem: PemProblem, model: Innovations) -> float:
    """A model without a gain is simulated: its own poles may stand where the caller allows them."""
    return 0.0 if problem.free.gain or model.k.any() else np.inf


def _cost(problem: PemProblem, errors: Array) -> float:
    weighted = problem.weight @ errors
    if problem.loss is None:
        return float(np.vdot(weighted, weighted))
    return float(problem.loss(np.square(weighted))[0].sum())


def _weighted(problem: PemProblem, errors: Array, change: Array) -> tuple[Array, Array]:
    """Weighted errors (ny n,) and derivatives (m, ny n); a loss by its weights rho' (Triggs et al., 2000, 4.3)."""
    e = problem.weight @ errors
    j = np.tensordot(problem.weight, change, 1)
    if problem.loss is not None:
        w = np.sqrt(np.maximum(problem.loss(np.square(e))[1], 0.0))
        e, j = w * e, w[:, None, :] * j
    return e.ravel(), j.transpose(1, 0, 2).reshape(j.shape[1], -1)


def _add_regulariser(problem: PemProblem, point: PemPoint, columns: Array, gradient: Array, gram: Array) -> None:
    """Adds the regulariser's share, its derivative by central differences along the coordinates."""
    assert problem.regulariser is not None
    full, m, h = coordinates.values(point.model), columns.shape[1], 1e-6
    at = np.atleast_1d(problem.regulariser(point.model))
    j = np.empty((len(at), m))
    for i in range(m):
        sides = [
            np.atleast_1d(problem.regulariser(coordinates.with_values(point.model, full + s * h * columns[:, i])))
            for s in (1.0, -1.0)
        ]
        j[:, i] = (sides[0] - sides[1]) / (2.0 * h)
    gradient[:m] += j.T @ at
    gram[:m, :m] += j.T @ j


def settled(point: PemPoint, start: int = 0) -> Innovations:
    """The model with the initial state of one experiment."""
    return replace(point.model, x0=point.starts[start])
