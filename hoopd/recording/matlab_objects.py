"""Tables in MATLAB files of version 5: columns by name, as MATLAB keeps them beside its variables.

A table is an object; the variable holds its number, and the last array of the file ("subsystem") what belongs to it: a
struct whose field MCOS is an array of cells. Its first cell is a table of whole numbers (names, classes, objects, their
properties) in regions whose offsets stand in front; from the third cell on there are values of properties.

Rules of this file: every index is checked; what does not fit is one ValueError. MathWorks publishes no account of this
form: it is known from readers (mat-io, MatFileHandler) and from files; what it does not say is not guessed.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.recording import mat5

MAGIC = 0xDD000000  # first number of a variable that is an object
VERSIONS = {2: 1, 3: 2, 4: 3}  # of the form -> cells behind the values of properties
HEAD = 40  # bytes: version, count of names, eight offsets
VALUE = 1  # kind of a property whose value is a cell
FIRST_VALUE = 2  # cell
MAX_RECORDS = 100_000
Numbers = NDArray[np.int64]


class TableVariable(NamedTuple):
    """One variable of a table."""

    values: mat5.Array
    unit: str


def tables(arrays: list[mat5.Array]) -> dict[str, dict[str, TableVariable]]:
    """Columns by name of every table among a file's variables; ValueError when they do not fit together."""
    objects = [array for array in arrays if array.kind == mat5.OPAQUE and _class(array) == "table"]
    hidden = [array for array in arrays if not array.name and array.kind in mat5.NUMBERS]
    if not objects or not hidden:
        return {}
    subsystem = _Subsystem(_cells_of(hidden[-1]))
    return {array.name: _columns(subsystem.properties(_number(array))) for array in objects}


def _columns(properties: Mapping[str, mat5.Array]) -> dict[str, TableVariable]:
    names, values = (mat5.cells(properties[key]) for key in ("varnames", "data"))
    if len(names) != len(values):
        raise ValueError("a table with more or fewer names than columns")
    described = mat5.fields(properties["props"]) if "props" in properties else {}
    units = mat5.cells(described["VariableUnits"]) if "VariableUnits" in described else []
    texts = [mat5.text(unit) if unit.kind == mat5.TEXT else "" for unit in units] or [""] * len(names)
    if len(texts) != len(names):
        raise ValueError("a table with more or fewer units than columns")
    columns = (TableVariable(value, unit) for value, unit in zip(values, texts, strict=True))
    return dict(zip(map(mat5.text, names), columns, strict=True))


def _class(array: mat5.Array) -> str:
    """Class of an object's variable: the parts are the kind of object, the class, and the numbers."""
    return bytes(array.parts[1].data).decode("ascii", "replace") if len(array.parts) == 3 else ""


def _number(array: mat5.Array) -> int:
    """Number of a single object: magic, number of dimensions, dimensions, the object's number, its class's."""
    numbers = mat5.values(mat5.inner(array.parts[2])).ravel().tolist()
    if len(numbers) != 6 or numbers[:4] != [MAGIC, 2, 1, 1]:
        raise ValueError("a variable that is no single object")
    return int(numbers[4])


def _cells_of(hidden: mat5.Array) -> list[mat5.Array]:
    """Cells of the subsystem."""
    data = mat5.values(hidden).astype(np.uint8).tobytes()
    (top,) = mat5.nested(data)[:1] or (None,)
    mcos = mat5.fields(top).get("MCOS") if top is not None else None
    if mcos is None or mcos.kind != mat5.OPAQUE or len(mcos.parts) != 3:
        raise ValueError("objects without what belongs to them")
    return mat5.cells(mat5.inner(mcos.parts[2]))


class _Subsystem:
    """Objects and their properties."""

    def __init__(self, cells: list[mat5.Array]) -> None:
        if not cells:
            raise ValueError("objects without cells")
        data = mat5.values(cells[0]).astype(np.uint8).tobytes()
        if len(data) < HEAD:
            raise ValueError("objects without a head")
        head = np.frombuffer(data, "<i4", HEAD // 4).tolist()
        version, offsets = head[0], head[2:]
        if version not in VERSIONS:
            raise ValueError(f"objects in a form {version} that is not known")
        edges = [HEAD, *offsets[:5]]
        if edges != sorted(edges) or edges[-1] > len(data) or any(edge % 4 for edge in edges[1:]):
            raise ValueError("objects whose regions overlap")
        self._names = [part.decode("ascii", "replace") for part in data[HEAD : offsets[0]].split(b"\0") if part]
        regions = [np.frombuffer(data[a:b], "<i4").astype(np.int64) for a, b in pairwise(edges[1:])]
        _, self._stored, self._objects, self._plain = regions
        self._values = cells[FIRST_VALUE : len(cells) - VERSIONS[version]]

    def properties(self, number: int) -> dict[str, mat5.Array]:
        """Saved properties of an object by name."""
        # class, two unknown, record among those that a class stores in a way of its own, record else, dependency
        row = self._objects[6 * number : 6 * number + 6]
        if number < 1 or len(row) != 6:
            raise ValueError("an object that is not there")
        record = _record(self._stored, int(row[3])) if row[3] else _record(self._plain, int(row[4]))
        found = {}
        for name, kind, value in record.tolist():
            if not 1 <= name <= len(self._names) or (kind == VALUE and not 0 <= value < len(self._values)):
                raise ValueError("a property that is not there")
            if kind == VALUE:
                found[self._names[name - 1]] = self._values[value]
        for name in ("data", "varnames"):
            if name not in found:
                raise ValueError(f"a table without {name}")
        return found


def _record(region: Numbers, number: int) -> Numbers:
    """Record of a region: a count, and three numbers for each property; padded to an even length."""
    position = 0
    if not 0 < number <= MAX_RECORDS:
        raise ValueError("an object without a record")
    for k in range(number + 1):
        count = int(region[position]) if position < len(region) else -1
        after = position + 1 + 3 * count
        if count < 0 or after > len(region):
            raise ValueError("an object whose record is not there")
        if k == number:
            return region[position + 1 : after].reshape(count, 3)
        position = after + after % 2
    raise AssertionError("no record was reached")
