"""Controller files (`hoopd.controller/1` with `plant`) of other plants than the hoop: their record, checks and text.

Rules of this file: everything wrong in a file is one `InputError`; no control law lives here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from hoopd.files.plant import LONGEST_SAMPLE_S
from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.records import Strict, between
from hoopd.files.yaml_text import text_of

Rows = list[list[float]]


class PlantGains(Strict, frozen=True):
    """Matrices of the law about the operating point, in the order of `states`, `inputs` and `channels`."""

    feedback: Rows  # K (inputs, states)
    filter: Rows  # M (states, channels)
    a: Rows  # (states, states) of a sample
    b: Rows  # (states, inputs)
    c: Rows  # (channels, states)


class PlantControllerFile(Strict, frozen=True):
    """`hoopd.controller/1` of another plant than the hoop: x += M (y - y0 - C x), u = u0 - K x within the limits,
    x = A x + B (u - u0)."""

    schema: Literal["hoopd.controller/1"]
    name: str
    plant: str  # a registered name or a plant file
    kind: Literal["state_feedback"]
    sample_time_s: float
    states: list[str]  # those that the law knows
    inputs: dict[str, str]  # name: unit
    channels: dict[str, str]  # name: unit
    operating_point: dict[str, float]  # u0 and y0 by the names of inputs and channels
    gains: PlantGains
    limits: dict[str, float] = msgspec.field(default_factory=dict)  # by input, of either sign; none where none is known
    model: str = ""  # the model that it was designed for, unless that is the plant's own numbers
    notes: str = ""


def load_plant_controller(path: Path) -> PlantControllerFile:
    """A checked controller of another plant than the hoop; InputError otherwise."""
    return parse_plant_controller(read_text(path), path)


def parse_plant_controller(text: str, path: object) -> PlantControllerFile:
    """The same from its file's text; `path` is what a message calls it."""
    file = to_struct(parse_yaml(text, path), PlantControllerFile, path)
    between(path, "sample_time_s", file.sample_time_s, 0.0, LONGEST_SAMPLE_S)
    n, m, p = len(file.states), len(file.inputs), len(file.channels)
    shapes = {"feedback": (m, n), "filter": (n, p), "a": (n, n), "b": (n, m), "c": (p, n)}
    for key, shape in shapes.items():
        _check_shape(path, f"gains.{key}", getattr(file.gains, key), shape)
    for name in (*file.inputs, *file.channels):
        if not math.isfinite(file.operating_point.get(name, math.nan)):
            raise InputError(path, f"operating_point.{name}", "a finite number is needed")
    for name, limit in file.limits.items():
        if name not in file.inputs:
            raise InputError(path, f"limits.{name}", f"no input; known: {', '.join(file.inputs)}")
        between(path, f"limits.{name}", limit, 0.0, 1e12)
    return file


def plant_controller_text(file: PlantControllerFile, head: str) -> str:
    """The file: a comment of one line, then YAML."""
    content = {key: value for key, value in msgspec.to_builtins(file).items() if value not in ("", {})}
    return f"# {head}\n" + text_of(content, default_flow_style=None, width=118)


def _check_shape(path: object, key: str, rows: Sequence[Sequence[float]], shape: tuple[int, int]) -> None:
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        raise InputError(path, key, f"must have {shape[0]} rows of {shape[1]} numbers")
    if not np.isfinite(np.array(rows, float)).all():
        raise InputError(path, key, "must be finite numbers")
