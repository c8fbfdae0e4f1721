"""A channel's own course, drawn through its samples: what each sample should have been, judged by all the others.

    z = y - p(u),   min  sum w_k (z_k - x_k)^2 / sigma^2 + sum (D^3 x)_k^2 / q^2

D^3 is the third divided difference: a course whose acceleration changes by chance. What the recorded torque does at
once, p(u), is taken out first: the inputs, held over a step and delayed by 0 to 3 of them, integrated as often as on
their way to what is read (speeds once, angles twice), with coefficients from this recording alone. A reading of no
body (a current, a level) may follow an input within a few samples: there each of its last ANSWERS rows counts, too.
Rules of this file: no plant, only the recording; banded systems, no loop over samples; a sample that is missing has
weight 0 and still gets a prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded, solveh_banded

from hoopd.recording.recording import PAUSE_STEPS

Array = NDArray[np.float64]

# A torque that acts up to three ticks late: delay and lag of a drive at 50 Hz.
LAGS = 4
# Rows in which a reading of no body follows a step of an input: what is slower a course follows by itself.
ANSWERS, ROWS_PER_ANSWER = 30, 25
# sigma^2 / q^2: from motion that outruns its samples to a course of about a dozen of them.
RATIOS = np.geomspace(0.03, 120.0, 7)
# Columns of the inverse this far apart do not see each other (at the largest ratio: 1e-3).
APART = 12
# Nothing is known of a stretch without samples; its course must still have a number.
NOTHING = 1e-9


class Course(NamedTuple):
    """Leave-one-out predictions of a sample at its own instant and at that of the row before, sigma = 1."""

    own: Array  # (n,) value at the row
    before: Array  # (n,) value at the row before
    own_variance: Array  # (n,) of the prediction, in sigma^2
    before_variance: Array  # (n,)


class Differences:
    """The third divided difference on given times, 6 h^3 f[t0..t3]: 1 -3 3 -1 where they are even."""

    def __init__(self, t: Array) -> None:
        times = np.lib.stride_tricks.sliding_window_view(t, 4)
        mean = (times[:, 3] - times[:, 0]) / 3
        apart = (times[:, :, None] - times[:, None, :]) / mean[:, None, None] + np.eye(4)
        self.weights = 6.0 / apart.prod(axis=2)  # (n-3, 4)
        usual = float(np.median(np.diff(t)))
        self.weights[np.diff(times, axis=1).max(axis=1) > PAUSE_STEPS * usual] = 0.0
        # white noise in the jerk gives f[t0..t3] a variance of h^-1: 6 h^3 f one of h^5
        self.growth = np.minimum(mean / usual, PAUSE_STEPS) ** 5  # (n-3,)
        self.n = len(t)

    def of(self, x: Array) -> Array:
        """D^3 of the columns of x: (n, ...) -> (n-3, ...)."""
        m = self.n - 3
        weights = self.weights.reshape(m, 4, *([1] * (x.ndim - 1)))
        return np.asarray(sum(weights[:, i] * x[i : m + i] for i in range(4)))

    def gram(self) -> Array:
        """D'D as lower bands (4, n), each difference over its spread."""
        bands, m = np.zeros((4, self.n)), self.n - 3
        scaled = self.weights / np.sqrt(self.growth)[:, None]
        for i in range(4):
            for j in range(i, 4):
                bands[j - i, i : m + i] += scaled[:, i] * scaled[:, j]
        return bands

    def covariance(self) -> Array:
        """D D' as lower bands (4, n-3): of the differences of unit noise."""
        m = self.n - 3
        bands = np.zeros((4, m))
        for d in range(4):
            for i in range(4 - d):
                bands[d, : m - d] += self.weights[: m - d, i + d] * self.weights[d:, i]
        return bands


def pushes(t: Array, drives: Array, integrals: int) -> Array:
    """Held inputs (n, k), integrated so often from rest: (n, k)."""
    h, levels = np.diff(t)[:, None], [drives]
    for level in range(1, integrals + 1):
        # x_k+1 = x_k + x'_k h + x''_k h^2 / 2 + ...
        steps = sum(levels[level - j][:-1] * h**j / factorial(j) for j in range(1, level + 1))
        levels.append(np.concatenate([np.zeros((1, drives.shape[1])), np.cumsum(steps, axis=0)]))
    return levels[-1]


def lagged(u: Array, lags: int = LAGS) -> Array:
    """The torque now and 1 ... lags - 1 rows before (n, lags), nothing where it is missing."""
    known = np.concatenate([np.zeros(lags - 1), np.nan_to_num(u)])
    return np.stack([known[lags - 1 - k : len(known) - k] for k in range(lags)], axis=1)


