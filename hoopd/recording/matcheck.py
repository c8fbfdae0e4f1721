"""Is a MATLAB file (version 5) sound enough to be handed to scipy?

Rules of this file: nothing is read out, only the frame of every element is checked: a known type, and an end within its
parent. scipy takes the type as an index without a look: one flipped bit there ends the interpreter (SIGSEGV), which
no `except` catches. Format: MathWorks, "MAT-File Level 5 File Format".
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

HEAD_BYTES = 128
# int8 to uint32, single, double, int64, uint64, utf-8, -16, -32: bytes of a value by type; 0: not a value.
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
MATRIX, COMPRESSED = 14, 15
INT32, UINT32 = 5, 6
CELL, STRUCT = 1, 2
NUMBERS = range(6, 16)  # classes double, single, int8 to uint64
MAX_DEPTH = 8
MAX_BYTES = 2**30  # unpacked: what claims more would fill the memory before it fails


class Element(NamedTuple):
    """Type and content of one element."""

    kind: int
    data: memoryview


def version(data: bytes) -> int:
    """5, or 73 for HDF5 in a MATLAB file; ValueError for anything else."""
    if len(data) < HEAD_BYTES or data[126:128] not in (b"IM", b"MI"):
        raise ValueError("no header of version 5 or 7")
    (number,) = struct.unpack(_order(data) + "H", data[124:126])
    if number not in (0x0100, 0x0200):
        raise ValueError(f"version {number:#06x} is not known")
    return 5 if number == 0x0100 else 73


def check(data: bytes) -> None:
    """ValueError when an element is not what its frame says."""
    order = _order(data)
    for element in _elements(memoryview(data)[HEAD_BYTES:], order, top=True):
        if element.kind == COMPRESSED:
            for inner in _elements(memoryview(_unpacked(element.data)), order):
                _check_matrix(inner, order, 0)
        else:
            _check_matrix(element, order, 0)


def _order(data: bytes) -> str:
    return "<" if data[126:128] == b"IM" else ">"


def _unpacked(data: memoryview) -> bytes:
    machine = zlib.decompressobj()
    try:
        plain = machine.decompress(data, MAX_BYTES)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if not machine.eof:
        raise ValueError("a packed element without an end")
    return plain


def _elements(data: memoryview, order: str, *, top: bool = False) -> Iterator[Element]:
    """The elements that stand one after the other."""
    position = 0
    while position < len(data):
        if position + 8 > len(data):
            raise ValueError("an element is cut")
        kind, size = struct.unpack_from(order + "II", data, position)
        start, step = position + 8, 8 + size + (0 if kind == COMPRESSED else -size % 8)
        if kind >> 16:  # short form: size and type in one word, data in the other
            kind, size, start, step = kind & 0xFFFF, kind >> 16, position + 4, 8
            if size > 4:
                raise ValueError("a short element is too long")
        if kind not in SIZES and kind != MATRIX and not (top and kind == COMPRESSED):
            raise ValueError(f"an element of unknown type {kind}")
        if start + size > len(data):
            raise ValueError("an element is longer than what holds it")
        yield Element(kind, data[start : start + size])
        position += step


def _check_matrix(element: Element, order: str, depth: int) -> None:
    """ValueError unless flags, dimensions, name and as many parts as they say are there."""
    if element.kind != MATRIX or depth > MAX_DEPTH:
        raise ValueError("expected an array" if element.kind != MATRIX else "nested too deeply")
    if not len(element.data):
        return
    parts = list(_elements(element.data, order))
    if len(parts) < 3 or parts[0].kind != UINT32 or len(parts[0].data) != 8 or parts[1].kind != INT32:
        raise ValueError("an array without flags, dimensions and name")
    (flags,) = struct.unpack_from(order + "I", parts[0].data)
    shape = struct.unpack(f"{order}{len(parts[1].data) // 4}i", parts[1].data[: len(parts[1].data) // 4 * 4])
    if len(shape) < 2 or min(shape) < 0 or parts[2].kind not in (1, 2, 16):
        raise ValueError("an array of impossible dimensions or name")
    _check_values(parts[3:], math.prod(shape), flags, order, depth)


def _check_values(parts: list[Element], count: int, flags: int, order: str, depth: int) -> None:
    kind = flags & 0xFF
    if kind in NUMBERS:
        wanted = 2 if flags & 0x0800 else 1  # real, imaginary
        if [len(part.data) // SIZES.get(part.kind, 1) for part in parts] != [count] * wanted:
            raise ValueError("an array with more or fewer numbers than its dimensions say")
    elif kind == STRUCT:
        _check_struct(parts, count, order, depth)
    elif kind == CELL:
        _check_nested(parts, count, order, depth)


def _check_struct(parts: list[Element], count: int, order: str, depth: int) -> None:
    if len(parts) < 2 or parts[0].kind != INT32 or len(parts[0].data) != 4:
        raise ValueError("a struct without names")
    (width,) = struct.unpack_from(order + "i", parts[0].data)
    if width < 1 or parts[1].kind not in (1, 2) or len(parts[1].data) % width:
        raise ValueError("a struct with impossible names")
    _check_nested(parts[2:], count * (len(parts[1].data) // width), order, depth)


def _check_nested(parts: list[Element], count: int, order: str, depth: int) -> None:
    if len(parts) != count:
        raise ValueError("more or fewer fields than the dimensions say")
    for part in parts:
        _check_matrix(part, order, depth + 1)
