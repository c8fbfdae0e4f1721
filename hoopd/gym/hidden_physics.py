"""The physics of an environment: a model, how far its parameters are drawn from it, and effects that nobody tells of.

Rules of this file: numbers and names in, a plant's own out; what is wrong is one ValueError.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.files.model import ModelFile
from hoopd.files.shipped import or_shipped
from hoopd.plants.found_effects import EffectError, FoundEffect, FoundEffects, checked
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF
from hoopd.plants.model_file import effects_of, load_model

# Weighed and measured, or nature's: not drawn.
KNOWN = frozenset({"g", "Ro", "Rb", "mb"})
LARGEST_SPREAD = 0.5


@dataclass(frozen=True)
class HiddenPhysics:
    """What the plant of an environment is made of.

    Attributes
    ----------
    model : Path
        A model file of the hoop; a shipped one by its name.
    effects : mapping of str to mapping
        Physics that the model does not have, by `slot.effect`, with its numbers.
    spread : float
        Every parameter but radii and masses is drawn anew in each try, from this share below to this share above.
    """

    model: Path = Path("models/hoop.yaml")
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    spread: float = 0.0

    def __post_init__(self) -> None:
        """ValueError for what no plant can have."""
        if not isinstance(self.spread, Real) or not 0.0 <= self.spread <= LARGEST_SPREAD:
            raise ValueError(f"spread must be 0 to {LARGEST_SPREAD:g}, not {self.spread!r}")
        if not isinstance(self.effects, Mapping) or not all(map(_is_effect, self.effects.items())):
            raise ValueError(f"effects: a mapping of names to their numbers, not {self.effects!r}")

    def check(self) -> None:
        """ValueError for effects that this model cannot have."""
        self.drawn(np.random.default_rng(0))

    def file(self) -> ModelFile:
        """The model, as its file tells it."""
        return load_model(or_shipped(self.model))

    def drawn(self, rng: np.random.Generator) -> FoundEffects:
        """The plant of one try; its ball may always leave the hoop."""
        told = effects_of(self.file())
        flies = LIFT_OFF in {one.name for one in told.entries}
        hidden = {**({} if flies else {LIFT_OFF: {}}), **self.effects}
        entries = [one for one in told.entries if one.name not in hidden]
        try:
            entries += [FoundEffect(name, checked(told.plant, name, numbers)) for name, numbers in hidden.items()]
        except EffectError as error:
            raise ValueError(f"effects: {error}") from None
        base = {name: value * self._factor(name, rng) for name, value in told.base.items()}
        return FoundEffects(told.structure, base, tuple(entries), told.limit_nm)

    def _factor(self, name: str, rng: np.random.Generator) -> float:
        return 1.0 if name in KNOWN or self.spread == 0.0 else float(rng.uniform(1 - self.spread, 1 + self.spread))


def physics_of(
    model: Path | str | None, effects: Mapping[str, Mapping[str, float]] | None, spread: float, usual: str
) -> HiddenPhysics:
    """As an environment is asked for it; `usual`: the model where none is named. ValueError."""
    if model is not None and not isinstance(model, str | PathLike):
        raise ValueError(f"model: a path, not {model!r}")
    return HiddenPhysics(Path(model or usual), {} if effects is None else effects, spread)


def _is_effect(entry: tuple[Any, Any]) -> bool:
    """A name, with numbers by theirs."""
    name, numbers = entry
    if not isinstance(name, str) or not isinstance(numbers, Mapping):
        return False
    return all(isinstance(key, str) and isinstance(value, Real) for key, value in numbers.items())