def answers(inputs: Sequence[Array], readings: int) -> Array:
    """Inputs (n,) as far back as a fast reading remembers them (n, k); none where so many readings tell too little."""
    each = min(ANSWERS, readings // (ROWS_PER_ANSWER * max(len(inputs), 1)))
    parts = [lagged(u, each) for u in inputs] if each > LAGS else []
    return np.hstack(parts) if parts else np.zeros((len(inputs[0]) if inputs else 0, 0))


class Explained(NamedTuple):
    """What the drives explain of a course, and how the rest moves."""

    path: Array  # (n,) what the drives do at once
    ratio: float  # sigma^2 / q^2
    sigma: float  # of a sample


def explained(t: Array, values: Array, paths: Array, used: NDArray[np.bool_], least: float) -> Explained:
    """Maximum likelihood of V = q^2 I + sigma^2 D D' over RATIOS, coefficients of the paths (n, k) eliminated.

    values: (n,), of which only the rows used (n,) are believed; least: sigma that a sample has at least. With the right
    V the innovations of past samples decide, so that a torque which a controller made of these very samples is not
    mistaken for their cause.
    """
    differences = Differences(t[used])
    target, regressors = differences.of(values[used]), differences.of(paths[used])
    scale = np.linalg.norm(regressors, axis=0)
    some = scale > 1e-12 * max(float(scale.max(initial=0.0)), 1e-30)
    regressors, paths = regressors[:, some] / scale[some], paths[:, some] / scale[some]
    noise = differences.covariance()
    best, found = np.inf, (np.zeros(paths.shape[1]), RATIOS[0], 1.0)
    for ratio in RATIOS:
        # V / sigma^2 = D D' + I / ratio
        bands = noise.copy()
        bands[0] += differences.growth / ratio
        factor = cholesky_banded(bands, lower=True, check_finite=False)
        whitened = cho_solve_banded((factor, True), np.column_stack([target, regressors]), check_finite=False)
        gram, right = regressors.T @ whitened[:, 1:], regressors.T @ whitened[:, 0]
        beta = np.linalg.lstsq(gram, right, rcond=1e-8)[0]
        variance = max(float(target @ whitened[:, 0] - beta @ right) / len(target), least**2)
        # n log sigma^2 + log det V
        loss = len(target) * np.log(variance) + 2.0 * float(np.log(factor[0]).sum())
        if loss < best:
            best, found = loss, (beta, float(ratio), float(np.sqrt(variance)))
    return Explained(paths @ found[0], found[1], found[2])


def leave_one_out(gram: Array, ratio: float, own: Array, before: Array, w_own: Array, w_before: Array) -> Course:
    """Predictions of every sample without that sample; sigma = 1.

    gram: D'D (4, n); own, before: (n,) the sample as a value at its row and at the row before (any number where its
    weight is 0); w_own, w_before: (n,) weights, w_before[0] = 0.
    """
    n = len(own)
    shifted = np.append(w_before[1:], 0.0)
    bands = ratio * gram
    bands[0] += w_own + shifted + NOTHING
    right = np.empty((n, APART + 1))
    right[:, 0] = w_own * own + shifted * np.append(before[1:], 0.0)
    right[:, 1:] = np.arange(n)[:, None] % APART == np.arange(APART)
    solved = solveh_banded(bands, right, lower=True, check_finite=False, overwrite_ab=True, overwrite_b=True)
    x, k = solved[:, 0], np.arange(n)
    here = solved[k, 1 + k % APART]
    across = np.append(0.0, solved[k[1:] - 1, 1 + k[1:] % APART])
    there = np.append(1.0, here[:-1])
    x_there = np.append(x[0], x[:-1])
    return _without(own, before, x, x_there, here, there, across, w_own, w_before)


def _without(
    own: Array, before: Array, x: Array, x_there: Array, g00: Array, g11: Array, g01: Array, w0: Array, w1: Array
) -> Course:
    """Take a sample's two shares out again: r- = (I - G W)^-1 r, G- = (I - G W)^-1 G (2 x 2, written out)."""
    r0, r1 = own - x, before - x_there
    a, b, c, d = 1.0 - g00 * w0, -g01 * w1, -g01 * w0, 1.0 - g11 * w1
    det = np.maximum(a * d - b * c, 1e-9)
    # inverse of [[a, b], [c, d]] = [[d, -b], [-c, a]] / det
    e0, e1 = (d * r0 - b * r1) / det, (a * r1 - c * r0) / det
    v0, v1 = (d * g00 - b * g01) / det, (a * g11 - c * g01) / det
    return Course(own - e0, before - e1, np.maximum(v0, 0.0), np.maximum(v1, 0.0))


__all__ = ["Course", "Differences", "Explained", "answers", "explained", "lagged", "leave_one_out", "pushes"]
