"""Cutting, joining and resampling of recordings: each function gives a new Recording and leaves its input alone.

Rules of this file: pure; nothing is invented where samples are missing; a gap is a row whose `u` is NaN, and nothing is
integrated or interpolated across it. A fit takes missing and uneven samples as they are: resample for other programs.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.recording.recording import UNITS, Column, Recording, from_columns
from hoopd.recording.resample import held_mean, sampled
from hoopd.recording.tables import MAX_ROWS
from hoopd.recording.timeline import TORQUE_TIMES, switch_times
from hoopd.recording.unwrap import unwrapped

__all__ = ["aged", "between", "joined", "resampled", "shifted", "unwrapped", "without"]

_TIMES = ("t", "y_t", "psi_t")
_SIGNALS = tuple(name for name in UNITS if name not in _TIMES)
MAX_AGE_S = 1.0  # older is a mistake in the unit
JOINT_S = 1.0  # a psi that was seen 50 ms before its row must not come before the end of the recording before


def between(recording: Recording, start_s: float | None = None, end_s: float | None = None) -> Recording:
    """Rows with start_s <= t <= end_s on the recording's own clock, None: open; ValueError when there is none."""
    t = recording.t
    keep = (t >= (-math.inf if start_s is None else start_s)) & (t <= (math.inf if end_s is None else end_s))
    if not keep.any():
        raise ValueError(f"no row between {_text(start_s)} and {_text(end_s)} s; there are {t[0]:.6g} to {t[-1]:.6g} s")
    return _each(recording, lambda column: column[keep])


def shifted(recording: Recording, start_s: float) -> Recording:
    """The same rows with t beginning at start_s; sample times keep their distance to t."""
    offset = start_s - recording.t[0]
    columns: dict[str, Any] = {name: getattr(recording, name) + offset for name in _TIMES}
    if TORQUE_TIMES in recording.extra:
        columns["extra"] = {**recording.extra, TORQUE_TIMES: recording.extra[TORQUE_TIMES] + offset}
    return _with(recording, columns)


def aged(recording: Recording, y_s: float | None = None, psi_s: float | None = None) -> Recording:
    """The board's readings taken y_s seconds before their row, the ball's angle psi_s, None: as it is.

    y_t = t - y_s, psi_t = t - psi_s; the torque goes on acting at t. ValueError for an age outside 0 to MAX_AGE_S, or
    where the recording has sample times of its own.
    """
    times: dict[str, Any] = {}
    for name, age_s in (("y", y_s), ("psi", psi_s)):
        if age_s is not None:
            times[f"{name}_t"] = recording.t - _checked_age(recording, name, age_s)
    return _with(recording, {**times, "extra": {**recording.extra, TORQUE_TIMES: switch_times(recording)}})


def _checked_age(recording: Recording, name: str, age_s: float) -> float:
    if not 0.0 <= age_s <= MAX_AGE_S:
        raise ValueError(f"{name} must be 0 to {MAX_AGE_S:g} s, not {age_s:g}")
    if has_times(recording, name):
        raise ValueError(f"{name}: {recording.source or 'the recording'} has sample times of its own ({name}_t)")
    return age_s


def has_times(recording: Recording, name: str) -> bool:
    """Whether `y` or `psi` was sampled at other times than its row's."""
    return not np.array_equal(getattr(recording, f"{name}_t"), recording.t, equal_nan=True)


def joined(recordings: Sequence[Recording]) -> Recording:
    """One recording after the other on one clock, with one row of nothing (all signals NaN) as the gap between two.

    The first keeps its times; each next begins JOINT_S, or five steps, after the last row before it. Of `extra`,
    columns of numbers and text that all have are kept, whole numbers are not (they have no value for missing).
    ValueError for an empty list.
    """
    if not recordings:
        raise ValueError("nothing to join")
    parts = [recordings[0]]
    for recording in recordings[1:]:
        gap = _gap_after(parts[-1])
        last_s = float(parts[-1].t[-1])
        parts += [gap, shifted(recording, last_s + max(JOINT_S, 5 * (float(gap.t[0]) - last_s)))]
    return _stacked(parts, recordings)


