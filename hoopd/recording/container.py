"""An MCAP file written in small chunks for hours, and read back however it ended.

Rules of this file: MCAP's records and their bytes are the `mcap` package's (but for the head of a message); here is
only their order. Its own writer
keeps a Python object per chunk until the end (measured: 650 bytes, 9 MB an hour at four chunks a second, and all of it
walked by the garbage collector), so the index is kept here as the bytes that the summary will hold (0.1 kB a chunk).
Nothing is written between two flushes, a partial write is continued, and the same content gives the same bytes.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, Protocol

import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

from hoopd.files.reading import unpacked_limit

# A message's record before its data: opcode and length, channel, sequence, log and publish time. The package packs them
# one by one, which costs 3 us a message under the interpreter's lock, a hundred times a second.
_MESSAGE = struct.Struct("<BQHIQQ")
_RECORD_HEAD_BYTES = 9  # opcode and length, which the length leaves out
CHUNK_BYTES = 64 * 1024  # a chunk is closed at this size even without a flush: bounds what is held in memory
# A chunk of ours is CHUNK_BYTES and one row more, of MCAP's own programs 4 MiB at most.
MAX_CHUNK_BYTES = 4 * 2**20 + CHUNK_BYTES
_DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, MemoryError, RuntimeError)


class ByteSink(Protocol):
    """What a file must offer: an unbuffered one may write less than it was given."""

    def write(self, data: Any, /) -> int | None: ...


def write_all(sink: ByteSink, data: bytes) -> None:
    """Every byte, however many calls it takes; OSError as soon as one fails."""
    view = memoryview(data)
    while view:
        count = sink.write(view)
        view = view[len(view) if count is None else count :]


class ChunkedFile:
    """Append-only MCAP with JSON messages; `flush` makes all that was added readable in the file."""

    def __init__(self, sink: ByteSink, profile: str) -> None:
        self._sink, self._offset = sink, 0
        self._out, self._chunk, self._index = RecordBuilder(), RecordBuilder(), RecordBuilder()
        self._metadata_index, self._repeated = RecordBuilder(), (RecordBuilder(), RecordBuilder())
        self._messages: dict[int, records.MessageIndex] = {}
        self._span = (0, 0)
        self._zstd = zstandard.ZstdCompressor()
        self._totals = records.Statistics(
            attachment_count=0,
            channel_count=0,
            channel_message_counts={},
            chunk_count=0,
            message_count=0,
            message_end_time=0,
            message_start_time=0,
            metadata_count=0,
            schema_count=0,
        )
        self._out.write(MCAP0_MAGIC)
        records.Header(profile=profile, library="hoopd").write(self._out)

    @property
    def size(self) -> int:
        """Bytes handed to the file so far."""
        return self._offset

    def add_channel(self, topic: str, schema_name: str = "", schema: bytes = b"") -> int:
        """Number of a new channel of JSON messages, with a JSON schema of its own when it has a name."""
        number = self._totals.channel_count = self._totals.channel_count + 1
        schema_id = self._add_schema(schema_name, schema) if schema_name else 0
        channel = records.Channel(id=number, topic=topic, message_encoding="json", schema_id=schema_id, metadata={})
        channel.write(self._out)
        channel.write(self._repeated[1])
        return number

    def _add_schema(self, name: str, data: bytes) -> int:
        number = self._totals.schema_count = self._totals.schema_count + 1
        schema = records.Schema(id=number, name=name, encoding="jsonschema", data=data)
        schema.write(self._out)
        schema.write(self._repeated[0])
        return number

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Named texts, outside of the chunks."""
        self.flush()
        records.Metadata(name=name, metadata=dict(data)).write(self._out)
        records.MetadataIndex(offset=self._offset, length=self._out.count, name=name).write(self._metadata_index)
        self._totals.metadata_count += 1
        self.flush()

    def add_message(self, channel: int, time_ns: int, sequence: int, data: bytes) -> None:
        """One message into the open chunk; a full chunk is closed and written."""
        entry = self._messages.get(channel)
        if entry is None:
            entry = self._messages[channel] = records.MessageIndex(channel, [])
        entry.records.append((time_ns, self._chunk.count))
        start, end = self._span if len(self._messages) > 1 or len(entry.records) > 1 else (time_ns, time_ns)
        self._span = min(start, time_ns), max(end, time_ns)
        size = len(data) + _MESSAGE.size - _RECORD_HEAD_BYTES
        head = _MESSAGE.pack(Opcode.MESSAGE, size, channel, sequence & 0xFFFFFFFF, time_ns, time_ns)
        self._chunk.write(head + data)
        if self._chunk.count >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Close the open chunk, if any, and hand all bytes to the file."""
        self._write_out()
        if self._messages:
            self._close_chunk()

    def finish(self) -> None:
        """Write the summary that indexed readers need; the file itself stays open."""
        self.flush()
        records.DataEnd(0).write(self._out)
        self._write_out()
        self._write_summary()

    def _write_out(self) -> None:
        data = _taken(self._out)
        write_all(self._sink, data)
        self._offset += len(data)

    def _close_chunk(self) -> None:
        messages, self._messages = self._messages, {}
        self._count(messages)
        plain = _taken(self._chunk)
        packed = self._zstd.compress(plain)
        start, end = self._span
        records.Chunk(
            compression="zstd",
            data=packed,
            message_start_time=start,
            message_end_time=end,
            uncompressed_crc=zlib.crc32(plain),
            uncompressed_size=len(plain),
        ).write(self._out)
        length, offsets = self._out.count, {}
        for channel, index in messages.items():
            offsets[channel] = self._offset + self._out.count
            index.write(self._out)
        index_length = self._out.count - length
        records.ChunkIndex(
            chunk_start_offset=self._offset,
            chunk_length=length,
            message_start_time=start,
            message_end_time=end,
            message_index_offsets=offsets,
            message_index_length=index_length,
            compression="zstd",
            compressed_size=len(packed),
            uncompressed_size=len(plain),
        ).write(self._index)
        self._write_out()

    def _count(self, messages: dict[int, records.MessageIndex]) -> None:
        totals, (start, end) = self._totals, self._span
        totals.message_start_time = min(totals.message_start_time, start) if totals.chunk_count else start
        totals.message_end_time = max(totals.message_end_time, end)
        totals.chunk_count += 1
        for channel, index in messages.items():
            totals.message_count += len(index.records)
            counts = totals.channel_message_counts
            counts[channel] = counts.get(channel, 0) + len(index.records)

    def _write_summary(self) -> None:
        start, summary, offsets = self._offset, RecordBuilder(), RecordBuilder()
        statistics = RecordBuilder()
        self._totals.write(statistics)
        groups = (
            (Opcode.SCHEMA, self._repeated[0]),
            (Opcode.CHANNEL, self._repeated[1]),
            (Opcode.STATISTICS, statistics),
            (Opcode.CHUNK_INDEX, self._index),
            (Opcode.METADATA_INDEX, self._metadata_index),
        )
        for opcode, builder in groups:
            if builder.count:
                records.SummaryOffset(
                    group_opcode=opcode, group_start=start + summary.count, group_length=builder.count
                ).write(offsets)
                summary.write(_taken(builder))
        offset_start = start + summary.count
        summary.write(_taken(offsets))
        body = _taken(summary)
        # The checksum covers the summary and the footer up to the checksum itself (MCAP specification, "Footer").
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, start, offset_start)
        self._out.write(body)
        checksum = zlib.crc32(footer, zlib.crc32(body))
        records.Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=checksum).write(self._out)
        self._out.write(MCAP0_MAGIC)
        self._write_out()


def _taken(builder: RecordBuilder) -> bytes:
    """The bytes of a builder, which is empty afterwards."""
    return bytes(builder.end())  # type: ignore[no-untyped-call]


@dataclass
class Scan:
    """How a file ended, filled while `stream` reads it."""

    profile: str = ""
    closed: bool = False  # the end of the data section was seen
    bad_chunks: int = 0  # whole chunks that cannot be unpacked, left out
    lost_bytes: int = 0  # tail that is no record
    topics: dict[int, str] = field(default_factory=dict)
    schemas: dict[str, str] = field(default_factory=dict)  # topic -> name of its schema
    _names: dict[int, str] = field(default_factory=dict)

    def note(self, record: Any) -> None:
        """Keep what later messages refer to."""
        if isinstance(record, records.Header):
            self.profile = record.profile
        elif isinstance(record, records.Schema):
            self._names[record.id] = record.name
        elif isinstance(record, records.Channel):
            self.topics[record.id] = record.topic
            self.schemas[record.topic] = self._names.get(record.schema_id, "")


_READ: dict[int, Any] = {
    Opcode.HEADER: records.Header.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.CHUNK: records.Chunk.read,
    Opcode.METADATA: records.Metadata.read,
}


# Of a packed chunk with its header: data that do not shrink grow by far less.
LONGEST_CHUNK_BYTES = 2 * MAX_CHUNK_BYTES


def stream(data: bytes, scan: Scan) -> Iterator[records.Message | records.Metadata]:
    """Messages and metadata in file order up to the first byte that is no record; ValueError when not MCAP at all."""
    if not data.startswith(MCAP0_MAGIC):
        raise ValueError("not an MCAP file")
    position, unpacked, limit = len(MCAP0_MAGIC), 0, unpacked_limit(len(data))
    while (length := _record_length(data, position)) is not None:
        if data[position] == Opcode.DATA_END:
            scan.closed = True
            return
        if data[position] == Opcode.CHUNK and length > LONGEST_CHUNK_BYTES:  # not even looked at: it may be the file
            scan.bad_chunks += 1
            position += 9 + length
            continue
        body = data[position + 9 : position + 9 + length]
        if data[position] == Opcode.CHUNK and (unpacked := unpacked + _unpacked_bytes(body)) > limit:
            raise ValueError(f"unpacks to more than {limit} bytes: no recording")
        yield from _contents(data[position], body, scan)
        position += 9 + length
    scan.lost_bytes = len(data) - position


def _record_length(data: bytes, position: int) -> int | None:
    """Length of the record that begins here, None when there is no whole one."""
    if position + 9 > len(data) or not Opcode.HEADER <= data[position] <= 0x7F:
        return None
    (length,) = struct.unpack_from("<Q", data, position + 1)
    return length if position + 9 + length <= len(data) else None


def _unpacked_bytes(chunk: bytes) -> int:
    """What a chunk's records will take, 0 for one that is refused before it is unpacked."""
    with contextlib.suppress(*_DAMAGE):
        return _claimed(_sound(records.Chunk.read(ReadDataStream(BytesIO(chunk)))))
    return 0


