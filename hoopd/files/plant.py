"""Records of a plant file (`hoopd.plant/1`), and the quantities that stand in it as text.

Rules of this file: what stands in the file and nothing more; what its equations amount to is judged where plants are
known (`plants.plant_file`).
"""

from __future__ import annotations

import re
from typing import Annotated, Literal

import msgspec

from hoopd.files.dimensions import parse_unit
from hoopd.files.reading import ANY_NUMBER, InputError
from hoopd.files.records import Strict

SCHEMA = "hoopd.plant/1"
_QUANTITY = re.compile(r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(.*)", re.DOTALL)

Bound = Annotated[float, ANY_NUMBER]


class CoordinateEntry(Strict, frozen=True):
    """A coordinate of second order: m or rad; how far and how fast it usually goes, where the file says so."""

    unit: str
    usual: float | None = None
    usual_rate: float | None = None


class StateEntry(Strict, frozen=True):
    """A state of first order: a level, a temperature, a current."""

    unit: str
    usual: float | None = None


class InputEntry(Strict, frozen=True):
    """What drives the plant; its limit in the same unit."""

    unit: str
    limit: float | None = None
    usual: float | None = None


class ParameterEntry(Strict, frozen=True):
    """A number of the plant: fitted within its bounds unless it is held."""

    value: float
    unit: str
    bounds: tuple[Bound, Bound] = (-float("inf"), float("inf"))
    held: bool = False


class ChannelEntry(Strict, frozen=True):
    """What is measured: an expression of states and parameters, by a sensor (the slot of its errors)."""

    reads: str
    unit: str = ""
    sensor: str = ""


class SlotEntry(Strict, frozen=True):
    """A place where physics may be missing, for who wants other places than those made from the coordinates."""

    kind: Literal["actuator", "body", "sensor", "push"]
    coordinate: str
    channels: tuple[str, ...] = ()
    device: str = ""


class PlantFile(Strict, frozen=True):
    """`hoopd.plant/1`; a text in place of a record is its unit, a parameter's value and unit, what a channel reads."""

    schema: Literal["hoopd.plant/1"]
    name: str
    equations: dict[str, str]
    description: str = ""
    coordinates: dict[str, CoordinateEntry | str] = msgspec.field(default_factory=dict)
    states: dict[str, StateEntry | str] = msgspec.field(default_factory=dict)
    inputs: dict[str, InputEntry | str] = msgspec.field(default_factory=dict)
    parameters: dict[str, ParameterEntry | str] = msgspec.field(default_factory=dict)
    channels: dict[str, ChannelEntry | str] = msgspec.field(default_factory=dict)
    slots: dict[str, SlotEntry] = msgspec.field(default_factory=dict)
    energy: str = ""  # J; what is stored, of states and parameters
    sample_time_s: float = 0.02


def quantity(path: object, key: str, text: str) -> tuple[float, str]:
    """Number and unit of "9.81 m/s2"; InputError for anything else."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise InputError(path, key, f"expected a number and its unit, got {text!r}")
    number = float(match[1])
    if abs(number) == float("inf"):
        raise InputError(path, key, f"must be a finite number, not {match[1]}")
    return number, match[2].strip()


def check_unit(path: object, key: str, text: str) -> None:
    """InputError for a unit that nobody knows."""
    try:
        parse_unit(text)
    except ValueError as error:
        raise InputError(path, key, str(error)) from None
