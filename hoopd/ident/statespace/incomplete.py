"""A state-space model where outputs are missing: the exact likelihood, over minimal coordinates and R's shape.

Coordinates x are the directions (`coordinates.basis`) away from a model, then the logarithms and off-diagonals of the
root of R, less its scale, which the likelihood has for nothing; the directions are renewed between searches.

Rules of this file: the predictor stays stable, the poles within the limit that is asked for; data are not changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data
from hoopd.ident.gaplikelihood import stretch
from hoopd.ident.gapsearch import GapOptimum, GapProblem, likeliest
from hoopd.ident.models import Innovations
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.gaussnewton import EDGE
from hoopd.ident.statespace.linear import radius

Array = NDArray[np.float64]

# Searches, each in directions of the model that the last one found.
ROUNDS = 2


@dataclass(frozen=True)
class IncompleteEstimate:
    """The model with R, the covariance of its full vector, whether the search came to an end, its steps."""

    model: Innovations
    covariance: Array
    settled: bool
    steps: int


def likeliest_model(
    each: Sequence[Data], start: Innovations, free: Freedom, *, free_start: bool, within: float
) -> IncompleteEstimate:  # fmt: skip
    """The likeliest from a start that is near."""
    model = start if start.r is not None else replace(start, r=np.eye(start.ny))
    for _ in range(ROUNDS):
        columns = coordinates.basis(model, free)
        shape = _shape(np.asarray(model.r))
        m, middle = columns.shape[1], coordinates.values(model)

        def made(x: Array, middle: Array = middle, columns: Array = columns, m: int = m) -> Innovations:
            found = coordinates.with_values(start, middle + columns @ x[:m])
            if radius(found.a - found.k @ found.c) >= EDGE or radius(found.a) > within:
                raise ValueError("the predictor or the model is not stable")
            return replace(found, r=_covariance(x[m:], start.ny))

        problem = GapProblem(made, [stretch(one.y, one.u) for one in each], free_start, start.nx)
        if problem.free <= m + len(shape):
            raise ValueError(f"too few samples: {problem.count} outputs for {m + len(shape)} coordinates")
        best = likeliest(problem, [np.concatenate([np.zeros(m), shape])])
        found = made(best.x)
        model = replace(found, r=best.variance * np.asarray(found.r))
    return IncompleteEstimate(model, columns @ _own(best, m) @ columns.T, best.settled, best.steps)


def _own(best: GapOptimum, m: int) -> Array:
    return best.covariance[:m, :m]


def _shape(r: Array) -> Array:
    """Logarithms of the root's diagonal less the first, then what is below it, relative to the first."""
    low = np.linalg.cholesky(r)
    low = low / low[0, 0]
    return np.concatenate([np.log(np.diag(low))[1:], low[np.tril_indices(len(r), -1)]])


def _covariance(shape: Array, ny: int) -> Array:
    """R from its shape, its first entry one."""
    low = np.diag(np.exp(np.concatenate([[0.0], shape[: ny - 1]])))
    low[np.tril_indices(ny, -1)] = shape[ny - 1 :]
    return np.asarray(low @ low.T)
