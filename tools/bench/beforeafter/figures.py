"""Figures of a fit or a diagnosis, and how far two of them lie apart.

Rules of this file: pure; a distance between two values of a parameter is counted in standard errors of the first one.
"""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Iterator, Mapping
from math import inf
from typing import Any, NamedTuple

WIDTH_OF_95 = 2.0 * 1.959963984540054  # of an interval, in standard errors
PACKAGES = ("numpy", "scipy", "casadi", "control")


class Distance(NamedTuple):
    """How far a parameter moved."""

    name: str
    errors: float  # standard errors of the first value; inf where it has none and the values differ


def versions() -> dict[str, str]:
    """Of all that a figure's last digits hang on."""
    return {"python": platform.python_version(), "machine": platform.machine()} | {
        name: importlib.metadata.version(name) for name in PACKAGES
    }


def of_diagnosis(found: Mapping[str, Any]) -> dict[str, Any]:
    """Verdict, names and parameters of a diagnosis (`hoopd.diagnosis/1`)."""
    return {
        "verdict": found["verdict"],
        "slot": (found.get("location") or {}).get("slot"),
        "effects": [
            {
                "name": effect["name"],
                "parameters": _parameters(effect["parameters"]),
                "log_likelihood_gain": effect["evidence"]["log_likelihood_gain"],
                "not_excluded": effect.get("not_excluded", []),
            }
            for effect in found["effects"]
        ],
        "base": _parameters(found["base"]["parameters"]),
    }


def of_fit(found: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a fit, and the fit of each channel of each recording in percent."""
    return {
        "base": _parameters(found["parameters"]),
        "percent": {
            f"{recording.rsplit('/', 1)[-1]} {channel}": row["fitted"]
            for recording, channels in found["fit"]["train"].items()
            for channel, row in channels.items()
        },
    }


def _parameters(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: {"value": one["value"], "ci95": one.get("ci95")} for name, one in given.items()}


def names(figures: Mapping[str, Any]) -> tuple[str, ...]:
    """Verdict and effects, in their order."""
    return (figures.get("verdict", "fit"), *(effect["name"] for effect in figures.get("effects", ())))


def distances(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[Distance]:
    """Of every parameter that both have."""
    yield from _between("", before["base"], after["base"])
    later = {effect["name"]: effect for effect in after.get("effects", ())}
    for effect in before.get("effects", ()):
        if effect["name"] in later:
            yield from _between(f"{effect['name']}.", effect["parameters"], later[effect["name"]]["parameters"])


def _between(prefix: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[Distance]:
    for name, old in before.items():
        new = after.get(name)
        yield Distance(prefix + name, inf if new is None else _errors(old, new["value"]))


def _errors(old: Mapping[str, Any], value: float) -> float:
    if value == old["value"]:
        return 0.0
    low, high = old["ci95"] or (0.0, 0.0)
    width = (high - low) / WIDTH_OF_95
    return abs(value - old["value"]) / width if width > 0.0 else inf


def largest(before: Mapping[str, Any], after: Mapping[str, Any]) -> Distance:
    """The parameter that moved most."""
    return max(distances(before, after), key=lambda one: one.errors, default=Distance("-", 0.0))
