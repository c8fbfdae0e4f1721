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

from hoopd.recording.recording import HOLDS, Column, Recording, Signal, from_signals
from hoopd.recording.resample import held_mean, sampled
from hoopd.recording.tables import MAX_ROWS
from hoopd.recording.timeline import TORQUE_TIMES, switch_times
from hoopd.recording.unwrap import unwrapped

__all__ = ["aged", "between", "joined", "resampled", "shifted", "unwrapped", "without"]

# Older is a mistake in the unit: seconds, or of what is sampled more rarely so many steps.
MAX_AGE_S, MAX_AGE_STEPS = 1.0, 50.0
JOINT_S = 1.0  # a picture taken 50 ms before its row must not come before the end of the recording before
# Without an input nothing else ends a run than a pause (`PAUSE_STEPS`), and the row of nothing is within it.
JOINT_STEPS = 7


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
    extra = dict(recording.extra)
    if TORQUE_TIMES in extra:
        extra[TORQUE_TIMES] = extra[TORQUE_TIMES] + offset
    inputs, channels = _signals(recording, lambda signal: dataclasses.replace(signal, t=signal.t + offset))
    return recording.replaced(t=recording.t + offset, inputs=inputs, channels=channels, extra=extra)


def aged(recording: Recording, **ages_s: float | None) -> Recording:
    """Channels sampled some seconds before their row, None: as it is.

    ages_s: by name of the sample times, `y_s` of the board's readings and otherwise CHANNEL_s: CHANNEL_t = t - age;
    the inputs go on acting at t. ValueError for an age below 0 or beyond MAX_AGE_S and MAX_AGE_STEPS, or where the
    recording has sample times of its own.
    """
    times: dict[str, Any] = {}
    for key, age_s in ages_s.items():
        if age_s is not None:
            name = key.removesuffix("_s")
            times[f"{name}_t"] = recording.t - _checked_age(recording, name, age_s)
    if recording.is_tick:  # else the board's sample times would say when a torque acts
        times["extra"] = {**recording.extra, TORQUE_TIMES: switch_times(recording)}
    return recording.replaced(**times)


def _checked_age(recording: Recording, name: str, age_s: float) -> float:
    most = max(MAX_AGE_S, MAX_AGE_STEPS * recording.sample_time_s) if len(recording) > 1 else MAX_AGE_S
    if not 0.0 <= age_s <= most:
        raise ValueError(f"{name} must be 0 to {most:g} s, not {age_s:g}")
    if has_times(recording, name):
        raise ValueError(f"{name}: {recording.source or 'the recording'} has sample times of its own ({name}_t)")
    return age_s


def has_times(recording: Recording, name: str) -> bool:
    """Whether a channel (or `y`, the board's) was sampled at other times than its row's; ValueError when unknown."""
    try:
        times = recording.column(f"{name}_t")
    except KeyError:
        raise ValueError(f"{name}: the recording has no such sample times") from None
    return not np.array_equal(times, recording.t, equal_nan=True)


def joined(recordings: Sequence[Recording]) -> Recording:
    """One recording after the other on one clock, with one row of nothing (all signals NaN) as the gap between two.

    The first keeps its times; each next begins JOINT_S, or five steps, after the last row before it. Of `extra`,
    columns of numbers and text that all have are kept, whole numbers are not (they have no value for missing).
    ValueError for an empty list, or when their signals differ.
    """
    if not recordings:
        raise ValueError("nothing to join")
    if any(_form(item) != _form(recordings[0]) for item in recordings):
        raise ValueError("recordings of different signals or units cannot be joined")
    parts, steps = [recordings[0]], 5 if recordings[0].inputs else JOINT_STEPS
    for recording in recordings[1:]:
        gap = _gap_after(parts[-1])
        last_s = float(parts[-1].t[-1])
        parts += [gap, shifted(recording, last_s + max(JOINT_S, steps * (float(gap.t[0]) - last_s)))]
    return _stacked(parts, recordings)


