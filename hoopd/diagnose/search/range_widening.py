"""A number on the end of its range: the range widened once, and everything fitted again.

A range of an effect holds what is usual. A fit that stands on its end would leave the rest of the effect to whatever
is tried next; what it can be at all (its sign, a share, the drive's limit) stays its bound.

Rules of this file: how far an end moves, and whether it may, say the effects.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch

# What is usual is known beforehand: a wider range is a second look at the same effect, and has to be worth that. Else a
# law with one number more wins by a number that no device has.
ASKED_NATS = 3.0


def in_wider_ranges(
    found: HypothesisFit, train: Sequence[Stretch], names: Collection[str] | None = None
) -> HypothesisFit:
    """The fit with the ranges widened on whose ends it stands, of the effects `names` (all); itself where none is, or
    where the recordings do not ask for it."""
    effects = tuple(
        effect.holding(found.values) if names is None or effect.name in names else effect for effect in found.effects
    )
    if effects == found.effects:
        return found
    wider = fit(train, effects, found.values, like=found, noise=found.noise, free=found.free)
    return wider if found.criterion - wider.criterion >= ASKED_NATS else found
