"""Which columns of a file are which signals of a plant, and in which unit: `--columns CHANNEL=COLUMN[:UNIT],...`.

Rules of this file: names and factors only; nothing is guessed: what is not found is one `InputError` that says what is
there. A column's unit is the one that was asked for, else the one behind its name ("Angle [deg]"), else the plant's;
where there is no plant (`ANY_UNIT`) numbers stay in the unit that the file or the user says, whatever that is.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from hoopd.files.dimensions import CELSIUS, parse_unit
from hoopd.files.reading import InputError
from hoopd.recording.tables import SKIP, Columns
from hoopd.recording.tick_columns import CHANNELS, INPUTS, TIMES

TIME = "t"
# Of a signal that no plant declares.
ANY_UNIT = "*"
# What programs call their time, in any case of letters; our own word for it is t, and T a temperature.
TIME_NAMES = ("time", "timestamps", "timestamp")
SHOWN = 12  # columns of a file that a message names
_WITH_UNIT = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")


@dataclass(frozen=True)
class SignalLayout:
    """Inputs and channels of a plant with their units."""

    inputs: Mapping[str, str]
    channels: Mapping[str, str]

    @property
    def is_tick(self) -> bool:
        """Whether it is the daemon's own."""
        return self.inputs.keys() == INPUTS.keys() and self.channels.keys() == CHANNELS.keys()

    @property
    def units(self) -> dict[str, str]:
        """Every column that a recording of it may have, and its unit: t, signals, sample times."""
        signals = {**self.inputs, **self.channels}
        times = TIMES.values() if self.is_tick else [f"{name}_t" for name in signals]
        return {TIME: "s", **signals, **dict.fromkeys(times, "s")}


TICK = SignalLayout(INPUTS, CHANNELS)


class Pick(NamedTuple):
    """Where a column comes from: a column of the file times a factor; without a column the factor itself.

    Of the time a factor without a column is the step from row to row.
    """

    column: str | None
    scale: float = 1.0
    unit: str = ""  # of a signal that no plant declares


def by_name(columns: Columns | None) -> bool:
    """Whether columns are told by name, not by their order."""
    return isinstance(columns, Mapping) or (isinstance(columns, str) and "=" in columns)


def choose(
    available: Mapping[str, str], columns: Columns | None, layout: SignalLayout, path: object
) -> dict[str, Pick]:
    """Where t and the signals of a plant come from.

    Parameters
    ----------
    available : mapping of str to str
        Columns of the file in order, each with its unit, empty where the file does not say.
    columns : str, sequence, mapping or None
        "x=Position:mm,F=Force", the same as a mapping (of `"Position"` or `("Position", "mm")`), names in the order of
        the file's columns beside the time, or None: columns are called as the plant's signals.
    layout : Layout
    path
        What a message calls the file.

    Returns
    -------
    dict of str to Pick
        t, every input, at least one channel.

    Raises
    ------
    InputError
        When a column is missing, named twice, or in a unit of another kind.
    """
    if columns is None:
        wanted = {name: (name, "") for name in layout.units if _place(name, available) is not None}
    elif by_name(columns):
        wanted = _asked(columns, layout, path)
    else:
        wanted = _in_order(columns, available, layout, path)
    if TIME not in wanted:
        wanted[TIME] = (_time(available, path), "")
    picks = {name: _pick(name, *asked, available, layout, path) for name, asked in wanted.items()}
    for name in layout.inputs:
        if name not in picks:
            raise InputError(path, "", f"no column for the input {name}{_there(available)}: {_hint(name)} or {name}=0")
    if not any(name in picks for name in layout.channels):
        first = next(iter(layout.channels), "CHANNEL")
        names = ", ".join(layout.channels) or "none"
        raise InputError(path, "", f"no column for a channel ({names}){_there(available)}: {_hint(first)}")
    return picks


def split_unit(name: str) -> tuple[str, str]:
    """Name and unit of "Angle [deg]" or "Angle (deg)"; what is no unit in the brackets belongs to the name."""
    match = _WITH_UNIT.fullmatch(name.strip())
    if match is None:
        return name.strip(), ""
    unit = (match[2] if match[2] is not None else match[3]).strip()
    try:
        parse_unit(unit)
    except ValueError:
        return name.strip(), ""
    return match[1], unit


def is_time(name: str) -> bool:
    """Whether a column is called as a time is, with or without a unit."""
    bare = split_unit(name)[0]
    return bare == TIME or bare.lower() in TIME_NAMES


def time_column(available: Mapping[str, str], columns: Columns | None, layout: SignalLayout, path: object) -> Pick:
    """Where the time comes from."""
    asked = _asked(columns, layout, path) if columns is not None and by_name(columns) else {}
    column, unit = asked.get(TIME) or (_time(available, path), "")
    return _pick(TIME, column, unit, available, layout, path)


