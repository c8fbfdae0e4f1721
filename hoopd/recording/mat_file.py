"""Recordings in MATLAB files: struct `meas_pos` with Time (n) and Data (n x 4: u, theta, dtheta, psi).

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
from hoopd.recording.recording import Recording
from hoopd.recording.tables import INPUT_AND_STATES, by_row, column_names, named, recording_of, vector

STRUCT = "meas_pos"
ORDER = INPUT_AND_STATES[:4]
FIELDS = {"current": "Current", "y_t": "y_t", "psi_t": "psi_t"}
_HEAD = b"MATLAB 5.0 MAT-file, written by hoopd".ljust(116)  # scipy puts platform and date there


def read(path: Path, columns: str | None = None) -> Recording:
    """Recording of a .mat file; InputError says what is wrong with it."""
    return _recording(_fields(file_bytes(path), path), column_names(columns, ORDER, path), path)


def encode(recording: Recording, fields: dict[str, Any]) -> bytes:
    """The file's bytes; `fields`: signals beside `Data`, by name of the signal."""
    data = np.column_stack([getattr(recording, name) for name in ORDER])
    others = {FIELDS[name]: column[:, None] for name, column in fields.items()}
    buffer = BytesIO()
    struct = {"Time": recording.t[:, None], "Data": data, **others}
    scipy.io.savemat(buffer, {STRUCT: struct}, do_compression=True)
    return _HEAD + buffer.getvalue()[len(_HEAD) :]


def _fields(data: bytes, path: Path) -> dict[str, Any]:
    """Fields of the struct; InputError when there is none."""
    try:
        if mat5.version(data) == 73:
            return _fields_of_hdf5(path)
        arrays = {array.name: array for array in mat5.variables(data, STRUCT)}
    except InputError:
        raise
    except ValueError as error:
        raise InputError(path, "", f"not a MATLAB file, or a damaged one ({error})") from None
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
