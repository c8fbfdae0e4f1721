"""How an effect is tried: proposed by screens and scans, fitted jointly, asked of folds of the training data.

Rules of this file: one effect beside one fit; which of them is taken is decided in naming.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isclose, isfinite

import numpy as np

from hoopd.diagnose.search.folds import fold_gain
from hoopd.diagnose.search.range_widening import in_wider_ranges
from hoopd.diagnose.search.scan import scan
from hoopd.diagnose.search.scan_score import Scanned
from hoopd.diagnose.search.screen import TOUCHED, Score, Screen
from hoopd.diagnose.search.surprise import THRESHOLD, needed_gain, surprise
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch

Progress = Callable[[str], None]

# Effects in one explanation.
MOST_EFFECTS = 3
# Data that were not fitted may lose so many nats, or this share of the gain, before an effect is refused: by chance, or
# by another effect that is not found yet. What is no effect loses a good part of what it gained.
UNSEEN_LOSS, UNSEEN_SHARE = 3.0, 0.1
# A limit is fitted from where it seems to be, and from this many times as far out.
MILDER = 1.08
# A fit that is begun anew with other noise levels and gains less than this had its own right.
LEVELS_NATS = 0.5
MOST_ANEW = 4
# A share within which a constant stands on an end of its range.
ON_END = 1e-3


@dataclass(frozen=True)
class Settings:
    """Of a search."""

    threshold: float = THRESHOLD
    most: int = MOST_EFFECTS
    grammar: bool = True  # mechanisms beyond the library are looked for, too
    progress: Progress = lambda text: None


@dataclass(frozen=True)
class Tried:
    """An effect fitted jointly with what was there before."""

    effect: Effect
    fit: HypothesisFit
    gain: float  # nats over what was there before
    surprise: float
    score: Score


class Judge:
    """The data, and how an effect is tried on them."""

    def __init__(self, train: Sequence[Stretch], library: Mapping[str, Effect], settings: Settings) -> None:
        self.train, self.library, self.settings = list(train), library, settings
        self.screens: dict[int, Screen] = {}

    def proposals(self, about: HypothesisFit, taken: Sequence[str]) -> list[Score]:
        """Best score of every effect beside a fit, most surprising first."""
        wanted = [e for name, e in self.library.items() if name not in taken]
        screen = self.screens[id(about)] = Screen(about, wanted)
        scans = (scan(screen, effect) for effect in wanted if effect.found_by == "scan")
        scores = [*screen.scores(), *(found for found in scans if found is not None)]
        return sorted((replace(one, origin=about) for one in scores), key=lambda s: -surprise_of(s, s.gain, self.train))

    def tried(self, before: HypothesisFit, score: Score) -> Tried:
        """The proposed effect fitted together with everything that was there, with the gain that the effect has."""
        return self.of_effects(before, [self.fitted(before, score)])[0]

    def fitted(self, before: HypothesisFit, score: Score) -> Tried:
        """The same, with what the noise levels gain."""
        effect = score.member.effect
        origin = score.origin or before
        start = {**origin.values, **before_effects(before), **score.start}
        new = fit(self.train, (*before.effects, effect), start, like=origin, noise=before.noise)
        if new.criterion > before.criterion and origin is not before:
            # lost on the way from far off: once more from where the fit before was
            start = {**before.values, **score.start}
            new = fit(self.train, (*before.effects, effect), start, like=before, noise=before.noise)
        if milder := _milder(effect, start):
            # a limit that cuts off too much at first leads the trajectory away
            later = fit(self.train, (*before.effects, effect), {**start, **milder}, like=origin, noise=before.noise)
            new = min(new, later, key=lambda one: one.criterion)
        new = self._not_run_off(new, start, effect)
        # what began elsewhere and came back to where the fit before was is not asked again
        if origin is not before and before.criterion - new.criterion >= self.settings.threshold / 2.0:
            new = self.settled(new)
        new = in_wider_ranges(new, self.train, [effect.name])
        effect, gain = new.effects[-1], before.criterion - new.criterion
        return Tried(effect, new, gain, surprise_of(score, gain, self.train), score)

    def of_effects(self, before: HypothesisFit, tried: Sequence[Tried]) -> list[Tried]:
        """What was tried beside a fit, each with the gain that its effect has: what would be named is no gain of the
        noise levels. Their search may stand still where nearly no disturbance acts, so that the fit before is begun
        anew with those that were found; where that changes nothing for the one that gains most, it was well."""
        found, order = list(tried), sorted(range(len(tried)), key=lambda i: -tried[i].gain)
        for i in order:
            found[i] = self._of_effect(before, found[i])
            if tried[i].gain - found[i].gain < LEVELS_NATS:
                break
        return found

    def _of_effect(self, before: HypothesisFit, one: Tried) -> Tried:
        if one.gain < self.settings.threshold:
            return one
        start = {**before.values, **one.fit.values}
        begun = fit(self.train, before.effects, start, like=before, noise=one.fit.noise)
        gain = min(one.gain, begun.criterion - one.fit.criterion)
        return replace(one, gain=gain, surprise=surprise_of(one.score, gain, self.train))

    def _not_run_off(self, new: HypothesisFit, start: Mapping[str, float], effect: Effect) -> HypothesisFit:
        """The fit; where a constant stands on an end of its range, or where it began because every step led away, the
        better one of it and one that began with the amplitude: beside an amplitude that is far too small, a first step
        throws a constant any distance."""
        constants = [p for p in effect.parameters if p.role == "shape" and not (p.per_recording or p.discrete)]
        ends = [(new.values[effect.key(p.name)], end) for p in constants for end in (p.low, p.high) if isfinite(end)]
        is_still = any(new.values[effect.key(p.name)] == start.get(effect.key(p.name)) for p in constants)
        if not is_still and not any(isclose(value, end, rel_tol=ON_END) for value, end in ends):
            return new
        free = [name for name in new.free if name not in {effect.key(p.name) for p in constants}]
        begun = fit(self.train, new.effects, start, like=new, noise=new.noise, free=free)
        again = fit(self.train, new.effects, begun.values, like=begun, noise=begun.noise, free=new.free)
        return again if again.criterion < new.criterion else new

    def settled(self, found: HypothesisFit) -> HypothesisFit:
        """A fit that began with noise levels of another one, begun anew from its end until that gains nothing."""
        for _ in range(MOST_ANEW):
            again = fit(self.train, found.effects, found.values, like=found, noise=found.noise, free=found.free)
            if again.criterion > found.criterion - LEVELS_NATS:
                break
            found = again
        return found

    def fold_loss(self, before: HypothesisFit, after: HypothesisFit, gain: float) -> float | None:
        """Nats that folds of the training data lose where that refuses an effect: more than chance, or another effect
        that is still missing, explains; else None."""
        found = fold_gain(before, after)
        return None if found is None or found > -max(UNSEEN_LOSS, UNSEEN_SHARE * gain) else -found


def _milder(effect: Effect, start: Mapping[str, float]) -> dict[str, float]:
    """Limits of an effect a little farther out than a start has them; of what is no limit nothing."""
    limits = [effect.key(p.name) for p in effect.parameters if p.touched is not None]
    return {name: start[name] * MILDER for name in limits if name in start}


def before_effects(found: HypothesisFit) -> dict[str, float]:
    """Parameters of a fit's effects."""
    marks = tuple(f"{effect.name}." for effect in found.effects)
    return {name: value for name, value in found.values.items() if name.startswith(marks)} if marks else {}


