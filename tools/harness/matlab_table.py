"""MATLAB files with a table, byte by byte as MATLAB writes them: scipy has no objects."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
DOUBLE, CELLS, STRUCT, TEXT, UINT8, UINT32, OBJECT = 6, 1, 2, 4, 9, 13, 17


def element(code: int, data: bytes) -> bytes:
    """Type, length, content, padded."""
    return np.array([code, len(data)], "<u4").tobytes() + data + bytes(-len(data) % 8)


def array(kind: int, shape: tuple[int, ...], parts: bytes, name: str = "") -> bytes:
    """An array of some class."""
    head = element(6, np.array([kind, 0], "<u4").tobytes()) + element(5, np.array(shape, "<i4").tobytes())
    return element(14, head + element(1, name.encode()) + parts)


def numbers(values: np.ndarray) -> bytes:
    """A column of doubles."""
    return array(DOUBLE, (len(values), 1), element(9, np.asarray(values, "<f8").tobytes()))


def text(words: str) -> bytes:
    """A line of text."""
    return array(TEXT, (1 if words else 0, len(words)), element(16, words.encode()))


def cells(parts: list[bytes], shape: tuple[int, int] | None = None) -> bytes:
    """An array of cells."""
    return array(CELLS, shape or (1, len(parts)), b"".join(parts))


def struct(fields: Mapping[str, bytes]) -> bytes:
    """One struct."""
    names = b"".join(name.encode().ljust(32, b"\0") for name in fields)
    return array(STRUCT, (1, 1), element(5, np.int32(32).tobytes()) + element(1, names) + b"".join(fields.values()))


def handle(kind: str, content: bytes, name: str = "") -> bytes:
    """A variable that is an object."""
    head = element(6, np.array([OBJECT, 0], "<u4").tobytes())
    return element(14, head + b"".join(element(1, one.encode()) for one in (name, "MCOS", kind)) + content)


def table(
    columns: Mapping[str, np.ndarray], units: Mapping[str, str], *, name: str = "T", kind: str = "table"
) -> bytes:
    """A file with one table."""
    names = [b"varnames", b"data", b"props", kind.encode()]
    strings = b"".join(one + b"\0" for one in names)
    strings += bytes(-len(strings) % 8)
    regions = (
        [0, 0, 0, 0, 0, 4, 0, 0],  # classes: none, and the fourth name
        [0, 0],  # objects that a class stores in a way of its own: none
        [0] * 6 + [1, 0, 0, 0, 1, 1],  # objects: none, and one of class 1 with record 1
        [0, 0, 3, 1, 1, 0, 2, 1, 1, 3, 1, 2],  # records: none, and three properties with values 0, 1, 2
        [0, 0, 0, 0],
    )
    starts = np.cumsum([40 + len(strings), *(4 * len(region) for region in regions)])
    offsets = [*starts.tolist(), 0, 0][:8]
    data = np.array([4, len(names), *offsets], "<i4").tobytes() + strings
    data += b"".join(np.array(region, "<i4").tobytes() for region in regions)
    first = array(UINT8, (len(data), 1), element(2, data))
    values = (
        cells([text(one) for one in columns]),
        cells([numbers(one) for one in columns.values()]),
        struct({"VariableUnits": cells([text(units.get(one, "")) for one in columns])}),
    )
    empty = array(DOUBLE, (0, 0), element(9, b""))
    wrapper = handle("FileWrapper__", cells([first, empty, *values, empty, empty, empty], (8, 1)))
    inside = b"\x00\x01IM\x00\x00\x00\x00" + struct({"MCOS": wrapper})
    hidden = array(UINT8, (1, len(inside)), element(2, inside))
    number = array(UINT32, (6, 1), element(6, np.array([0xDD000000, 2, 1, 1, 1, 1], "<u4").tobytes()))
    return HEAD + handle(kind, number, name) + hidden
