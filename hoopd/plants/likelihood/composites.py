"""Models of a plant with a set of effects, and their functions: built once for equal plants and effects.

Rules of this file: nothing of a recording enters; equal arguments give one and the same object.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca

from hoopd.plants.composite import Composite
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.batch_calls import KEPT, Recursion

# Composites live as long as the process: there are as many as sets of effects are tried, some hundred.
_libraries: dict[str, dict[str, Effect]] = {}
_composites: dict[tuple[str, tuple[str, ...], int], Composite] = {}
_derivatives: dict[tuple[int, tuple[str, ...]], tuple[ca.Function, ca.Function]] = {}


def fitting_effects(plant: Plant, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects as this plant has them: an effect of a slot that it lacks is none of its."""
    key = plant_key(plant)
    if key not in _libraries:
        _libraries[key] = library(plant)
    own = _libraries[key]
    return tuple(own.get(one.name, one) for one in effects if one.fits(plant))


def plant_key(plant: Plant) -> str:
    """Equal for plants with equal equations and values; an effect may have given one a state more."""
    return f"{plant.name} {plant.states} {sorted(plant.values.items())}"


def composite_of(plant: Plant, effects: tuple[Effect, ...], substeps: int = 0) -> Composite:
    """One object for equal plants and effects: its functions are built once; `substeps`: other than its own."""
    key = (plant_key(plant), tuple(effect.name for effect in effects), substeps)
    if key not in _composites:
        _composites[key] = Composite(plant, effects, substeps or None)
    return _composites[key]


def derivatives_of(composite: Composite, free: tuple[str, ...]) -> tuple[ca.Function, ca.Function]:
    """Of a substep and of the readings, built once."""
    key = (id(composite), free)
    if key not in _derivatives:
        _derivatives[key] = composite.substep_derivatives(free), composite.output_derivatives(free)
    return _derivatives[key]


@lru_cache(maxsize=KEPT)
def carrying(composite: Composite, given: int) -> Recursion:
    """(added states, given ones, torques, h, t, p) -> added states one step later, all states one step later."""
    symbols = {k: ca.SX.sym(k, composite.step_function.nnz_in(i)) for i, k in enumerate(("z", "u", "w", "h", "t", "p"))}
    x, own = symbols["z"][:given], symbols["z"][given:]
    ins = [own, x, *(symbols[k] for k in ("u", "h", "t", "p"))]
    still = {"w": ca.SX.zeros(composite.nw)}
    after = composite.step_function(*(({**symbols, **still})[k] for k in ("z", "u", "w", "h", "t", "p")))
    return Recursion(ca.Function("carried", [ca.vertcat(own), ca.vertcat(x), *ins[2:]], [after[given:], after]))
