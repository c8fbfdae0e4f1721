"""One subspace estimate from the windows of the data: A, C, gain, B, D, x0, and Gauss-Newton steps from there.

Steps: LQ factor of all windows -> weighted singular values -> observability -> A, C by shift invariance -> states from
the past, noise covariances, Kalman gain by the Riccati equation -> B, D and x0 by least squares.

Rules of this file: channels are scaled already; what overflows is a ValueError; nothing is chosen here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data
from hoopd.ident.models import Innovations
from hoopd.ident.statespace import gaussnewton, projection
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.inputs import InputMatrices, fit_inputs
from hoopd.ident.statespace.kalman import gain
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.ordering import joined
from hoopd.ident.statespace.projection import Decomposition, TriangularFactor, Weighting, WindowSplit
from hoopd.ident.statespace.sensitivities import Piece, piece
from hoopd.ident.statespace.stabilise import bounded

Array = NDArray[np.float64]
Focus = Literal["prediction", "simulation"]

LARGEST = 150.0  # natural logarithm of what a response may grow to: products of two and more are numbers still


@dataclass(frozen=True)
class Goal:
    """What an estimate is for: the focus, the largest modulus of a pole (False: any), steps of refinement."""

    focus: Focus = "prediction"
    stable: bool | float = False

    @property
    def limit(self) -> float:
        """The largest modulus of a pole."""
        return np.inf if self.stable is False else 1.0 - 1e-9 if self.stable is True else float(self.stable)


@dataclass(frozen=True)
class WindowedData:
    """Stretches without gaps, their triangular factor, and its decompositions, made when they are asked for."""

    parts: Sequence[Data]
    factor: TriangularFactor
    decompositions: dict[str, Decomposition] = field(default_factory=dict)

    @classmethod
    def of(cls, parts: Sequence[Data], split: WindowSplit) -> WindowedData:
        """Of stretches cut into windows."""
        return cls(parts, projection.factor([joined(part) for part in parts], split))

    def decomposed(self, weighting: Weighting) -> Decomposition:
        """The weighted singular value decomposition."""
        if weighting not in self.decompositions:
            self.decompositions[weighting] = projection.decompose(self.factor, weighting)
        return self.decompositions[weighting]

    @property
    def most_order(self) -> int:
        """The largest order that shift invariance can tell."""
        split = self.factor.split
        return (split.future - 1) * split.ny


@dataclass(frozen=True)
class SubspaceEstimate:
    """A model with the stretches that it was fitted to and the initial state of each."""

    model: Innovations
    pieces: Sequence[Piece]
    starts: tuple[Array, ...]


def estimate(windowed: WindowedData, nx: int, weighting: Weighting, direct: bool, goal: Goal) -> SubspaceEstimate:
    """The estimate of one order."""
    split, decomposed = windowed.factor.split, windowed.decomposed(weighting)
    if nx > len(decomposed.s):
        raise ValueError(f"order {nx} is more than the horizon can tell: {len(decomposed.s)}")
    gamma = decomposed.observability(nx)
    c = gamma[: split.ny]
    shifted = np.linalg.lstsq(gamma[: -split.ny], gamma[split.ny :], rcond=None)[0]
    a = _bounded(np.asarray(shifted, dtype=float), goal.limit)
    q, r, s = _noise(windowed.factor, gamma, a, c, direct)
    k, innovation = gain(a, c, q, r, s)
    if goal.focus == "simulation":
        k = np.zeros_like(k)
    usable = [piece(part) for part in windowed.parts if part.n > nx]
    rest = _inputs(a, c, k, usable, direct)
    model = Innovations(
        a, rest.b, c, rest.d, k, 1.0, r=innovation, q=q, s=s, x0=rest.starts[0], singular_values=decomposed.s
    )
    return SubspaceEstimate(model, usable, rest.starts)


def refined(found: SubspaceEstimate, direct: bool, goal: Goal) -> Iterator[Innovations]:
    """The model with the covariance of its errors, then after one Gauss-Newton step on all matrices, after two, ...

    The errors are those one step ahead, weighted by their covariance. Ends where there is no error or no better step.
    """
    problem = gaussnewton.PemProblem(
        found.pieces, np.eye(found.model.ny), Freedom(direct=direct), within=goal.limit
    )  # fmt: skip
    point = gaussnewton.evaluate(problem, found.model, found.starts)
    if not np.isfinite(point.cost):
        yield found.model
        return
    covariance = _covariance(found.pieces, point)
    yield replace(gaussnewton.settled(point), r=covariance)
    power = sum(float(np.vdot(p.y, p.y)) for p in found.pieces) / sum(p.n for p in found.pieces)
    if goal.focus == "simulation" or np.trace(covariance) <= 1e-16 * power:
        return
    while np.linalg.eigvalsh(covariance)[0] > 1e-12 * np.trace(covariance):
        problem = replace(problem, weight=np.linalg.inv(np.linalg.cholesky(covariance)))
        point = gaussnewton.evaluate(problem, point.model, point.starts)
        before = point.cost
        point = gaussnewton.minimise(problem, point, 1)
        if not point.cost < before:
            return
        covariance = _covariance(found.pieces, point)
        yield replace(gaussnewton.settled(point), r=covariance)


def _covariance(pieces: Sequence[Piece], point: gaussnewton.PemPoint) -> Array:
    return np.asarray(sum(path.e @ path.e.T for path in point.paths) / sum(p.n for p in pieces))


def _noise(found: TriangularFactor, gamma: Array, a: Array, c: Array, direct: bool) -> tuple[Array, Array, Array]:
    """Covariances Q, R, S of x+ - A x - B u and y - C x - D u, the states taken from the past of each window."""
    split = found.split
    into = projection.state_map(found, gamma)
    p = split.past
    now = into @ found.window_rows(split.rows(range(p), inputs=True, outputs=True))
    then = into @ found.window_rows(split.rows(range(1, p + 1), inputs=True, outputs=True))
    u = found.window_rows(split.rows(range(p, p + 1), inputs=True, outputs=False))
    y = found.window_rows(split.rows(range(p, p + 1), inputs=False, outputs=True))
    w, v = _without(then - a @ now, u), y - c @ now
    v = _without(v, u) if direct else v
    return w @ w.T / found.count, v @ v.T / found.count, w @ v.T / found.count


def _without(rows: Array, u: Array) -> Array:
    """What the inputs do not explain."""
    return rows - np.linalg.lstsq(u.T, rows.T, rcond=1e-10)[0].T @ u if len(u) else rows


def _inputs(a: Array, c: Array, k: Array, pieces: Sequence[Piece], direct: bool) -> InputMatrices:
    """`fit_inputs`; ValueError where responses overflow, as those of states that are rounding do."""
    grown = max(one.n for one in pieces) * np.log(max(radius(a - k @ c), 1e-300))
    try:
        with np.errstate(all="ignore"):
            found = None if grown > LARGEST else fit_inputs(a, c, k, pieces, direct=direct)
    except ValueError:
        found = None
    if found is None or not (np.isfinite(found.b).all() and np.isfinite(found.d).all()):
        raise ValueError(
            f"order too high, or a simulation of an unstable system: responses of the estimate of order {len(a)} "
            "overflow; take a lower order"
        )
    return found


def _bounded(a: Array, limit: float) -> Array:
    """Poles drawn in where that is asked; a margin keeps the later steps inside."""
    limit = min(limit, 1e300)
    return a if radius(a) <= limit else bounded(a, limit * (1.0 - 1e-6))
