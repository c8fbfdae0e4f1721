"""Signals on another grid of time: means of what was held, and readings of what was sampled.

Rules of this file: pure; NaN is missing, in and out; times in seconds.
"""

from __future__ import annotations

import math

import numpy as np

from hoopd.recording.recording import Column

GAP_SAMPLES = 3.0  # a gap longer than this many usual steps stays a gap
FLAT = 0.8  # of the new Nyquist frequency that a low-pass leaves alone
LOBES = 20  # half-length of the low-pass in new steps: -6 dB at 0.9, below -60 dB from the Nyquist frequency on
MAX_PARTS = 1000  # samples in one new step: a second of 1 kHz
_BETA = 6.0  # Kaiser window, -63 dB


def held_mean(t: Column, u: Column, grid: Column, step_s: float) -> Column:
    """Mean over [grid, grid + step_s] of a signal held from t[k] to t[k+1], the last one on; NaN where missing."""
    ends = np.append(grid, grid[-1] + step_s)
    there = np.isfinite(u)
    area = np.diff(_held_integral(t, np.where(there, u, 0.0), ends))
    hole = np.diff(_held_integral(t, np.where(there, 0.0, 1.0), ends))
    inside = _held_at(t, u, grid, step_s)  # exact where the torque does not change within the step
    return np.where(hole > 1e-9 * step_s, np.nan, np.where(np.isnan(inside), area / np.diff(ends), inside))


def _held_integral(t: Column, u: Column, at: Column) -> Column:
    """Integral of the held signal from t[0] to each time."""
    whole = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 1)
    return whole[k] + u[k] * (at - t[k])


def _held_at(t: Column, u: Column, grid: Column, step_s: float) -> Column:
    """The held value where one value is held over the whole step (but for rounding), else NaN."""
    slack = 1e-9 * step_s + 4 * np.spacing(np.abs(grid).max())
    first = np.clip(np.searchsorted(t, grid + slack, side="right") - 1, 0, len(t) - 1)
    last = np.clip(np.searchsorted(t, grid + step_s - slack, side="right") - 1, 0, len(t) - 1)
    changes = np.concatenate([[0], np.cumsum(np.diff(u) != 0)])
    return np.where(changes[first] == changes[last], u[first], np.nan)


def sampled(times: Column, values: Column, grid: Column, step_s: float) -> Column:
    """Values at the grid, NaN outside of the samples and in long gaps; low-passed first when the step grows."""
    result = np.full(len(grid), np.nan)
    there = np.isfinite(times) & np.isfinite(values)
    times, first = np.unique(times[there], return_index=True)  # one sample may stand in two rows
    values = values[there][first]
    if not len(times):
        return result
    usual = float(np.median(np.diff(times))) if len(times) > 1 else step_s
    breaks = np.flatnonzero(np.diff(times) > GAP_SAMPLES * usual * (1 + 1e-6)) + 1
    slack = 1e-6 * usual  # rounding of a grid that is a sum
    for a, b in zip(np.r_[0, breaks], np.r_[breaks, len(times)], strict=True):
        inside = slice(*np.searchsorted(grid, (times[a] - slack, times[b - 1] + slack)))
        if inside.start < inside.stop:
            result[inside] = _segment(times[a:b], values[a:b], grid[inside], step_s, usual)
    return result


def _segment(times: Column, values: Column, grid: Column, step_s: float, usual: float) -> Column:
    """Values of one stretch without long gaps, at the grid."""
    parts = math.ceil(min(step_s / usual, 2 * MAX_PARTS) - 1e-6)
    if parts > MAX_PARTS:
        raise ValueError(f"a step of {step_s} s is more than {MAX_PARTS} samples long")
    if parts < 2 or len(times) < 2:
        return np.interp(grid, times, values)
    count = (len(grid) - 1) * parts + 1
    fine = grid[0] + step_s / parts * np.arange(count)
    return _low_passed(np.interp(fine, times, values), parts)[::parts]


def _low_passed(x: Column, parts: int) -> Column:
    """Zero-phase low-pass of an even column; both ends go on point-symmetrically: straight lines stay."""
    from scipy.signal import oaconvolve  # half a second, for commands that resample nothing

    half = LOBES * parts
    cutoff = (1 + FLAT) / 2 / parts  # of the fine Nyquist frequency, between flat and stopped
    n = np.arange(-half, half + 1)
    kernel = cutoff * np.sinc(cutoff * n) * np.kaiser(2 * half + 1, _BETA)
    kernel /= kernel.sum()
    if len(x) < 2:
        return x
    passed: Column = oaconvolve(np.pad(x, half, mode="reflect", reflect_type="odd"), kernel, "valid")
    return passed
