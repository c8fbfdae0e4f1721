"""Jumps of a counter: counts that were lost, a coupling that slipped, an index that set it anew.

A place that goes from one row to the next by far more than its speed before and after takes it, and then goes on from
there, was not moved so by any force. Where it counts from is another place from then on; the way itself is as good as
before, so that the jump is taken out of all that follows.

Only what moves on both sides of it, the same way, and is read anew in every row tells one: from rest to rest a fast
plant goes as far in a row, and a reading that is held does so in every one that is new.

Rules of this file: one channel's numbers in, numbers out; what is false for a while comes back, and is no jump.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.noise_floor import quantum
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]

# Rows on either side whose median is the speed there.
ROWS = 3
# A jump is so many times what a row is usually off its neighbours' speed, or of a count,
BEYOND = 25.0
# and so many times what its neighbours are off, and what the speed changes by there: a motion that is sampled finely.
APART = 4.0
# What moves goes by so many times that in a row.
MOVES = 2.0
# Rows that are further apart than so many usual steps tell nothing of what was between them.
GAP = 1.5
# A scatter's standard deviation over its median.
OF_MEDIAN = 1.4826
# With more of them, and more than one in so many rows, a channel is one that does not count a way at all.
MOST, ROWS_APART = 20, 200


class Jump(NamedTuple):
    """Of a place, in its unit."""

    row: int  # the first one beyond it
    size: float


def jumps_of(t: Array, y: Array, resolution: float | None = None) -> list[Jump]:
    """Jumps of a place, in the order of time.

    Parameters
    ----------
    t : (n,) array
        s.
    y : (n,) array
        The place; NaN where nothing was read.
    resolution : float, optional
        A count, in the unit of y, where it is known.

    Returns
    -------
    list of Jump
        More of them than `are_usual` allows are how the channel is, and no fault of a moment.
    """
    rows = _read_anew(t, y)
    if len(rows) < 4 * ROWS + 2:
        return []
    h, way = np.diff(t[rows]), np.diff(y[rows])
    speeds = np.lib.stride_tricks.sliding_window_view(way / h, 2 * ROWS + 1)
    sides = speeds[:, :ROWS], speeds[:, ROWS + 1 :]
    before, after = (np.median(side, axis=1) for side in sides)
    middle = slice(ROWS, len(h) - ROWS)
    size = (speeds[:, ROWS] - (before + after) / 2.0) * h[middle]
    around = np.maximum(*(np.abs(s - m[:, None]).max(axis=1) for s, m in zip(sides, (before, after), strict=True)))
    usual = max(OF_MEDIAN * float(np.median(np.abs(size))), resolution or _count(y[rows], way))
    least = np.maximum(BEYOND * usual, APART * h[middle] * np.maximum(around, np.abs(after - before)))
    dense = np.lib.stride_tricks.sliding_window_view(h, 2 * ROWS + 1).max(axis=1) <= GAP * np.median(h)
    slower = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    moves = slower * h[middle] > MOVES * usual
    if usual == 0.0:
        return []
    found = np.flatnonzero((np.abs(size) > least) & dense & moves)
    return [Jump(int(rows[k + ROWS + 1]), float(size[k])) for k in found]


def are_usual(found: Sequence[Jump], rows: int) -> bool:
    """Whether so many jumps in so many rows are how a channel is."""
    return len(found) > max(MOST, rows // ROWS_APART)


def _read_anew(t: Array, y: Array) -> NDArray[np.intp]:
    """Rows with a reading that differs from the one before, later than all before."""
    rows = np.flatnonzero(np.isfinite(y))
    latest = np.maximum.accumulate(t[rows])
    rows = rows[np.append(True, np.diff(latest) > 0.0)] if len(rows) else rows
    return rows[np.append(True, np.diff(y[rows]) != 0.0)] if len(rows) else rows


def _count(y: Array, way: Array) -> float:
    """The step of a counter, also of one that goes on at one speed; 0 where it does not count."""
    steps = [one for one in (quantum(y), quantum(way)) if np.isfinite(one)]
    return min(steps, default=0.0)


def without_jumps(recording: Recording, found: Mapping[str, Sequence[Jump]]) -> Recording:
    """The recording with jumps taken out of what follows them, by channel."""
    return recording.replaced(**{name: _joined(recording.column(name), jumps) for name, jumps in found.items()})


def _joined(y: Array, jumps: Sequence[Jump]) -> Array:
    steps = np.zeros(len(y))
    for one in jumps:
        steps[one.row] += one.size
    return np.asarray(y - np.cumsum(steps))
