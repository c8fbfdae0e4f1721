"""Jumps of a counter: counts that were lost, a coupling that slipped, an index that set it anew.

A place that goes from one row to the next by far more than its speed before and after takes it, and then goes on from
there, was not moved so by any force. Where it counts from is another place from then on; the way itself is as good as
before, so that the jump is taken out of all that follows.

Rules of this file: one channel's numbers in, numbers out; what is false for a row or two comes back, and is no jump.
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
# Rows that are further apart than so many usual steps tell nothing of what was between them.
GAP = 1.5
# A scatter's standard deviation over its median.
OF_MEDIAN = 1.4826
# A channel with more of them is one that does not count a way at all.
MOST = 20


class Jump(NamedTuple):
    """Of a place, in its unit."""

    row: int  # the first one beyond it
    size: float


def jumps_of(t: Array, y: Array) -> list[Jump]:
    """Jumps of a place y (n,) at t (n,) s; NaN where nothing was read."""
    rows = np.flatnonzero(np.isfinite(y))
    if len(rows) < 4 * ROWS + 2:
        return []
    h, way = np.diff(t[rows]), np.diff(y[rows])
    if not np.all(h > 0.0):
        return []
    speed = way / h
    near = np.lib.stride_tricks.sliding_window_view(speed, 2 * ROWS + 1)
    sides = near[:, :ROWS], near[:, ROWS + 1 :]
    before, after = (np.median(side, axis=1) for side in sides)
    own = slice(ROWS, len(speed) - ROWS)
    off = (speed[own] - (before + after) / 2.0) * h[own]
    around = np.maximum(*(np.abs(s - m[:, None]).max(axis=1) for s, m in zip(sides, (before, after), strict=True)))
    counts = quantum(y[rows])
    usual = max(OF_MEDIAN * float(np.median(np.abs(off))), counts if np.isfinite(counts) else 0.0)
    least = np.maximum(BEYOND * usual, APART * h[own] * np.maximum(around, np.abs(after - before)))
    found = np.flatnonzero((np.abs(off) > least) & (h[own] <= GAP * np.median(h)))
    return [] if len(found) > MOST else [Jump(int(rows[k + ROWS + 1]), float(off[k])) for k in found]


def without_jumps(recording: Recording, found: Mapping[str, Sequence[Jump]]) -> Recording:
    """The recording with jumps taken out of what follows them, by channel."""
    return recording.replaced(**{name: _joined(recording.column(name), jumps) for name, jumps in found.items()})


def _joined(y: Array, jumps: Sequence[Jump]) -> Array:
    steps = np.zeros(len(y))
    for one in jumps:
        steps[one.row] += one.size
    return np.asarray(y - np.cumsum(steps))
