"""Gram matrices of lagged signals without the matrix of lags: time and memory linear in the samples.

Along a diagonal two entries differ by one product at each end, so only the first row and column need sums over the
samples (the shift structure of the covariance method: Ljung, System Identification, 1999, 10.1; Morf et al., 1977).

Rules of this file: numpy only; signals are complete and contiguous; nothing is estimated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def lagged_gram(signals: Sequence[Array], lags: Sequence[range], first: int) -> Array:
    """Gram (p, p) of the columns s_i(t - k), k in lags[i] (consecutive), over t = first .. n - 1.

    The columns stand in the order of `signals` and, within one, of its lags. ValueError when a lag reaches before the
    data or none is left.
    """
    n = len(signals[0])
    if not all(lag.start >= 0 and lag.step == 1 and (not lag or lag[-1] <= first) for lag in lags) or first >= n:
        raise ValueError(f"lags {list(lags)} do not fit into the samples {first} to {n - 1}")
    offsets = np.concatenate([[0], np.cumsum([len(lag) for lag in lags])])
    gram = np.empty((offsets[-1], offsets[-1]))
    for i, (a, la) in enumerate(zip(signals, lags, strict=True)):
        for j in range(i, len(signals)):
            if la and lags[j]:
                block = _block(a, la, signals[j], lags[j], first)
                gram[offsets[i] : offsets[i + 1], offsets[j] : offsets[j + 1]] = block
                gram[offsets[j] : offsets[j + 1], offsets[i] : offsets[i + 1]] = block.T
    return gram


def _block(a: Array, la: range, b: Array, lb: range, first: int) -> Array:
    """sum_t a(t - k) b(t - l), (len(la), len(lb))."""
    n, rows, columns = len(a), len(la), len(lb)
    block = np.empty((rows, columns))
    block[0] = _row(a, la[0], b, lb, first)
    block[:, 0] = block[0] if a is b and la == lb else _row(b, lb[0], a, la, first)
    # G[i+1, j+1] = G[i, j] + a(first-1-i) b(first-1-j) - a(n-1-i) b(n-1-j)
    enter, leave = _ends(a, la, first, n), _ends(b, lb, first, n)
    for i in range(rows - 1):
        block[i + 1, 1:] = block[i, :-1] + enter[0][i] * leave[0] - enter[1][i] * leave[1]
    return block


def _row(a: Array, k: int, b: Array, lb: range, first: int) -> Array:
    """sum_t a(t - k) b(t - l) for every l in lb."""
    n = len(a)
    part = np.correlate(b[first - lb[-1] : n - lb[0]], a[first - k : n - k], "valid")
    return np.asarray(part[::-1])


def _ends(a: Array, la: range, first: int, n: int) -> tuple[Array, Array]:
    """Values that enter at the first and leave at the last sample, by lag but the last."""
    lag = np.arange(la.start, la.stop - 1)
    return a[first - 1 - lag], a[n - 1 - lag]
