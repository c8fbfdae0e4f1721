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

from hoopd.ident.statespace.linear import run_down
from hoopd.ident.statespace.sensitivities import Piece

Array = NDArray[np.float64]

# Above this condition number of the scaled columns, normal equations lose digits that matter.
SQUARED_BELOW = 1e4
# Samples whose columns exist at a time where there are more.
CHUNK = 32768


@dataclass(frozen=True)
class InputMatrices:
    """b (nx, nu), d (ny, nu), the initial states by piece."""

    b: Array
    d: Array
    starts: tuple[Array, ...]


def fit_inputs(a: Array, c: Array, k: Array, pieces: Sequence[Piece], *, direct: bool) -> InputMatrices:
    """The least squares of the errors one step ahead (k = 0: of the simulation) of complete pieces."""
    nx, ny = len(a), len(c)
    nu = len(pieces[0].u)
    # in the Schur basis of the recursion an unknown drives one row of it, and two changes of basis are saved
    t, z = linalg.schur(a - k @ c)
    if sum(one.n for one in pieces) > CHUNK:
        return _unpacked(_from_chunks(t, c @ z, z.T @ k, pieces, direct), z, k, (nu, ny), direct)
    blocks = [_columns(t, c @ z, z.T @ k, one, direct) for one in pieces]
    shared = blocks[0][0].shape[1]
    rows = [len(block) for block, _, _ in blocks]
    x = np.zeros((sum(rows), shared + nx * len(pieces)))
    first = 0
    for i, (block, free, _) in enumerate(blocks):
        x[first : first + len(block), :shared] = block
        x[first : first + len(block), shared + i * nx : shared + (i + 1) * nx] = free
        first += len(block)
    found = least_squares(x, np.concatenate([target for _, _, target in blocks]))
    return _unpacked(found, z, k, (nu, ny), direct)


def _unpacked(found: Array, z: Array, k: Array, sizes: tuple[int, int], direct: bool) -> InputMatrices:
    """Matrices and initial states out of the vector, in the basis of the states."""
    (nu, ny), nx = sizes, len(z)
    shared = nu * nx + nu * ny * direct
    d = found[nu * nx : shared].reshape(nu, ny).T if direct else np.zeros((ny, nu))
    b = z @ found[: nu * nx].reshape(nu, nx).T + k @ d
    return InputMatrices(b, d, tuple(z @ one for one in found[shared:].reshape(-1, nx)))


def _from_chunks(t: Array, c: Array, k: Array, pieces: Sequence[Piece], direct: bool) -> Array:
    """The same unknowns from the triangular factor of rows that exist some thousands at a time."""
    nx, nu = len(t), len(pieces[0].u)
    shared = nu * nx + nu * len(c) * direct
    width = shared + nx * len(pieces)
    r = np.zeros((0, width + 1))
    for i, one in enumerate(pieces):
        before = np.zeros((nx, nu + 1, nx)), np.zeros(nx)
        own = [*range(shared), *range(shared + i * nx, shared + (i + 1) * nx), width]
        for first in range(0, one.n, CHUNK):
            block, free, target, before = _part(t, c, k, one, direct, slice(first, min(first + CHUNK, one.n)), before)
            rows = np.zeros((len(target), width + 1))
            rows[:, own] = np.column_stack([block, free, target])
            r = linalg.qr(np.vstack([r, rows]), mode="r", check_finite=False)[0][: width + 1]
    return least_squares(r[:, :width], r[:, width])


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


def _columns(t: Array, c: Array, k: Array, data: Piece, direct: bool) -> tuple[Array, Array, Array]:
    """Columns of B - K D (input by input, state by state) and D; of x0; the target; rows by output, then time.

    t: a real Schur form, c and k in its basis.
    """
    nx = len(t)
    rest = np.zeros((nx, len(data.u) + 1, nx)), np.zeros(nx)
    return _part(t, c, k, data, direct, slice(0, data.n), rest)[:3]


Carried = tuple[Array, Array]


def _part(
    t: Array, c: Array, k: Array, data: Piece, direct: bool, span: slice, before: Carried
) -> tuple[Array, Array, Array, Carried]:
    """`_columns` of the samples of a span, and the states at its end; `before`: those before it."""
    nx, ny, nu, n = len(t), len(c), len(data.u), span.stop - span.start
    early = max(span.start - 1, 0)
    driven = np.zeros((nx, nu + 1, nx, n))
    reading = np.zeros((nx, n))
    skip = int(span.start == 0)
    for state in range(nx):
        driven[state, :nu, state, skip:] = data.u[:, early : span.stop - 1]
        driven[state, nu, state, 0] = skip
    reading[:, skip:] = k @ data.y[:, early : span.stop - 1]
    driven[..., 0] += np.tensordot(t, before[0], 1)
    reading[:, 0] += t @ before[1]
    with np.errstate(over="ignore", invalid="ignore"):
        x, z = run_down(t, driven), run_down(t, reading)
        seen = np.tensordot(c, x, 1).reshape(ny, (nu + 1) * nx, n).transpose(0, 2, 1)
        target = data.y[:, span] - c @ z
    rows, free = seen[:, :, : nu * nx].reshape(ny * n, -1), seen[:, :, nu * nx :].reshape(ny * n, nx)
    if direct:
        rows = np.hstack([rows, np.einsum("ij,kn->inkj", np.eye(ny), data.u[:, span]).reshape(ny * n, nu * ny)])
    return rows, free, target.ravel(), (x[..., -1].copy(), z[:, -1].copy())