def _asked(columns: Columns, layout: SignalLayout, path: object) -> dict[str, tuple[str, str]]:
    """Signal -> column and unit, as asked for; the unit is still in the column's text where it was one text."""
    wanted: dict[str, tuple[str, str]] = {}
    for name, value in columns.items() if isinstance(columns, Mapping) else _pairs(str(columns), path):
        _known(name, layout, path)
        if name in wanted:
            raise InputError(path, "columns", f"{name} stands twice")
        wanted[name] = (value, "") if isinstance(value, str) else value
    return wanted


def _pairs(text: str, path: object) -> list[tuple[str, str]]:
    pairs = []
    for part in text.split(","):
        name, equals, column = (piece.strip() for piece in part.partition("="))
        if not equals or not column:
            raise InputError(path, "columns", f"expected CHANNEL=COLUMN[:UNIT], found {part.strip()!r}")
        pairs.append((name, column))
    return pairs


def _in_order(
    columns: Columns, available: Mapping[str, str], layout: SignalLayout, path: object
) -> dict[str, tuple[str, str]]:
    names = [name.strip() for name in (columns.split(",") if isinstance(columns, str) else columns)]
    time = _time(available, path)
    others = [column for column in available if column != time]
    if len(names) != len(others):
        raise InputError(path, "columns", f"{len(names)} names for {len(others)} columns beside {time}")
    wanted: dict[str, tuple[str, str]] = {}
    for name, column in zip(names, others, strict=True):
        if name == SKIP:
            continue
        _known(name, layout, path)
        if name in wanted:
            raise InputError(path, "columns", f"{name} stands twice")
        wanted[name] = (column, "")
    return wanted


def _known(name: str, layout: SignalLayout, path: object) -> None:
    if name not in layout.units:
        known = ", ".join((*layout.inputs, *layout.channels))
        raise InputError(
            path, "columns", f"unknown name {name!r}; known: {known}, t; another plant's come with --plant"
        )


def _pick(name: str, column: str, unit: str, available: Mapping[str, str], layout: SignalLayout, path: object) -> Pick:
    """One column with its factor; a number is a value that does not change, a minus before a column turns its sign."""
    place = _place(column, available)
    if place is None and not unit and ":" in column:
        column, _, unit = (part.strip() for part in column.rpartition(":"))
        place = _place(column, available)
    if place is None and column.startswith("-") and _number(column) is None:
        turned = _pick(name, column[1:].strip(), unit, available, layout, path)
        return turned._replace(scale=-turned.scale)
    open_unit = layout.units[name] == ANY_UNIT
    if place is None and not open_unit and (value := _number(column)) is not None:
        return Pick(None, value * _scale(unit, layout.units[name], path, name))
    if place is None:
        close = difflib.get_close_matches(column, available, 1)
        meant = f"; did you mean {close[0]!r}?" if close else _there(available)
        raise InputError(path, f"column {column}", f"no such column for {name}{meant}")
    if open_unit:
        return Pick(place, unit=unit or available[place])
    wanted = layout.units[name]
    if not unit and not available[place] and (strange := _strange_unit(place)):
        reason = f"nobody here knows the unit {strange!r}: say it, {name}={place}:{wanted or '-'}"
        raise InputError(path, f"column {place}", reason)
    return Pick(place, _scale(unit or available[place], wanted, path, f"column {place}"))


def _strange_unit(column: str) -> str:
    """What stands as a unit in square brackets behind a name and is none that is known."""
    match = _WITH_UNIT.fullmatch(column.strip())
    return "" if match is None or match[2] is None or match[2].strip().isdigit() else match[2].strip()


def _scale(unit: str, wanted: str, path: object, key: str) -> float:
    """Factor from a unit to the plant's."""
    if not unit or unit == wanted:
        return 1.0
    try:
        have, want = parse_unit(unit), parse_unit(wanted)
    except ValueError as error:
        raise InputError(path, key, str(error)) from None
    if not have.same_kind(want):
        raise InputError(path, key, f"wrong unit {unit!r}: the plant's is {wanted or 'a plain number'}")
    if (unit in CELSIUS) != (wanted in CELSIUS):
        reason = f"{unit} and {wanted} count from elsewhere, 273.15 apart: have both the same unit, or say :{wanted}"
        raise InputError(path, key, f"{reason} where the numbers are such already")
    return 1.0 if have.same(want) else have.factor / want.factor


def _place(column: str, available: Mapping[str, str]) -> str | None:
    """The file's column of a name, with or without the unit behind it."""
    if column in available:
        return column
    bare = [name for name in available if split_unit(name)[0] == column]
    return bare[0] if len(bare) == 1 else None


def _time(available: Mapping[str, str], path: object) -> str:
    if (own := _place(TIME, available)) is not None:
        return own
    found = [name for name in available if is_time(name)]
    if len(found) != 1:
        raise InputError(path, "", f"no column for the time{_there(available)}: {_hint(TIME)}")
    return found[0]


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in text else None


def _there(available: Mapping[str, str]) -> str:
    names = list(available)
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"; there are {', '.join(names[:SHOWN])}{more}" if names else "; there is none"


def _hint(name: str) -> str:
    return f"say {name}=COLUMN[:UNIT] in --columns (in Python: columns=)"
