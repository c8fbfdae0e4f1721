"""How finely and how noisily a sensor reads, seen in its own samples and nothing else.

Rules of this file: no model of the plant; what a polynomial of third degree over five samples explains is motion, the
rest is noise; missing samples are left out, never filled in.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoopd.recording.recording import MISSED_STEPS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A fourth difference needs five samples in a row; over a longer span the motion is no polynomial of third degree.
POINTS = 5
# Errors beyond this many sigma are not noise; the factor gives the sigma of a normal distribution cut there.
CLIP = 3.0
CLIPPED = 0.98658
# Phase order |mean exp(2 pi i d/q)| of differences that are whole numbers of steps; random ones give 1/sqrt(n).
WHOLE = 0.9
FEWEST = 12


def noise_floor(t: Array, values: Array) -> float:
    """Standard deviation of a sample's noise, in the channel's unit; NaN with fewer than FEWEST fourth differences.

    t, values: (n,), NaN where missing. The fourth divided difference over five neighbours, divided by the norm of its
    weights, has the noise's own sigma at any spacing; the spread is that of what lies within CLIP sigma.
    """
    whole = _divided(t, values)
    return clipped_sigma(whole) if len(whole) >= FEWEST else float("nan")


def clipped_sigma(errors: Array) -> float:
    """Standard deviation of the normal part of (n,) errors: quantised ones too, where a median jumps by steps."""
    sigma = float(np.median(np.abs(errors))) * 1.4826
    sigma = sigma if sigma > 0.0 else float(np.sqrt(np.mean(errors**2)))
    for _ in range(20):
        inside = np.abs(errors) <= CLIP * sigma
        new = float(np.sqrt(np.mean(errors[inside] ** 2))) / CLIPPED if inside.any() else 0.0
        if abs(new - sigma) <= 1e-6 * sigma:
            break
        sigma = new
    return sigma


def _divided(t: Array, values: Array) -> Array:
    """Fourth differences of unit norm over five present samples in a row (k,)."""
    seen = np.isfinite(values) & np.isfinite(t)
    when, y = t[seen], values[seen]
    if len(y) < POINTS:
        return np.zeros(0)
    times = np.lib.stride_tricks.sliding_window_view(when, POINTS)
    usual = float(np.median(np.diff(when)))
    steps = np.diff(times, axis=1)
    near = (steps.max(axis=1) < MISSED_STEPS * usual) & (steps.min(axis=1) > 0.1 * usual)
    times, samples = times[near], np.lib.stride_tricks.sliding_window_view(y, POINTS)[near]
    # c_i = 1 / prod_j (t_i - t_j)
    apart = (times[:, :, None] - times[:, None, :]) / usual + np.eye(POINTS)
    weights = 1.0 / apart.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray((weights * samples).sum(axis=1))


def quantum(values: Array) -> float:
    """Step of a sensor that counts, in the channel's unit: all differences are whole numbers of it; NaN without one.

    values: (n,), NaN where missing. Rounding of a file and a few false values do not matter.
    """
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = np.sort(steps[steps > 1e-9 * max(float(np.nanmax(np.abs(values), initial=0.0)), 1e-30)])
    if len(steps) < FEWEST:
        return float("nan")
    small = steps[: max(FEWEST, len(steps) // 4)]
    first = float(np.median(small[small < 1.5 * small[0]]))
    found = [q for part in (1, 2, 3) if (q := _refined(steps, first / part)) > 0.0]
    return found[0] if found else float("nan")


def _refined(steps: Array, q: float) -> float:
    """The step near q by least squares over more and more differences; 0 when they are no whole numbers of it."""
    reach = 4.0
    while True:
        near = steps[steps < reach * q]
        count = np.round(near / q)
        if len(near) < FEWEST // 2 or not count.any():
            return 0.0
        q = float(count @ near / (count @ count))
        if abs(np.exp(2j * np.pi * near / q).mean()) < WHOLE:
            return 0.0
        if len(near) == len(steps) or reach > 200:
            return q
        reach *= 3.0


def resolution(values: Array) -> float:
    """Width within which two readings are one and the same number, in the channel's unit; 0 for a continuous reading.

    values: (n,), NaN where missing. Of the pairs of readings taken at different passes that lie within w, the share
    q / (2 w) is equal to the bit: that holds for pixels too, whose angles stand on no even grid.
    """
    seen = values[np.isfinite(values)]
    if len(seen) < FEWEST:
        return 0.0
    passes = np.sort(seen[np.r_[True, np.diff(seen) != 0.0]])
    _, many = np.unique(passes, return_counts=True)
    equal = float((many * (many - 1)).sum())
    width = float(np.ptp(np.quantile(passes, [0.1, 0.9]))) / 10
    if equal == 0.0 or width == 0.0:
        return 0.0
    ends = np.searchsorted(passes, [passes - width, passes + width], side="right")
    return 2.0 * width * equal / float((ends[1] - ends[0] - 1).sum())
