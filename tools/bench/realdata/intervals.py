"""Intervals of parameters in model files, and which of two models' overlap.

Rules of this file: a model is what its file says; a number without an interval is counted, and judged by nobody.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import yaml

# Where the angle began belongs to a recording: two of them share no phase, and no place on the hoop's angle, whose zero
# is where it stood.
PHASE, PLACE, ON_THE_HOOP = "phi", "v0", "_of_theta"
# How often a turn: a size at another number is another thing.
NUMBER = "n"


class Estimate(NamedTuple):
    """A number with its 95 % interval; None: it has none."""

    value: float
    interval: tuple[float, float] | None


class Compared(NamedTuple):
    """A parameter that two models have."""

    name: str
    models: tuple[str, str]
    first: Estimate
    second: Estimate

    @property
    def overlap(self) -> bool | None:
        """Whether the intervals do; None when one has none."""
        one, other = self.first.interval, self.second.interval
        if one is None or other is None:
            return None
        return one[0] <= other[1] and other[0] <= one[1]


def estimates(path: Path) -> dict[str, Estimate]:
    """By name: the base's parameters, and the effects' as `slot.effect.parameter`."""
    model = yaml.safe_load(path.read_text(encoding="utf-8"))
    found = {name: _estimate(one) for name, one in model["parameters"].items() if isinstance(one, Mapping)}
    for effect in model.get("effects", ()):
        own = effect["parameters"]
        which = f"[n={round(float(own[NUMBER]['value']))}]" if NUMBER in own else ""
        for name, one in own.items():
            if name != PHASE and not (name == PLACE and ON_THE_HOOP in effect["name"]):
                found[f"{effect['name']}{which if name != NUMBER else ''}.{name}"] = _estimate(one)
    return found


def named(path: Path) -> list[str]:
    """Effects of a model file, in its order."""
    return [one["name"] for one in yaml.safe_load(path.read_text(encoding="utf-8")).get("effects", ())]


def _estimate(one: Mapping[str, Any]) -> Estimate:
    interval = one.get("ci95")
    return Estimate(float(one["value"]), None if interval is None else (float(interval[0]), float(interval[1])))


def compared(models: Mapping[str, Mapping[str, Estimate]]) -> Iterator[Compared]:
    """Every parameter that two of the models both have."""
    for one, other in combinations(models, 2):
        for name in models[one].keys() & models[other].keys():
            yield Compared(name, (one, other), models[one][name], models[other][name])


def share(rows: Sequence[Compared]) -> tuple[int, int]:
    """How many overlap, of how many that can be compared."""
    judged = [one.overlap for one in rows if one.overlap is not None]
    return sum(judged), len(judged)


def shown(one: Estimate) -> str:
    """As a table has it."""
    if one.interval is None:
        return f"{one.value:.4g}"
    return f"{one.value:.4g} ({one.interval[0]:.4g} to {one.interval[1]:.4g})"
