"""Which effects of a library a set of recordings asks for: screened, refitted, and tested on data held out.

Forward: screens propose, joint fits of base and effect decide, the held-out recordings may refuse. Then backward and
swap: each accepted effect is taken out again; it goes when that costs nothing, and another takes its place where that
explains more.

Rules of this file: no name of an effect is written here; what is nested, equal or near stands in the effects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hoopd.diagnose.engine.dataset import Stretch
from hoopd.diagnose.engine.fitting import Fit, fit
from hoopd.diagnose.search.scan import scan
from hoopd.diagnose.search.scanned import Scanned
from hoopd.diagnose.search.screen import TOUCHED, Score, Screen
from hoopd.diagnose.search.stiff import deflated, far_beyond, stiffened
from hoopd.diagnose.search.surprise import THRESHOLD, needed_gain, surprise
from hoopd.physics.effects.base import Effect

Progress = Callable[[str], None]

# Effects in one explanation.
MOST_EFFECTS = 3
# While the disturbances that are left are far beyond the usual, more is missing.
MOST_WHERE_FAR = 5
# An effect that was dropped may be proposed again; so often at most is anything added.
MOST_ROUNDS = 8
# Of a screen's proposals so many are refitted, and those that come this near to the best one.
MOST_REFITS, NEAR_SHARE = 4, 0.4
OTHER_STARTS = 2
# A rival this many nats behind is not excluded (posterior odds 20 : 1).
NOT_EXCLUDED_NATS = 3.0
# The larger of two nested effects must gain this much more: nats, and share of the gain.
OCCAM_NATS, OCCAM_SHARE = 4.0, 0.02
# Held-out data may lose so many nats, or this share of the gain, before an effect is refused: by chance, or by another
# effect that is not found yet. What is no effect loses a good part of what it gained.
HELD_OUT_LOSS, HELD_OUT_SHARE = 3.0, 0.1


@dataclass(frozen=True)
class Settings:
    """Of a search."""

    threshold: float = THRESHOLD
    most: int = MOST_EFFECTS
    progress: Progress = lambda text: None


@dataclass(frozen=True)
class Tried:
    """An effect fitted jointly with what was there before."""

    effect: Effect
    fit: Fit
    gain: float  # nats over what was there before
    surprise: float
    score: Score
    heldout_gain: float | None = None


@dataclass
class Named:
    """What the search found."""

    nominal: Fit  # parameters as given
    base: Fit
    final: Fit
    accepted: list[Tried] = field(default_factory=list)
    tried: list[Tried] = field(default_factory=list)  # everything refitted in the first round
    losses: dict[str, float] = field(default_factory=dict)  # nats lost without each accepted effect
    without: dict[str, Fit] = field(default_factory=dict)
    scores: list[Score] = field(default_factory=list)  # first screen, best first
    screens: dict[int, Screen] = field(default_factory=dict)  # by the fit they are about (its id)
    left: list[Score] = field(default_factory=list)  # screen of the final fit
    rivals: dict[str, list[tuple[str, float]]] = field(default_factory=dict)  # accepted -> (name, nats behind)
    heldout: dict[str, float] = field(default_factory=dict)  # criterion of nominal, base, final on the held-out data


def name_effects(
    train: Sequence[Stretch],
    heldout: Sequence[Stretch],
    library: Mapping[str, Effect],
    nominal: Fit,
    base: Fit,
    settings: Settings | None = None,
) -> Named:
    """The search; `nominal`, `base`: fits of the training stretches with parameters as given and re-estimated."""
    settings = settings or Settings()
    found = Named(nominal, base, base)
    judge = Judge(train, heldout, library, settings)
    for _ in range(MOST_ROUNDS):
        if len(found.accepted) >= (MOST_WHERE_FAR if far_beyond(found.final) else settings.most):
            break
        best = _next(found, judge)
        if best is None:
            break
        found.accepted.append(best)
        found.final = best.fit
        if len(found.accepted) > 1:
            _reconsider(found, judge)
    _ablate(found, judge)
    found.screens = {id(one): judge.screens[id(one)] for one in (base, found.final) if id(one) in judge.screens}
    found.heldout = {"base": judge.on_heldout(base), "final": judge.on_heldout(found.final)}
    return found


class Judge:
    """The data, and how an effect is tried on them."""

    def __init__(
        self, train: Sequence[Stretch], heldout: Sequence[Stretch], library: Mapping[str, Effect], settings: Settings
    ) -> None:
        self.train, self.heldout, self.library, self.settings = list(train), list(heldout), library, settings
        # with the fits themselves: the address of one that is gone is soon another's
        self._held: dict[int, tuple[Fit, float]] = {}
        self.screens: dict[int, Screen] = {}

    def proposals(self, about: Fit, taken: Sequence[str]) -> list[Score]:
        """Best score of every effect beside a fit, most surprising first."""
        wanted = [e for name, e in self.library.items() if name not in taken]
        screen = self.screens[id(about)] = Screen(about, wanted)
        scans = (scan(screen, effect) for effect in wanted if effect.found_by == "scan")
        scores = [*screen.scores(), *(found for found in scans if found is not None)]
        return sorted((replace(one, origin=about) for one in scores), key=lambda s: -surprise_of(s, s.gain, self.train))

    def tried(self, before: Fit, score: Score) -> Tried:
        """The proposed effect fitted together with everything that was there."""
        effect = score.member.effect
        origin = score.origin or before
        start = {**origin.values, **before_effects(before), **score.start}
        new = fit(self.train, (*before.effects, effect), start, like=origin, noise=before.noise)
        if new.criterion > before.criterion and origin is not before:
            # lost on the way from far off: once more from where the fit before was
            start = {**before.values, **score.start}
            new = fit(self.train, (*before.effects, effect), start, like=before, noise=before.noise)
        gain = before.criterion - new.criterion
        return Tried(effect, new, gain, surprise_of(score, gain, self.train), score)

    def on_heldout(self, found: Fit) -> float:
        """Criterion on the held-out data: parameters frozen, what belongs to a recording fitted again."""
        if not self.heldout:
            return float("nan")
        if id(found) not in self._held:
            own = tuple(n for n in free_of_recordings(found.effects, self.heldout))
            self._held[id(found)] = found, fit(self.heldout, found.effects, found.values, free=own).criterion
        return self._held[id(found)][1]


def before_effects(found: Fit) -> dict[str, float]:
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


# ---------------------------------------------------------------------------------------------- forward


def _next(found: Named, judge: Judge) -> Tried | None:
    """The effect that the recordings ask for most, beside what was found; None when they ask for none."""
    settings, first = judge.settings, not found.accepted
    settings.progress("screening the library")
    scores = judge.proposals(found.final, found.final.names)
    chosen = _chosen(scores, judge)
    if first:
        found.scores = scores
        chosen += _other_starts(chosen, judge.proposals(found.nominal, found.nominal.names), judge)
    # about the parameters as given, too: where disturbances explain everything, no way may lead back from the base's
    for about in (found.nominal, found.final) if first else (found.final,):
        if far_beyond(about):
            settings.progress("screening with usual disturbances")
            held = stiffened(about)
            chosen += _other_starts(chosen, deflated(judge.proposals(held, about.names), held), judge)
    tried = []
    for score in chosen:
        settings.progress(f"fitting {score.member.effect.name}")
        tried.append(judge.tried(found.final, score))
    tried.sort(key=lambda one: -one.surprise)
    if first:
        found.tried = tried
    found.left = scores
    for one in _in_order(tried):
        if one.surprise < settings.threshold:
            continue
        better = judge.on_heldout(found.final) - judge.on_heldout(one.fit)
        if not judge.heldout or better > -max(HELD_OUT_LOSS, HELD_OUT_SHARE * one.gain):
            gap = [(other.effect.name, one.gain - other.gain) for other in tried if other is not one]
            found.rivals[one.effect.name] = gap
            return replace(one, heldout_gain=None if np.isnan(better) else float(better))
    return None


def _chosen(scores: Sequence[Score], judge: Judge) -> list[Score]:
    """Proposals worth a fit: those above half the threshold and near the best, and the simpler form of each."""
    surprises = {s.member.effect.name: surprise_of(s, s.gain, judge.train) for s in scores}
    best = max(surprises.values(), default=0.0)
    least = max(judge.settings.threshold / 2.0, NEAR_SHARE * best)
    chosen = [s for s in scores if surprises[s.member.effect.name] >= least][:MOST_REFITS]
    wanted = {name for s in chosen for name in s.member.effect.contains}
    chosen += [s for s in scores if s.member.effect.name in wanted and s not in chosen]
    # of effects that are never told apart one is enough
    kept: list[Score] = []
    for score in chosen:
        if not any(score.member.effect.name in one.member.effect.same_as for one in kept):
            kept.append(score)
    return kept


def _other_starts(chosen: Sequence[Score], scores: Sequence[Score], judge: Judge) -> list[Score]:
    """The best proposals from the nominal parameters: a base bent by a large effect may hide it from its own screen."""
    taken = {score.member.effect.name for score in chosen}
    return [score for score in _chosen(scores, judge) if score.member.effect.name not in taken][:OTHER_STARTS]


def _in_order(tried: Sequence[Tried]) -> list[Tried]:
    """By surprise; a simpler effect goes before the one that contains it and gains little more."""
    out = list(tried)
    for one in tried:
        for name in one.effect.contains:
            simple = next((t for t in out if t.effect.name == name), None)
            if simple is None or out.index(simple) < out.index(one):
                continue
            if one.gain - simple.gain < max(OCCAM_NATS, OCCAM_SHARE * one.gain):
                out.remove(simple)
                out.insert(out.index(one), simple)
    return out


# ---------------------------------------------------------------------------------------------- backward, swap


def _reconsider(found: Named, judge: Judge) -> None:
    """Each earlier effect against being left out, and against another in its place."""
    for one in list(found.accepted[:-1]):
        rest = _others(found, one)
        judge.settings.progress(f"reconsidering {one.effect.name}")
        without = fit(judge.train, rest, found.final.values, like=found.final, noise=found.final.noise)
        loss = without.criterion - found.final.criterion
        if surprise_of(one.score, loss, judge.train) < judge.settings.threshold:
            found.accepted.remove(one)
            found.final = without
            continue
        rival = _better(found, judge, one, without, loss)
        if rival is not None:
            found.accepted[found.accepted.index(one)] = rival
            found.final = rival.fit


def _others(found: Named, one: Tried) -> list[Effect]:
    """The base's effects and all accepted ones but one."""
    return [*found.base.effects, *(other.effect for other in found.accepted if other is not one)]


def _better(found: Named, judge: Judge, one: Tried, without: Fit, loss: float) -> Tried | None:
    scores = judge.proposals(without, (*without.names, one.effect.name))
    for score in scores[:2]:
        if score.gain < 0.8 * loss:
            return None
        other = judge.tried(without, score)
        if other.surprise > surprise_of(one.score, loss, judge.train) + OCCAM_NATS:
            return other
    return None


def _ablate(found: Named, judge: Judge) -> None:
    """What each accepted effect is worth beside the others."""
    for one in found.accepted:
        rest = _others(found, one)
        if len(found.accepted) == 1:
            without = found.base
        else:
            judge.settings.progress(f"without {one.effect.name}")
            without = fit(judge.train, rest, found.final.values, like=found.final, noise=found.final.noise)
        found.without[one.effect.name] = without
        found.losses[one.effect.name] = without.criterion - found.final.criterion
