"""How well models foretell data that they were not fitted to, over several horizons and in simulation, side by side.

    loss = sum over horizons of the mean over outputs of |y - yhat| / |y - mean y|
Two models differ by no more than chance where the difference of their losses is within its standard error, by the
jackknife over consecutive blocks of the data held back: errors of one block are alike for both, and correlated within.

Rules of this file: nothing is fitted here; a simulation that runs away counts as one somewhat worse than the mean.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import estimate_x0, predict

Array = NDArray[np.float64]

# One step, ten steps, simulation: what a predictor, a controller and a simulator ask for.
HORIZONS: tuple[float, ...] = (1, 10, np.inf)
# Each fold holds another part of the record back: its end, its beginning, what lies between.
PARTS = 3
# The state at the start of what is held back is told by its first samples, as many as so, or so many an order.
START, START_BY_ORDER = 50, 3
# Blocks of the jackknife in each piece held back.
BLOCKS = 8
# An error so many times the outputs' change, and more, counts alike: how far an unstable simulation gets means nothing.
WORST = 1.5
# A loss so much smaller, a third of a point of fit at each horizon, is worth no other model.
WORTH = 0.01
# Means so small beside a channel's deviation were taken out.
CENTRED = 1e-6
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
    """Three ways to hold a third of every experiment back, its end first; none where too little would be left.

    Where the means are taken out of a record, those of what is fitted are taken out of each fold: an operating point
    that moves is then as far off as in the next record. Of the third between the others that would be a mean of both
    its sides, which nobody has of a next record: there it is that of the rows before.
    """
    each = [one[: min(one.n, MOST)] for one in experiments(data)]
    if sum(one.n // PARTS for one in each) < FEWEST:
        return []
    parts = (PARTS - 1, 0, *range(1, PARTS - 1))
    found = [_fold(each, part) for part in parts]
    if not _is_centred(each):
        return found
    return [
        _centred(one, one.fitted if part in (0, PARTS - 1) else [whole[: _edge(whole, part)] for whole in each])
        for part, one in zip(parts, found, strict=True)
    ]


def _edge(one: Data, part: int) -> int:
    """The first row of a part."""
    return round(one.n * part / PARTS)


def _fold(each: Sequence[Data], part: int) -> Fold:
    """One part held back."""
    fitted, held = [], []
    for one in each:
        first, last = _edge(one, part), _edge(one, part + 1)
        fitted += [rest for rest in (one[:first], one[last:]) if rest.n]
        held.append(one[first:last])
    return Fold(tuple(fitted), tuple(held))


def _is_centred(each: Sequence[Data]) -> bool:
    rows = np.concatenate([np.hstack([one.u, one.y]) for one in each])
    return bool((np.abs(np.nanmean(rows, axis=0)) <= CENTRED * np.nanstd(rows, axis=0)).all())


def _centred(fold: Fold, known: Sequence[Data]) -> Fold:
    """Without the means of what is fitted; what is held back without those of the rows that are `known`, or of a signal
    that is missing in all of these, without the fitted ones'."""
    fitted, before = _means(fold.fitted), _means(known)
    told = tuple(np.where(np.isnan(one), other, one) for one, other in zip(before, fitted, strict=True))
    return Fold(_less(fold.fitted, fitted), _less(fold.held, (told[0], told[1])))


def _means(parts: Sequence[Data]) -> tuple[Array, Array]:
    """Of inputs and outputs; NaN of one that is missing everywhere."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        u, y = (np.nanmean(np.concatenate([getattr(one, x) for one in parts]), axis=0) for x in ("u", "y"))
    return u, y


def _less(parts: Sequence[Data], means: tuple[Array, Array]) -> tuple[Data, ...]:
    u, y = means
    return tuple(replace(one, u=one.u - u, y=one.y - y) for one in parts)


def held_errors(model: Innovations, held: Sequence[Data], horizons: Sequence[float] = HORIZONS) -> HeldErrors:
    """Of one model over the experiments held back, its state at the start of each told by the first samples alone."""
    errors, changes = [], []
    for one in held:
        centred = one.y - np.nanmean(one.y, axis=0)
        changes.append(_by_block(np.square(np.nan_to_num(centred))))
        far = WORST * np.sqrt(np.nanmean(np.square(centred), axis=0))
        own = []
        with np.errstate(all="ignore"):
            starts = {ahead: _start(model, one, ahead) for ahead in {h == np.inf for h in horizons}}
            for h in horizons:
                e = one.y - predict(model, one, h, starts[h == np.inf])
                e = np.where(np.isnan(one.y), 0.0, np.where(np.isfinite(e), np.clip(e, -10.0 * far, 10.0 * far), far))
                own.append(_by_block(np.square(e)))
        errors.append(np.array(own))
    return HeldErrors(np.concatenate(errors, axis=2), np.concatenate(changes, axis=1))


def _start(model: Innovations, one: Data, simulation: bool) -> Array:
    samples = min(max(START, START_BY_ORDER * model.nx), max(one.n // 2, model.nx))
    return estimate_x0(model, one, samples=samples, simulation=simulation)


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
