"""How well models foretell data that they were not fitted to, over several horizons and in simulation, side by side.

    loss = sum over horizons of the mean over outputs of |y - yhat| / |y - mean y|
Two models differ by no more than chance where the difference of their losses is within its standard error, by the
jackknife over consecutive blocks of the data held back: errors of one block are alike for both, and correlated within.

Rules of this file: nothing is fitted here; a simulation that runs away counts as one somewhat worse than the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import predict

Array = NDArray[np.float64]

# One step, ten steps, simulation: what a predictor, a controller and a simulator ask for.
HORIZONS: tuple[float, ...] = (1, 10, np.inf)
# Of the record: each of the two folds holds back so much, one at its end, one at its beginning.
HELD = 1.0 / 3.0
# Blocks of the jackknife in each piece held back.
BLOCKS = 8
# An error so many times the outputs' change, and more, counts alike: how far an unstable simulation gets means nothing.
WORST = 1.5
# A loss so much smaller, a third of a point of fit at each horizon, is worth no other model.
WORTH = 0.01
# Fewer samples held back tell nothing.
FEWEST = 40
# A choice looks at so many samples of an experiment.
MOST = 4_000


@dataclass(frozen=True)
class Fold:
    """Experiments to fit and experiments held back."""

    fitted: tuple[Data, ...]
    held: tuple[Data, ...]


@dataclass(frozen=True)
class HeldErrors:
    """Sums of squared errors (horizons, ny, blocks) and of the outputs' squared changes (ny, blocks)."""

    errors: Array
    changes: Array

    @property
    def losses(self) -> Array:
        """(horizons,) error relative to the change, mean over the outputs."""
        return _losses(self.errors.sum(axis=2), self.changes.sum(axis=1))

    @property
    def loss(self) -> float:
        """Over all horizons."""
        return float(self.losses.sum())

    def without_each_block(self) -> Array:
        """(blocks,) the loss without one of them."""
        kept = self.errors.sum(axis=2, keepdims=True) - self.errors
        change = self.changes.sum(axis=1, keepdims=True) - self.changes
        return np.array([_losses(kept[:, :, b], change[:, b]).sum() for b in range(self.changes.shape[1])])


def folds(data: Data | Sequence[Data]) -> list[Fold]:
    """Two ways to hold a third of every experiment back; none where too little would be left."""
    each = [one[: min(one.n, MOST)] for one in experiments(data)]
    cuts = [(round(HELD * one.n), one.n) for one in each]
    if sum(cut for cut, _ in cuts) < FEWEST:
        return []
    late = Fold(
        tuple(one[: n - cut] for one, (cut, n) in zip(each, cuts, strict=True)),
        tuple(one[n - cut :] for one, (cut, n) in zip(each, cuts, strict=True)),
    )
    early = Fold(
        tuple(one[cut:] for one, (cut, _) in zip(each, cuts, strict=True)),
        tuple(one[:cut] for one, (cut, _) in zip(each, cuts, strict=True)),
    )
    return [late, early]


def held_errors(model: Innovations, held: Sequence[Data], horizons: Sequence[float] = HORIZONS) -> HeldErrors:
    """Of one model over the experiments held back."""
    errors, changes = [], []
    for one in held:
        centred = one.y - np.nanmean(one.y, axis=0)
        changes.append(_by_block(np.square(np.nan_to_num(centred))))
        own = []
        for h in horizons:
            with np.errstate(all="ignore"):
                e = one.y - predict(model, one, h)
                far = WORST * np.sqrt(np.nanmean(np.square(centred), axis=0))
                e = np.where(np.isnan(one.y), 0.0, np.where(np.isfinite(e), np.clip(e, -10.0 * far, 10.0 * far), far))
            own.append(_by_block(np.square(e)))
        errors.append(np.array(own))
    return HeldErrors(np.concatenate(errors, axis=2), np.concatenate(changes, axis=1))


def together(parts: Sequence[HeldErrors]) -> HeldErrors:
    """Of all folds."""
    return HeldErrors(
        np.concatenate([one.errors for one in parts], axis=2), np.concatenate([one.changes for one in parts], axis=1)
    )


def no_worse(one: HeldErrors, best: HeldErrors, deviations: float = 1.0) -> bool:
    """Whether `one` is no worse than `best` by more than so many standard errors of the difference, or than matters."""
    difference = one.loss - best.loss
    if difference <= WORTH:
        return True
    left_out = one.without_each_block() - best.without_each_block()
    count = len(left_out)
    error = float(np.sqrt((count - 1.0) / count * np.sum(np.square(left_out - left_out.mean()))))
    return difference <= deviations * error


def _losses(errors: Array, changes: Array) -> Array:
    ratio = np.sqrt(errors / np.maximum(changes, 1e-300))
    return np.asarray(np.minimum(ratio, WORST).mean(axis=1))


def _by_block(squares: Array) -> Array:
    """(ny, blocks) sums over consecutive blocks of rows (n, ny)."""
    edges = np.linspace(0, len(squares), BLOCKS + 1).astype(int)
    return np.array([squares[a:b].sum(axis=0) for a, b in pairwise(edges)]).T
