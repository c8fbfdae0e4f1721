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

# Signals from which on one matrix product of all of them is faster than products pair by pair.
MANY = 4
# Samples that are gone through at all lags before the next: so many of a few signals stay in a core's cache.
PART = 8192


def lagged_gram(signals: Sequence[Array], lags: Sequence[range], first: int) -> Array:
    """Gram (p, p) of the columns s_i(t - k), k in lags[i] (consecutive), over t = first .. n - 1.

    The columns stand in the order of `signals` and, within one, of its lags. ValueError when a lag reaches before the
    data or none is left.
    """
    n = len(signals[0])
    if not all(lag.start >= 0 and lag.step == 1 and (not lag or lag[-1] <= first) for lag in lags) or first >= n:
        raise ValueError(f"lags {list(lags)} do not fit into the samples {first} to {n - 1}")
    return (_by_pairs if len(signals) < MANY else _together)(signals, lags, first)


# ------------------------------------------------------------------------------------------------- pair by pair


def _by_pairs(signals: Sequence[Array], lags: Sequence[range], first: int) -> Array:
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


# ------------------------------------------------------------------------------------------------- all at once


def _together(signals: Sequence[Array], lags: Sequence[range], first: int) -> Array:
    """All signals at as many lags as the most that one has, of which those asked for are kept."""
    count, size = len(signals), max(map(len, lags))
    if size == 0:
        return np.zeros((0, 0))
    whole = _all_lags(signals, lags, first, size).transpose(2, 0, 3, 1).reshape(count * size, count * size)
    kept = np.concatenate([i * size + np.arange(len(lag)) for i, lag in enumerate(lags)])
    return np.asarray(whole[np.ix_(kept, kept)])


def _all_lags(signals: Sequence[Array], lags: Sequence[range], first: int, size: int) -> Array:
    """G[k, l, i, j] = sum_t r_i(t - k) r_j(t - l), r_i(t) = s_i(t - lags[i].start), k and l < size."""
    n, before = len(signals[0]), size - 1
    gram = np.zeros((size, size, len(signals), len(signals)))
    for start in range(first, n, PART):
        rows = _shifted(signals, lags, start - before, min(start + PART, n))
        for lag in range(size):
            gram[0, lag] += rows[:, before:] @ rows[:, before - lag : rows.shape[1] - lag].T
    gram[1:, 0] = gram[0, 1:].transpose(0, 2, 1)
    # G[k+1, l+1] = G[k, l] + r(first-1-k) r(first-1-l)' - r(n-1-k) r(n-1-l)'
    ends = (_shifted(signals, lags, end - before, end).T[::-1] for end in (first, n))
    enter, leave = (one[:, None, :, None] * one[None, :, None, :] for one in ends)
    change = enter - leave
    for lag in range(before):
        gram[lag + 1, 1:] = gram[lag, :-1] + change[lag]
    return gram


def _shifted(signals: Sequence[Array], lags: Sequence[range], start: int, end: int) -> Array:
    """Rows r_i(t), t = start .. end - 1; zero before the data, where no lag that is asked for reaches."""
    rows = np.zeros((len(signals), end - start))
    for row, signal, lag in zip(rows, signals, lags, strict=True):
        if lag:
            late = max(lag.start, start)
            row[late - start :] = signal[late - lag.start : end - lag.start]
    return rows