def _contents(opcode: int, body: bytes, scan: Scan) -> Iterator[records.Message | records.Metadata]:
    try:
        found = _unpack(opcode, body)
    except _DAMAGE:
        scan.bad_chunks += 1
        return
    for record in found:
        scan.note(record)
        if isinstance(record, records.Message | records.Metadata):
            yield record


def _unpack(opcode: int, body: bytes) -> list[Any]:
    source = ReadDataStream(BytesIO(body))
    if opcode == Opcode.MESSAGE:
        return [records.Message.read(source, len(body))]
    if opcode not in _READ:
        return []
    record = _READ[opcode](source)
    return breakup_chunk(_sound(record), validate_crc=True) if isinstance(record, records.Chunk) else [record]


def _sound(chunk: records.Chunk) -> records.Chunk:
    """The chunk, unless it is larger unpacked than any of ours, or than it says itself; ValueError then."""
    claimed = _claimed(chunk)
    if claimed > MAX_CHUNK_BYTES or chunk.compression not in ("", "zstd"):
        raise ValueError(f"a chunk of {claimed} bytes, packed as {chunk.compression!r}")
    return chunk


def _claimed(chunk: records.Chunk) -> int:
    """Bytes that a chunk says to unpack to."""
    packed = zstandard.frame_content_size(chunk.data) if chunk.compression == "zstd" else len(chunk.data)
    return max(int(chunk.uncompressed_size), packed)
