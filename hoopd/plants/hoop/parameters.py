"""Which parameters each structure of the plant has, in which units, and which values are possible.

Rules of this file: tables and checks; no equation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

LIMIT_NM = 0.7  # what the drive gives, of either sign

KINEMATICS = ("rolling", "published")
STRUCTURES = (*KINEMATICS, "entries")

# Which parameters each structure takes, with their units.
_GEOMETRY = {"mb": "kg", "Ro": "m", "Rb": "m", "g": "m/s^2"}
_LAGRANGIAN = {**_GEOMETRY, "Ib": "kg m^2", "Ih": "kg m^2", "bb": "N m s", "bh": "N m s"}
_ENTRIES = {
    **_GEOMETRY,  # only generalised forces beyond the torque need these
    "J11": "1/s",
    "J12": "1/s",
    "K1": "1/s^2",
    "L1": "1/(kg m^2)",
    "J21": "1/s",
    "J22": "1/s",
    "K2": "1/s^2",
    "L2": "1/(kg m^2)",
}
PARAMETER_UNITS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "rolling": MappingProxyType(_LAGRANGIAN),
        "published": MappingProxyType(_LAGRANGIAN),
        "entries": MappingProxyType(_ENTRIES),
    }
)
_POSITIVE = frozenset({"mb", "Ro", "Rb", "g", "Ib", "Ih", "L1"})
_NOT_NEGATIVE = frozenset({"bb", "bh"})


class ParameterError(ValueError):
    """A parameter is missing, unknown or outside its range; `name` says which."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(f"{name}: {reason}")


def check_parameters(structure: str, values: Mapping[str, float], extra: tuple[str, ...] = ()) -> dict[str, float]:
    """The parameters of a structure in their order; ParameterError on a missing, unknown or impossible one."""
    if structure not in STRUCTURES:
        raise ParameterError("structure", f"unknown {structure!r}; known: {', '.join(STRUCTURES)}")
    names = (*PARAMETER_UNITS[structure], *extra)
    for name in values:
        if name not in names:
            raise ParameterError(name, f"not a parameter of the {structure} model; known: {', '.join(names)}")
    for name in names:
        _check_value(name, values.get(name))
    if values["Ro"] <= values["Rb"]:
        raise ParameterError("Rb", f"the ball's rolling radius {values['Rb']} m must be below Ro = {values['Ro']} m")
    return {name: float(values[name]) for name in names}


def _check_value(name: str, value: float | None) -> None:
    if value is None:
        raise ParameterError(name, "missing")
    if not math.isfinite(value):
        raise ParameterError(name, f"must be finite, not {value}")
    if name in _POSITIVE and value <= 0.0:
        raise ParameterError(name, f"must be positive, not {value}")
    if name in _NOT_NEGATIVE and value < 0.0:
        raise ParameterError(name, f"must not be negative, not {value}")
