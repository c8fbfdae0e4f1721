"""Where one signal of a recording is unusual: the energy of half a second against its own level and correlation.

The level is the robust one of this very recording, so that what happened in a few seconds does not hide itself.

Rules of this file: numbers in, numbers out; what is usual comes from the signal itself, no level of a device.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from hoopd.recording.spans import spans

Array = NDArray[np.float64]

# Energy is taken over windows of this length; what is nearer than this to its neighbour is one interval.
WINDOW_S = 0.5
# Root of mean square over the usual one: what is less is no candidate.
CANDIDATE = 2.5
# An interval grows from where it was found to where the energy is this near to the usual one.
GROWN_TO = 3.0
# Larger values do not count for the level and its correlation, in robust standard deviations.
CLIP = 3.0
# At least so many samples before a level is known.
FEWEST = 50
MAD = 1.4826


def unusual(
    pieces: Sequence[tuple[Array, Array]], chance_a_minute: float, slower: float = 1.0
) -> list[tuple[float, float]]:
    """(t0, t1) of one signal in pieces (t (n,), x (n,)) of one recording.

    `slower`: times of the motion over usual ones; a window and a minute are so many times as long.
    """
    level = level_of(pieces)
    if level <= 0.0:
        return []
    step = float(np.median(np.concatenate([np.diff(t) for t, _ in pieces])))
    width, step = width_of(pieces[0][0], slower), step / slower
    needed = max(CANDIDATE**2, threshold([x / level for _, x in pieces], width, step, chance_a_minute))
    return [one for t, x in pieces for one in _found(t, x / level, width, needed)]


def width_of(t: Array, slower: float = 1.0) -> int:
    """Samples of a window."""
    return max(3, round(WINDOW_S * slower / float(np.median(np.diff(t)))))


def level_of(pieces: Sequence[tuple[Array, Array]]) -> float:
    """Robust level of a signal in pieces; 0 when there is too little of it."""
    known = np.concatenate([x[np.isfinite(x)] for _, x in pieces])
    return robust_level(known) if len(known) >= FEWEST else 0.0


def robust_level(x: Array) -> float:
    """Standard deviation of what is not far out (n,)."""
    return float(MAD * np.median(np.abs(x)))


def threshold(pieces: Sequence[Array], width: int, step: float, chance_a_minute: float) -> float:
    """Mean square of a window that chance exceeds so seldom: chi2 with as many degrees as the correlation leaves."""
    rho = correlation(pieces, width)
    # var(mean of x^2) = 2/width^2 sum (width - |k|) rho_k^2 = 2/nu
    lags = np.arange(1, width)
    nu = width**2 / (width + 2.0 * np.sum((width - lags) * rho**2))
    # neighbouring windows overlap: in effect so many are tried
    tries = 60.0 / step / width * 4.0
    return float(chdtri(nu, chance_a_minute / tries) / nu)


def correlation(pieces: Sequence[Array], width: int) -> Array:
    """(width-1,) autocorrelation of a signal of robust level 1 at lags 1, 2, ..., its far values clipped."""
    clipped = [np.clip(np.nan_to_num(x), -CLIP, CLIP) for x in pieces]
    energy = sum(float(x @ x) for x in clipped)
    return np.array([sum(float(x[:-k] @ x[k:]) for x in clipped) / max(energy, 1e-300) for k in range(1, width)])


def mean_squares(x: Array, width: int) -> Array:
    """(n,) mean of x^2 over what is known of the window around each sample; 0 where that is less than a third."""
    known = np.isfinite(x)
    kernel = np.ones(width)
    count = np.convolve(known.astype(float), kernel, "same")[: len(x)]
    total = np.convolve(np.where(known, x, 0.0) ** 2, kernel, "same")[: len(x)]
    return np.where(count >= width / 3, total / np.maximum(count, 1.0), 0.0)


def _found(t: Array, x: Array, width: int, needed: float) -> list[tuple[float, float]]:
    if len(x) < width:
        return []
    energy, found = mean_squares(x, width), []
    for a, b in spans(energy > GROWN_TO):
        if energy[a:b].max() > needed:
            first, last = _trimmed(x, a, b)
            found.append((float(t[first]), float(t[last])))
    return found


def _trimmed(x: Array, a: int, b: int) -> tuple[int, int]:
    """Without the half windows at both ends in which the signal itself is usual."""
    loud = np.flatnonzero(np.nan_to_num(np.abs(x[a:b])) > CLIP)
    return (a, b - 1) if len(loud) == 0 else (a + int(loud[0]), a + int(loud[-1]))


def merged(intervals: Sequence[tuple[float, float]], slower: float = 1.0) -> list[tuple[float, float]]:
    """Intervals nearer than a window are one."""
    kept: list[tuple[float, float]] = []
    for t0, t1 in sorted(intervals):
        if kept and t0 <= kept[-1][1] + WINDOW_S * slower:
            kept[-1] = (kept[-1][0], max(kept[-1][1], t1))
        else:
            kept.append((t0, t1))
    return kept
