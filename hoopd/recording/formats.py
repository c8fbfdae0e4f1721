"""Recordings from and to files: the extension says the format.

Rules of this file: it only chooses; what a format needs is imported when a file of it is met (the daemon imports this
package and needs none of them). A file is written whole or not at all.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file
from hoopd.recording.recording import Recording
from hoopd.recording.tables import checked

HDF5 = (".h5", ".hdf5")
EXTENSIONS = (".mcap", ".mat", *HDF5, ".csv")
_WITH_EXPERIMENT = re.compile(r"(?is)(.+\.(?:h5|hdf5)):([^/:]+)")


def load(path: Path | str, columns: str | None = None, experiment: str | None = None) -> Recording:
    """Recording of a .mcap, .mat, .h5 or .csv file; InputError with file, row and column when it cannot be used.

    columns: names of the file's signal columns in order, where they are not what the format says
    ("u,theta,dtheta,current"; "-" leaves one out). experiment: group of an .h5 file; also as "file.h5:Exp2".
    """
    file, found = split_path(path)
    if found and experiment and found != experiment:
        raise InputError(file, "experiment", f"{found} in the path and {experiment} beside it")
    extension = extension_of(file)
    if extension in HDF5:
        from hoopd.recording import hdf5

        return hdf5.read(file, columns, found or experiment)
    if experiment:
        raise InputError(file, "experiment", "only an .h5 file holds several experiments")
    return _load(file, extension, columns)


def load_all(path: Path | str, columns: str | None = None) -> tuple[Recording, ...]:
    """Every recording of a file: the experiments of an .h5 file in order, else the one there is."""
    file, found = split_path(path)
    if found or extension_of(file) not in HDF5:
        return (load(path, columns),)
    from hoopd.recording import hdf5

    return tuple(hdf5.read(file, columns, name) for name in hdf5.experiments(file))


def save(recording: Recording, path: Path | str) -> None:
    """Write a recording in the format of the extension, whole or not at all; InputError when it cannot be written."""
    target = Path(path)
    encode = _encoder(extension_of(target))
    replace_file(target, encode(checked(recording, target), beside_states(recording)))


def beside_states(recording: Recording) -> dict[str, Any]:
    """Signals that not every recording has: a current that was measured, sample times that differ from `t`."""
    signals = {"current": recording.current} if not np.isnan(recording.current).all() else {}
    times = {name: getattr(recording, name) for name in ("y_t", "psi_t")}
    return {**signals, **{name: column for name, column in times.items() if not np.array_equal(column, recording.t)}}


def split_path(path: Path | str) -> tuple[Path, str | None]:
    """File and experiment of "file.h5:Exp2"; a file of that very name goes first."""
    match = _WITH_EXPERIMENT.fullmatch(str(path))
    if match is None or Path(path).exists():
        return Path(path), None
    return Path(match.group(1)), match.group(2)


def extension_of(path: Path) -> str:
    """Extension in lower case; InputError when no format has it."""
    extension = path.suffix.lower()
    if extension not in EXTENSIONS:
        raise InputError(path, "", f"unknown extension {extension or '(none)'}; known: {', '.join(EXTENSIONS)}")
    return extension


def _load(file: Path, extension: str, columns: str | None) -> Recording:
    if extension == ".mat":
        from hoopd.recording import mat_file as matfile

        return matfile.read(file, columns)
    if extension == ".csv":
        from hoopd.recording import csv_file as csvfile

        return csvfile.read(file, columns)
    from hoopd.recording import mcap

    if columns is not None:
        raise InputError(file, "columns", "an MCAP file names its columns itself")
    return checked(mcap.read(file), file)


def _encoder(extension: str) -> Callable[[Recording, dict[str, Any]], bytes]:
    if extension == ".mat":
        from hoopd.recording.mat_file import encode
    elif extension == ".csv":
        from hoopd.recording.csv_file import encode
    elif extension in HDF5:
        from hoopd.recording.hdf5 import encode
    else:
        from hoopd.recording.imported import encode
    return encode
