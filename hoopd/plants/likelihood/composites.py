"""Models of a plant with a set of effects, and their functions: built once for equal plants and effects.

Rules of this file: nothing of a recording enters; equal arguments give one and the same object.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import fields
from functools import lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.fingerprint import fingerprint
from hoopd.plants.integration_step import split_inputs
from hoopd.plants.likelihood.batch_calls import KEPT, Recursion
from hoopd.plants.plant_with_effects import Composite

# Composites live as long as the process: there are as many as sets of effects are tried, some hundred.
_libraries: dict[Hashable, dict[str, Effect]] = {}
_composites: dict[Hashable, Composite] = {}
_derivatives: WeakKeyDictionary[Composite, dict[tuple[str, ...], tuple[ca.Function, ca.Function]]] = WeakKeyDictionary()
# Numbers of fingerprints, and of things that were asked for before; a thing is kept, so that its place in memory stays
# its own.
_numbers: dict[Hashable, int] = {}
_known: dict[int, tuple[object, int]] = {}


def fitting_effects(plant: Plant, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects as this plant has them: an effect of a slot that it lacks is none of its.

    An effect of the library that was made for another plant becomes this one's; a redefined one stays what it is.
    """
    key = key_of(plant)
    if key not in _libraries:
        _libraries[key] = library(plant)
    own = _libraries[key]
    return tuple(_as_known(one, own.get(one.name)) for one in effects if one.fits(plant))


def _as_known(given: Effect, known: Effect | None) -> Effect:
    return given if known is None or _laws(given) != _laws(known) else known


def _laws(effect: Effect) -> tuple[object, ...]:
    """The code of an effect's functions and the names of its parameters: alike on every plant of a library."""
    friction = effect.friction
    functions = [getattr(effect, one.name) for one in fields(effect)]
    functions += [] if friction is None else [friction.level, friction.along, friction.needed]
    code = [getattr(one, "__code__", None) for one in functions if callable(one)]
    return (*code, *(one.name for one in effect.parameters))


def key_of(thing: Plant | Effect) -> int:
    """Equal for plants, and for effects, with equal equations, limits and values."""
    if id(thing) not in _known:
        _known[id(thing)] = thing, _numbers.setdefault(fingerprint(thing), len(_numbers))
    return _known[id(thing)][1]


def composite_of(plant: Plant, effects: tuple[Effect, ...], substeps: int = 0) -> Composite:
    """One object for equal plants and effects: its functions are built once; `substeps`: other than its own."""
    key = (key_of(plant), tuple(map(key_of, effects)), substeps)
    if key not in _composites:
        _composites[key] = Composite(plant, effects, substeps or None)
    return _composites[key]


def derivatives_of(composite: Composite, free: tuple[str, ...]) -> tuple[ca.Function, ca.Function]:
    """Of a substep and of the readings, built once."""
    kept = _derivatives.setdefault(composite, {})
    if free not in kept:
        kept[free] = composite.substep_derivatives(free), composite.output_derivatives(free)
    return kept[free]


@lru_cache(maxsize=KEPT)
def rates_of(composite: Composite) -> ca.Function:
    """(x, inputs, t, p) -> x' of a composite's plant."""
    sizes = {"x": composite.nx, "u": composite.nu, "t": 1, "p": len(composite.names)}
    x, u, t, p = (ca.SX.sym(name, size) for name, size in sizes.items())
    named = {name: p[i] for i, name in enumerate(composite.names)}
    return ca.Function("rates", [x, u, t, p], [ca.densify(composite.rate_expression(x, u, t, named))])


@lru_cache(maxsize=KEPT)
def dry_frictions_of(composite: Composite) -> ca.Function | None:
    """(x, inputs, t, p) -> level, and part of each coordinate in the rate that it opposes, friction after friction.

    None without any; a contact that the accelerations hold is none.
    """
    every = [(one, one.friction) for one in composite.effects]
    frictions = [(one, friction) for one, friction in every if friction is not None and friction.needed is None]
    if not frictions:
        return None
    plant, sizes = composite.plant, {"x": composite.nx, "u": composite.nu, "t": 1, "p": len(composite.names)}
    x, u, t, p = (ca.SX.sym(name, size) for name, size in sizes.items())
    named = {name: p[i] for i, name in enumerate(composite.names)}
    s = composite.point_in_frame(x, named, t, u)
    s.demand = split_inputs(u, len(plant.inputs))[0]
    rows = [
        value
        for effect, friction in frictions
        for along in [friction.along(s)]
        for value in (friction.level(s, effect.values(named)), *(along.get(q, 0.0) for q in plant.coordinates))
    ]
    return ca.Function("dry", [x, u, t, p], [ca.densify(ca.vertcat(*rows))])


class Carrying(NamedTuple):
    """How states that effects add follow given ones. What follows from the given ones alone, most of it, is worked out
    at all nodes at once."""

    known: ca.Function  # (given states, inputs, h, t, p) -> what the added ones need of them
    added: Recursion  # (added states, given ones, inputs, h, t, p, known) -> added states one step later


@lru_cache(maxsize=KEPT)
def carrying(composite: Composite, given: int) -> Carrying:
    """Of a composite's states, of which the first `given` are given; no disturbance."""
    symbols = {k: ca.SX.sym(k, composite.step_function.nnz_in(i)) for i, k in enumerate(("z", "u", "w", "h", "t", "p"))}
    x, own = symbols["z"][:given], symbols["z"][given:]
    still = {"w": ca.SX.zeros(composite.nw), "u": ca.reshape(symbols["u"], composite.substeps, composite.nu)}
    after = composite.step_function(*(({**symbols, **still})[k] for k in ("z", "u", "w", "h", "t", "p")))[given:]
    data = [ca.vertcat(x), *(symbols[k] for k in ("u", "h", "t", "p"))]
    after, needed, known = ca.extract_parametric(after, ca.vertcat(*data))
    return Carrying(
        ca.Function("known", data, [ca.densify(ca.vertcat(*known))], {"cse": True}),
        Recursion(ca.Function("added", [ca.vertcat(own), *data, ca.vertcat(*needed)], [after], {"cse": True})),
    )
