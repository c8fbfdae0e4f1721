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

_QUANTITY = re.compile(r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(.*)", re.DOTALL)

# No plant of a laboratory is sampled more rarely, s.
LONGEST_SAMPLE_S = 3600.0

Bound = Annotated[float, ANY_NUMBER]


class CoordinateEntry(Strict, frozen=True):
    """A coordinate of second order; how far and how fast it usually goes, where the file says so."""

    unit: str  # m or rad
    usual: float | None = None  # size of its usual motion
    usual_rate: float | None = None  # of its rate, a second


class StateEntry(Strict, frozen=True):
    """A state of first order: a level, a temperature, a current."""

    unit: str
    usual: float | None = None  # its usual size


class InputEntry(Strict, frozen=True):
    """What drives the plant, held between two samples."""

    unit: str
    limit: float | None = None  # the drive gives no more, of either sign
    usual: float | None = None  # its usual size


class ParameterEntry(Strict, frozen=True):
    """A number of the plant."""

    value: float  # nominal: where a fit starts
    unit: str
    bounds: tuple[Bound, Bound] = (-float("inf"), float("inf"))  # a fit stays within; .inf: no bound
    held: bool = False  # known, and not fitted


class ChannelEntry(Strict, frozen=True):
    """What is measured."""

    reads: str  # an expression of states, rates and parameters
    unit: str = ""  # that of the expression without it
    sensor: str = ""  # the slot of its errors; encoder and camera have effects of their own
    # arbitrary: counted from where it was switched on, another place in each recording
    zero: Literal["fixed", "arbitrary"] = "fixed"


class SlotEntry(Strict, frozen=True):
    """A place where physics may be missing."""

    kind: Literal["actuator", "body", "store", "sensor", "push"]
    coordinate: str  # of a store its first-order state
    channels: tuple[str, ...] = ()  # of a sensor
    device: str = ""  # of a sensor: encoder, camera or anything else


class PlantFile(Strict, frozen=True):
    """What moves and by which equations. A text in place of a record is its unit, of a parameter its value and unit, of
    a channel what it reads: `coordinates: {x: m}`, `parameters: {m: 2 kg}`, `channels: {x: x}`."""

    schema: Literal["hoopd.plant/1"]
    name: str
    equations: dict[str, str]  # `left = right` by coordinate and state
    description: str = ""
    coordinates: dict[str, CoordinateEntry | str] = msgspec.field(default_factory=dict)  # each with x, x', x''
    states: dict[str, StateEntry | str] = msgspec.field(default_factory=dict)  # each with h, h'
    inputs: dict[str, InputEntry | str] = msgspec.field(default_factory=dict)
    parameters: dict[str, ParameterEntry | str] = msgspec.field(default_factory=dict)
    channels: dict[str, ChannelEntry | str] = msgspec.field(default_factory=dict)  # without: coordinates and states
    slots: dict[str, SlotEntry] = msgspec.field(default_factory=dict)  # without: made from the coordinates
    energy: str = ""  # J; what is stored, of states and parameters
    sample_time_s: float = 0.02  # usual time between two samples


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
