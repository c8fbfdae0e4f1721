"""The recursion x+ = a x + w for many signals at once, without a loop over samples.

In the real Schur basis the recursion falls into scalar and 2 x 2 blocks; each is an all-pole filter that
`scipy.signal.lfilter` runs in compiled code, from the last block up. No eigenvectors: a defective `a` does no harm.

Rules of this file: time runs along the last axis; an unstable recursion may overflow, and the caller judges that.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

Array = NDArray[np.float64]


def states(a: Array, driven: Array, x0: Array | None = None) -> Array:
    """x (nx, ..., n) of x(k+1) = a x(k) + driven(k); `driven` (nx, ..., n), x(0) = x0 (nx, ...) or zero."""
    nx = len(a)
    if nx == 0 or driven.shape[-1] == 0:
        return np.zeros_like(driven)
    t, z = linalg.schur(a)
    w = np.empty(driven.shape)
    w[..., 1:] = np.tensordot(z.T, driven[..., :-1], 1)
    w[..., 0] = 0.0 if x0 is None else np.tensordot(z.T, x0, 1)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.tensordot(z, run_down(t, w), 1))


def run_down(t: Array, w: Array) -> Array:
    """s(k) = t s(k-1) + w(k), (nx, ..., n), for a real Schur form t (nx, nx); w (nx, ..., n) is overwritten."""
    for rows in _blocks_upwards(t):
        if rows.stop < len(t):
            w[rows, ..., 1:] += np.tensordot(t[rows, rows.stop :], w[rows.stop :, ..., :-1], 1)
        w[rows] = _block(t[rows, rows], w[rows])
    return w


def outputs(a: Array, c: Array, driven: Array, x0: Array | None = None) -> Array:
    """c x (ny, ..., n) of the same recursion."""
    return np.asarray(np.tensordot(c, states(a, driven, x0), 1))


def radius(a: Array) -> float:
    """The largest modulus of an eigenvalue."""
    return float(np.abs(np.linalg.eigvals(a)).max(initial=0.0))


def _blocks_upwards(t: Array) -> Iterator[slice]:
    """Rows of the 1 x 1 and 2 x 2 blocks on the diagonal, from the last to the first."""
    last = len(t)
    while last > 0:
        size = 2 if last > 1 and t[last - 1, last - 2] != 0.0 else 1
        yield slice(last - size, last)
        last -= size


def _block(t: Array, w: Array) -> Array:
    """s(k) = t s(k-1) + w(k) for one block."""
    if len(t) == 1:
        return np.asarray(signal.lfilter([1.0], [1.0, -t[0, 0]], w, axis=-1))
    # (I - t q^-1)^-1 = (I - adj(t) q^-1) / (1 - tr(t) q^-1 + det(t) q^-2), where adj(t) = tr(t) I - t
    adjugate = np.array([[t[1, 1], -t[0, 1]], [-t[1, 0], t[0, 0]]])
    pushed = w.copy()
    pushed[..., 1:] -= np.tensordot(adjugate, w[..., :-1], 1)
    det = t[0, 0] * t[1, 1] - t[0, 1] * t[1, 0]
    return np.asarray(signal.lfilter([1.0], [1.0, -t[0, 0] - t[1, 1], det], pushed, axis=-1))
