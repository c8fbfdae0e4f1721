"""Prediction errors of an innovation form and their derivatives in any directions of its matrices.

x+ = A x + B u + K e, y = C x + D u + e, so with Abar = A - K C a change (dA, dB, dC, dD, dK) gives
dx+ = Abar dx + dA x + dB u + dK e - K (dC x + dD u),  de = -(C dx + dC x + dD u)   (Ljung, 1999, section 10.3).
A missing output corrects nothing (its e is zero in the state's equation): then the recursion depends on time and runs
sample by sample, all directions at once.

Rules of this file: time runs along the last axis; nothing is estimated here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.linear import states

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Piece:
    """One experiment with time along the last axis: y (ny, n), u (nu, n), known (ny, n)."""

    y: Array
    u: Array
    known: NDArray[np.bool_]
    complete: bool

    @property
    def n(self) -> int:
        """Samples."""
        return int(self.y.shape[1])


def piece(data: Data) -> Piece:
    """The arrays of an experiment, contiguous in time, zero where an output is missing."""
    known = np.isfinite(data.y.T)
    return Piece(
        np.ascontiguousarray(np.where(known, data.y.T, 0.0)), np.ascontiguousarray(data.u.T), known, bool(known.all())
    )


@dataclass(frozen=True)
class Directions:
    """m changes of a model: a (m, nx, nx), b (m, nx, nu), c (m, ny, nx), d (m, ny, nu), k (m, nx, ny), x0 (m, nx)."""

    a: Array
    b: Array
    c: Array
    d: Array
    k: Array
    x0: Array

    @property
    def count(self) -> int:
        """Directions."""
        return len(self.a)


@dataclass(frozen=True)
class PredictionTrajectory:
    """x (nx, n) predicted one step ahead, e (ny, n) its errors, zero where missing; `ahead`: those h steps ahead."""

    x: Array
    e: Array
    ahead: Array


def trajectory(model: Innovations, data: Piece, x0: Array, horizon: int = 1) -> PredictionTrajectory:
    """Predicted states and errors of an experiment from the state x0 (nx,)."""
    if data.complete:
        x, e = _filtered(model, data, x0)
    else:
        x, e = _stepped(model, data, x0)
    return PredictionTrajectory(x, e, e if horizon == 1 else _errors_ahead(model, data, x, e, horizon))


def paired(errors: Sequence[Array], known: Sequence[NDArray[np.bool_]]) -> Array:
    """Covariance (ny, ny) of errors (ny, n) that are zero where an output is missing, by the pairs that are known."""
    pairs = sum(one.astype(float) @ one.astype(float).T for one in known)
    return np.asarray(sum(e @ e.T for e in errors) / np.maximum(pairs, 1.0))


def sensitivities(
    model: Innovations, data: Piece, path: PredictionTrajectory, along: Directions, horizon: int = 1
) -> Array:
    """Derivatives (ny, m, n) of the errors `horizon` steps ahead, zero where an output is missing."""
    driven, seen = _pushes(model, data, path, along)
    dx = (_filtered_change if data.complete else _stepped_change)(model, data, driven, along.x0.T)
    de = -np.tensordot(model.c, dx, 1) - seen
    if horizon > 1:
        de = _change_ahead(model, data, path, along, dx, de, horizon)
    return de if data.complete else de * data.known[:, None, :]


def _filtered(model: Innovations, data: Piece, x0: Array) -> tuple[Array, Array]:
    inner = model.a - model.k @ model.c
    x = states(inner, (model.b - model.k @ model.d) @ data.u + model.k @ data.y, x0)
    return x, data.y - model.c @ x - model.d @ data.u


def _stepped(model: Innovations, data: Piece, x0: Array) -> tuple[Array, Array]:
    x, e = np.empty((model.nx, data.n)), np.empty((model.ny, data.n))
    driven, said, now = model.b @ data.u, data.y - model.d @ data.u, np.asarray(x0, dtype=float)
    for i in range(data.n):
        x[:, i] = now
        e[:, i] = (said[:, i] - model.c @ now) * data.known[:, i]
        now = model.a @ now + driven[:, i] + model.k @ e[:, i]
    return x, e


def _pushes(model: Innovations, data: Piece, path: PredictionTrajectory, along: Directions) -> tuple[Array, Array]:
    """What a change adds to the state (nx, m, n) and to the output (ny, m, n)."""
    x, u, e = path.x, data.u, path.e
    seen = _applied(np.concatenate([along.c, along.d], axis=2), np.vstack([x, u]))
    if data.complete:
        a, b = along.a - model.k @ along.c, along.b - model.k @ along.d
        return _applied(np.concatenate([a, b, along.k], axis=2), np.vstack([x, u, e])), seen
    return _applied(np.concatenate([along.a, along.b, along.k], axis=2), np.vstack([x, u, e])) - np.tensordot(
        model.k, seen * data.known[:, None, :], 1
    ), seen


def _applied(matrices: Array, signals: Array) -> Array:
    """(rows, m, n) of matrices (m, rows, s) times signals (s, n)."""
    m, rows, s = matrices.shape
    return np.asarray((matrices.transpose(1, 0, 2).reshape(rows * m, s) @ signals).reshape(rows, m, -1))


def _filtered_change(model: Innovations, data: Piece, driven: Array, x0: Array) -> Array:
    return states(model.a - model.k @ model.c, driven, x0)


def _stepped_change(model: Innovations, data: Piece, driven: Array, x0: Array) -> Array:
    dx, now = np.empty_like(driven), np.array(x0, dtype=float)
    for i in range(data.n):
        dx[:, :, i] = now
        inner = model.a - model.k @ (data.known[:, i, None] * model.c)
        now = inner @ now + driven[:, :, i]
    return dx


def _errors_ahead(model: Innovations, data: Piece, x: Array, e: Array, horizon: int) -> Array:
    """y(t) - C z, z the state of h - 1 samples before carried on by the inputs; the first samples as far as they go."""
    out, z = e.copy(), x
    for _ in range(horizon - 1):
        z = model.a @ z[:, :-1] + model.b @ data.u[:, _start(data, z) : -1]
        later = slice(data.n - z.shape[1], None)
        out[:, later] = (data.y - model.d @ data.u)[:, later] - model.c @ z
    return out if data.complete else out * data.known


def _change_ahead(
    model: Innovations, data: Piece, path: PredictionTrajectory, along: Directions, dx: Array, de: Array, horizon: int
) -> Array:
    out, z, dz = de.copy(), path.x, dx
    both = np.concatenate([along.a, along.b], axis=2)
    seen = np.concatenate([along.c, along.d], axis=2)
    for _ in range(horizon - 1):
        u = data.u[:, _start(data, z) : -1]
        dz = np.tensordot(model.a, dz[..., :-1], 1) + _applied(both, np.vstack([z[:, :-1], u]))
        z = model.a @ z[:, :-1] + model.b @ u
        later = slice(data.n - z.shape[1], None)
        out[..., later] = -np.tensordot(model.c, dz, 1) - _applied(seen, np.vstack([z, data.u[:, later]]))
    return out


def _start(data: Piece, z: Array) -> int:
    return data.n - int(z.shape[1])
