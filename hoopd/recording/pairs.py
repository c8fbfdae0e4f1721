"""Two recordings of the same experiment over each other: by how much the second is shifted, and how far it is off.

Rules of this file: from two recordings to numbers; nothing is judged. Both begin at zero; the shift is the one at which
their inputs agree best, and none where they do not agree: then they are no repetitions of one signal.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hoopd.files.reading import InputError
from hoopd.recording.recording import PAUSE_STEPS, Column, Recording, Signal

# Correlation of the inputs from which on they are the same signal, and the part of the shorter one that has to overlap.
ALIKE, OVERLAP = 0.8, 0.5
# Lags whose correlations are nearer to each other than this agree alike.
SAME = 0.01
# The ball's angle, told from -pi to pi or on and on.
AGAIN_AFTER_A_TURN = frozenset({"psi"})
LONGEST = 2**20  # samples that are correlated: six hours of ticks


class SignalDifference(NamedTuple):
    """Of one channel or input: the second less the first, at the times of the first, s, from its beginning."""

    unit: str
    t: Column
    values: Column
    first_rms: float
    second_rms: float
    rms: float
    mean: float
    largest: float  # of the magnitudes


class RecordingPair(NamedTuple):
    """How the second lies over the first."""

    shift_s: float  # what happens at t of the first happens at t + shift of the second, each from its own beginning
    correlation: float  # of the inputs there; NaN where neither has one that moves
    signals: Mapping[str, SignalDifference]


def paired(first: Recording, second: Recording) -> RecordingPair:
    """Align two recordings by their inputs, and subtract what both have.

    Parameters
    ----------
    first, second : Recording
        The second is subtracted from at the sample times of the first.

    Returns
    -------
    RecordingPair

    Raises
    ------
    InputError
        They have no signal in common.

    Examples
    --------
    >>> from hoopd.recording.recording import from_columns
    >>> t = np.arange(200) * 0.02
    >>> u = np.sign(np.sin(t * t * 9.0))
    >>> late = from_columns({"t": t + 5.0, "u": np.roll(u, 10), "psi": np.roll(u, 10) + 0.1})
    >>> pair = paired(from_columns({"t": t, "u": u, "psi": u}), late)
    >>> round(pair.shift_s, 3), round(pair.signals["psi"].mean, 3)
    (0.2, 0.1)
    """
    names = [name for name in first.signals if _known(first.signals[name]) and name in second.signals]
    names = [name for name in names if _known(second.signals[name]) and _one_unit(first, second, name)]
    if not names:
        raise InputError(second.source, "", f"has no signal in common with {first.source}")
    shift_s, correlation = _shift(first, second)
    start = float(second.t[0]) + shift_s
    differences = {
        name: _difference(
            first.signals[name], second.signals[name], float(first.t[0]), start,
            held=name in first.inputs, turns=name in AGAIN_AFTER_A_TURN,
        )
        for name in names
    }  # fmt: skip
    return RecordingPair(shift_s, correlation, {name: one for name, one in differences.items() if len(one.t)})


def _one_unit(first: Recording, second: Recording, name: str) -> bool:
    """What is in another unit is not subtracted; one that nobody told may be any."""
    one, other = first.signals[name].unit, second.signals[name].unit
    return not one or not other or one == other


def _known(signal: Signal) -> bool:
    return bool((np.isfinite(signal.values) & np.isfinite(signal.t)).any())


def _shift(first: Recording, second: Recording) -> tuple[float, float]:
    """Seconds, and the correlation there; no shift where the inputs are not alike."""
    name = next((name for name in first.inputs if name in second.inputs and _moves(first, second, name)), None)
    if name is None:
        return 0.0, float("nan")
    step = float(np.median(np.diff(first.t)))
    a, b = (_gridded(one.inputs[name], float(one.t[0]), step) for one in (first, second))
    lag, correlation = _best_lag(a, b)
    return (lag * step if correlation >= ALIKE else 0.0), correlation


def _moves(first: Recording, second: Recording, name: str) -> bool:
    return all(len(one) > 2 and np.nanstd(one.inputs[name].values) > 0.0 for one in (first, second))


def _gridded(signal: Signal, start_s: float, step_s: float) -> Column:
    """Held values on an even grid, the mean taken off."""
    known = np.isfinite(signal.t) & np.isfinite(signal.values)
    t, values = signal.t[known] - start_s, signal.values[known]
    grid = np.arange(min(LONGEST, int(t[-1] / step_s + 0.5) + 1)) * step_s
    # half a step of room: a tick that is a little late belongs to its own place
    found = values[np.clip(np.searchsorted(t, grid + step_s / 2, side="right") - 1, 0, len(t) - 1)]
    return np.asarray(found - found.mean(), float)


def _best_lag(a: Column, b: Column) -> tuple[int, float]:
    """By how many samples b is later than a where they correlate best, each lag over what overlaps."""
    size = 1 << (len(a) + len(b) - 1).bit_length()
    lags = np.arange(-(len(a) - 1), len(b))
    overlap = np.minimum(len(a), len(b) - lags) - np.maximum(0, -lags)

    def summed(x: Column, y: Column) -> Column:
        """sum_k x(k) y(k + lag) for every lag."""
        whole = np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)
        return np.asarray(whole[lags % size], float)

    power = summed(a * a, np.ones(len(b))) * summed(np.ones(len(a)), b * b)
    enough = (overlap >= OVERLAP * min(len(a), len(b))) & (power > 1e-12 * power.max())
    correlation = np.where(enough, summed(a, b) / np.sqrt(np.where(enough, power, 1.0)), -1.0)
    # of a periodic input every period agrees as well: the lag at which most of both is there
    best = int(np.argmax(np.where(correlation >= correlation.max() - SAME, overlap, 0)))
    return int(lags[best]), float(correlation[best])


def _difference(
    first: Signal, second: Signal, first_start: float, second_start: float, *, held: bool, turns: bool
) -> SignalDifference:
    """`held`: the second's value is that of its tick, which may come half a tick later, else on a straight line;
    `turns`: a whole turn is no difference."""
    t, values = _samples(first, first_start)
    other_t, other = _samples(second, second_start)
    step = float(np.median(np.diff(other_t))) if len(other_t) > 1 else 0.0
    after = np.searchsorted(other_t, t + (step / 2 if held else 0.0), side="right" if held else "left")
    before, after = (np.clip(places, 0, len(other_t) - 1) for places in (after - 1, after))
    inside = (t >= other_t[0] - (step / 2 if held else 0.0)) & (t <= other_t[-1])
    inside &= (other_t[after] - other_t[before] <= PAUSE_STEPS * step) | (other_t[after] == t)
    there = other[before] if held else np.interp(t, other_t, np.unwrap(other) if turns else other)
    t, a, b = t[inside], values[inside], there[inside]
    off = np.arctan2(np.sin(b - a), np.cos(b - a)) if turns else b - a
    return SignalDifference(first.unit, t, off, _rms(a), _rms(b), _rms(off), _mean(off), _largest(off))


def _samples(signal: Signal, start_s: float) -> tuple[Column, Column]:
    known = np.isfinite(signal.t) & np.isfinite(signal.values)
    return signal.t[known] - start_s, signal.values[known]


def _rms(values: Column) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _mean(values: Column) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _largest(values: Column) -> float:
    return float(np.abs(values).max()) if len(values) else float("nan")
