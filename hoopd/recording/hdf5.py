"""Recordings in HDF5 as the thesis keeps them: groups ExpN with Timestamps (n), States (n x 3 or 4) and Input (n).

Of another plant: a group whose datasets are `t`, the signals and their sample times `x_t`, each with attributes `unit`,
`role` (input, channel, time) and `hold`. Read by name are datasets of any group, too.

Rules of this file: HDF5's bytes are h5py's. Julia and MATLAB store the columns of a matrix one after the other, so
their n x 3 arrives here as 3 x n; which side is time is told by Timestamps. We write as they do. Further signals stand
in further datasets (`Current`, `y_t`, `psi_t`). The same recording gives the same bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from hoopd.files.reading import InputError, unpacked_limit
from hoopd.files.whole_files import opened as opened_file
from hoopd.recording.by_name import NamedValues, chosen, from_fields, renamed
from hoopd.recording.column_choice import TICK, SignalLayout, by_name
from hoopd.recording.recording import Recording, Signal, from_signals
from hoopd.recording.tables import (
    INPUT_AND_STATES,
    Columns,
    by_row,
    checked,
    column_names,
    in_tick_form,
    named,
    recording_of,
    vector,
)

FIELDS = {"current": "Current", "y_t": "y_t", "psi_t": "psi_t"}
NEEDED = ("Timestamps", "States", "Input")
STATES = INPUT_AND_STATES[1:4]
LAYOUT = "layout"  # attribute of States: which side is time, said by files of ours
SIGNALS_FIRST = b"signals,samples"
CONFIG = "config"  # attribute of the group: configuration text
MAX_TEXT_BYTES = 60_000  # an attribute holds 64 kB
FORM, SIGNALS = "form", b"hoopd.signals/1"  # attribute of a group of ours that tells its own signals
MAX_FIELDS = 1000  # of a group
OBJECT = "MATLAB_object_decode"  # attribute of a MATLAB variable that is an object: its numbers are no signal


def read(
    path: Path,
    columns: Columns | None = None,
    experiment: str | None = None,
    layout: SignalLayout | None = None,
    hold: str = "zero",
) -> Recording:
    """Recording of one experiment; InputError when several are there and none is chosen.

    columns: what Input and the columns of States are, in order; or CHANNEL=COLUMN[:UNIT] of datasets. layout: the
    plant's signals.
    """
    with opened(path) as file:
        if layout is not None or by_name(columns):
            return _by_name(file, columns, experiment, layout or TICK, hold, path)
        name = _chosen(_experiments(file, path), experiment, path)
        if _text(file[name], FORM) != SIGNALS:
            return _recording(file[name], None if columns is None else str(columns), path, name)
        if columns is not None:
            raise InputError(path, "columns", "the file names its columns itself; others come with --plant")
        return _described(file[name], path, name)


def experiments(path: Path) -> tuple[str, ...]:
    """Names of the experiments in a file, Exp2 before Exp10; InputError when there is none."""
    with opened(path) as file:
        return _experiments(file, path)


def encode(recording: Recording, fields: dict[str, Any]) -> bytes:
    """The file's bytes, with one experiment `Exp1`; `fields`: further signals by name."""
    buffer = BytesIO()
    with h5py.File(buffer, "w") as file:
        group = file.create_group("Exp1")
        if 0 < len(config := recording.config.encode()) <= MAX_TEXT_BYTES:
            group.attrs[CONFIG] = np.bytes_(config)
        if not in_tick_form(recording):
            _write_signals(group, recording, fields)
            return _closed(file, buffer)
        group["Timestamps"], group["Input"] = recording.t, recording.u
        group["States"] = np.stack([recording.column(name) for name in STATES])
        group["States"].attrs[LAYOUT] = np.bytes_(SIGNALS_FIRST)
        for name, column in fields.items():
            group[FIELDS[name]] = column
        return _closed(file, buffer)


def _closed(file: h5py.File, buffer: BytesIO) -> bytes:
    file.close()
    return buffer.getvalue()


