"""Recordings from named columns of any file, and recordings that tell their own names under other ones.

Rules of this file: pure; which column is what is `column_choice`'s; every refusal is one `InputError`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError
from hoopd.recording.column_choice import ANY_UNIT, Pick, SignalLayout, choose, is_time, time_column
from hoopd.recording.recording import HOLDS, Recording, Signal, from_columns, from_signals, with_hold
from hoopd.recording.tables import MAX_ROWS, Columns, Place, by_row, checked, numbers, row, vector

Array = NDArray[np.float64]


class NamedValues(NamedTuple):
    """Numbers of a file under a name: one a row, or a matrix with a row of the time on one side."""

    values: Any
    unit: str = ""


def from_fields(
    fields: Mapping[str, NamedValues],
    columns: Columns | None,
    layout: SignalLayout,
    hold: str,
    path: Path,
    key: str = "",
) -> Recording:
    """Recording of fields by name; of a matrix NAME each column is NAME_1, NAME_2 ...

    What has another length than the time, or is no matrix of it, is left out. InputError as of `choose`.
    """
    units = {name: field.unit for name, field in fields.items()}
    time = time_column(units, columns, layout, path)
    if time.column is None:
        rows = _usual_length(fields)
    else:
        rows = len(vector(fields[time.column].values, path, _place(key, time.column)))
    if rows > MAX_ROWS:
        raise InputError(path, key, f"more than {MAX_ROWS} rows")
    single = _split(fields, rows, path, key)
    picks = choose({name: field.unit for name, field in single.items()}, columns, layout, path)
    return built(picks, {name: field.values for name, field in single.items()}, layout, hold, path)


def built(
    picks: Mapping[str, Pick],
    arrays: Mapping[str, Array],
    layout: SignalLayout,
    hold: str,
    path: Path,
    place: Place = row,
    **about: Any,
) -> Recording:
    """Recording of chosen columns in the plant's units; InputError names row and column of an impossible number."""
    if hold not in HOLDS:
        raise InputError(path, "hold", f"unknown {hold!r}; known: {', '.join(HOLDS)}")
    t = _time(picks, arrays, path)
    if not len(t):
        raise InputError(path, "", "holds no rows")
    columns = {name: _scaled(pick, arrays, len(t)) for name, pick in picks.items()} | {"t": t}
    own = _with_units(layout, picks)
    try:
        recording = _recording(columns, own, hold, source=Path(path).name, **about)
    except ValueError as error:
        raise InputError(path, "", str(error)) from None
    return checked(recording, path, place)


def renamed(recording: Recording, columns: Columns | None, layout: SignalLayout, path: Path) -> Recording:
    """A recording that tells its own names and units, as one of this plant; InputError when it is none of it."""
    there = recording.columns()
    units = {name: signal.unit for name, signal in recording.signals.items()}
    available = {name: units.get(name, "s") for name in there}
    picks = choose(available, columns, layout, path)
    for name in list(picks):  # sample times come along with what was sampled
        pick = picks[name]
        if pick.column in recording.channels and f"{name}_t" in layout.units and f"{name}_t" not in picks:
            picks[f"{name}_t"] = Pick(_times_of(recording, str(pick.column)))
    there |= {_times_of(recording, name): signal.t for name, signal in recording.channels.items()}
    holds = {signal.hold for signal in (recording.inputs or recording.channels).values()}
    hold = holds.pop() if len(holds) == 1 else HOLDS[0]
    return built(picks, there, layout, hold, path, config=recording.config, lost=recording.lost)


def _times_of(recording: Recording, name: str) -> str:
    """A name for a channel's times that no column has."""
    return f"times of {name}"


