"""The colour of errors with gaps, as an autoregression, and rows made white by it.

Rules of this file: pure numbers; NaN is a sample that was not measured, and counts nowhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

Array = NDArray[np.float64]

# Coefficients of the autoregression that stands for the colour of a signal, and the samples that each of them asks for.
COLOUR, EACH = 10, 20
# Errors (or products of them at one lag) below which chance is not normal.
FEWEST = 10


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


def whitened(a: Array, columns: Array) -> Array:
    """Rows of signals (n, m) without what the rows before tell by the autoregression `a`, all of one variance.

    Rows with NaN in the first column are left out; past them a Kalman filter of the autoregression carries on, so what
    comes out is L^-1 of the known rows, L L' the covariance of such noise at them.
    """
    p, known = len(a) - 1, np.isfinite(columns[:, 0])
    if p == 0:
        return columns[known]
    if known.all():
        return np.asarray(signal.lfilter(a, [1.0], columns, axis=0)[p:])
    into, new = np.vstack([-a[1:], np.eye(p)[:-1]]), np.diag([1.0] + [0.0] * (p - 1))
    cov, state = linalg.solve_discrete_lyapunov(into, new), np.zeros((p, columns.shape[1]))
    out = np.empty((int(known.sum()), columns.shape[1]))
    row = 0
    for t in range(len(columns)):
        if known[t]:
            gain = cov[:, 0] / cov[0, 0]
            fresh = columns[t] - state[0]
            out[row] = fresh / np.sqrt(cov[0, 0])
            state = state + np.outer(gain, fresh)
            cov = cov - np.outer(gain, cov[0])
            row += 1
        state, cov = into @ state, into @ cov @ into.T + new
    return out
