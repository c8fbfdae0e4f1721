"""The colour of errors with gaps, as an autoregression, and rows made white by it.

Rules of this file: pure numbers; NaN is a sample that was not measured, and counts nowhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Array = NDArray[np.float64]

# Coefficients of the autoregression that stands for the colour of a signal, and the samples that each of them asks for.
COLOUR, EACH = 10, 20
# Errors (or products of them at one lag) below which chance is not normal.
FEWEST = 10
# Rows of a long signal that are looked at together.
PART = 1 << 15


def colour_of(rest: Array) -> tuple[Array, float]:
    """Autoregression 1, a_1, ... of a signal with gaps, and the share of its variance that is new at each sample.

    By the recursion of Levinson and Durbin; the order is that of the least BIC, for coefficients beyond it add nothing
    but chance. A correlation is that of the pairs that are known, by the powers of these very pairs: those of all
    samples would leave errors in it that a strong colour makes large. Windows without a gap are what counts as samples.
    """
    known = int(np.isfinite(rest).sum())
    order = min(COLOUR, known // EACH)
    seen, x = np.isfinite(rest).astype(float), np.nan_to_num(rest)
    both = [(x[k:], x[: len(x) - k], seen[k:], seen[: len(x) - k]) for k in range(order + 1)]
    pairs = np.array([m @ n for _, _, m, n in both])
    r = np.array([a @ b / max(np.sqrt((a**2 @ n) * (b**2 @ m)), np.finfo(float).tiny) for a, b, m, n in both])
    a, share, best, least = np.ones(1), 1.0, (np.ones(1), 1.0), 0.0
    for p in range(1, order + 1):
        step = -float(a @ r[p:0:-1]) / share
        if abs(step) >= 1.0 or pairs[p] < FEWEST:
            break
        a = np.concatenate([a, [0.0]]) + step * np.concatenate([[0.0], a[::-1]])
        share *= 1.0 - step**2
        windows = np.convolve(seen, np.ones(p + 1), "valid") > p + 0.5
        cost = float(windows.sum()) * np.log(share) + p * np.log(known)
        if cost < least:
            best, least = (a, share), cost
    return best


def whitened_parts(a: Array, known: NDArray[np.bool_], columns_of: Callable[[int, int], Array]) -> Iterator[Array]:
    """Rows of signals (n, m) without what the rows before tell by the autoregression `a`, all of one variance.

    `columns_of(begin, end)` makes these rows; those that are not `known` are left out, and a Kalman filter of the
    autoregression carries on past them: what comes out, part after part, is L^-1 of the known rows, L L' the covariance
    of such noise at them. After as many known rows as the autoregression is long the filter knows its state: what is
    new is a sum then.
    """
    p = len(a) - 1
    by_sum = known & all_known(np.where(known, 0.0, np.nan), p)
    carry = _Carried(a, columns_of(0, 0).shape[1])
    for begin, end in parts_of(len(known)):
        first = max(begin - p, 0)
        columns = columns_of(first, end)
        out = np.zeros((end - begin, columns.shape[1]))
        out[p - begin + first :] = _new_to(a, columns)
        for row in np.flatnonzero(~by_sum[begin:end]):
            t = row + begin - first
            if t and by_sum[row + begin - 1]:
                carry.after(columns[t - p : t])
            carry.step(columns[t] if known[row + begin] else None, out[row])
        yield out[known[begin:end]]


class _Carried:
    """The filter of an autoregression where samples are missing: what it foretells of the next row, and how surely."""

    def __init__(self, a: Array, signals: int) -> None:
        p = len(a) - 1
        self._into = np.vstack([-a[1:], np.eye(p)[:-1]]) if p else np.zeros((0, 0))
        self._new = np.diag([1.0] + [0.0] * (p - 1)) if p else np.zeros((0, 0))
        self._cov = linalg.solve_discrete_lyapunov(self._into, self._new) if p else self._new
        self._state = np.zeros((p, signals))

    def after(self, rows: Array) -> None:
        """These rows (the newest last) are known, and tell all."""
        self._state, self._cov = self._into @ rows[::-1], self._new

    def step(self, row: Array | None, out: Array) -> None:
        """One row on; what is new in a known one goes into `out`."""
        state, cov = self._state, self._cov
        if row is not None:
            gain, fresh = cov[:, 0] / cov[0, 0], row - state[0]
            out[:] = fresh / np.sqrt(cov[0, 0])
            state, cov = state + np.outer(gain, fresh), cov - np.outer(gain, cov[0])
        self._state, self._cov = self._into @ state, self._into @ cov @ self._into.T + self._new


def parts_of(n: int) -> Iterator[tuple[int, int]]:
    """Begin and end of the parts of n rows that are looked at together."""
    return ((begin, min(begin + PART, n)) for begin in range(0, n, PART))


def all_known(w: Array, lags: int) -> NDArray[np.bool_]:
    """Whether a sample and so many before it are there and no NaN."""
    at = np.arange(len(w))
    last_missing = np.maximum.accumulate(np.where(np.isfinite(w), -1, at))
    return np.asarray(at - last_missing > lags) & (at >= lags)


def _new_to(a: Array, columns: Array) -> Array:
    """a_0 x(t) + a_1 x(t-1) + ..., from the first row on that has so many before it."""
    p = len(a) - 1
    rows = max(len(columns) - p, 0)
    out = np.zeros((rows, columns.shape[1]))
    for k, one in enumerate(a.tolist()):
        out += one * columns[p - k : p - k + rows]
    return out
