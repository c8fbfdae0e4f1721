"""All effects that fit a plant, in a fixed order.

Rules of this file: it only collects, and says what the plant's input is: effects are declared with the word torque.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from hoopd.plants.declaration import Plant
from hoopd.plants.effects import angle_sensor, body, drive, image_sensor, push, store
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.usual_sizes import input_with_article

# A user's effects: ready ones, or what makes them for a plant.
Extra = Effect | Callable[[Plant], Iterable[Effect]]
# Along the signal path; a plant's own kinds of slot come between the bodies and what pushes and reads them.
FORCES, READINGS = (drive, body, store), (push, image_sensor, angle_sensor)
TORQUE, TEXTS = "torque", ("statement", "signature", "best_experiment", "write_back")


def library(plant: Plant, extra: Iterable[Extra] = ()) -> dict[str, Effect]:
    """Give the effects that a plant may have, by name along the signal path.

    Parameters
    ----------
    plant : Plant
        A declaration; its slots say which effects there are.
    extra : iterable of Effect or callable
        Further ones, or functions of the plant that make them.

    Returns
    -------
    dict of str to Effect
        Forces, the plant's own, readings, then `extra`.

    Raises
    ------
    ValueError
        A name that stands twice.

    Examples
    --------
    >>> from hoopd.plants.effects.library import library
    >>> from hoopd.plants.registry import plant_named
    >>> [name for name in library(plant_named("pendulum")) if "friction" in name]
    ['body.coulomb_friction', 'body.stribeck_friction', 'body.friction_drift']
    """
    own = [_in_words_of(plant, effect) for module in FORCES for effect in module.effects(plant)]
    own += plant.own_effects(plant) if plant.own_effects is not None else ()
    own += [_in_words_of(plant, effect) for module in READINGS for effect in module.effects(plant)]
    found: dict[str, Effect] = {}
    for effect in (*own, *(one for more in extra for one in ((more,) if isinstance(more, Effect) else more(plant)))):
        if effect.name in found:
            raise ValueError(f"{effect.name}: there is an effect of this name already")
        found[effect.name] = effect
    return found


def _in_words_of(plant: Plant, effect: Effect) -> Effect:
    """The same where the plant's input is no torque: a force, a flow, or an input."""
    word, one = plant.input_word, input_with_article(plant)
    if word == TORQUE:
        return effect
    told = {name: getattr(effect, name).replace(f"a {TORQUE}", one).replace(TORQUE, word) for name in TEXTS}
    return replace(effect, **told)
