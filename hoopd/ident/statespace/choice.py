"""Order, horizon, weighting and refinement of a subspace estimate, by prediction of data that it was not fitted to.

Every candidate is fitted to two thirds of the record and judged on the rest (`heldback`), at either end; the best are
refined, step by step, as long as that foretells better, and count where it does by more than chance. Of those that are
not worse than the best by more than chance the likeliest on the whole record counts, by an information criterion over
all horizons: what was held back rejects, the whole record decides between equals. One that is unstable or simulates far
worse on the whole record than before is passed over.

Rules of this file: channels are scaled; nothing is random; a choice is told in words.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, runs
from hoopd.ident.doubts import IdentificationWarning
from hoopd.ident.models import Innovations
from hoopd.ident.statespace import heldback
from hoopd.ident.statespace.disturbances import SlowDisturbance, disturbances, predicts, with_disturbance
from hoopd.ident.statespace.heldback import HORIZONS, WORTH, Fold, HeldErrors, held_errors, no_worse, together
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.ordering import split_of
from hoopd.ident.statespace.projection import Weighting, WindowSplit
from hoopd.ident.statespace.structure_choice import StructureChoice
from hoopd.ident.statespace.subspacefit import Goal, SubspaceEstimate, WindowedData, estimate, refined

Array = NDArray[np.float64]

# Steps of refinement after which it is looked: the best of every order takes the first looks, so many of them the rest,
# as long as not so many looks in a row find nothing better.
STEPS, FIRST_LOOKS, REFINED, PATIENCE = (1, 2, 4, 8, 16, 32), 2, 4, 2
# Candidates of different orders that are given slow disturbances.
DISTURBED = 5
# Likelihoods are compared so many steps towards their largest: an order is not to win by a better start.
TOWARDS = 3
# Candidates within chance of the best that are fitted to the whole record.
FINALISTS = 8
# Simulation of the whole record may be so much worse (of the outputs' change) than of what was held back.
SIMULATED_WORSE = 0.1


@dataclass(frozen=True)
class SubspaceSetting:
    """How one subspace estimate is made."""

    order: int
    horizon: int
    weighting: Weighting
    direct: bool
    steps: int = 0
    disturbance: SlowDisturbance | None = None


@dataclass(frozen=True)
class CandidateRange:
    """What is looked at: orders, horizons, weightings; a direct term, refinement (None: any), a slow disturbance."""

    orders: Sequence[int]
    horizons: Sequence[int]
    weightings: Sequence[Weighting]
    direct: bool
    steps: int | None
    goal: Goal
    disturbance: bool


@dataclass(frozen=True)
class JudgedSetting:
    """A setting and its errors on what was held back."""

    setting: SubspaceSetting
    held: HeldErrors


@dataclass
class _Fits:
    """Windows of folds and of the whole record by horizon, made once."""

    folds: Sequence[Fold]
    goal: Goal
    made: dict[tuple[int, int], WindowedData | None] = field(default_factory=dict)

    def estimate(self, i: int, setting: SubspaceSetting) -> SubspaceEstimate | None:
        """Of fold i; None where its data cannot give one."""
        key = i, setting.horizon
        if key not in self.made:
            self.made[key] = _windowed(self.folds[i].fitted, setting.horizon)
        windowed = self.made[key]
        if windowed is None or setting.order > windowed.most_order:
            return None
        try:
            return estimate(windowed, setting.order, setting.weighting, setting.direct, self.goal)
        except (ValueError, np.linalg.LinAlgError):
            return None


def choose(each: Sequence[Data], allowed: CandidateRange) -> tuple[Innovations, StructureChoice] | None:
    """The model of the whole record and how it was chosen; None where too little is there to hold any back.

    The experiments are scaled, of step 1.
    """
    folds = heldback.folds(each)
    if not folds:
        return None
    horizons = HORIZONS if allowed.goal.focus == "prediction" else (np.inf,)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", IdentificationWarning)
        fits = _Fits(folds, allowed.goal)
        judged = [one for setting in _settings(allowed) if (one := _judged(fits, setting, horizons)) is not None]
        if not judged:
            return None
        judged.sort(key=lambda one: one.held.loss)
        if allowed.steps is None:
            judged = sorted([*judged, *_refinements(fits, judged, horizons)], key=lambda one: one.held.loss)
        if allowed.disturbance and allowed.goal.focus == "prediction":
            judged = sorted([*judged, *_disturbed(fits, judged, horizons)], key=lambda one: one.held.loss)
        return _decided(each, judged, allowed.goal, horizons)


def _settings(allowed: CandidateRange) -> Iterator[SubspaceSetting]:
    for horizon in allowed.horizons:
        for weighting in allowed.weightings:
            for order in allowed.orders:
                yield SubspaceSetting(order, horizon, weighting, allowed.direct, allowed.steps or 0)


def _windowed(each: Sequence[Data], horizon: int) -> WindowedData | None:
    """None where there are fewer windows than rows."""
    parts = [part for one in each for part in runs(one)]
    if not parts:
        return None
    split = WindowSplit(horizon, horizon, parts[0].nu, parts[0].ny)
    long = [part for part in parts if part.n >= split.length]
    if sum(part.n - split.length + 1 for part in long) < sum(split.sizes):
        return None
    return WindowedData.of(parts, split)


def _judged(fits: _Fits, setting: SubspaceSetting, horizons: Sequence[float]) -> JudgedSetting | None:
    held = []
    for i, fold in enumerate(fits.folds):
        found = fits.estimate(i, setting)
        if found is None:
            return None
        model = _after(found, setting, fits.goal) if setting.steps else found.model
        held.append(held_errors(model, fold.held, horizons))
    return JudgedSetting(setting, together(held))


def _after(found: SubspaceEstimate, setting: SubspaceSetting, goal: Goal) -> Innovations:
    """The model after the setting's steps, or as many as lower the errors, with its disturbances."""
    model = list(islice(refined(found, setting.direct, goal), setting.steps + 1))[-1]
    return model if setting.disturbance is None else with_disturbance(model, setting.disturbance)


