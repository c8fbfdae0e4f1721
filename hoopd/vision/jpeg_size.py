"""Width and height of a JPEG by its header: how much memory a decoder would take, asked before it takes it.

Rules of this file: only as far as the frame header (ITU-T T.81, annex B.2), and only what is written as the standard
says: anything else has no size, so that no decoder finds another one.
"""

from __future__ import annotations

import struct

_START = b"\xff\xd8"
# A frame header by its marker: baseline, extended, progressive and the rest of T.81 table B.1, without the tables
# (DHT, DAC) and the reserved marker (JPG) that lie between them.
_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
# What may stand before it: tables, restart interval, applications' own, comments.
_BEFORE = frozenset({0xC4, 0xCC, 0xDB, 0xDD, *range(0xE0, 0xF0), 0xFE})
_SEGMENT = struct.Struct(">BBH")  # 0xFF, marker, length with itself
_FRAME = struct.Struct(">BHH")  # precision, height, width


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Width and height in pixels; None for what is no JPEG, or tells no size.

    Examples
    --------
    >>> jpeg_size(bytes.fromhex("ffd8 ffdb 0003 00 ffc0 0008 08 0010 0020 01"))
    (32, 16)
    """
    if not data.startswith(_START):
        return None
    position = len(_START)
    while position + _SEGMENT.size + _FRAME.size <= len(data):
        first, marker, length = _SEGMENT.unpack_from(data, position)
        if first != 0xFF or length < 2:
            return None
        if marker in _FRAMES:
            _, height, width = _FRAME.unpack_from(data, position + _SEGMENT.size)
            return (width, height) if width and height else None  # 0: told later, by a line count
        if marker not in _BEFORE:
            return None
        position += 2 + length
    return None
