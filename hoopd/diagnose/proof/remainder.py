"""What remains beside everything that was named: whether it still follows a law more than noise allows.

Every direction of the grammar and every curve is asked of what the final fit leaves. The best of them has its level
from noise drawn on the same columns (`chance.Null`), its size is told the residual's colour, and the direction must
hold in blocks of the recordings that its size was not estimated on: what a name has left behind does, what one odd
moment makes does not.

Rules of this file: it judges screens that were made; nothing is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.unknown_effects import Survey
from hoopd.diagnose.search.chance import EULER
from hoopd.diagnose.search.folds import FOLDS, LEAST_KNOWN, fold_of_rows
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]

# How often the best of all directions may be as surprising by chance.
CHANCE = 0.01


@dataclass(frozen=True)
class Remainder:
    """The best of what still follows a law beside a fit."""

    slot: str
    follows: str  # in words
    surprise: float  # nats, told the residual's colour and how much was looked at
    level: float  # what chance exceeds in a share CHANCE of all recordings
    usual: float  # what chance reaches on average
    held_back: float  # nats in blocks that its size was not estimated on

    @property
    def fires(self) -> bool:
        """More than noise allows."""
        return self.surprise > self.level and self.held_back > 0.0

    @property
    def log_odds(self) -> float:
        """Against chance: even at the level."""
        return self.surprise - self.level if self.held_back > 0.0 else -self.level

    @property
    def beyond(self) -> float:
        """Nats beyond what chance reaches; 0 where that is all."""
        return max(self.surprise - self.usual, 0.0) if self.fires else 0.0


def remainder(screen: MechanismScreen, curves: Survey | None) -> Remainder | None:
    """What stands out most above its level; `screen` and `curves` are beside the same final fit."""
    found = [*_of_mechanisms(screen), *_of_curves(curves)]
    return max(found, key=lambda one: one.log_odds, default=None)


def _of_mechanisms(screen: MechanismScreen) -> Iterator[Remainder]:
    best = max(screen.proposals, key=lambda one: one.surprise, default=None)
    if best is None:
        return
    # what it costs to say which it is stands in the level: that of the best of all that were looked at
    yield Remainder(
        best.mechanism.site.slot, best.mechanism.axis.words, best.surprise, screen.null.threshold(CHANCE),
        log(screen.null.tries) + EULER, held_back(screen.fit, best.vector, screen.residual),
    )  # fmt: skip


def _of_curves(about: Survey | None) -> Iterator[Remainder]:
    if about is None or not about.curves:
        return
    best = about.curves[0]
    yield Remainder(
        best.curve.slot, " and ".join(best.curve.depends_on), best.surprise, about.threshold,
        log(about.null.tries) + EULER, held_back(about.fit, best.vector, about.screen.residual),
    )  # fmt: skip


def held_back(fit: HypothesisFit, direction: Array, residual: Array) -> float:
    """Nats that a direction (rows,) gains where its size was not estimated, over all blocks that can say."""
    fold, along, size = fold_of_rows(fit), direction * residual, direction**2
    gained = 0.0
    for k in range(FOLDS):
        mine = fold == k
        rest = float(size[~mine].sum())
        if rest > LEAST_KNOWN * float(size.sum()):
            weight = float(along[~mine].sum()) / rest
            gained += weight * float(along[mine].sum()) - weight**2 * float(size[mine].sum()) / 2.0
    return gained


def explained(losses: Sequence[float], total: float, rest: Remainder | None) -> list[float]:
    """Of each name, its share of what names and remainder explain together."""
    whole = max(total, max(losses, default=0.0)) + (rest.beyond if rest is not None else 0.0)
    return [float(np.clip(loss / whole, 0.0, 1.0)) if whole > 0.0 else 0.0 for loss in losses]