def _refinements(
    fits: _Fits, judged: Sequence[JudgedSetting], horizons: Sequence[float]
) -> Iterator[JudgedSetting]:  # fmt: skip
    """The best of each order takes some steps, the best of these take more; after how many they foretell best."""
    each = [_Refinement.of(fits, one, horizons) for one in _of_each_order(judged)]
    for one in each:
        one.go_on(FIRST_LOOKS)
    for one in sorted(each, key=lambda one: one.best.held.loss)[:REFINED]:
        one.go_on(len(STEPS))
    for one in each:
        if not no_worse(one.first.held, one.best.held):
            yield one.best


@dataclass
class _Refinement:
    """A setting whose estimates of all folds are refined side by side, and what it has come to."""

    first: JudgedSetting
    best: JudgedSetting
    models: Iterator[tuple[Innovations, ...]]
    folds: Sequence[Fold]
    horizons: Sequence[float]
    looks: int = 0
    idle: int = 0

    @classmethod
    def of(cls, fits: _Fits, first: JudgedSetting, horizons: Sequence[float]) -> _Refinement:
        found = [fits.estimate(i, first.setting) for i in range(len(fits.folds))]
        ways = [refined(one, first.setting.direct, fits.goal) for one in found if one is not None]
        return cls(first, first, islice(zip(*ways, strict=False), 1, None), fits.folds, horizons)

    def go_on(self, looks: int) -> None:
        """Until so many looks were taken, the steps end or several looks have found nothing better."""
        while self.looks < looks and self.idle < PATIENCE:
            before = STEPS[self.looks - 1] if self.looks else 0
            models = next(islice(self.models, STEPS[self.looks] - before - 1, None), None)
            if models is None:
                self.idle = PATIENCE
                return
            held = together([
                held_errors(model, fold.held, self.horizons) for model, fold in zip(models, self.folds, strict=True)
            ])  # fmt: skip
            better = held.loss < self.best.held.loss
            if better:
                self.best = JudgedSetting(replace(self.first.setting, steps=STEPS[self.looks]), held)
            self.idle = 0 if better else self.idle + 1
            self.looks += 1


def _disturbed(fits: _Fits, judged: Sequence[JudgedSetting], horizons: Sequence[float]) -> Iterator[JudgedSetting]:
    """The best of different orders, each with the slow disturbance that foretells best, where one does."""
    for one in _of_each_order(judged)[:DISTURBED]:
        models = [
            _after(found, one.setting, fits.goal)
            for i in range(len(fits.folds)) if (found := fits.estimate(i, one.setting)) is not None
        ]  # fmt: skip
        tried = [
            JudgedSetting(replace(one.setting, disturbance=disturbance), together([
                held_errors(model, fold.held, horizons) for model, fold in zip(wider, fits.folds, strict=True)
            ]))
            for disturbance in disturbances()
            if all(map(predicts, wider := [with_disturbance(model, disturbance) for model in models]))
        ]  # fmt: skip
        best = min(tried, key=lambda one: one.held.loss, default=one)
        if best.held.loss < one.held.loss - WORTH:
            yield best


