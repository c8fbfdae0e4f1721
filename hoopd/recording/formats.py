"""Recordings from and to files: the extension says the format.

Rules of this file: it only chooses; what a format needs is imported when a file of it is met (the daemon imports this
package and needs none of them). A file is written whole or not at all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file
from hoopd.recording.recording import HOLDS, Recording, with_hold
from hoopd.recording.tables import Columns, checked

if TYPE_CHECKING:
    from hoopd.recording.column_choice import SignalLayout

HDF5 = (".h5", ".hdf5")
EXTENSIONS = (".mcap", ".mat", *HDF5, ".csv")
# Numbers between blanks or tabs, as many programs and data bases leave them: read by column, not written.
TEXT = (".dat", ".txt", ".tsv")
_WITH_EXPERIMENT = re.compile(r"(?is)(.+\.(?:h5|hdf5)):([^/:]+)")


def load(
    path: Path | str,
    columns: Columns | None = None,
    experiment: str | None = None,
    *,
    layout: SignalLayout | None = None,
    hold: str = "zero",
) -> Recording:
    """Recording of a .mcap, .mat, .h5 or .csv file; InputError with file, row and column when it cannot be used.

    columns: names of the file's signal columns in order, where they are not what the format says
    ("u,theta,dtheta,current"; "-" leaves one out), or by name and with units: "theta=Angle:deg,u=Torque", also as a
    mapping {"theta": ("Angle", "deg")}; a number is a value that does not change ("u=0"). experiment: group of an .h5
    file; also as "file.h5:Exp2". layout: inputs and channels of another plant (`hoopd.plants.layout.layout_of`).
    hold: "zero"; "linear" where the input went straight from row to row; "smooth" where it was filtered; "mean"
        where each row, of inputs and readings, is a mean over the time about it.
    """
    if layout is not None and layout.is_tick and not isinstance(columns, Mapping) and "=" not in (columns or ""):
        layout = None
    recording = _loaded(path, columns, experiment, layout, hold)
    return _held(recording, hold) if recording.is_tick and hold != HOLDS[0] else recording


def _held(recording: Recording, hold: str) -> Recording:
    if hold not in HOLDS:
        raise InputError(recording.source, "hold", f"unknown {hold!r}; known: {', '.join(HOLDS)}")
    return with_hold(recording, hold)


def _loaded(
    path: Path | str, columns: Columns | None, experiment: str | None, layout: SignalLayout | None, hold: str
) -> Recording:
    file, found = split_path(path)
    if found and experiment and found != experiment:
        raise InputError(file, "experiment", f"{found} in the path and {experiment} beside it")
    extension = extension_of(file, readable=layout is not None)
    if extension in HDF5:
        from hoopd.recording import hdf5

        return hdf5.read(file, columns, found or experiment, layout, hold)
    if extension == ".mat":
        from hoopd.recording import mat_file

        return mat_file.read(file, columns, layout, hold, experiment)
    if experiment:
        raise InputError(file, "experiment", "only an .h5 file holds several experiments, a .mat file several structs")
    if extension in (".csv", *TEXT):
        from hoopd.recording import csv_file

        return csv_file.read(file, columns, layout, hold)
    return _load_mcap(file, columns, layout)


def load_all(
    path: Path | str, columns: Columns | None = None, *, layout: SignalLayout | None = None, hold: str = "zero"
) -> tuple[Recording, ...]:
    """Every recording of a file: the experiments of an .h5 file in order, else the one there is."""
    file, found = split_path(path)
    if found or extension_of(file, readable=True) not in HDF5:
        return (load(path, columns, layout=layout, hold=hold),)
    from hoopd.recording import hdf5

    return tuple(load(file, columns, name, layout=layout, hold=hold) for name in hdf5.experiments(file))


def save(recording: Recording, path: Path | str) -> None:
    """Write a recording in the format of the extension, whole or not at all.

    Parameters
    ----------
    recording : Recording
        What is written.
    path : str or Path
        The file: .mcap, .mat, .h5 or .csv.

    Raises
    ------
    InputError
        It cannot be written.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> lab.save(lab.load("run.mcap@2:14"), "part.csv")  # doctest: +SKIP
    """
    target = Path(path)
    encode = _encoder(extension_of(target))
    replace_file(target, encode(checked(recording, target), beside_states(recording)))


def beside_states(recording: Recording) -> dict[str, Any]:
    """Columns that not every file has: a current that was measured, times that differ from `t`."""
    signals = {"current": recording.current} if recording.is_tick and not np.isnan(recording.current).all() else {}
    times = {name: column for name, column in recording.columns().items() if name not in {"t", *recording.signals}}
    return {**signals, **{name: column for name, column in times.items() if not np.array_equal(column, recording.t)}}


def split_path(path: Path | str) -> tuple[Path, str | None]:
    """File and experiment of "file.h5:Exp2"; a file of that very name goes first."""
    match = _WITH_EXPERIMENT.fullmatch(str(path))
    if match is None or Path(path).exists():
        return Path(path), None
    return Path(match.group(1)), match.group(2)


def extension_of(path: Path, *, readable: bool = False) -> str:
    """Extension in lower case; InputError when no format that is written (or only read) has it."""
    extension, known = path.suffix.lower(), (*EXTENSIONS, *TEXT) if readable else EXTENSIONS
    if extension not in known:
        raise InputError(path, "", f"unknown extension {extension or '(none)'}; known: {', '.join(known)}")
    return extension


def _load_mcap(file: Path, columns: Columns | None, layout: SignalLayout | None) -> Recording:
    from hoopd.recording import mcap, sample_rows

    if columns is not None and layout is None:
        raise InputError(file, "columns", "an MCAP file names its columns itself")
    recording = checked(sample_rows.read(file) if sample_rows.is_of_samples(file) else mcap.read(file), file)
    if layout is None:
        return recording
    from hoopd.recording.by_name import renamed

    return renamed(recording, columns, layout, file)


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
