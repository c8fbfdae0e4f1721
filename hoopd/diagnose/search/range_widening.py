"""A number on the end of its range: the range widened once, and everything fitted again.

A range of an effect holds what is usual. A fit that stands on its end would leave the rest of the effect to whatever
is tried next; what it can be at all (its sign, a share, the drive's limit) stays its bound.

Rules of this file: how far an end moves, and whether it may, say the effects.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch


def in_wider_ranges(
    found: HypothesisFit, train: Sequence[Stretch], names: Collection[str] | None = None
) -> HypothesisFit:
    """The fit with the ranges widened on whose ends it stands, of the effects `names` (all); itself where none is, or
    where the recordings are no likelier."""
    effects = tuple(
        effect.holding(found.values) if names is None or effect.name in names else effect for effect in found.effects
    )
    if effects == found.effects:
        return found
    wider = fit(train, effects, found.values, like=found, noise=found.noise, free=found.free)
    return wider if wider.criterion < found.criterion else found