def _decided(
    each: Sequence[Data], judged: Sequence[JudgedSetting], goal: Goal, horizons: Sequence[float]
) -> tuple[Innovations, StructureChoice] | None:  # fmt: skip
    """The likeliest on the whole record of those that no other foretells better than by more than chance."""
    best = judged[0].held
    equal = [one for one in judged if no_worse(one.held, best)]
    others = [one for one in judged if one not in equal]
    whole = _Fits([Fold(tuple(each), ())], goal)
    fallback = None
    for group in (_of_each_order(equal)[:FINALISTS], *([one] for one in others[:FINALISTS])):
        ranked = []
        for one in group:
            found = whole.estimate(0, one.setting)
            if found is None:
                continue
            model = _after(found, one.setting, goal)
            likeliest = _after(found, replace(one.setting, steps=max(one.setting.steps, TOWARDS)), goal)
            entry = _information(likeliest, model, each, horizons, one.setting.disturbance is not None), model, one
            fallback = fallback or entry
            if _sound(model, one, each, horizons):
                ranked.append(entry)
        if ranked:
            _, model, one = min(ranked, key=lambda entry: entry[0])
            return model, _told(one, len(judged), len(equal), horizons)
    if fallback is None:
        return None
    return fallback[1], _told(fallback[2], len(judged), len(equal), horizons)


def _of_each_order(judged: Sequence[JudgedSetting]) -> list[JudgedSetting]:
    """The best of each order, the best first."""
    return list({one.setting.order: one for one in reversed(judged)}.values())[::-1]


def _sound(model: Innovations, one: JudgedSetting, each: Sequence[Data], horizons: Sequence[float]) -> bool:
    """Whether the model of the whole record simulates it about as well as the parts simulated what was held back."""
    before = one.held.losses[-1]
    if before >= heldback.WORST:
        return True
    now = held_errors(model, [part[: heldback.MOST] for part in each], horizons).losses[-1]
    return bool(radius(model.a) < 1.0 and predicts(model) and now < before + SIMULATED_WORSE)


def _information(
    likeliest: Innovations, model: Innovations, each: Sequence[Data], horizons: Sequence[float], disturbed: bool
) -> float:  # fmt: skip
    """BIC with the errors of all horizons, each counting alike: N log(mean square) + d log N.

    Where it is the one step that a model is better at, errors near their least (`likeliest`) count for it.
    """
    count = sum(int(np.isfinite(one.y).any(axis=1).sum()) for one in each)
    errors = held_errors(model, each, horizons).errors.sum(axis=2)
    if horizons[0] == 1:
        errors[0] = np.minimum(errors[0], held_errors(likeliest, each, [1]).errors.sum(axis=2)[0])
    own = model.nx - model.ny * disturbed
    free = own * (model.nu + 2 * model.ny) + model.ny * disturbed
    return count * float(np.log(errors + 1e-300).sum(axis=1).mean()) + free * float(np.log(count))


def _told(one: JudgedSetting, looked: int, equal: int, horizons: Sequence[float]) -> StructureChoice:
    setting = one.setting
    fits = {h: 100.0 * (1.0 - float(loss)) for h, loss in zip(horizons, one.held.losses, strict=True)}
    return StructureChoice(
        setting.order, setting.horizon, setting.weighting, setting.direct, setting.steps, fits, looked, equal,
        None if setting.disturbance is None else str(setting.disturbance),
    )  # fmt: skip


def horizons_of(parts: Sequence[Data], order: int | None) -> list[int]:
    """Candidates: twice the lags of the autoregression of least AIC, twice that, and one that is short."""
    usual = split_of(parts, order, None)[0].future
    nu, ny = parts[0].nu, parts[0].ny
    least = max(-(-(order or 1) // ny) + 1, 3)
    longest = max(part.n for part in parts)
    most = max(min(25, longest * (heldback.PARTS - 1) // heldback.PARTS // (3 * (nu + ny) + 4)), least)
    return sorted({int(np.clip(one, least, most)) for one in (usual, 10, 2 * usual)})
