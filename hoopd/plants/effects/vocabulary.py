"""Effects by name, of the library or of the grammar: what a model file may name.

Rules of this file: it only looks up.
"""

from __future__ import annotations

from collections.abc import Iterable

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library


def remembering(plant: Plant, effects: Iterable[Effect]) -> list[str]:
    """Names of the mechanisms that have a memory: it begins with nothing wherever a run does."""
    own = library(plant)
    return [one.name for one in effects if one.plant is not None and one.name not in own]


def known_effects(plant: Plant, names: Iterable[str] = ()) -> dict[str, Effect]:
    """Give the library of a plant, and those mechanisms of the grammar that are named.

    Parameters
    ----------
    plant : Plant
        A declaration.
    names : iterable of str
        `slot.effect`; a name that nobody knows is left out.

    Returns
    -------
    dict of str to Effect
        The library in its order, then the named mechanisms.

    Examples
    --------
    >>> from hoopd.plants.effects.vocabulary import known_effects
    >>> from hoopd.plants.registry import plant_named
    >>> known_effects(plant_named("pendulum"), ["body.dahl_of_alpha"])["body.dahl_of_alpha"].parameters[1].unit
    'rad'
    """
    found = library(plant)
    more = [name for name in names if name not in found]
    every = mechanisms(plant) if more else {}
    return {**found, **{name: every[name].effect for name in more if name in every}}
