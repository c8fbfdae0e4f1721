"""Files of identified models (`hoopd.identified/1`): a linear model in innovation form, and how it was found.

Rules of this file: everything wrong in a file is one `InputError`; no mathematics beyond shapes and finite numbers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.yaml_text import text_of

Array = NDArray[np.float64]
Rows = list[list[float]]

MATRICES = ("a", "b", "c", "d", "k", "r")
# Keys that files of the hoop do without.
LATER = ("structure", "units", "operating_point", "usual_size", "columns", "estimates")
SPREAD = "spread"


class IdentifiedFile(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """x+ = a x + b u + k e, y = c x + d u + e, e white with covariance r; rows of the matrices as lists."""

    schema: Literal["hoopd.identified/1"]
    name: str
    method: str
    sample_time_s: float
    inputs: list[str]
    outputs: list[str]
    a: Rows
    b: Rows
    c: Rows
    d: Rows
    k: Rows
    r: Rows
    recordings: list[str] = []
    fit_percent: dict[str, dict[str, float]] = {}  # by horizon ("1", "10", "simulation") and output
    notes: list[str] = []
    structure: str = ""  # orders, where the method alone does not tell them
    units: dict[str, str] = {}  # by signal, as a person writes them
    operating_point: dict[str, float] = {}  # by signal: what the model is about, 0 where nothing stands
    usual_size: dict[str, float] = {}  # by signal: standard deviation in the data of the fit
    columns: dict[str, str] = {}  # by signal, and t: the column of the files that it was fitted to
    estimates: dict[str, dict[str, float | None]] = {}  # coefficients by name: value, standard_error
    spread: Rows = []  # by one standard deviation along each axis of their ellipsoid: a, b, c, d, k, row by row

    def matrices(self) -> dict[str, Array]:
        """By their letters."""
        nx, nu, ny = len(self.a), len(self.inputs), len(self.outputs)
        shapes = {"a": (nx, nx), "b": (nx, nu), "c": (ny, nx), "d": (ny, nu), "k": (nx, ny), "r": (ny, ny)}
        return {name: _matrix(name, getattr(self, name), shape) for name, shape in shapes.items()}

    def moves(self) -> list[dict[str, Array]]:
        """What a, b, c, d and k change by, a standard deviation along each axis of what the data leave open."""
        parts = {name: one for name, one in self.matrices().items() if name != "r"}
        cuts = np.cumsum([one.size for one in parts.values()])
        rows = _matrix(SPREAD, self.spread, (len(self.spread), int(cuts[-1])))
        pieces = ([*np.split(row, cuts[:-1])] for row in rows)
        return [
            {name: piece.reshape(one.shape) for (name, one), piece in zip(parts.items(), own, strict=True)}
            for own in pieces
        ]


def is_identified(path: Path) -> bool:
    """Whether a file says that it is one; whatever else is wrong with it is told by who reads it."""
    try:
        found = parse_yaml(read_text(path), path)
    except InputError:
        return False
    return isinstance(found, dict) and str(found.get("schema", "")).startswith("hoopd.identified/")


def load_identified(path: Path) -> IdentifiedFile:
    """A checked file of an identified model; InputError otherwise."""
    return parse_identified(read_text(path), path)


def parse_identified(text: str, path: object) -> IdentifiedFile:
    """A checked model from its file's text; `path` is what a message calls it."""
    file = to_struct(parse_yaml(text, path), IdentifiedFile, path)
    if not 0.0 < file.sample_time_s < np.inf:
        raise InputError(path, "sample_time_s", f"must be a positive number of seconds, not {file.sample_time_s}")
    for key in ("inputs", "outputs"):
        names = getattr(file, key)
        if not names or len(set(names)) != len(names):
            raise InputError(path, key, "must be different names, at least one")
    for key in ("operating_point", "usual_size"):
        for name, value in getattr(file, key).items():
            if name not in (*file.inputs, *file.outputs) or not np.isfinite(value):
                raise InputError(path, f"{key}.{name}", "a finite number of an input or output")
    try:
        file.moves()
    except ValueError as error:
        key, _, reason = str(error).partition(": ")
        raise InputError(path, key, reason) from None
    return file


def identified_text(file: IdentifiedFile) -> str:
    """As YAML, a row of a matrix on a line."""
    plain = msgspec.to_builtins(file)
    blocks = [*MATRICES, *([SPREAD] if file.spread else [])]
    head = {
        key: value for key, value in plain.items() if key not in (*MATRICES, SPREAD) and (key not in LATER or value)
    }
    text = text_of(head, allow_unicode=True)
    return text + "".join(f"{name}:\n{_rows(plain[name])}" for name in blocks)


def _rows(rows: Rows) -> str:
    if not rows:
        return "  []\n"
    return "".join(f"- [{', '.join(repr(float(value)) for value in row)}]\n" for row in rows)


def _matrix(name: str, rows: Any, shape: tuple[int, int]) -> Array:
    try:
        found = np.array(rows, dtype=float).reshape(shape)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: must have {shape[0]} rows of {shape[1]} numbers") from None
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        raise ValueError(f"{name}: must have {shape[0]} rows of {shape[1]} numbers")
    if not np.isfinite(found).all():
        raise ValueError(f"{name}: every number must be finite")
    return found
