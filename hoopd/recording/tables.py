"""What every importer checks before numbers become a Recording: names, shapes, times, infinities.

Rules of this file: pure; every refusal is one `InputError` with file, row and column; nothing is guessed: what could
mean two things is refused and the message says how to decide.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError
from hoopd.recording.recording import HOLDS, UNITS, Recording, from_columns
from hoopd.recording.tick_columns import FILE_ORDER, FOURTH_STATE

# Names in the order of a file's columns, or signal -> column, or column and unit.
Columns = str | Sequence[str] | Mapping[str, str | tuple[str, str]]
Place = Callable[[int], str]  # row from 0 -> how a person finds it in the file

INPUT_AND_STATES = (*FILE_ORDER, FOURTH_STATE)
NAME_THEM = "name them with --columns (in Python: columns=)"
SKIP = "-"  # in `columns`: a column that is left out
NAMES = (*(name for name in UNITS if name != "t"), FOURTH_STATE)
# Seconds since 1970 are 2e9, milliseconds 2e12: what is larger is not in seconds.
MAX_TIME_S = 1e10
# Four days at 50 Hz: what claims more is damaged, and would fill the memory before it fails.
MAX_ROWS = 2**24


def in_tick_form(recording: Recording) -> bool:
    """Whether the daemon's own form says everything that the recording does: its torque is held."""
    return recording.is_tick and all(signal.hold == HOLDS[0] for signal in recording.inputs.values())


def row(index: int) -> str:
    """Row as a person counts it."""
    return f"row {index + 1}"


def column_names(columns: str | Sequence[str] | None, default: Sequence[str], path: object) -> tuple[str, ...]:
    """Names of a file's signal columns in order, as asked or else the default; InputError on an unknown one."""
    if columns is None:
        return tuple(default)
    names = tuple(name.strip() for name in (columns.split(",") if isinstance(columns, str) else columns))
    for name in names:
        if name != SKIP and name not in NAMES:
            raise InputError(
                path, "columns", f"unknown name {name!r}; known: {', '.join(NAMES)}, and - to leave one out"
            )
    refuse_double(names, path, "columns")
    return names


def refuse_double(names: Sequence[str], path: object, key: str) -> None:
    """InputError when a name stands twice."""
    double = [name for k, name in enumerate(names) if name != SKIP and name in names[:k]]
    if double:
        raise InputError(path, key, f"{double[0]} stands twice")


def numbers(value: Any, path: object, key: str) -> NDArray[np.float64]:
    """Real numbers as float64, whatever width they were stored with; InputError for anything else."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise InputError(path, key, f"expected real numbers, found {array.dtype}")
    return array.astype(np.float64)


def vector(value: Any, path: object, key: str) -> NDArray[np.float64]:
    """One number a row: a vector, or a matrix with one row or one column."""
    array = numbers(value, path, key)
    if array.ndim > 2 or array.ndim == 0 or (array.ndim == 2 and 1 not in array.shape and array.size):
        raise InputError(path, key, f"expected one number a row, found {_shape(array)}")
    return array.ravel()


def by_row(value: Any, rows: int, path: object, key: str, *, samples_first: bool | None) -> NDArray[np.float64]:
    """Matrix (samples, signals), turned where the other side has the length of the time.

    A square one is taken as `samples_first` says; None: refused, since nothing tells the sides apart.
    """
    array = numbers(value, path, key)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or rows not in array.shape:
        raise InputError(path, key, f"is {_shape(array)}, neither side has the {rows} rows of the time")
    if array.shape[0] == array.shape[1] and samples_first is None:
        raise InputError(path, key, f"is {_shape(array)} for {rows} times: rows and columns cannot be told apart")
    first = array.shape[0] == rows and (array.shape[1] != rows or bool(samples_first))
    return array if first else array.T


def named(data: NDArray[np.float64], names: Sequence[str], path: object, key: str) -> dict[str, NDArray[np.float64]]:
    """Columns of a matrix by name; InputError when there are more or fewer than names."""
    if data.shape[1] != len(names):
        reason = f"has {data.shape[1]} columns, expected {len(names)} ({','.join(names)}); {NAME_THEM}"
        raise InputError(path, key, reason)
    return {name: data[:, k] for k, name in enumerate(names) if name != SKIP}


def recording_of(
    columns: Mapping[str, Any], path: Path, place: Place = row, *, config: str = "", lost: str = ""
) -> Recording:
    """Recording of checked columns; InputError names row and column of the first impossible number."""
    if not len(columns["t"]):
        raise InputError(path, "", "holds no rows")
    try:
        recording = from_columns(columns, source=Path(path).name, config=config, lost=lost)
    except ValueError as error:
        raise InputError(path, "", str(error)) from None
    return checked(recording, path, place)


def checked(recording: Recording, path: object, place: Place = row) -> Recording:
    """The recording, when its time is finite and grows and no signal is infinite; else InputError."""
    t = recording.t
    _refuse(~np.isfinite(t), "t", t, "time must be a finite number", path, place)
    _refuse(np.abs(t) > MAX_TIME_S, "t", t, "time is not in seconds", path, place)
    _refuse(np.diff(t, prepend=-np.inf) <= 0, "t", t, "time must grow from row to row", path, place)
    for name, column in recording.columns().items():
        _refuse(np.isinf(column), name, column, "must be finite, or empty (NaN) when missing", path, place)
    return recording


def _refuse(
    bad: NDArray[np.bool_], name: str, column: NDArray[np.float64], reason: str, path: object, place: Place
) -> None:
    if bad.any():
        index = int(np.argmax(bad))
        raise InputError(path, f"{place(index)}, column {name}", f"{reason}, found {column[index]}")


def _shape(array: NDArray[Any]) -> str:
    return " x ".join(map(str, array.shape)) or "a single number"
