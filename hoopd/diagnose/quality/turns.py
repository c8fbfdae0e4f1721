"""Turns of an angle of which some samples are false.

Rules of this file: a false value is no turn; whatever goes on by whole turns is decided by the good samples
around, never by one.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import pi

import numpy as np
from numpy.typing import NDArray

from hoopd.recording.recording import Recording
from hoopd.recording.unwrap import unwrapped

Array = NDArray[np.float64]

# Steps whose median is the angle's rate there: a fifth of false values spoils two fifths of them.
STEPS = 11
# Neighbours agree to this, rad: what noise and a change of rate leave, a ninth of a turn.
AGREES = 0.7


def turned(recording: Recording, cameras: Iterable[str] = ()) -> Recording:
    """The recording with unwrapped angles; those that cameras see through false values and past the axis too."""
    found = {name: _turned(recording.column(name)) for name in cameras}
    return unwrapped(recording).replaced(**{name: angle for name, angle in found.items() if angle is not None})


def _turned(angle: Array) -> Array | None:
    """(n,) through false values; None for one that is unwrapped already, or too short."""
    rows = np.flatnonzero(np.isfinite(angle))
    if len(rows) < STEPS + 1 or np.abs(angle[rows]).max() > pi * (1 + 1e-6):
        return None
    seen, result = angle[rows], angle.copy()
    # what turns with the local rate is taken out before the shorter way is looked for
    steps = np.pad(_wrapped(np.diff(seen)), STEPS // 2, mode="edge")
    rate = np.median(np.lib.stride_tricks.sliding_window_view(steps, STEPS), axis=1)
    base = np.concatenate([[0.0], np.cumsum(rate)])
    rest = _through_good(seen - base)
    result[rows] = _by_whole_turns(seen, base + rest)
    return np.asarray(result + (seen[0] - result[rows[0]]))


def _through_good(rest: Array) -> Array:
    """What is left beside the rate (k,), unwrapped over samples that agree with a neighbour, lines between them."""
    close = np.abs(_wrapped(np.diff(rest))) < AGREES
    good = np.flatnonzero(np.append(False, close) | np.append(close, False))
    if len(good) < 2:
        return np.unwrap(rest)
    return np.interp(np.arange(len(rest)), good, np.unwrap(rest[good]))


def near(angle: Array) -> Array:
    """The angle (n,) within half a turn of the median of its neighbours."""
    rows = np.flatnonzero(np.isfinite(angle))
    result = angle.copy()
    if len(rows) < 5:
        return result
    padded = np.pad(angle[rows], 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    result[rows] = _by_whole_turns(angle[rows], middle + _wrapped(angle[rows] - middle))
    return result


def _by_whole_turns(angle: Array, wanted: Array) -> Array:
    """The angle nearest to the wanted one; equal angles stay equal to the bit."""
    return np.asarray(angle + 2.0 * pi * np.round((wanted - angle) / (2.0 * pi)))


def _wrapped(angle: Array) -> Array:
    """Into [-pi, pi)."""
    return np.asarray(np.remainder(angle + pi, 2.0 * pi) - pi)