def _write_signals(group: h5py.Group, recording: Recording, times: dict[str, Any]) -> None:
    group.attrs[FORM] = np.bytes_(SIGNALS)
    inputs = [(name, s.values, "input", s.unit, s.hold) for name, s in recording.inputs.items()]
    channels = [(name, s.values, "channel", s.unit, s.told_hold) for name, s in recording.channels.items()]
    others = [(name, column, "time", "s", "") for name, column in {"t": recording.t, **times}.items()]
    for k, (name, column, *texts) in enumerate([*inputs, *channels, *others]):
        group[name] = column
        attributes = group[name].attrs
        for key, value in zip(("role", "unit", "hold"), texts, strict=True):
            if value:
                attributes[key] = np.bytes_(value.encode())
        attributes["order"] = k


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file; whatever its damage makes the library say is one InputError."""
    with opened_file(path):  # a file, not empty, of bounded size
        pass
    try:
        with h5py.File(path, "r") as file:
            yield file
    except InputError:
        raise
    except Exception as error:  # the library raises OSError, KeyError, RuntimeError, ValueError, TypeError on damage
        text = (str(error).strip().splitlines() or [""])[0]
        raise InputError(path, "", f"not an HDF5 file, or a damaged one ({type(error).__name__}: {text})") from None


def datasets(group: Any, names: Iterable[str], path: Path, key: str) -> dict[str, Any]:
    """Those of the named arrays that a group has; InputError when it is none, or one is no array of numbers."""
    if not isinstance(group, h5py.Group):
        raise InputError(path, key, "expected a group with arrays")
    left, arrays = unpacked_limit(path.stat().st_size), {}
    for name in names:
        if own(group, name):
            arrays[name] = _array(group[name], path, f"{key}/{name}", left)
            left -= arrays[name].nbytes
    return arrays


def own(group: h5py.Group, name: str) -> bool:
    """The group has it itself; links are not followed: they may lead into another file, and that may be a pipe."""
    return isinstance(group.get(name, getlink=True), h5py.HardLink)


def named_fields(file: h5py.File, path: Path, experiment: str | None = None) -> tuple[str, dict[str, NamedValues]]:
    """Name of a group (empty: the file itself) and its datasets of numbers; InputError when groups are several."""
    if len(file) > MAX_FIELDS:
        raise InputError(path, "", f"more than {MAX_FIELDS} groups and arrays")
    groups = {name: file[name] for name in file if own(file, name) and not name.startswith("#")}
    fields = {name: _fields(group, path, name) for name, group in groups.items() if isinstance(group, h5py.Group)}
    return chosen({name: one for name, one in fields.items() if one}, _fields(file, path, ""), path, experiment)


def _fields(group: h5py.Group, path: Path, key: str) -> dict[str, NamedValues]:
    """Arrays of numbers of a group, and of the group `signals` in it."""
    if len(group) > MAX_FIELDS:
        raise InputError(path, key, f"more than {MAX_FIELDS} arrays")
    own_names = [name for name in group if own(group, name)]
    names = [name for name in own_names if _is_numbers(group[name])]
    arrays = datasets(group, names, path, key)
    fields = {name: NamedValues(array, _unit(group[name])) for name, array in arrays.items()}
    inner = group["signals"] if "signals" in own_names else None
    return {**fields, **_fields(inner, path, f"{key}/signals")} if isinstance(inner, h5py.Group) else fields


def _is_numbers(item: Any) -> bool:
    if not isinstance(item, h5py.Dataset) or OBJECT in item.attrs:
        return False
    return item.dtype.kind in "fiu" and item.shape is not None and item.ndim < 3


def _unit(item: Any) -> str:
    return (_text(item, "unit") or _text(item, "units")).decode(errors="replace")


def _by_name(
    file: h5py.File, columns: Columns | None, experiment: str | None, layout: SignalLayout, hold: str, path: Path
) -> Recording:
    ours = [name for name in file if own(file, name) and _text(file[name], FORM) == SIGNALS]
    if ours:
        name = _chosen(tuple(sorted(ours, key=_natural)), experiment, path)
        return renamed(_described(file[name], path, name), columns, layout, path)
    key, fields = named_fields(file, path, experiment)
    return from_fields(fields, columns, layout, hold, path, key)


def _described(group: h5py.Group, path: Path, key: str) -> Recording:
    """The recording of a group that tells its signals."""
    if len(group) > MAX_FIELDS:
        raise InputError(path, key, f"more than {MAX_FIELDS} arrays")
    arrays = {name: vector(value, path, f"{key}/{name}") for name, value in datasets(group, group, path, key).items()}
    if "t" not in arrays:
        raise InputError(path, f"{key}/t", "no such array")
    signals: dict[bytes, dict[str, Signal]] = {b"input": {}, b"channel": {}}
    for name in sorted(arrays, key=lambda name: _order(group[name])):
        if (role := _text(group[name], "role")) in signals:
            unit, hold = (_text(group[name], text).decode(errors="replace") for text in ("unit", "hold"))
            times = arrays.get(f"{name}_t", arrays["t"])
            signals[role][name] = Signal(arrays[name], times, unit, hold or "zero")
    config = _text(group, CONFIG).decode(errors="replace")
    if not len(arrays["t"]):
        raise InputError(path, key, "holds no rows")
    try:
        run = from_signals(arrays["t"], signals[b"input"], signals[b"channel"], source=Path(path).name, config=config)
    except ValueError as error:
        raise InputError(path, key, str(error)) from None
    return checked(run, path)


def _order(item: Any) -> int:
    """Place of a signal among the others."""
    known = "order" in item.attrs and item.attrs.get_id("order").dtype.kind in "iu"
    return int(np.ravel(item.attrs["order"])[0]) if known else MAX_FIELDS


def _array(dataset: Any, path: Path, key: str, limit: int) -> Any:
    if not isinstance(dataset, h5py.Dataset):
        raise InputError(path, key, "expected an array, found a group")
    if dataset.is_virtual or dataset.external:
        raise InputError(path, key, "its numbers stand in another file")
    if dataset.dtype.kind not in "fiu":
        raise InputError(path, key, f"expected real numbers, found {dataset.dtype}")
    if dataset.shape is None or dataset.nbytes > limit:
        raise InputError(path, key, f"an array of {dataset.size or 0} values: no recording")
    return dataset[()]


def _text(item: Any, name: str) -> bytes:
    """Text of an attribute of fixed length; others are not followed: a damaged heap stops the library for ever."""
    if name not in item.attrs or item.attrs.get_id(name).dtype.kind != "S":
        return b""
    value = item.attrs[name]
    return bytes(value) if isinstance(value, bytes) else b""


def _experiments(file: h5py.File, path: Path) -> tuple[str, ...]:
    names = [name for name in file if own(file, name) and _is_experiment(file[name])]
    if not names:
        held = f"; it holds {', '.join(list(file)[:8])}" if len(file) else "; it holds nothing"
        raise InputError(path, "", f"no group with {', '.join(NEEDED)} (Exp1, Exp2, ...){held}")
    return tuple(sorted(names, key=_natural))


def _is_experiment(item: Any) -> bool:
    return isinstance(item, h5py.Group) and (own(item, "Timestamps") or _text(item, FORM) == SIGNALS)


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def _chosen(names: tuple[str, ...], experiment: str | None, path: Path) -> str:
    if experiment is None and len(names) == 1:
        return names[0]
    if experiment is None:
        raise InputError(path, "", f"holds {', '.join(names)}: choose one, as {path.name}:{names[-1]}")
    if experiment not in names:
        raise InputError(path, experiment, f"no such experiment; there are {', '.join(names)}")
    return experiment


def _recording(group: h5py.Group, columns: str | None, path: Path, key: str) -> Recording:
    arrays = datasets(group, (*NEEDED, *FIELDS.values()), path, key)
    for name in NEEDED:
        if name not in arrays:
            raise InputError(path, f"{key}/{name}", f"no such array; there are {', '.join(group) or 'none'}")
    t = vector(arrays["Timestamps"], path, f"{key}/Timestamps")
    u = vector(arrays["Input"], path, f"{key}/Input")
    if len(u) != len(t):
        raise InputError(path, f"{key}/Input", f"has {len(u)} values, Timestamps has {len(t)}")
    first = False if _text(group["States"], LAYOUT) == SIGNALS_FIRST else None
    states = by_row(arrays["States"], len(t), path, f"{key}/States", samples_first=first)
    default = INPUT_AND_STATES[: 5 if states.shape[1] == 4 else 4]
    names = column_names(columns, default, path)
    signals = named(np.column_stack([u, states]), names, path, f"{key}/Input and States")
    others = {n: vector(arrays[f], path, f"{key}/{f}") for n, f in FIELDS.items() if f in arrays and n not in names}
    config = _text(group, CONFIG).decode(errors="replace")
    return recording_of({"t": t, **others, **signals}, path, config=config)
