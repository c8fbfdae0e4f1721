"""UART frames: bytes to records and back.

Rules of this file: no clock and no port; the layout is a table that code only reads; any byte string gives
frames or typed faults and never another exception; whole or byte by byte gives the same events.
Silence on the line is the caller's knowledge (`Decoder.silence()`). The contract is written in docs/reference/board.md.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any, Final, Literal, NamedTuple, TypeAlias

from hoopd.core.layout import DEFAULT_LAYOUT, WORDS, Field, FrameLayout, Kind, Layout

__all__ = ["DEFAULT_LAYOUT", "Answer", "Decoder", "Layout", "LinkFault", "Request", "encode_answer", "encode_request"]

# Request flags, answer status and answer errors: one bit each.
FLAG_ENABLE: Final = 0x01
FLAG_CLEAR_FAULT: Final = 0x02
STATUS_ENABLED: Final = 0x01
STATUS_TIMEOUT: Final = 0x02
STATUS_LIMITED: Final = 0x04
STATUS_FAULT: Final = 0x08
ERROR_CRC: Final = 0x01
ERROR_SEQ_GAP: Final = 0x02
ERROR_OVERCURRENT: Final = 0x04
ERROR_ENCODER: Final = 0x08
ERROR_SUPPLY: Final = 0x10
ERROR_OVERSPEED: Final = 0x20

# The board wraps theta here, so that its f32 stays finer than one count of the encoder (2 pi / 4096 = 1.5e-3 rad).
THETA_WRAP_RAD: Final = 512 * 2 * math.pi

# Input is worked off in slices of this size, so that a babbling line costs bounded memory here: 0.35 s at 115200 baud,
# far more than the few milliseconds between two reads. Less than two frames stay buffered after a call.
MAX_SLICE_BYTES: Final = 4096
# Garbage without any frame is reported at least this often (22 ms at 115200 baud: about once a tick).
GARBAGE_REPORT_BYTES: Final = 256


class Request(NamedTuple):
    """Host to board."""

    seq: int
    enable: bool
    clear_fault: bool
    torque_nm: float


class Answer(NamedTuple):
    """Board to host; a field that the layout lacks keeps its default."""

    seq: int = -1
    status: int = 0
    errors: int = 0
    theta: float = 0.0  # rad, wrapped at +-THETA_WRAP_RAD
    dtheta: float = 0.0  # rad/s
    current: float = 0.0  # A
    board_ms: int = 0  # board clock modulo 65536


class LinkFault(NamedTuple):
    """What the line brought instead of a frame: bad_crc (frames), garbage (bytes) or implausible (frames)."""

    kind: Literal["bad_crc", "garbage", "implausible"]
    amount: int
    field: str = ""  # implausible: the first field that broke its bound


Event: TypeAlias = Request | Answer | LinkFault

# |value| beyond these is not this device. theta: the wrap, with one turn of slack. dtheta: 5 times the fastest motion
# in recordings (39 rad/s). current: 5 times what 0.7 N m needs (1.9 A at 0.37 N m/A).
ANSWER_BOUNDS: Final[Mapping[str, float]] = {"theta": 513 * 2 * math.pi, "dtheta": 200.0, "current": 10.0}


# --- encoding --------------------------------------------------------------------------------------------------------


def encode_request(layout: Layout, seq: int, enable: bool, clear_fault: bool, torque_nm: float) -> bytes:
    """One request; counters wrap at the width of their field, a torque beyond its format becomes its extreme."""
    flags = (FLAG_ENABLE if enable else 0) | (FLAG_CLEAR_FAULT if clear_fault else 0)
    return _encode(layout.request, {"seq": seq, "flags": flags, "torque_nm": torque_nm})


def encode_answer(layout: Layout, answer: Answer) -> bytes:
    """One answer: the board's side."""
    return _encode(layout.answer, answer._asdict())


def _encode(frame: FrameLayout, values: Mapping[str, float]) -> bytes:
    raw = [_to_raw(f, values.get(f.name, 0)) for f in frame.fields]
    if frame.sync is not None:
        raw.insert(0, frame.sync)
    body = frame.body.pack(*raw)
    return body if frame.checksum is None else body + frame.tail.pack(frame.checksum(body))