def free_of_recordings(effects: Sequence[Effect], stretches: Sequence[Stretch]) -> tuple[str, ...]:
    """Names of the parameters that each recording has for itself."""
    recordings = dict.fromkeys(one.recording for one in stretches)
    own = [(e, p) for e in effects for p in e.parameters if p.per_recording and p.role == "phase"]
    return tuple(f"{e.key(p.name)}@{r}" for r in recordings for e, p in own)


def columns_of(effect: Effect, stretches: Sequence[Stretch]) -> tuple[int, int]:
    """How many columns an effect has in a screen, and how many choices of them."""
    recordings = len({one.recording for one in stretches})
    amplitudes = sum(p.role == "amplitude" for p in effect.parameters)
    phases = [p for p in effect.parameters if p.role == "phase"]
    grids = [max(len(p.grid), 1) for p in effect.parameters if p.role == "shape"]
    if not amplitudes:
        # sizes of one thing; of a limit, other samples at each size
        return 1, len(TOUCHED) if any(p.touched for p in effect.parameters) else 1
    columns = 2 * (recordings if phases[0].per_recording else 1) if phases else amplitudes
    return columns, int(np.prod(grids)) if grids else 1


def surprise_of(score: Score, gain: float, stretches: Sequence[Stretch]) -> float:
    """Of a gain by the effect of a score: as many columns and choices as it had."""
    if isinstance(score, Scanned):
        return max(0.0, replace(score, gain=max(gain, 0.0)).threshold_equivalent)
    return surprise(gain, *columns_of(score.member.effect, stretches))


def needed_of(score: Score, threshold: float, stretches: Sequence[Stretch]) -> float:
    """The gain by the effect of a score that is as surprising as the threshold."""
    if isinstance(score, Scanned):
        return needed_gain(threshold, score.freedom, max(score.candidates, 1.0))
    return needed_gain(threshold, *columns_of(score.member.effect, stretches))
