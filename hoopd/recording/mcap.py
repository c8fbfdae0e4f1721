"""Recordings on disk: MCAP with the channels `tick`, `input` and `event` and one metadata record, the header.

Rules of this file: a message's `log_time` is its run time counted from `zero_ns`, the wall clock at the run's start and
0 in lock-step, the only date in a file; no host or path goes in; the same content gives the same bytes; what was
recorded in an older form is read as before; whatever a file lost is counted and said; an unusable file is one
`InputError`. The caller owns the file object.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgspec
import numpy as np
from mcap import records
from mcap.writer import MCAP0_MAGIC

from hoopd.core.records import Inputs, TickRecord
from hoopd.files.reading import InputError, os_reason
from hoopd.files.whole_files import opened
from hoopd.recording import rows
from hoopd.recording.container import ChunkedFile, Scan, stream
from hoopd.recording.recording import Recording, from_columns
from hoopd.recording.schemas import CHANNELS, DESCRIBED, TOPIC_PREFIX, LogEvent, schema_bytes, topic_of

PROFILE = "hoopd"  # in the file's own header: how a run of ours is told from other MCAP files
HEADER = "hoopd.header/1"
MAX_FILE_BYTES = 2**31  # two days in one file; the quota of all of them is as large
# The header comes before the first row; each of its four texts is a file of 1 MiB at most.
HEADER_BYTES = 2**23
SHOWN_CHARS = 40  # of a number that is none
FLUSH_S = 0.25  # a killed daemon loses at most what came since the last flush
_SECRET = re.compile(r"""(\bpassword["']?\s*:\s*)("[^"]*"|'[^']*'|[^\s,}#]+)""")


class Header(msgspec.Struct, frozen=True):
    """What a run was made with; texts are whole files, so that a run can be repeated from its recording alone."""

    device: str = ""
    config: str = ""  # configuration after all overrides, YAML
    model: str = ""  # hoopd.model/1 text
    controller: str = ""  # hoopd.controller/1 text
    versions: dict[str, str] = {}
    seed: int | None = None
    law: str = ""  # text of a user's own law
    part: int = 0  # above 0: goes on from the file before (after a fault of the disk, or a full one)
    converted: str = ""  # name of the file that this one was made from; empty: recorded by the daemon
    session: str = ""  # name of the run, as its telemetry tells it; empty of one in lock-step


class RecordedRun(NamedTuple):
    """Everything of one file, in file order."""

    header: Header
    inputs: list[Inputs]
    ticks: list[TickRecord]
    events: list[LogEvent]
    lost: str  # one line, empty when the file is whole
    zero_ns: int = 0  # log_time of run time 0: the wall clock, 0 of a run in lock-step


def without_secrets(text: str) -> str:
    """Text with the values of `password` keys blanked: recordings travel."""
    return _SECRET.sub(r"\1'***'", text)


def add_channels(file: ChunkedFile) -> dict[str, int]:
    """Register the channels of a run in a new file; their numbers."""
    return {
        name: file.add_channel(topic_of(name), *((schema, schema_bytes(name)) if name in DESCRIBED else ()))
        for name, (schema, _) in CHANNELS.items()
    }


class Writer:
    """Rows into an open binary file; a chunk is closed and handed over at every quarter second of run time."""

    def __init__(self, file: BinaryIO, header: Header, *, sync: bool = True, zero_ns: int = 0) -> None:
        """`zero_ns`: log_time of run time 0."""
        self._file, self._sync, self._slot, self._sequence, self._zero_ns = file, sync, -1, 0, zero_ns
        self._container = ChunkedFile(file, PROFILE)
        self._channel = add_channels(self._container)
        self._container.add_metadata(HEADER, header_texts(header))
        self.flushes = 0  # chunks that reached the disk so far
        self._waiting = 0

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._container.size

    def add(self, record: TickRecord, inputs: Inputs) -> None:
        """One tick: what it knew and what it did."""
        known, done = rows.encode_input(inputs), rows.encode_tick(record)  # both or neither
        self._add("input", inputs.t, known)
        self._add("tick", record.t, done)

    def add_tick(self, record: TickRecord) -> None:
        """One tick of a recording from elsewhere, whose inputs nobody kept."""
        self._add("tick", record.t, rows.encode_tick(record))

    def add_event(self, event: LogEvent) -> None:
        """One event."""
        self._add("event", event.t, rows.encode_event(event))

    def flush(self) -> None:
        """Close the chunk, flush the file and wait for the disk (unless `sync` is off)."""
        self._container.flush()
        self._file.flush()
        if self._sync:
            os.fdatasync(self._file.fileno())
        self.flushes += 1
        self._waiting = 0

    def finish(self) -> None:
        """Write the index that viewers use and flush; add nothing afterwards."""
        self._container.finish()
        self.flush()

    def _add(self, channel: str, t: float, data: bytes) -> None:
        slot = int(t / FLUSH_S)
        if slot != self._slot and self._waiting:
            self.flush()
        self._slot = slot
        self._sequence += 1
        self._waiting += 1
        self._container.add_message(self._channel[channel], max(0, self._zero_ns + _ns(t)), self._sequence, data)


def _ns(t: float) -> int:
    return round(t * 1e9)


def header_texts(header: Header) -> dict[str, str]:
    texts = {name: getattr(header, name) for name in ("device", "model", "controller", "law")}
    config = without_secrets(header.config)
    versions = msgspec.json.encode(header.versions, order="sorted").decode()
    seed = "" if header.seed is None else str(header.seed)
    more = {name: value for name in ("converted", "session") if (value := getattr(header, name))}
    return {**texts, "config": config, "versions": versions, "seed": seed, "part": str(header.part), **more}


_TEXTS = ("device", "config", "model", "controller", "law", "converted", "session")


def header_of(texts: dict[str, str]) -> Header:
    plain = {name: texts.get(name, "") for name in _TEXTS}
    versions = texts.get("versions") or "{}"
    return Header(
        **plain,
        versions=msgspec.json.decode(versions, type=dict[str, str]),
        seed=_whole(texts, "seed"),
        part=_whole(texts, "part") or 0,
    )


def _whole(texts: dict[str, str], key: str) -> int | None:
    """A whole number of the header; None where it tells none."""
    text = texts.get(key, "")
    try:
        return int(text) if text else None
    except ValueError:
        raise ValueError(f"header: {key}: expected a whole number, got {text[:SHOWN_CHARS]!r}") from None


_DECODE: dict[str, Any] = {"tick": rows.decode_tick, "input": rows.decode_input, "event": rows.decode_event}


def read_run(path: Path, channels: Iterable[str] = tuple(CHANNELS)) -> RecordedRun:
    """Header and rows of the wanted channels, torn tails recovered; InputError when it is no run of ours."""
    wanted, scan, header, zero_ns = set(channels), Scan(), Header(), None
    found: dict[str, list[Any]] = {name: [] for name in CHANNELS}
    try:
        for record in stream(file_bytes(path), scan):
            if isinstance(record, records.Metadata):
                header = header_of(record.metadata) if record.name == HEADER else header
            elif (name := _channel(scan, scan.topics.get(record.channel_id, ""))) in wanted:
                row = _DECODE[name](record.data)
                found[name].append(row)
                zero_ns = _zero_ns(record.log_time, row.t) if zero_ns is None else zero_ns
    except InputError:
        raise
    except (ValueError, msgspec.MsgspecError) as error:
        raise InputError(path, "", str(error)) from None
    if "tick" not in {_channel(scan, topic) for topic in scan.topics.values()}:
        raise InputError(path, "", _foreign(scan))
    return RecordedRun(header, found["input"], found["tick"], found["event"], describe_loss(scan), zero_ns or 0)


def read_header(path: Path) -> Header:
    """What a run was made with, from the beginning of its file alone; InputError when it is no run of ours."""
    scan = Scan()
    try:
        for record in stream(file_bytes(path, HEADER_BYTES), scan):
            if not isinstance(record, records.Metadata):
                break
            if record.name == HEADER:
                return header_of(record.metadata)
    except (ValueError, msgspec.MsgspecError) as error:
        raise InputError(path, "", str(error)) from None
    raise InputError(path, "", f"no header of hoopd in its first {HEADER_BYTES} bytes")


def read(path: Path) -> Recording:
    """Recording of a run's ticks; InputError when it holds none."""
    path = Path(path)
    run = read_run(path, ("tick",))
    if not run.ticks:
        raise InputError(path, "tick", "the recording holds no ticks" + (f" ({run.lost})" if run.lost else ""))
    try:
        columns = {
            name: np.array(values)
            for name, values in zip(TickRecord._fields, zip(*run.ticks, strict=True), strict=True)
        }
        rig = run.header.seed is not None
        return from_columns(columns, source=path.name, config=run.header.config, lost=run.lost, rig=rig)
    except (ValueError, OverflowError) as error:  # rows that no daemon wrote
        raise InputError(path, "tick", str(error)) from None


def recover(path: Path, out: Path) -> str:
    """Write what can be read of a damaged run as a whole file; the one-line account of what was lost."""
    run = read_run(path)
    with Path(out).open("xb") as file:
        writer = Writer(file, run.header, zero_ns=run.zero_ns)
        for row in _in_order(run):
            if isinstance(row, LogEvent):
                writer.add_event(row)
            elif row[1] is None:
                writer.add_tick(row[0])
            else:
                writer.add(*row)
        writer.finish()
    return run.lost or "nothing was lost"


def describe_loss(scan: Scan) -> str:
    """One line on how a damaged file ended, empty when it is whole."""
    if scan.closed and not scan.bad_chunks:
        return ""
    parts = [] if scan.closed else ["the file was never closed"]
    if scan.bad_chunks:
        parts.append(f"{scan.bad_chunks} damaged chunk{'s' if scan.bad_chunks > 1 else ''} left out")
    if scan.lost_bytes:
        parts.append(f"{scan.lost_bytes} bytes at the end are no record")
    return ", ".join(parts)


def _in_order(run: RecordedRun) -> list[Any]:
    """Rows and events by run time; a tick without its inputs (or the reverse) is torn, unless there never were any."""
    inputs = {row.id: row for row in run.inputs}
    pairs = [(tick, inputs.get(tick.id)) for tick in run.ticks if tick.id in inputs or run.header.converted]
    return sorted([*pairs, *run.events], key=lambda row: row.t if isinstance(row, LogEvent) else row[0].t)


def _channel(scan: Scan, topic: str) -> str:
    """Our name of a topic, new or old, empty when it is none of ours."""
    name = topic.removeprefix(TOPIC_PREFIX)
    described = name in DESCRIBED or name == topic
    return name if name in CHANNELS and scan.schemas.get(topic) == (CHANNELS[name][0] if described else "") else ""


def _zero_ns(log_time: int, t: float) -> int:
    """The log_time of run time 0; 0 when a row does not know its time."""
    return max(0, log_time - _ns(t)) if math.isfinite(t) else 0


def _foreign(scan: Scan) -> str:
    if not scan.topics:
        return "an MCAP file without any channel: torn before its first row, or empty"
    return f"not a recording of hoopd; its channels: {', '.join(sorted(set(scan.topics.values()))[:8])}"


def file_bytes(path: Path, at_most: int = -1) -> bytes:
    """A recording's bytes, or its first ones; of what is none the few that show it."""
    try:
        with opened(Path(path), MAX_FILE_BYTES) as file:
            head = file.read(len(MCAP0_MAGIC))  # looked at before the rest is in memory
            return head + file.read(at_most) if head == MCAP0_MAGIC else head
    except OSError as error:
        raise InputError(path, "", os_reason(error)) from None