_F32_MAX: Final = 3.4028234e38


def _integer_range(code: str) -> tuple[int, int]:
    """Smallest and largest number of a struct format."""
    bits = 8 * struct.calcsize("=" + code)
    low = 0 if code.isupper() else -(1 << (bits - 1))
    return low, low + (1 << bits) - 1


_INTEGER_RANGES: Final = {code: _integer_range(code) for code in "bBhHiI"}


def _to_raw(entry: Field, value: float) -> float:
    """The number to pack: floats beyond f32 become infinite, counters wrap, scaled integers saturate."""
    if entry.code in "fd":
        raw = value / entry.scale
        return math.copysign(math.inf, raw) if entry.code == "f" and abs(raw) > _F32_MAX else raw
    low, high = _INTEGER_RANGES[entry.code]
    if entry.name in WORDS:
        return low + ((int(value) - low) & (high - low))
    # A non-finite number has no integer: zero is the harmless one for a torque.
    return min(max(round(value / entry.scale), low), high) if math.isfinite(value) else 0


# --- decoding --------------------------------------------------------------------------------------------------------


def implausible_field(record: Request | Answer, bounds: Mapping[str, float]) -> str:
    """Name of the first field that is not finite or beyond its bound; empty when all are plausible."""
    for name, bound in bounds.items():
        if not -bound <= getattr(record, name) <= bound:  # false for NaN too
            return name
    return ""


_BAD_CRC: Final = LinkFault("bad_crc", 1)


class Decoder:
    """Bytes of one direction to frames and typed faults.

    A frame is taken at once where the previous one (or a silence) lets it begin: on the grid. Off the grid, after
    bytes were lost or garbage came in, a frame that verifies is held while a sync byte inside it may begin another one
    that verifies too; then the one on the grid is taken, or neither. So the tail of a damaged frame and the head of the
    next do not pass for a frame unless the bytes after them fit as well."""

    def __init__(self, layout: Layout, kind: Kind = "answer", bounds: Mapping[str, float] | None = None) -> None:
        """`bounds` None: ANSWER_BOUNDS for answers, none for requests (the board judges a torque itself)."""
        self._frame = layout.request if kind == "request" else layout.answer
        self._length = self._frame.length
        self._build = _builder(self._frame)
        self._bounds = bounds if bounds is not None else (ANSWER_BOUNDS if kind == "answer" else {})
        self._buffer = bytearray()
        self._grid = 0  # offset in the buffer at which the next frame is due
        self._charged = 0  # bytes at the buffer's head that a bad_crc has already accounted for
        self._garbage = 0  # bytes not yet reported
        self._events: list[Event] = []

    @property
    def pending(self) -> int:
        """Bytes that wait for more."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[Event]:
        """Take bytes of any number; return what they complete, in the order of the line."""
        if len(data) == self._length and not (self._buffer or self._grid or self._garbage or self._charged):
            record = self._verify(data, 0)  # a whole frame where one is due, as nearly always
            if record is not None and not implausible_field(record, self._bounds):
                return [record]
        for start in range(0, len(data), MAX_SLICE_BYTES):
            self._buffer += data[start : start + MAX_SLICE_BYTES]
            self._scan(final=False)
        return self._collect()

    def silence(self) -> list[Event]:
        """The line fell silent: release a held frame, drop a partial one, expect a frame to begin next."""
        self._scan(final=True)
        self._skip(len(self._buffer))
        self._report_garbage()
        self._grid = self._charged = 0
        return self._collect()

    def _collect(self) -> list[Event]:
        events, self._events = self._events, []
        return events

    def _scan(self, final: bool) -> None:
        """Work off the buffer's head until it waits for more bytes."""
        buffer, length = self._buffer, self._length
        while buffer:
            self._skip(self._find_sync(0))
            if len(buffer) < length:
                return
            record = self._verify(buffer, 0)
            if record is None:
                self._reject()
            elif self._grid == 0 or self._frame.checksum is None:
                self._accept(record)
            elif not self._settle(record, final):
                return

    def _find_sync(self, start: int) -> int:
        """Offset of the first byte at or after `start` that may begin a frame."""
        if self._frame.sync is None:
            return start
        found = self._buffer.find(self._frame.sync, start)
        return len(self._buffer) if found < 0 else found

    def _verify(self, buffer: bytes | bytearray, start: int) -> Request | Answer | None:
        """The record at `start` when its sync and CRC hold."""
        frame = self._frame
        if frame.sync is not None and buffer[start] != frame.sync:
            return None
        if frame.checksum is not None:
            split = start + frame.body.size
            if (frame.checksum(buffer[start:split]),) != frame.tail.unpack_from(buffer, split):
                return None
        return self._build(buffer, start)

    def _settle(self, record: Request | Answer, final: bool) -> bool:
        """Decide on a frame off the grid; False while it must wait for the bytes that overlap it."""
        rivals = self._rivals()
        if rivals and not final and len(self._buffer) < rivals[-1] + self._length:
            return False
        valid = [
            s for s in rivals if s + self._length <= len(self._buffer) and self._verify(self._buffer, s) is not None
        ]
        if not valid:
            self._accept(record)
        elif self._grid in valid:
            self._skip(self._grid)
        else:
            self._skip(valid[0] + 1)  # nobody can tell which one is true: take neither
        return True

    def _rivals(self) -> list[int]:
        """Offsets inside the frame at the buffer's head at which another one may begin."""
        rivals, start = [], self._find_sync(1)
        while start < self._length:
            rivals.append(start)
            start = self._find_sync(start + 1)
        return rivals

    def _accept(self, record: Request | Answer) -> None:
        broken = implausible_field(record, self._bounds)
        if broken and self._frame.checksum is None and self._frame.sync is not None:
            return self._reject(LinkFault("implausible", 1, broken))  # perhaps no frame at all: search inside
        self._report_garbage()
        self._events.append(LinkFault("implausible", 1, broken) if broken else record)
        del self._buffer[: self._length]
        self._grid = self._charged = 0
        return None

    def _reject(self, fault: LinkFault = _BAD_CRC) -> None:
        """Report the frame at the head once and step over its first byte, so that the search goes on inside it."""
        if self._charged == 0:
            self._report_garbage()
            self._events.append(fault)
            self._charged = self._length
        self._skip(1)

    def _skip(self, count: int) -> None:
        """Drop bytes from the head; those that no rejected frame accounts for are garbage."""
        charged = min(count, self._charged)
        self._charged -= charged
        self._garbage += count - charged
        del self._buffer[:count]
        self._grid = (self._grid - count) % self._length
        while self._garbage >= GARBAGE_REPORT_BYTES:
            self._events.append(LinkFault("garbage", GARBAGE_REPORT_BYTES))
            self._garbage -= GARBAGE_REPORT_BYTES

    def _report_garbage(self) -> None:
        if self._garbage:
            self._events.append(LinkFault("garbage", self._garbage))
            self._garbage = 0


