"""What stands in a MATLAB file of version 5, as far as a recording needs it: structs of real numeric arrays.

Rules of this file: every type, length and dimension is checked before it is used; ValueError says what is wrong. scipy
writes these files but does not read them here: its loadmat (seen with 1.17.1) takes the type of an element as an index
without a look, so one flipped bit in a file ends the interpreter (SIGSEGV), which no `except` catches. A test compares
both on sound files.
Format: MathWorks, "MAT-File Level 5 File Format".
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import unpacked_limit

HEAD_BYTES = 128
VERSIONS = {0x0100: 5, 0x0200: 73}  # 73: HDF5 behind a MATLAB header
# Type of an element -> numpy's code of its values (the last three are text: utf-8, -16, -32).
CODES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = (16, 17, 18)
TEXT_CODES = dict(zip(TEXTS, ("utf-8", "utf-16", "utf-32"), strict=True))
_ENDS = {"<": "-le", ">": "-be"}
MATRIX, COMPRESSED = 14, 15
INT8, INT32, UINT32 = 1, 5, 6
CELLS, STRUCT, TEXT, OPAQUE, NUMBERS = 1, 2, 4, 17, range(6, 16)  # classes; the last: double, single, int8 to uint64
COMPLEX = 0x0800  # flag
CLASSES = {1: "a cell array", 2: "a struct", 3: "an object", 4: "text", 5: "a sparse matrix", 17: "an object"}
# Of a packed variable, what tells its name: three elements, of which MATLAB lets a name be 63 characters.
NAMED_BYTES = 1024


class Element(NamedTuple):
    """Type and content of one element, and the order of its bytes."""

    kind: int
    data: memoryview
    order: str

    def numbers(self) -> NDArray[Any]:
        """Its values; ValueError when it holds none."""
        if self.kind not in CODES or len(self.data) % (size := int(CODES[self.kind][1])):
            raise ValueError("an element of numbers has another type or length")
        return np.frombuffer(self.data, np.dtype(self.order + CODES[self.kind]), len(self.data) // size)


class Array(NamedTuple):
    """One array: its class, shape and the elements that hold its content."""

    name: str
    flags: int
    shape: tuple[int, ...]
    parts: tuple[Element, ...]

    @property
    def kind(self) -> int:
        """Class of the array."""
        return self.flags & 0xFF


def version(data: bytes) -> int:
    """5, or 73 for HDF5 in a MATLAB file; ValueError for anything else."""
    if len(data) < HEAD_BYTES or data[126:128] not in (b"IM", b"MI"):
        raise ValueError("no header of version 5 or later")
    (number,) = struct.unpack(_order(data) + "H", data[124:126])
    if number not in VERSIONS:
        raise ValueError(f"version {number:#06x} is not known")
    return VERSIONS[number]


def variables(data: bytes, wanted: str | None) -> Iterator[Array]:
    """The arrays of a file, in its order; ValueError at the first damage.

    Packed ones of another name than the wanted one (None: all are) come without content: what nobody asks for is not
    unpacked.
    """
    order, left = _order(data), unpacked_limit(len(data))
    for element in _elements(memoryview(data)[HEAD_BYTES:], order, top=True):
        if element.kind != COMPRESSED:
            yield _array(element)
            continue
        if wanted is not None and (name := _packed_name(element.data, order)) != wanted:
            yield Array(name, 0, (0, 0), ())
            continue
        plain = _unpacked(element.data, left)
        left -= len(plain)
        yield from map(_array, _elements(memoryview(plain), order))


def fields(array: Array) -> dict[str, Array]:
    """Arrays of a single struct by name; ValueError when it is something else."""
    if array.kind != STRUCT or math.prod(array.shape) != 1:
        raise ValueError(f"expected one struct, found {_described(array)}")
    return elements(array)[0]


def elements(array: Array) -> list[dict[str, Array]]:
    """Arrays by name of every element of an array of structs; ValueError when it is something else."""
    if array.kind != STRUCT:
        raise ValueError(f"expected a struct, found {_described(array)}")
    if len(array.parts) < 2 or array.parts[0].kind != INT32 or len(array.parts[0].data) != 4:
        raise ValueError("a struct without names")
    (width,) = array.parts[0].numbers().tolist()
    texts = bytes(array.parts[1].data)
    if width < 1 or array.parts[1].kind != INT8 or len(texts) % width:
        raise ValueError("a struct with impossible names")
    names = [_text(texts[k : k + width]) for k in range(0, len(texts), width)]
    parts, count = array.parts[2:], math.prod(array.shape)
    if len(parts) != count * len(names):
        raise ValueError("a struct with more or fewer arrays than names")
    return [
        dict(zip(names, map(_array, parts[k * len(names) : (k + 1) * len(names)]), strict=True)) for k in range(count)
    ]


def cells(array: Array) -> list[Array]:
    """Arrays of an array of cells; ValueError when it is something else."""
    if array.kind != CELLS or len(array.parts) != math.prod(array.shape):
        raise ValueError(f"expected cells, found {_described(array)}")
    return list(map(_array, array.parts))


def inner(element: Element) -> Array:
    """The array within an element; ValueError when it is something else."""
    return _array(element)


def nested(data: bytes) -> list[Array]:
    """Arrays of a file within a file, whose head is eight bytes; ValueError at the first damage."""
    if data[2:4] not in (b"IM", b"MI"):
        raise ValueError("no head of a file within a file")
    return [_array(element) for element in _elements(memoryview(data)[8:], "<" if data[2:4] == b"IM" else ">")]


def text(array: Array) -> str:
    """A text of one line; ValueError when it is something else."""
    if array.kind != TEXT or len(array.shape) != 2 or array.shape[0] > 1:
        raise ValueError(f"expected text, found {_described(array)}")
    if not array.parts or not math.prod(array.shape):
        return ""
    part = array.parts[0]
    if part.kind in TEXT_CODES:
        return bytes(part.data).decode(TEXT_CODES[part.kind] + ("" if part.kind == TEXTS[0] else _ENDS[part.order]))
    return "".join(map(chr, part.numbers().tolist()))


def values(array: Array) -> NDArray[Any]:
    """Numbers of a real array; ValueError when it is something else."""
    if array.kind not in NUMBERS or array.flags & COMPLEX:
        raise ValueError(f"expected real numbers, found {_described(array)}")
    numbers = array.parts[0].numbers() if len(array.parts) == 1 else np.empty(0)
    if len(numbers) != math.prod(array.shape):
        raise ValueError("more or fewer numbers than the dimensions say")
    return numbers.reshape(array.shape, order="F")


def _order(data: bytes) -> str:
    return "<" if data[126:128] == b"IM" else ">"


def _described(array: Array) -> str:
    shape = " x ".join(map(str, array.shape))
    kind = "complex numbers" if array.flags & COMPLEX else CLASSES.get(array.kind, "numbers")
    return f"{kind} ({shape})"


def _text(data: bytes) -> str:
    return data.split(b"\0")[0].decode("ascii", "replace")


def _unpacked(data: memoryview, limit: int) -> bytes:
    plain, whole = _begun(data, limit + 1)
    if len(plain) > limit:
        raise ValueError(f"a packed element of more than {limit} bytes: no recording")
    if not whole:
        raise ValueError("a packed element without an end")
    return plain


def _begun(data: memoryview, count: int) -> tuple[bytes, bool]:
    """At most so many unpacked bytes, and whether they are all."""
    machine = zlib.decompressobj()
    try:
        return machine.decompress(data, count), machine.eof
    except zlib.error as error:
        raise ValueError(str(error)) from None


def _packed_name(data: memoryview, order: str) -> str:
    """Name of a packed array; ValueError when it is none."""
    head = memoryview(_begun(data, NAMED_BYTES)[0])
    if len(head) < 8 or struct.unpack_from(order + "I", head)[0] != MATRIX:
        raise ValueError("expected an array")
    parts = list(islice(_elements(head[8:], order), 3))
    if len(parts) < 3:
        raise ValueError("an array without flags, dimensions and name")
    return _text(bytes(parts[2].data))


def _elements(data: memoryview, order: str, *, top: bool = False) -> Iterator[Element]:
    """The elements that stand one after the other."""
    position = 0
    while position < len(data):
        if position + 8 > len(data):
            raise ValueError("an element is cut")
        kind, size = struct.unpack_from(order + "II", data, position)
        start, step = position + 8, 8 + size + (0 if kind == COMPRESSED else -size % 8)
        if kind >> 16:  # short form: type and size in one word, up to four bytes of data in the other
            kind, size, start, step = kind & 0xFFFF, kind >> 16, position + 4, 8
        if kind not in CODES and kind not in TEXTS and kind != MATRIX and not (top and kind == COMPRESSED):
            raise ValueError(f"an element of unknown type {kind}")
        if start + size > min(len(data), position + step):
            raise ValueError("an element is longer than what holds it")
        yield Element(kind, data[start : start + size], order)
        position += step


def _is_opaque(parts: tuple[Element, ...]) -> bool:
    flags = parts[0] if len(parts) > 1 else None
    if flags is None or flags.kind != UINT32 or len(flags.data) != 8 or parts[1].kind != INT8:
        return False
    return int(flags.numbers()[0]) & 0xFF == OPAQUE


def _array(element: Element) -> Array:
    """Head and parts of an array; ValueError unless flags, dimensions and name are there."""
    if element.kind != MATRIX:
        raise ValueError("expected an array")
    if not len(element.data):  # how MATLAB writes []
        return Array("", NUMBERS[0], (0, 0), ())
    parts = tuple(_elements(element.data, element.order))
    if _is_opaque(parts):  # a table, a timeseries: what belongs to it stands elsewhere (`matlab_objects`)
        return Array(_text(bytes(parts[1].data)), OPAQUE, (1, 1), parts[2:])
    if len(parts) < 3 or [part.kind for part in parts[:3]] != [UINT32, INT32, INT8] or len(parts[0].data) != 8:
        raise ValueError("an array without flags, dimensions and name")
    shape = tuple(parts[1].numbers().tolist())
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError("an array of impossible dimensions")
    return Array(_text(bytes(parts[2].data)), int(parts[0].numbers()[0]), shape, parts[3:])
