"""Effects with numbers, as a model file says they were found: which they are on a plant, and at what values.

Rules of this file: it looks effects up and checks numbers; no equation, no file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, isfinite

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.library import library
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.parameters import LIMIT_NM, PARAMETER_UNITS
from hoopd.plants.recorded_sizes import undeclared_sizes

Region = Mapping[str, tuple[float, float]]
# What a region of validity may bound: the state, and the torque that is demanded.
REGION_NAMES = ("theta", "dtheta", "psi", "dpsi", "u")


class EffectError(ValueError):
    """An effect that cannot be meant: which part of its entry, and why."""

    def __init__(self, key: str, reason: str) -> None:
        self.key, self.reason = key, reason
        super().__init__(f"{key}: {reason}" if key else reason)


@dataclass(frozen=True)
class FoundEffect:
    """One effect with its numbers."""

    name: str  # slot.effect
    parameters: Mapping[str, float]
    cautious: Mapping[str, float] = field(default_factory=dict)  # amplitudes at the weak ends of their intervals
    valid: Region = field(default_factory=dict)  # where it was seen; empty: everywhere
    phase_lost: bool = False  # its phase was another one in each recording: nobody knows the next one's

    def weakened(self) -> FoundEffect:
        """The same with the amplitudes that it has at least."""
        return replace(self, parameters={**self.parameters, **self.cautious}, cautious={})


@dataclass(frozen=True)
class FoundEffects:
    """Effects of one model file on one plant."""

    structure: str
    base: Mapping[str, float]  # parameters of the base
    entries: tuple[FoundEffect, ...] = ()
    limit_nm: float = LIMIT_NM

    def __bool__(self) -> bool:
        return bool(self.entries)

    @property
    def names(self) -> tuple[str, ...]:
        """`slot.effect` of each."""
        return tuple(one.name for one in self.entries)

    @cached_property
    def plant(self) -> Plant:
        """The declared plant, hoop and ball."""
        return self.plant_of("both")

    def plant_of(self, moving: str) -> Plant:
        """The same plant when both, the hoop or the ball alone moves."""
        return hoop_plant(self.structure, self.base, moving, self.limit_nm)

    def effects(self, plant: Plant | None = None) -> tuple[Effect, ...]:
        """Declarations of those that can act on the plant, in the library's order, in ranges that hold the values."""
        known = known_effects(plant or self.plant, self.names)
        values = self.values
        return tuple(effect.holding(values) for name, effect in known.items() if name in self.names)

    @property
    def values(self) -> dict[str, float]:
        """Base parameters, and effects' by `slot.effect.parameter`."""
        own = {f"{one.name}.{key}": value for one in self.entries for key, value in one.parameters.items()}
        return {**self.base, **own}

    def only(self, wanted: Callable[[Effect], bool]) -> FoundEffects:
        """Those whose declarations are wanted."""
        names = {effect.name for effect in self.effects() if wanted(effect)}
        return self._with(tuple(one for one in self.entries if one.name in names))

    def believed(self) -> FoundEffects:
        """Those that the next run will have as they were measured."""
        return self._with(tuple(one for one in self.entries if not one.phase_lost))

    def weakened(self) -> FoundEffects:
        """Every amplitude at the end of its interval that is nearest to no effect."""
        return self._with(tuple(one.weakened() for one in self.entries))

    def on(self, structure: str, base: Mapping[str, float]) -> FoundEffects:
        """The same effects on another base."""
        return FoundEffects(
            structure, {name: base[name] for name in PARAMETER_UNITS[structure]}, self.entries, self.limit_nm
        )

    def _with(self, entries: tuple[FoundEffect, ...]) -> FoundEffects:
        return FoundEffects(self.structure, self.base, entries, self.limit_nm)

    def __getstate__(self) -> dict[str, object]:
        """Declarations hold functions: they are made again where this is sent."""
        return {name: getattr(self, name) for name in ("structure", "base", "entries", "limit_nm")}


# ---------------------------------------------------------------------------------------------- checks


def checked(plant: Plant, name: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """All parameters of an effect of the plant (those left out neutral); EffectError."""
    effect = known_effects(plant, [name]).get(name)
    if effect is None:
        known = [one for one in library(plant) if one.split(".")[0] == name.split(".", maxsplit=1)[0]] or [
            *library(plant)
        ]
        raise EffectError("name", f"unknown effect {name!r}; known: {', '.join(known)}")
    sized = not undeclared_sizes(plant)
    for key, value in parameters.items():
        _check(effect, key, value, sized=sized)
    needed = [one.name for one in effect.parameters if _needed(one)] if effect.found_by != "switch" else []
    if missing := [name for name in needed if name not in parameters]:
        raise EffectError("parameters", f"{name} lacks {', '.join(missing)}")
    return {**effect.neutral(), **parameters}


def _needed(parameter: EffectParameter) -> bool:
    """Without an amplitude or a scale an entry says nothing; phases and switches have a natural zero."""
    is_natural = parameter.discrete and (parameter.neutral == 0.0 or parameter.per_recording)
    return parameter.role != "phase" and not is_natural


def _check(effect: Effect, key: str, value: float, *, sized: bool) -> None:
    """`sized`: the plant says how large it is; otherwise ranges are those of a recording, and only signs are known."""
    names = [one.name for one in effect.parameters]
    if key not in names:
        raise EffectError(f"parameters.{key}", f"unknown parameter of {effect.name}; known: {', '.join(names)}")
    one = effect.parameter(key)
    if value == one.neutral:
        return
    low, high = one.widest
    if not sized and not one.discrete:
        low, high = (0.0 if low >= 0.0 else -inf), (0.0 if high <= 0.0 else inf)
    if not isfinite(value) or not (one.role == "phase" or low <= value <= high):
        raise EffectError(f"parameters.{key}", f"must be {low:g} to {high:g} {one.unit}, not {value:g}")
    if one.discrete and len(one.grid) == 1 and value != round(value):
        raise EffectError(f"parameters.{key}", f"must be a whole number, not {value:g}")
    if one.discrete and len(one.grid) > 1 and value not in one.grid:
        raise EffectError(f"parameters.{key}", f"must be one of {one.grid[0]:g} to {one.grid[-1]:g}, not {value:g}")


def check_region(valid: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
    """A region of validity; EffectError."""
    for name, bounds in valid.items():
        if name not in REGION_NAMES:
            raise EffectError(f"valid.{name}", f"unknown; known: {', '.join(REGION_NAMES)}")
        if not (len(bounds) == 2 and bounds[0] < bounds[1]):
            raise EffectError(f"valid.{name}", f"must be two numbers, the lower one first, not {list(bounds)}")
    return {name: (float(low), float(high)) for name, (low, high) in valid.items()}


def weak_end(parameter: EffectParameter, value: float, ci95: tuple[float, float] | None) -> float:
    """What an effect has at least: the end of the interval nearest to neutral, neutral where it may be none at all.

    Sizes only: an amplitude, and a shape whose neutral value is the end of its range (a dead zone of none).
    """
    if ci95 is None or not isfinite(parameter.neutral) or not _is_size(parameter):
        return value
    low, high = ci95
    return min(max(parameter.neutral, low), high)


def _is_size(parameter: EffectParameter) -> bool:
    """More of it is more of the effect; a choice, a harmonic or a speed where a law bends is none."""
    if parameter.role == "amplitude":
        return True
    return parameter.role == "shape" and not parameter.discrete and parameter.neutral == parameter.low
