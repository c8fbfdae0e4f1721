"""Recordings in MATLAB files: struct `meas_pos` with Time (n) and Data (n x 4: u, theta, dtheta, psi).

Of another plant: a struct as Simulink writes it, `measData` with `time` and `signals` (values, label, unit). Read are
such structs of any name (`matlab_structs`), too.

Rules of this file: scipy writes, `mat5` reads; a file of version 7.3 is HDF5 and goes through h5py. What `Data` has no
column for stands in further fields (`Current`, `y_t`, `psi_t`), written only where there is something to say. No date
goes in: the same recording gives the same bytes.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from hoopd.files.reading import InputError
from hoopd.files.whole_files import file_bytes
from hoopd.recording import mat5
from hoopd.recording.by_name import from_fields
from hoopd.recording.column_choice import TICK, SignalLayout, by_name
from hoopd.recording.matlab_structs import fields_of
from hoopd.recording.recording import Recording
from hoopd.recording.tables import INPUT_AND_STATES, Columns, by_row, column_names, named, recording_of, vector

STRUCT = "meas_pos"
OTHER = "measData"
ORDER = INPUT_AND_STATES[:4]
FIELDS = {"current": "Current", "y_t": "y_t", "psi_t": "psi_t"}
_HEAD = b"MATLAB 5.0 MAT-file, written by hoopd".ljust(116)  # scipy puts platform and date there


def read(
    path: Path,
    columns: Columns | None = None,
    layout: SignalLayout | None = None,
    hold: str = "zero",
    experiment: str | None = None,
) -> Recording:
    """Recording of a .mat file; InputError says what is wrong with it.

    columns: what the columns of `Data` are, in order; or CHANNEL=COLUMN[:UNIT], where a column is a field of a struct
    or the label of a signal. layout: the plant's signals. experiment: name of the struct, where there are several.
    """
    data = file_bytes(path)
    if layout is None and experiment is None and not by_name(columns):
        names = None if columns is None else str(columns)
        if names is not None or _holds(data, path, STRUCT):
            return _recording(_fields(data, path), column_names(names, ORDER, path), path)
        if not _holds(data, path, OTHER):
            _fields(data, path)
        layout, experiment = TICK, OTHER
    key, fields = fields_of(data, path, experiment)
    return from_fields(fields, columns, layout or TICK, hold, path, key)


def encode(recording: Recording, fields: dict[str, Any]) -> bytes:
    """The file's bytes; `fields`: signals beside `Data`, by name of the signal."""
    if not recording.is_tick:
        return _saved({OTHER: _structure_with_time(recording, fields)})
    data = np.column_stack([recording.column(name) for name in ORDER])
    others = {FIELDS[name]: column[:, None] for name, column in fields.items()}
    return _saved({STRUCT: {"Time": recording.t[:, None], "Data": data, **others}})


def _saved(content: dict[str, Any]) -> bytes:
    buffer = BytesIO()
    scipy.io.savemat(buffer, content, do_compression=True, long_field_names=True)
    return _HEAD + buffer.getvalue()[len(_HEAD) :]


def _structure_with_time(recording: Recording, times: dict[str, Any]) -> dict[str, Any]:
    """What Simulink's block To Workspace writes, with units."""
    signals = {name: (signal.values, signal.unit) for name, signal in recording.signals.items()}
    signals |= {name: (column, "s") for name, column in times.items()}
    elements = np.empty((1, len(signals)), dtype=[("values", object), ("label", object), ("unit", object)])
    for k, (name, (values, unit)) in enumerate(signals.items()):
        elements[0, k] = (values[:, None], name, unit)
    return {"time": recording.t[:, None], "signals": elements}


def _holds(data: bytes, path: Path, name: str) -> bool:
    """Whether a file has a variable of this name."""
    try:
        if mat5.version(data) == 73:
            from hoopd.recording.hdf5 import opened, own

            with opened(path) as file:
                return own(file, name)
        return any(array.name == name for array in mat5.variables(data, name))
    except ValueError as error:
        raise error if isinstance(error, InputError) else _damaged(path, error) from None


def _damaged(path: Path, error: ValueError) -> InputError:
    return InputError(path, "", f"not a MATLAB file, or a damaged one ({error})")


def _fields(data: bytes, path: Path) -> dict[str, Any]:
    """Fields of the struct; InputError when there is none."""
    try:
        if mat5.version(data) == 73:
            return _fields_of_hdf5(path)
        arrays = {array.name: array for array in mat5.variables(data, STRUCT)}
    except InputError:
        raise
    except ValueError as error:
        raise _damaged(path, error) from None
    if STRUCT not in arrays:
        held = ", ".join(list(arrays)[:8]) or "nothing"
        raise InputError(path, STRUCT, f"no such struct in the file; it holds {held}")
    return _fields_of_struct(arrays[STRUCT], path)


def _fields_of_struct(array: mat5.Array, path: Path) -> dict[str, Any]:
    key = STRUCT
    try:
        fields = mat5.fields(array)
        wanted, result = {"Time", "Data", *FIELDS.values()}, {}
        for name, field in fields.items():
            key = f"{STRUCT}.{name}"
            result[name] = mat5.values(field) if name in wanted else None
    except ValueError as error:
        raise InputError(path, key, str(error)) from None
    return result


def _fields_of_hdf5(path: Path) -> dict[str, Any]:
    """Fields of the struct in a file of version 7.3."""
    from hoopd.recording.hdf5 import datasets, opened, own

    with opened(path) as file:
        if not own(file, STRUCT):
            raise InputError(path, STRUCT, "no such struct in the file")
        return datasets(file[STRUCT], ("Time", "Data", *FIELDS.values()), path, STRUCT)


def _recording(fields: dict[str, Any], names: tuple[str, ...], path: Path) -> Recording:
    for name in ("Time", "Data"):
        if name not in fields:
            raise InputError(path, f"{STRUCT}.{name}", f"no such field; there are {', '.join(fields) or 'none'}")
    t = vector(fields["Time"], path, f"{STRUCT}.Time")
    data = by_row(fields["Data"], len(t), path, f"{STRUCT}.Data", samples_first=True)
    others = {
        name: vector(fields[field], path, f"{STRUCT}.{field}")
        for name, field in FIELDS.items()
        if field in fields and name not in names
    }
    return recording_of({"t": t, **others, **named(data, names, path, f"{STRUCT}.Data")}, path)
