"""The layout of the UART frames as a table, and its checksums.

Rules of this file: data and its checks; a laboratory may have another layout, with or without sync and CRC, and the
codec (frames.py) only reads what stands here. A wrong table is one ValueError with one clear line.
"""

from __future__ import annotations

import math
import struct
from binascii import crc_hqx
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple, TypeAlias

Kind: TypeAlias = Literal["request", "answer"]
CrcKind: TypeAlias = Literal["crc8", "crc16", "none"]

# Larger than any frame a small driver board sends; a longer one is a mistake in the configuration.
MAX_FRAME_BYTES: Final = 64

# --- checksums -------------------------------------------------------------------------------------------------------


def _crc8_table(poly: int) -> bytes:
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = ((crc << 1) ^ poly if crc & 0x80 else crc << 1) & 0xFF
        table.append(crc)
    return bytes(table)


_CRC8: Final = _crc8_table(0x07)


def crc8(data: bytes | bytearray) -> int:
    """CRC-8: poly 0x07, init 0x00, not reflected, no final xor (check value of b"123456789": 0xF4)."""
    crc = 0
    for byte in data:
        crc = _CRC8[crc ^ byte]
    return crc


def crc16(data: bytes | bytearray) -> int:
    """CRC-16/CCITT-FALSE: poly 0x1021, init 0xFFFF, not reflected (check value 0x29B1); table and loop are in C."""
    return crc_hqx(data, 0xFFFF)


_CRC: Final[Mapping[str, tuple[Callable[[bytes | bytearray], int], str]]] = {
    "crc8": (crc8, "B"),
    "crc16": (crc16, "H"),
}


# --- tables ----------------------------------------------------------------------------------------------------------

_VOCABULARY: Final[Mapping[str, tuple[str, ...]]] = {
    "request": ("seq", "flags", "torque_nm"),
    "answer": ("seq", "status", "errors", "theta", "dtheta", "current", "board_ms"),
}
# Bit fields and counters: integer, never scaled.
WORDS: Final = ("seq", "flags", "status", "errors", "board_ms")
_CODES: Final = frozenset("bBhHiIfd")


class Field(NamedTuple):
    """One field on the wire; value = raw * scale. The name `pad` is skipped."""

    name: str
    code: str  # struct format of one number
    scale: float = 1.0


