"""Where a run begins in the middle of things: what lags behind its plant has a past there.

A drive's lag knows its past from the input before; a sensor's lag shows where it is. To begin settled instead makes a
false transient of its time constant's length, and a model with the true numbers misses by it.

Rules of this file: of data alone; nothing is fitted here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# A lagging reading is the straight line through its first samples, those of this share of its time constant or the
# fewest and the most of them.
LINE_SHARE, FEWEST_SAMPLES, MOST_SAMPLES = 0.25, 5, 25


def low_passed(u: Array, h: ArrayLike, lag_s: float) -> Array:
    """What a lag makes of an input that is held over steps, settled at the first.

    Parameters
    ----------
    u : ndarray, shape (n - 1,)
        The input in each step.
    h : array_like, shape (n - 1,)
        Lengths of the steps, s.
    lag_s : float
        Time constant, s.

    Returns
    -------
    ndarray, shape (n,)
        The exact answer at the nodes.

    Examples
    --------
    >>> low_passed(np.array([0.0, 1.0, 1.0]), [1.0, 1.0, 1.0], 1.0).round(3).tolist()
    [0.0, 0.0, 0.632, 0.865]
    """
    decay = np.exp(-np.asarray(h, float) / lag_s) if lag_s > 0.0 else np.zeros(len(u))
    out = [float(u[0])]
    for held, kept in zip(u.tolist(), decay.tolist(), strict=True):
        out.append(held + (out[-1] - held) * kept)
    return np.array(out)


def read_at_start(t: Array, y: Array, lag_s: float) -> float:
    """Where a lagging reading was at t[0]; NaN where too few samples tell it.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times, s; the first is the start.
    y : ndarray, shape (n,)
        Readings, NaN where there is none.
    lag_s : float
        The sensor's time constant, s.

    Returns
    -------
    float

    Examples
    --------
    >>> round(read_at_start(np.arange(6.0), np.array([np.nan, 2.0, 3.0, 4.0, 5.0, 6.0]), 1.0), 9)
    1.0
    """
    there = np.flatnonzero(np.isfinite(y))[:MOST_SAMPLES]
    within = int(np.searchsorted(t[there], t[0] + LINE_SHARE * lag_s, side="right"))
    used = there[: max(within, FEWEST_SAMPLES)]
    if len(used) < FEWEST_SAMPLES:
        return float("nan")
    return line_at_start(t[used] - t[0], y[used])[0]


def line_at_start(when: Array, y: Array) -> tuple[float, float]:
    """Value at the start and slope of the straight line through samples `when` (n,) s after it."""
    slope, value = np.polyfit(when, y, 1)
    return float(value), float(slope)
