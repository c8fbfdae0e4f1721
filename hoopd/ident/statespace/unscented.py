"""One-step errors of a nonlinear model by a sigma-point Kalman filter, for many parameter sets at once.

x+ = f(x, u, p, t) + w, y = h(x, u, p, t) + v. The 2 nx points mean +- sqrt(nx) root(P) weigh alike (the unscented
transform with kappa = 0: Julier & Uhlmann, 2004; Arasaratnam & Haykin, 2009), so covariances stay positive.

Rules of this file: states run along the first axis and everything behind it is a batch; a missing output corrects
nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Map = Callable[[Array, Array, Array, float], Any]


@dataclass(frozen=True)
class NonlinearSystem:
    """f and h take x (nx, batch), u (nu, 1), p (np, batch), t in seconds and give (nx, batch), (ny, batch)."""

    f: Map
    h: Map
    nx: int
    ny: int
    q: Array  # (nx, nx) of w
    r: Array  # (ny, ny) of v
    spread: Array  # (nx, nx) of the initial state


@dataclass(frozen=True)
class Filtered:
    """Errors e (n, ny, m), zero where missing, their covariance s (n, ny, ny) of the first set, predicted states x."""

    e: Array
    s: Array
    x: Array  # (n, nx, m)


def filtered(system: NonlinearSystem, y: Array, u: Array, t: Array, p: Array, x0: Array) -> Filtered:
    """One-step errors of y (n, ny) for m parameter sets p (np, m) and initial states x0 (nx, m).

    LinAlgError where a covariance is lost, which a model that diverges brings about.
    """
    n, m = len(y), p.shape[1]
    known = np.isfinite(y)
    e, s, states = np.zeros((n, system.ny, m)), np.zeros((n, system.ny, system.ny)), np.empty((n, system.nx, m))
    x, cov = x0.astype(float), np.repeat(system.spread[None], m, axis=0)
    repeated = np.repeat(p, 2 * system.nx, axis=1)
    for i in range(n):
        states[i] = x
        points = _points(x, cov)
        said = _called(system.h, points, u[i], repeated, t[i], system.ny)
        x, cov, e[i], s[i] = _corrected(system, x, cov, points, said, np.where(known[i], y[i], 0.0), known[i])
        moved = _called(system.f, _points(x, cov), u[i], repeated, t[i], system.nx)
        x = moved.mean(axis=2)
        off = moved - x[:, :, None]
        cov = np.einsum("amk,bmk->mab", off, off) / (2 * system.nx) + system.q
    return Filtered(e, s, states)


def _points(x: Array, cov: Array) -> Array:
    """(nx, m, 2 nx)."""
    root = np.sqrt(len(x)) * np.linalg.cholesky(cov).transpose(1, 0, 2)
    return np.concatenate([x[:, :, None] + root, x[:, :, None] - root], axis=2)


def _called(of: Map, points: Array, u: Array, p: Array, t: float, rows: int) -> Array:
    flat = points.reshape(len(points), -1)
    found = np.asarray(of(flat, u[:, None], p, t), dtype=float)
    return np.broadcast_to(found.reshape(rows, -1), (rows, flat.shape[1])).reshape(rows, *points.shape[1:])


def _corrected(
    system: NonlinearSystem, x: Array, cov: Array, points: Array, said: Array, y: Array, known: NDArray[np.bool_]
) -> tuple[Array, Array, Array, Array]:
    """State and covariance with the sample's output, the errors and their covariance (first set)."""
    mean = said.mean(axis=2)
    off, turn = said - mean[:, :, None], points - x[:, :, None]
    e = (y[:, None] - mean) * known[:, None]
    s = np.einsum("amk,bmk->mab", off, off) / points.shape[2] + system.r
    if not known.any():
        return x, cov, e, s[0]
    mask = known.astype(float)
    cross = np.einsum("amk,bmk->mab", turn, off) / points.shape[2] * mask
    used = s * np.outer(mask, mask) + np.diag(1.0 - mask)
    gain = np.linalg.solve(used, cross.transpose(0, 2, 1)).transpose(0, 2, 1)
    cov = cov - gain @ used @ gain.transpose(0, 2, 1)
    return x + np.einsum("mab,bm->am", gain, e), 0.5 * (cov + cov.transpose(0, 2, 1)), e, s[0]