@dataclass(frozen=True)
class FrameLayout:
    """One frame as a table; `sync` None and `crc` none are allowed."""

    kind: Kind
    fields: tuple[Field, ...]
    sync: int | None
    crc: CrcKind
    byte_order: Literal["<", ">"] = "<"
    body: struct.Struct = field(init=False, repr=False, compare=False)  # sync and fields, without the CRC
    tail: struct.Struct = field(init=False, repr=False, compare=False)  # the CRC
    length: int = field(init=False, repr=False, compare=False)  # bytes of the whole frame
    checksum: Callable[[bytes | bytearray], int] | None = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._check()
        head = "" if self.sync is None else "B"
        checksum, code = _CRC.get(self.crc, (None, ""))
        body = struct.Struct(self.byte_order + head + "".join(f.code for f in self.fields))
        tail = struct.Struct(self.byte_order + code)
        if body.size + tail.size > MAX_FRAME_BYTES:
            raise ValueError(f"{self.kind}: frame of {body.size + tail.size} bytes, at most {MAX_FRAME_BYTES}")
        derived = {"body": body, "tail": tail, "length": body.size + tail.size, "checksum": checksum}
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def _check(self) -> None:
        if self.kind not in _VOCABULARY:
            raise ValueError(f"frame kind must be request or answer, not {self.kind!r}")
        if self.crc != "none" and self.crc not in _CRC:
            raise ValueError(f"{self.kind}.crc: must be crc8, crc16 or none, not {self.crc!r}")
        if self.byte_order not in ("<", ">"):
            raise ValueError(f"{self.kind}.byte_order: must be < or >, not {self.byte_order!r}")
        whole = isinstance(self.sync, int) and not isinstance(self.sync, bool)
        if self.sync is not None and not (whole and 0 <= self.sync <= 0xFF):
            raise ValueError(f"{self.kind}.sync: must be a byte or none, not {self.sync!r}")
        self._check_fields()

    def _check_fields(self) -> None:
        names = [f.name for f in self.fields if f.name != "pad"]
        known = _VOCABULARY[self.kind]
        for name, code, scale in self.fields:
            if name not in (*known, "pad"):
                raise ValueError(f"{self.kind}.fields: unknown field {name!r}, known: {', '.join(known)}, pad")
            if code not in _CODES:
                raise ValueError(f"{self.kind}.fields: {name}: format must be one of {' '.join(sorted(_CODES))}")
            if not (math.isfinite(scale) and scale != 0.0) or (name in WORDS and scale != 1.0):
                raise ValueError(f"{self.kind}.fields: {name}: scale {scale} is not allowed")
            if name in WORDS and code in "fd":
                raise ValueError(f"{self.kind}.fields: {name}: must be an integer format")
        if len(set(names)) != len(names):
            raise ValueError(f"{self.kind}.fields: a field is given twice")
        needed = {"torque_nm", "flags"} if self.kind == "request" else {"theta"}
        if missing := needed - set(names):
            raise ValueError(f"{self.kind}.fields: missing {', '.join(sorted(missing))}")

    @property
    def has_seq(self) -> bool:
        """Whether this frame carries a sequence number."""
        return any(f.name == "seq" for f in self.fields)


@dataclass(frozen=True)
class Layout:
    """Both frames of one board."""

    request: FrameLayout
    answer: FrameLayout

    def __post_init__(self) -> None:
        if self.request.kind != "request" or self.answer.kind != "answer":
            raise ValueError("layout: request and answer are swapped")


DEFAULT_LAYOUT: Final = Layout(
    request=FrameLayout(
        kind="request",
        fields=(Field("seq", "B"), Field("flags", "B"), Field("torque_nm", "f")),
        sync=0xA5,
        crc="crc8",
    ),
    answer=FrameLayout(
        kind="answer",
        fields=(
            Field("seq", "B"),
            Field("status", "B"),
            Field("errors", "B"),
            Field("theta", "f"),
            Field("dtheta", "f"),
            Field("current", "f"),
            Field("board_ms", "H"),
        ),
        sync=0x5A,
        crc="crc16",
    ),
)


def layout_from_table(table: Mapping[str, Any]) -> Layout:
    """Build a layout from plain data {request|answer: {sync, crc, byte_order, fields: [[name, code, scale?]]}}.

    Raises ValueError with one clear line."""
    return Layout(request=_frame_from_table("request", table), answer=_frame_from_table("answer", table))


def _frame_from_table(kind: Kind, table: Mapping[str, Any]) -> FrameLayout:
    known = {"sync", "crc", "byte_order", "fields"}
    try:
        row = table[kind]
        if unknown := set(row) - known:
            raise ValueError(f"{kind}: unknown key {sorted(unknown)[0]!r}, known: {', '.join(sorted(known))}")
        fields = tuple(Field(*entry) for entry in row["fields"])
        return FrameLayout(kind, fields, row.get("sync"), row.get("crc", "none"), row.get("byte_order", "<"))
    except KeyError as error:
        raise ValueError(f"layout.{kind}: {error} is missing") from error
    except (TypeError, AttributeError) as error:
        raise ValueError(f"layout.{kind}: {error}") from error


def layout_to_table(layout: Layout) -> dict[str, Any]:
    """Plain data that `layout_from_table` reads back."""
    return {
        f.kind: {"sync": f.sync, "crc": f.crc, "byte_order": f.byte_order, "fields": [list(x) for x in f.fields]}
        for f in (layout.request, layout.answer)
    }