def _builder(frame: FrameLayout) -> Callable[[bytes | bytearray, int], Request | Answer]:
    """Function from bytes at an offset to the record, with the table's order and scales resolved once."""
    first = 0 if frame.sync is None else 1
    slots = {f.name: (first + i, f.scale) for i, f in enumerate(frame.fields) if f.name != "pad"}
    unpack = frame.body.unpack_from
    if frame.kind == "request":
        return lambda buffer, start: _request(slots, unpack(buffer, start))
    if tuple(slots) == Answer._fields and all(scale == 1.0 for _, scale in slots.values()):
        low, high = first, first + len(slots)  # the usual table: the fields stand in the record's own order
        if all(f.name != "pad" for f in frame.fields):
            return lambda buffer, start: Answer._make(unpack(buffer, start)[low:high])
    return lambda buffer, start: Answer(**_values(slots, unpack(buffer, start)))


def _values(slots: Mapping[str, tuple[int, float]], raw: tuple[Any, ...]) -> dict[str, Any]:
    return {name: raw[i] if name in WORDS else raw[i] * scale for name, (i, scale) in slots.items()}


def _request(slots: Mapping[str, tuple[int, float]], raw: tuple[Any, ...]) -> Request:
    values = _values(slots, raw)
    flags = values["flags"]
    return Request(
        values.get("seq", -1), bool(flags & FLAG_ENABLE), bool(flags & FLAG_CLEAR_FAULT), values["torque_nm"]
    )
