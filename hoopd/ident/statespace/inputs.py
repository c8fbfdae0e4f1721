"""B, D and the initial states of a model whose A, C and K are known, by linear least squares.

y - C (qI - Abar)^-1 K y = C (qI - Abar)^-1 (B - K D) u + D u + C Abar^t x0 + e is linear in B - K D, D and x0; with
K = 0 that is the simulation error (Verhaegen & Verdult, 2007, section 9.2.4).

Rules of this file: every experiment, and every piece between gaps, has an initial state of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.statespace.linear import states
from hoopd.ident.statespace.sensitivities import Piece

Array = NDArray[np.float64]

# Above this condition number of the scaled columns, normal equations lose digits that matter.
SQUARED_BELOW = 1e4


@dataclass(frozen=True)
class Inputs:
    """b (nx, nu), d (ny, nu), the initial states by piece."""

    b: Array
    d: Array
    starts: tuple[Array, ...]


def fit_inputs(a: Array, c: Array, k: Array, pieces: Sequence[Piece], *, direct: bool) -> Inputs:
    """The least squares of the errors one step ahead (k = 0: of the simulation) of complete pieces."""
    nx, ny = len(a), len(c)
    nu = len(pieces[0].u)
    inner = a - k @ c
    blocks = [_columns(inner, c, k, one, direct) for one in pieces]
    shared = blocks[0][0].shape[1]
    rows = [len(block) for block, _, _ in blocks]
    x = np.zeros((sum(rows), shared + nx * len(pieces)))
    first = 0
    for i, (block, free, _) in enumerate(blocks):
        x[first : first + len(block), :shared] = block
        x[first : first + len(block), shared + i * nx : shared + (i + 1) * nx] = free
        first += len(block)
    found = least_squares(x, np.concatenate([target for _, _, target in blocks]))
    d = found[nu * nx : shared].reshape(nu, ny).T if direct else np.zeros((ny, nu))
    b = found[: nu * nx].reshape(nu, nx).T + k @ d
    return Inputs(b, d, tuple(found[shared + i * nx : shared + (i + 1) * nx] for i in range(len(pieces))))


def least_squares(x: Array, y: Array) -> Array:
    """argmin |x b - y|; normal equations with one refinement where the columns are well conditioned, else a complete
    orthogonal factorisation, the solution of least length."""
    size = np.linalg.norm(x, axis=0)
    if size.min(initial=1.0) > 0.0:
        gram = (x.T @ x) / np.outer(size, size)
        try:
            low = linalg.cho_factor(gram, lower=True)
            if np.diag(low[0]).min(initial=1.0) > 1.0 / SQUARED_BELOW:
                found = linalg.cho_solve(low, x.T @ y / size)
                found += linalg.cho_solve(low, x.T @ (y - x @ (found / size)) / size)
                return np.asarray(found / size)
        except linalg.LinAlgError:
            pass
    unit = np.where(size > 0.0, size, 1.0)
    return np.asarray(linalg.lstsq(x / unit, y, lapack_driver="gelsy", cond=1e-14)[0] / unit)


def _columns(inner: Array, c: Array, k: Array, data: Piece, direct: bool) -> tuple[Array, Array, Array]:
    """Columns of B - K D (input by input, state by state) and D; of x0; the target; rows by output, then time."""
    nx, ny, n, nu = len(inner), len(c), data.n, len(data.u)
    driven = np.einsum("ij,kn->ikjn", np.eye(nx), data.u).reshape(nx, nu * nx, n)
    rows = np.tensordot(c, states(inner, driven), 1).transpose(0, 2, 1).reshape(ny * n, nu * nx)
    if direct:
        rows = np.hstack([rows, np.einsum("ij,kn->inkj", np.eye(ny), data.u).reshape(ny * n, nu * ny)])
    free = np.tensordot(c, states(inner, np.zeros((nx, nx, n)), np.eye(nx)), 1).transpose(0, 2, 1).reshape(ny * n, nx)
    target = data.y - c @ states(inner, k @ data.y)
    return rows, free, target.ravel()
