"""All effects that fit a plant, in a fixed order.

Rules of this file: it only collects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from hoopd.plants.declaration import Plant
from hoopd.plants.effects import angle_sensor as encoder
from hoopd.plants.effects import body as hoop
from hoopd.plants.effects import drive as actuator
from hoopd.plants.effects import image_sensor as camera
from hoopd.plants.effects import push as external
from hoopd.plants.effects.base import Effect
from hoopd.plants.hoop import ball_effects as ball
from hoopd.plants.hoop import frame_effects as frame

# A user's effects: ready ones, or what makes them for a plant.
Extra = Effect | Callable[[Plant], Iterable[Effect]]
SLOT_FILES = (actuator, hoop, ball, frame, external, camera, encoder)


def library(plant: Plant, extra: Iterable[Extra] = ()) -> dict[str, Effect]:
    """Effects by name along the signal path, then `extra`; ValueError when a name stands twice."""
    own = [effect for module in SLOT_FILES for effect in module.effects(plant)]
    found: dict[str, Effect] = {}
    for effect in (*own, *(one for more in extra for one in ((more,) if isinstance(more, Effect) else more(plant)))):
        if effect.name in found:
            raise ValueError(f"{effect.name}: there is an effect of this name already")
        found[effect.name] = effect
    return found
