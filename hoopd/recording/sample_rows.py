"""Recordings of other plants in MCAP: the channel `/hoopd/sample`, a message a row, and what its signals are.

The schema is made from the signals, with units and without unions: a number that is missing is left out. Sample times
stand in a row (`x_t`) where any of them differs from the row's.

Rules of this file: as of `mcap`, whose container and header it uses; the same recording gives the same bytes.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np
from mcap import records

from hoopd.files.reading import InputError
from hoopd.files.whole_files import opened
from hoopd.recording.container import ChunkedFile, Scan, stream
from hoopd.recording.mcap import HEADER, PROFILE, Header, describe_loss, file_bytes, header_of, header_texts
from hoopd.recording.recording import Recording, Signal, from_signals
from hoopd.recording.schemas import topic_of
from hoopd.recording.tables import MAX_ROWS

FORM = "hoopd.signals/1"  # metadata record that says what the signals are
TOPIC = topic_of("sample")
SCHEMA = "hoopd.sample"
HEAD_BYTES = 2**16  # the metadata record is the first one
MAX_SIGNALS = 1000


class _About(msgspec.Struct, frozen=True):
    """One signal of a recording."""

    name: str
    role: str
    unit: str = ""
    hold: str = "zero"
    times: bool = False  # it has times of its own


_SIGNALS = msgspec.json.Decoder(list[_About])
_ROW = msgspec.json.Decoder(dict[str, float])


def write(file: BinaryIO, recording: Recording, header: Header) -> None:
    """The whole file."""
    about = _about(recording)
    columns = {"t": recording.t, **{name: signal.values for name, signal in recording.signals.items()}}
    columns |= {f"{one.name}_t": recording.signals[one.name].t for one in about if one.times}
    container = ChunkedFile(file, PROFILE)
    channel = container.add_channel(TOPIC, SCHEMA, msgspec.json.encode(_schema(about)))
    container.add_metadata(FORM, {"signals": msgspec.json.encode(about).decode()})
    container.add_metadata(HEADER, header_texts(header))
    names, table = list(columns), np.column_stack(list(columns.values())).tolist()
    for k, row in enumerate(table):
        there = {name: x for name, x in zip(names, row, strict=True) if x == x}  # noqa: PLR0124 (NaN is missing)
        container.add_message(channel, max(0, round(row[0] * 1e9)), k + 1, msgspec.json.encode(there))
    container.finish()


def is_of_samples(path: Path) -> bool:
    """Whether an MCAP file holds samples of another plant; False for what cannot be read at all."""
    scan = Scan()
    with contextlib.suppress(InputError, OSError, ValueError), opened(path, 2**63) as file:
        for record in stream(file.read(HEAD_BYTES), scan):
            return isinstance(record, records.Metadata) and record.name == FORM
    return False


def read(path: Path) -> Recording:
    """The recording; InputError when its rows are none."""
    scan, header = Scan(), Header()
    about: list[_About] = []
    rows: list[dict[str, float]] = []
    try:
        for record in stream(file_bytes(path), scan):
            if isinstance(record, records.Metadata):
                about = _SIGNALS.decode(record.metadata.get("signals", "")) if record.name == FORM else about
                header = header_of(record.metadata) if record.name == HEADER else header
            elif scan.topics.get(record.channel_id) == TOPIC:
                rows.append(_ROW.decode(record.data))
        if not rows or len(rows) > MAX_ROWS or len(about) > MAX_SIGNALS:
            raise ValueError(f"the recording holds {len(rows) or 'no'} samples of {len(about)} signals")
        return _recording(about, rows, source=Path(path).name, config=header.config, lost=describe_loss(scan))
    except InputError:
        raise
    except (ValueError, msgspec.MsgspecError, RecursionError) as error:
        raise InputError(path, "sample", str(error)) from None


def _about(recording: Recording) -> list[_About]:
    def one(name: str, signal: Signal, role: str, hold: str) -> _About:
        times = not np.array_equal(signal.t, recording.t, equal_nan=True)
        return _About(name, role, signal.unit, hold, times)

    inputs = [one(name, signal, "input", signal.hold) for name, signal in recording.inputs.items()]
    return [*inputs, *(one(name, signal, "channel", signal.told_hold) for name, signal in recording.channels.items())]


def _recording(about: list[_About], rows: list[dict[str, float]], **more: Any) -> Recording:
    def column(name: str) -> np.ndarray:
        return np.array([row.get(name, np.nan) for row in rows], dtype=np.float64)

    t = column("t")
    groups: dict[str, dict[str, Signal]] = {"input": {}, "channel": {}}
    for one in about:
        if one.role not in groups:
            raise ValueError(f"{one.name} is {one.role!r}, neither input nor channel")
        times = column(f"{one.name}_t") if one.times else t
        groups[one.role][one.name] = Signal(column(one.name), times, one.unit, one.hold or "zero")
    return from_signals(t, groups["input"], groups["channel"], **more)


def _schema(about: list[_About]) -> dict[str, Any]:
    """JSON schema (draft 2020-12 subset, no unions) of a row."""
    properties: dict[str, Any] = {"t": _number("s", "run time of the row")}
    for one in about:
        read = "mean about t" if one.hold else "sampled at t"
        meaning = read if one.role == "channel" else f"input from t on, {one.hold} hold"
        properties[one.name] = _number(one.unit, meaning.replace(" t", f" {one.name}_t") if one.times else meaning)
    properties |= {f"{one.name}_t": _number("s", f"when {one.name} was sampled") for one in about if one.times}
    return {
        "title": SCHEMA,
        "type": "object",
        "properties": properties,
        "required": ["t"],
        "additionalProperties": False,
    }


def _number(unit: str, meaning: str) -> dict[str, str]:
    described = f"{meaning} [{unit}]" if unit else meaning
    return {"type": "number", **({"unit": unit} if unit else {}), "description": described}