def _recording(columns: dict[str, Array], layout: SignalLayout, hold: str, **about: Any) -> Recording:
    if layout.is_tick:
        recording = from_columns(columns, **about)
        return with_hold(recording, hold)
    t = columns["t"]

    def signal(name: str, unit: str) -> Signal:
        values = columns.get(name)
        missing = np.full(len(t), np.nan)
        return Signal(missing if values is None else values, columns.get(f"{name}_t", t), unit, hold)

    inputs = {name: signal(name, unit) for name, unit in layout.inputs.items()}
    channels = {name: signal(name, unit) for name, unit in layout.channels.items()}
    return with_hold(from_signals(t, inputs, channels, **about), hold)


def _time(picks: Mapping[str, Pick], arrays: Mapping[str, Array], path: Path) -> Array:
    """The time of the rows: a column, or rows that are a step apart."""
    pick = picks["t"]
    if pick.column is not None:
        return _scaled(pick, arrays, 0)
    if not pick.scale > 0.0:
        raise InputError(path, "t", f"rows are a positive number of seconds apart, not {pick.scale:g}")
    rows = next((len(arrays[one.column]) for one in picks.values() if one.column is not None), 0)
    return np.asarray(pick.scale * np.arange(rows), dtype=float)


def _with_units(layout: SignalLayout, picks: Mapping[str, Pick]) -> SignalLayout:
    """The layout with the units that a file says where no plant does."""
    if ANY_UNIT not in layout.units.values():
        return layout
    said = {name: pick.unit for name, pick in picks.items()}
    inputs, channels = (
        {name: said.get(name, "") if unit == ANY_UNIT else unit for name, unit in part.items()}
        for part in (layout.inputs, layout.channels)
    )
    return SignalLayout(inputs, channels)


def _usual_length(fields: Mapping[str, NamedValues]) -> int:
    """The length that most fields have along their longer side."""
    arrays = [np.asarray(field.values) for field in fields.values()]
    sides = [max(one.shape) for one in arrays if one.dtype.kind in "fiu" and one.ndim in (1, 2) and one.size > 1]
    return max(set(sides), key=lambda side: (sides.count(side), side)) if sides else 0


def _scaled(pick: Pick, arrays: Mapping[str, Array], rows: int) -> Array:
    if pick.column is None:
        return np.full(rows, pick.scale)
    column = arrays[pick.column]
    with np.errstate(over="ignore"):  # told where the columns are checked
        return column if pick.scale == 1.0 else column * pick.scale


def _split(fields: Mapping[str, NamedValues], rows: int, path: Path, key: str) -> dict[str, NamedValues]:
    """Fields with one number a row; a matrix gives one for each of its columns."""
    single: dict[str, NamedValues] = {}
    for name, field in fields.items():
        array = np.asarray(field.values)
        if array.dtype.kind not in "fiu" or rows not in array.shape or array.ndim not in (1, 2):
            continue
        place = _place(key, name)
        if array.size == rows:
            single[name] = NamedValues(numbers(array, path, place).ravel(), field.unit)
            continue
        table = by_row(array, rows, path, place, samples_first=True)
        single |= {f"{name}_{k + 1}": NamedValues(table[:, k], field.unit) for k in range(table.shape[1])}
    return single


def _place(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def chosen(
    groups: Mapping[str, dict[str, NamedValues]], plain: dict[str, NamedValues], path: Path, experiment: str | None
) -> tuple[str, dict[str, NamedValues]]:
    """The group that is asked for, else the only one, else the only one with a time, else what stands beside them."""
    if experiment is not None:
        if experiment not in groups:
            raise InputError(path, experiment, f"no such struct with signals; there are {', '.join(groups) or 'none'}")
        return experiment, groups[experiment]
    timed = [name for name, fields in groups.items() if has_time(fields)]
    names = timed if timed or has_time(plain) else list(groups)
    if len(names) == 1:
        return names[0], groups[names[0]]
    if names:
        raise InputError(path, "", f"holds {', '.join(names[:8])}: choose one with --experiment")
    if not plain:
        raise InputError(path, "", "holds no struct and no arrays with signals")
    return "", plain


def has_time(fields: Mapping[str, NamedValues]) -> bool:
    """Whether one of the signals is the time."""
    return any(map(is_time, fields))
