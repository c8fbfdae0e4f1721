"""Where the drive does not answer, the clock is uneven, and an input is at its limit.

Rules of this file: read off the recording alone; what rests under a small force may be held by friction, what rests
under forces which move it elsewhere is not driven.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.outliers import stretches
from hoopd.plants.fits.repeated_samples import HELD_COUNTS
from hoopd.recording.recording import Recording
from hoopd.recording.timeline import usual_steps

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A drive answers within a tick or two; rest for longer is no delay.
REST_S = 0.3
# Of the forces at which it moves: one in four is smaller, and friction may hold those.
LEVEL = 0.25
# Clocks that move against each other by more steps than that were set; a median over so many rows tells.
SHIFT_STEPS, SHIFT_ROWS = 3.0, 15
# A longer step between rows is a missing row.
MISSING_STEPS = 1.5
# So many largest values in a row are a limit (a sine has two at its peak), unless there are only a few levels at all.
STAYS, LEVELS = 3, 8
# At a limit that nobody told of an input stays so many times as long as it is usually held.
HELD_LONGER = 3.0


class Clock(NamedTuple):
    """How even the rows are."""

    step_s: float  # usual step
    jitter_s: float  # standard deviation of a step within the usual ones
    gaps: list[tuple[float, float]]  # s, from and to, where rows are missing
    not_increasing: int  # rows with the time of the one before, or an earlier one
    steps: list[float]  # s, rows before which sensor and row clocks shift against each other


def clock(recording: Recording) -> Clock:
    """Steps, gaps and shifts of the clocks."""
    t = recording.t
    if len(t) < 2:
        return Clock(float("nan"), float("nan"), [], 0, [])
    h, usual = np.diff(t), usual_steps(t)
    long = h > MISSING_STEPS * usual
    ordinary = h[~long & (h > 0.0)]
    jitter = float(np.std(ordinary)) if len(ordinary) else float("nan")
    gaps = [(float(t[k]), float(t[k + 1])) for k in np.flatnonzero(long)]
    return Clock(float(np.median(h)), jitter, gaps, int((h <= 0.0).sum()), _shifts(recording, float(np.median(h))))


def _shifts(recording: Recording, step_s: float) -> list[float]:
    """Rows from which samples keep another distance to t: a clock that was set."""
    found = set()
    for stamps in {id(one.t): one.t for one in recording.channels.values()}.values():
        seen = np.flatnonzero(np.isfinite(stamps))
        if len(seen) < 3 * SHIFT_ROWS:
            continue
        offset = stamps[seen] - recording.t[seen]
        windows = np.lib.stride_tricks.sliding_window_view(offset, SHIFT_ROWS)
        middle = np.median(windows, axis=1)
        jumped = np.abs(middle[SHIFT_ROWS:] - middle[:-SHIFT_ROWS]) > SHIFT_STEPS * step_s
        found |= {float(recording.t[seen[a + SHIFT_ROWS]]) for a, _ in stretches(jumped)}
    return sorted(found)


def resting(place: Array, t: Array, resolution: float) -> Mask:
    """Rows (n,) of stretches of REST_S or longer in which a reading stays within HELD_COUNTS of its steps."""
    seen = np.flatnonzero(np.isfinite(place))
    mask = np.zeros(len(place), dtype=bool)
    width = max(int(np.ceil(REST_S / np.median(np.diff(t)))), 3) + 1 if len(t) > 1 else 2
    if len(seen) < width:
        return mask
    windows = np.lib.stride_tricks.sliding_window_view(place[seen], width)
    still = np.ptp(windows, axis=1) < HELD_COUNTS * resolution
    mask[seen[np.convolve(still.astype(int), np.ones(width, dtype=int)) > 0]] = True
    return mask


def unanswered(t: Array, place: Array, force: Array, resolution: float) -> list[tuple[int, int]]:
    """First and last row of stretches in which forces that move it elsewhere do not move it."""
    u, rest = np.abs(np.nan_to_num(force)), resting(place, t, resolution)
    moving = np.isfinite(place) & ~rest & (u > 0.0)
    if not moving.any():
        return []
    level = float(np.quantile(u[moving], LEVEL))
    return [(a, b) for a, b in stretches(rest) if _driven(u[a : b + 1], level)]


def _driven(u: Array, level: float) -> bool:
    return bool(np.mean(u >= 0.999 * level) > 0.5)


def reaches(u: Array, limit: float | None) -> bool:
    """Whether an input comes to a limit that is known."""
    return limit is not None and bool(np.nanmax(np.abs(u)) >= limit * (1.0 - 1e-6))


def saturated_share(u: Array, limit: float | None = None) -> float:
    """Share of rows that stay at an input's known limit; else at its largest value, for longer than it is held anywhere
    else, of an input with more than a few levels (else 0: two levels)."""
    seen = np.abs(u[np.isfinite(u)])
    if len(seen) == 0 or len(np.unique(seen)) < LEVELS:
        return 0.0
    is_known = reaches(u, limit)
    top = seen >= (limit if is_known and limit is not None else seen.max()) * (1.0 - 1e-6)
    held = np.diff(np.flatnonzero(np.diff(u[np.isfinite(u)], prepend=np.nan, append=np.nan) != 0.0))
    least = STAYS if is_known else max(STAYS, HELD_LONGER * float(np.median(held)))
    return sum(b - a + 1 for a, b in stretches(top) if b - a + 1 >= least) / len(seen)