def resampled(recording: Recording, step_s: float) -> Recording:
    """The recording at t[0], t[0] + step_s, ... up to its last row; ValueError for an impossible step.

    u: mean over the new step of the torque as it acted (`timeline.switch_times`), missing when a part of it is.
    Outputs: read at the new t from their own sample times, straight between samples, missing in gaps of more than
    three samples; when the step grows, low-passed first (zero phase, within 0.1 % up to 0.8 of the new Nyquist
    frequency). Angles are unwrapped before. `extra` is dropped. New y_t and psi_t are t.
    """
    t = _grid(recording, step_s)
    whole = unwrapped(recording)
    outputs: dict[str, Any] = {
        name: sampled(getattr(whole, times), getattr(whole, name), t, step_s)
        for name, times in (("theta", "y_t"), ("dtheta", "y_t"), ("current", "y_t"), ("psi", "psi_t"))
    }
    u = held_mean(np.maximum.accumulate(switch_times(recording)), recording.u, t, step_s)
    return dataclasses.replace(recording, t=t, u=u, y_t=t, psi_t=t, extra={}, **outputs)


def without(recording: Recording, *signals: str) -> Recording:
    """The recording with these signals missing in every row; ValueError for an unknown one."""
    for name in signals:
        if name not in _SIGNALS:
            raise ValueError(f"no signal {name!r}; there are {', '.join(_SIGNALS)}")
    return _with(recording, {name: np.full(len(recording), np.nan) for name in signals})


def _with(recording: Recording, changes: dict[str, Any]) -> Recording:
    return dataclasses.replace(recording, **changes)


def _each(recording: Recording, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Recording:
    """Every column changed in the same way."""
    extra = {name: change(column) for name, column in recording.extra.items()}
    return _with(recording, {**{name: change(getattr(recording, name)) for name in UNITS}, "extra": extra})


def _gap_after(recording: Recording) -> Recording:
    """One row of nothing, a step after the last one."""
    step = recording.sample_time_s
    t = np.array([recording.t[-1] + (step if math.isfinite(step) else 0.02)])
    return from_columns({"t": t})


def _stacked(parts: Sequence[Recording], sources: Sequence[Recording]) -> Recording:
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in UNITS}
    extra = {name: np.concatenate([_extra(part, sources[0], name) for part in parts]) for name in _shared(sources)}
    names = list(dict.fromkeys(item.source for item in sources if item.source))
    lost = "; ".join(dict.fromkeys(item.lost for item in sources if item.lost))
    config = sources[0].config if len({item.config for item in sources}) == 1 else ""
    return Recording(**columns, source=" + ".join(names), config=config, extra=extra, lost=lost)


def _shared(sources: Sequence[Recording]) -> list[str]:
    """Extra columns that every recording has in the same shape, and that can be missing."""
    return [
        name
        for name, column in sources[0].extra.items()
        if column.dtype.kind in "fU"
        and all(name in item.extra and _shape(item.extra[name]) == _shape(column) for item in sources)
    ]


def _shape(column: NDArray[Any]) -> tuple[object, ...]:
    return (column.dtype.kind, *column.shape[1:])


def _extra(part: Recording, pattern: Recording, name: str) -> NDArray[Any]:
    if name in part.extra:
        return part.extra[name]
    column = pattern.extra[name]
    return np.full((len(part), *column.shape[1:]), np.nan if column.dtype.kind == "f" else "", column.dtype)


def _grid(recording: Recording, step_s: float) -> Column:
    t = recording.t
    if not (math.isfinite(step_s) and step_s > 0):
        raise ValueError(f"the step must be a positive time, not {step_s}")
    if len(t) < 2:
        raise ValueError("a recording of one row cannot be resampled")
    steps = float(t[-1] - t[0]) / step_s * (1 + 1e-12) + 1e-9  # the last row counts, however the times were rounded
    if steps >= MAX_ROWS:
        raise ValueError(f"a step of {step_s} s gives {steps:.3g} rows, more than {MAX_ROWS}")
    grid: Column = t[0] + step_s * np.arange(math.floor(steps) + 1)
    if not (np.diff(grid) > 0).all():
        raise ValueError(f"a step of {step_s} s is below the resolution of the time")
    return grid


def _text(time_s: float | None) -> str:
    return "..." if time_s is None else f"{time_s:g}"
