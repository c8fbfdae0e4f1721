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
    count, size = len(signals), max(map(len, lags))
    if size == 0:
        return np.zeros((0, 0))
    gram = _all_lags(_shifted(signals, lags, first - size + 1), size)
    whole = gram.transpose(2, 0, 3, 1).reshape(count * size, count * size)
    kept = np.concatenate([i * size + np.arange(len(lag)) for i, lag in enumerate(lags)])
    return whole if len(kept) == len(whole) else whole[np.ix_(kept, kept)]


def _shifted(signals: Sequence[Array], lags: Sequence[range], start: int) -> Array:
    """Rows s_i(t - lags[i].start), t = start .. n - 1; zero before the data, where no lag that is asked for reaches."""
    n = len(signals[0])
    rows = np.zeros((len(signals), n - start))
    for row, signal, lag in zip(rows, signals, lags, strict=True):
        early = max(lag.start - start, 0)
        row[early:] = signal[start + early - lag.start : n - lag.start]
    return rows


def _all_lags(rows: Array, size: int) -> Array:
    """G[k, l, i, j] = sum_t r_i(t - k) r_j(t - l) for k, l < size, t from size - 1 on."""
    n, late = rows.shape[1], rows[:, size - 1 :]
    gram = np.empty((size, size, len(rows), len(rows)))
    for lag in range(size):
        gram[0, lag] = late @ rows[:, size - 1 - lag : n - lag].T
    gram[1:, 0] = gram[0, 1:].transpose(0, 2, 1)
    # G[k+1, l+1, i, j] = G[k, l, i, j] + r_i(first-1-k) r_j(first-1-l) - r_i(n-1-k) r_j(n-1-l)
    ends = rows[:, : size - 1].T[::-1], rows[:, n - size + 1 :].T[::-1]
    enter, leave = (one[:, None, :, None] * one[None, :, None, :] for one in ends)
    change = enter - leave
    for lag in range(size - 1):
        gram[lag + 1, 1:] = gram[lag, :-1] + change[lag]
    return gram
