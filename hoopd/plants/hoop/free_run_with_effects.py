"""Free runs of the hoop under the names that fits and tests know: both are `simulate.Model`.

Rules of this file: names only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.simulate import STEP_S, HoopModel


class EffectModel(HoopModel):
    """`HoopModel` of what was found on one base."""

    def __init__(
        self, found: FoundEffects, free: Sequence[str] = (), *, moving: str = "both", step_s: float = STEP_S
    ) -> None:
        super().__init__(found.structure, found.base, free, effects=found, moving=moving, step_s=step_s)


def model_of(
    structure: str,
    values: Mapping[str, float],
    free: Sequence[str] = (),
    extra_forces: tuple[ExtraForce, ...] = (),
    effects: FoundEffects | None = None,
    *,
    moving: str = "both",
    step_s: float = STEP_S,
) -> HoopModel:
    """What simulates a hoop again and again, with effects where there are some."""
    found = effects.on(structure, values) if effects else None
    return HoopModel(structure, values, free, extra_forces, found, moving=moving, step_s=step_s)
