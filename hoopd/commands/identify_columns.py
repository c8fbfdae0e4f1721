"""Data of any file by its columns: `--input u1,u2 --output y1,y2`, with names and units of the user's own.

A signal is said as COLUMN[:UNIT] or NAME=COLUMN[:UNIT]; the unit is a word in figures and in the model's file, numbers
stay as they are. The time is a column, or rows are a step apart. Rows are cut where a time is skipped or an input is
missing.

Rules of this file: whatever cannot be used is an InputError that names file, column and reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.identify_data import EVEN, SAME_STEP, SHORTEST, in_step
from hoopd.files.reading import InputError
from hoopd.ident.data import Data, iddata
from hoopd.recording.column_choice import ANY_UNIT, SignalLayout
from hoopd.recording.edit import resampled
from hoopd.recording.recording import Recording, rounded_step_s
from hoopd.recording.slices import read_recording
from hoopd.recording.spans import spans

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ColumnChoice:
    """Which columns are inputs and outputs, under which names and units, and where the time is."""

    inputs: Mapping[str, tuple[str, str]]  # name: column and unit
    outputs: Mapping[str, tuple[str, str]]
    time: str = ""  # COLUMN[:UNIT], or a column that is called as times are
    step_s: float | None = None  # of rows without a time; with one, the step that rows are brought to

    @property
    def layout(self) -> SignalLayout:
        """The signals, in whatever unit."""
        return SignalLayout(dict.fromkeys(self.inputs, ANY_UNIT), dict.fromkeys(self.outputs, ANY_UNIT))

    @property
    def columns(self) -> dict[str, str | tuple[str, str]]:
        """What `hoopd.recording.load` is asked for."""
        asked: dict[str, str | tuple[str, str]] = {
            name: (column, unit) if unit else column for name, (column, unit) in {**self.inputs, **self.outputs}.items()
        }
        return asked | ({"t": self.time} if self.time else {})


def column_choice(
    inputs: Sequence[str], outputs: Sequence[str], time: str = "", step_s: float | None = None
) -> ColumnChoice:
    """The columns that options ask for; InputError where they mean nothing."""
    if not outputs:
        raise InputError("--output", "", "is missing: the columns that answer to the inputs, e.g. --output y1,y2")
    if not inputs:
        raise InputError("--input", "", "is missing: the columns that drive the outputs, e.g. --input u1,u2")
    if step_s is not None and not 0.0 < step_s < np.inf:
        raise InputError("--sample-time", "", f"must be a positive number of seconds, not {step_s:g}")
    ins, outs = _asked("--input", inputs), _asked("--output", outputs)
    if twice := set(ins) & set(outs):
        raise InputError("--output", sorted(twice)[0], "is an input, too")
    return ColumnChoice(ins, outs, time, step_s)


def read_columns(
    names: Sequence[str], choice: ColumnChoice, hold: str = "zero"
) -> tuple[list[Data], dict[str, str], list[str]]:
    """The stretches of files, the units of the signals, and what has to be said."""
    found: list[Data] = []
    units: dict[str, str] = {}
    said: list[str] = []
    for name in names:
        recording = _read(name, choice, hold)
        units |= {key: signal.unit for key, signal in recording.signals.items() if signal.unit}
        parts, notes = _stretches(recording, name, choice)
        found += parts
        said += notes
    if other := next((one for one in found if abs(one.dt / found[0].dt - 1.0) > SAME_STEP), None):
        reason = f"files of different steps ({found[0].dt:g} and {other.dt:g} s): --sample-time brings all to one"
        raise InputError(names[-1], "", reason)
    return found, units, said


def _asked(option: str, texts: Sequence[str]) -> dict[str, tuple[str, str]]:
    found: dict[str, tuple[str, str]] = {}
    for text in texts:
        name, equals, rest = (part.strip() for part in text.partition("="))
        column, _, unit = (part.strip() for part in (rest if equals else name).partition(":"))
        name = name if equals else column
        if not name or not column:
            raise InputError(option, text, "expected COLUMN[:UNIT] or NAME=COLUMN[:UNIT]")
        if name in found:
            raise InputError(option, name, "stands twice")
        found[name] = (column, unit)
    return found


def _read(name: str, choice: ColumnChoice, hold: str) -> Recording:
    """A file; rows without a time are the step apart, rows with one are brought to it."""
    timed = choice.columns
    try:
        recording = read_recording(name, timed, layout=choice.layout, hold=hold)
    except InputError as error:
        if choice.step_s is None or choice.time or "no column for the time" not in error.reason:
            raise _in_our_words(error, choice) from None
        return read_recording(name, timed | {"t": f"{choice.step_s!r}"}, layout=choice.layout, hold=hold)
    if choice.step_s is None or (np.abs(np.diff(recording.t) / choice.step_s - 1.0) < EVEN).all():
        return recording
    try:
        return resampled(recording, choice.step_s)
    except ValueError as error:
        raise InputError("--sample-time", "", str(error)) from None


def _in_our_words(error: InputError, choice: ColumnChoice) -> InputError:
    if "no column for the time" in error.reason:
        there = error.reason.partition(": say ")[0]
        return InputError(
            error.path, "", f"{there}: --time COLUMN[:UNIT], or --sample-time S where rows are evenly apart"
        )
    return error


def _stretches(recording: Recording, name: str, choice: ColumnChoice) -> tuple[list[Data], list[str]]:
    step, notes = rounded_step_s(recording), []
    y, u = _table(recording, choice.outputs), _table(recording, choice.inputs)
    kept = in_step(recording, step, name, "--sample-time S")
    known = np.asarray(np.isfinite(u).all(axis=1))
    parts = [(first + a, first + b) for first, last in kept for a, b in spans(known[first:last])]
    kept = [(a, b) for a, b in parts if b - a >= (SHORTEST if len(parts) > 1 else 1)]
    if not kept:
        raise InputError(
            name, next(iter(choice.inputs)), f"no {SHORTEST} rows follow each other with every input known"
        )
    if len(parts) > 1:
        rows = sum(b - a for a, b in kept)
        notes.append(f"{name}: rows are missing: {rows} of {len(recording)} rows used, in {len(kept)} parts")
    names = {"outputs": list(choice.outputs), "inputs": list(choice.inputs)}
    try:
        return [iddata(y[a:b], u[a:b], step, t0=float(recording.t[a]), time_axis=0, **names) for a, b in kept], notes
    except ValueError as error:
        raise InputError(name, "", str(error)) from None


def _table(recording: Recording, names: Mapping[str, object]) -> Array:
    return np.stack([recording.column(name) for name in names], axis=1)


def offsets_of(each: Sequence[Data]) -> dict[str, float]:
    """Means of all signals over all data."""
    first = each[0]
    y, u = np.concatenate([one.y for one in each]), np.concatenate([one.u for one in each])
    outputs = zip(first.outputs, np.nanmean(y, axis=0).tolist(), strict=True)
    return {**dict(outputs), **dict(zip(first.inputs, u.mean(axis=0).tolist(), strict=True))}


def without(data: Data, offsets: Mapping[str, float]) -> Data:
    """The data about an operating point; a signal that has none there stays."""
    y = np.array([offsets.get(name, 0.0) for name in data.outputs])
    u = np.array([offsets.get(name, 0.0) for name in data.inputs])
    return replace(data, y=data.y - y, u=data.u - u)
