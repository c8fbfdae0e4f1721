"""Digests of a recording's contents: columns by their documented names, ticks, inputs, events, header texts.

Rules of this file: a digest is of values, never of classes or field order of the container; a float counts with all of
its bits, a missing number is one value. `python tests/before_the_move.py` prints the digests of the recordings that
were kept (the state 96d3d18 wrote them down; run it elsewhere to look, not to write).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.core.records import CameraSample, Command, TickRecord
from hoopd.recording import load
from hoopd.recording.mcap import read_run

KEPT = Path(__file__).parent / "data" / "before_the_move"
# A tick and a picture as they were then.
TICK_FIELDS = TickRecord._fields[: TickRecord._fields.index("distance")]
CAMERA_FIELDS = CameraSample._fields.index("direction")
COLUMNS = ("t", "u", "theta", "dtheta", "current", "psi", "y_t", "psi_t")


def recordings() -> list[Path]:
    """The recordings that were kept, of every format."""
    return sorted(path for path in KEPT.iterdir() if path.suffix in (".mcap", ".csv", ".h5", ".mat"))


def columns(path: Path) -> dict[str, str]:
    """Digest of each documented column, as `load` gives it."""
    recording = load(path)
    return {name: column_digest(getattr(recording, name)) for name in COLUMNS}


def column_digest(column: Any) -> str:
    """Digest of a column of floats; every NaN is the same one."""
    numbers = np.array(column, dtype="<f8")
    numbers[np.isnan(numbers)] = np.nan
    return _digest(numbers.tobytes())


def contents(path: Path) -> dict[str, Any]:
    """Digests of what a run holds beside its columns: the fields of its ticks, its inputs, events and header texts."""
    run = read_run(path)
    ticks = {name: _digest(_text([getattr(tick, name) for tick in run.ticks])) for name in TICK_FIELDS}
    header = {name: _digest(getattr(run.header, name).encode()) for name in ("config", "model", "controller", "law")}
    return {
        "rows": len(run.ticks),
        "lost": run.lost,
        "seed": run.header.seed,
        "ticks": ticks,
        "inputs": _digest(_text(run.inputs)),
        "events": _digest(_text([(event.t, event.event, event.level, event.fields) for event in run.events])),
        "header": header,
    }


def _text(value: Any) -> bytes:
    """Nested values as text: floats by their bits, records as the tuples that they are."""
    return repr(_plain(value)).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Command) and not value.text:
        value = value[:3]  # the digests are from before commands brought a text
    if isinstance(value, CameraSample):
        value = value[:CAMERA_FIELDS]
    if isinstance(value, Mapping):
        return sorted((str(key), _plain(item)) for key, item in value.items())
    return [_plain(item) for item in value] if isinstance(value, Iterable) else value


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _kept(path: Path) -> dict[str, Any]:
    digests = {"file": hashlib.sha256(path.read_bytes()).hexdigest(), "columns": columns(path)}
    return digests | (contents(path) if path.suffix == ".mcap" else {})


if __name__ == "__main__":
    print(json.dumps({path.name: _kept(path) for path in recordings()}, indent=1))  # noqa: T201
