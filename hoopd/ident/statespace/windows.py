"""Second moments of all windows of consecutive samples: what every subspace method needs of the data, and all it needs.

The moments of a block Hankel matrix follow from those of its first block row: G(i+1, j+1) = G(i, j) less the sample
that leaves, plus the sample that enters. That costs n (channels)^2 (length), not (length)^2, and no memory beyond G.
Where G is too ill-conditioned for Cholesky (data without noise), the triangular factor is gathered by QR in chunks.

Rules of this file: a window never crosses a gap or the end of an experiment; memory does not grow with the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import linalg

Array = NDArray[np.float64]

# Below this ratio of the diagonal of the scaled Cholesky factor, squaring the data costs digits that matter.
LEAST_PIVOT = 1e-4
CHUNK = 4096  # windows taken into one QR


def count(pieces: Sequence[Array], length: int) -> int:
    """Windows of `length` samples in the pieces (n, channels)."""
    return sum(max(len(one) - length + 1, 0) for one in pieces)


def moments(pieces: Sequence[Array], length: int) -> Array:
    """(length * channels)^2 sums over all windows of w w', w = [z(t); ...; z(t + length - 1)]."""
    total = np.zeros((length * pieces[0].shape[1],) * 2)
    for z in pieces:
        if len(z) >= length:
            total += _moments(z, length)
    return total


def factor(pieces: Sequence[Array], length: int, order: NDArray[Any], gram: Array | None = None) -> Array:
    """Lower triangular L with L L' = moments in the given order of rows."""
    g = (moments(pieces, length) if gram is None else gram)[np.ix_(order, order)]
    scale = np.sqrt(np.maximum(np.diag(g), np.finfo(float).tiny))
    try:
        low = linalg.cholesky(g / np.outer(scale, scale), lower=True)
        if np.diag(low).min() > LEAST_PIVOT:
            return np.asarray(scale[:, None] * low)
    except linalg.LinAlgError:
        pass
    return _by_qr(pieces, length, order)


def _moments(z: Array, length: int) -> Array:
    n, m = z.shape
    windows = n - length + 1
    g = np.zeros((length, length, m, m))
    head = z[:windows]
    for j in range(length):
        g[0, j] = head.T @ z[j : j + windows]
    for i in range(length - 1):
        leaves, enters = z[i], z[windows + i]
        later = np.arange(i, length - 1)
        change = enters[:, None] * z[windows + later][:, None, :] - leaves[:, None] * z[later][:, None, :]
        g[i + 1, i + 1 :] = g[i, i : length - 1] + change
    full = g.transpose(0, 2, 1, 3).reshape(length * m, length * m)
    upper = np.triu(full)
    return np.asarray(upper + np.triu(upper, 1).T)


def _by_qr(pieces: Sequence[Array], length: int, order: NDArray[Any]) -> Array:
    r = np.zeros((0, len(order)))
    for rows in _chunks(pieces, length):
        r = linalg.qr(np.vstack([r, rows[:, order]]), mode="r", check_finite=False)[0][: len(order)]
    if len(r) < len(order):
        r = np.vstack([r, np.zeros((len(order) - len(r), len(order)))])
    return np.asarray(np.triu(r).T)


def _chunks(pieces: Sequence[Array], length: int) -> Iterator[Array]:
    """Windows as rows, some thousands at a time."""
    for z in pieces:
        if len(z) < length:
            continue
        view = sliding_window_view(z, length, axis=0)  # (windows, channels, length)
        for first in range(0, len(view), CHUNK):
            part = view[first : first + CHUNK]
            yield part.transpose(0, 2, 1).reshape(len(part), -1)