def resampled(recording: Recording, step_s: float) -> Recording:
    """The recording at t[0], t[0] + step_s, ... up to its last row; ValueError for an impossible step.

    Inputs that are held: mean over the new step of what acted (`timeline.switch_times`), missing when a part of it is.
    Channels and inputs that go straight: read at the new t from their own times, straight between samples, missing in
    gaps of more than three samples; when the step grows, low-passed first (zero phase, within 0.1 % up to 0.8 of the
    new Nyquist frequency): of what were means, inputs are smooth then. Angles are unwrapped before. `extra` is dropped.
    All new times are t.
    """
    t = _grid(recording, step_s)
    channels = {
        name: dataclasses.replace(signal, values=sampled(signal.t, signal.values, t, step_s), t=t, hold=HOLDS[0])
        for name, signal in unwrapped(recording).channels.items()
    }
    inputs = {
        name: dataclasses.replace(
            signal, values=_resampled_input(recording, name, t, step_s), t=t, hold=_held_after(signal)
        )
        for name, signal in recording.inputs.items()
    }
    return recording.replaced(t=t, inputs=inputs, channels=channels, extra={})


def _resampled_input(recording: Recording, name: str, t: Column, step_s: float) -> Column:
    signal, times = recording.inputs[name], np.maximum.accumulate(switch_times(recording, name))
    resample = held_mean if signal.hold == "zero" else sampled
    return resample(times, signal.values, t, step_s)


def _held_after(signal: Signal) -> str:
    """What was a mean is filtered by then."""
    return "smooth" if signal.hold == "mean" else signal.hold


def without(recording: Recording, *signals: str) -> Recording:
    """The recording with these signals missing in every row; ValueError for an unknown one."""
    for name in signals:
        if name not in recording.signals:
            raise ValueError(f"no signal {name!r}; there are {', '.join(recording.signals)}")
    return recording.replaced(**{name: np.full(len(recording), np.nan) for name in signals})


def _form(recording: Recording) -> list[tuple[str, str, str]]:
    return [(name, signal.unit, signal.hold) for name, signal in recording.signals.items()]


def _signals(recording: Recording, change: Callable[[Signal], Signal]) -> tuple[dict[str, Signal], dict[str, Signal]]:
    """Inputs and channels, all changed in the same way."""
    inputs, channels = (
        {name: change(signal) for name, signal in group.items()} for group in (recording.inputs, recording.channels)
    )
    return inputs, channels


def _each(recording: Recording, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Recording:
    """Every column changed in the same way."""
    inputs, channels = _signals(recording, lambda s: dataclasses.replace(s, values=change(s.values), t=change(s.t)))
    extra = {name: change(column) for name, column in recording.extra.items()}
    return recording.replaced(t=change(recording.t), inputs=inputs, channels=channels, extra=extra)


def _gap_after(recording: Recording) -> Recording:
    """One row of nothing, a step after the last one."""
    step = recording.sample_time_s
    t = np.array([recording.t[-1] + (step if math.isfinite(step) else 0.02)])
    inputs, channels = _signals(recording, lambda s: dataclasses.replace(s, values=np.array([np.nan]), t=t))
    return from_signals(t, inputs, channels)


def _stacked(parts: Sequence[Recording], sources: Sequence[Recording]) -> Recording:
    def stacked(group: str, name: str) -> Signal:
        signals: list[Signal] = [getattr(part, group)[name] for part in parts]
        values, t = (np.concatenate([getattr(signal, key) for signal in signals]) for key in ("values", "t"))
        return dataclasses.replace(signals[0], values=values, t=t)

    inputs, channels = (
        {name: stacked(group, name) for name in getattr(parts[0], group)} for group in ("inputs", "channels")
    )
    extra = {name: np.concatenate([_extra(part, sources[0], name) for part in parts]) for name in _shared(sources)}
    names = list(dict.fromkeys(item.source for item in sources if item.source))
    lost = "; ".join(dict.fromkeys(item.lost for item in sources if item.lost))
    config = sources[0].config if len({item.config for item in sources}) == 1 else ""
    t = np.concatenate([part.t for part in parts])
    return from_signals(t, inputs, channels, source=" + ".join(names), config=config, extra=extra, lost=lost)


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
