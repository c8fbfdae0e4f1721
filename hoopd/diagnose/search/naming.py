"""Which effects of a library a set of recordings asks for: screened, refitted, and tested on folds.

Forward: screens propose, joint fits of base and effect decide, folds of the training data may refuse. Then backward and
swap: each accepted effect is taken out again; it goes when that costs nothing, and another takes its place where that
explains more.

Rules of this file: no name of an effect is written here; what is nested, equal or near stands in the effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from hoopd.diagnose.search.bounded_disturbance import deflated, far_beyond, stiffened
from hoopd.diagnose.search.candidates import Judge, Settings, Tried, surprise_of
from hoopd.diagnose.search.fits_side_by_side import tried_all
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.range_widening import in_wider_ranges
from hoopd.diagnose.search.screen import Score, Screen
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch

# While the disturbances that are left are far beyond the usual, more is missing.
MOST_WHERE_FAR = 5
# An effect that was dropped may be proposed again; so often at most is anything added.
MOST_ROUNDS = 8
# Of a screen's proposals so many are refitted, and those that come this near to the best one.
MOST_REFITS, NEAR_SHARE = 4, 0.4
# Beside the best so many of what is told from it by rich data only are refitted, whatever the screen says of them: its
# straight lines hide what a base has bent to.
MOST_NEAR = 2
OTHER_STARTS = 2
# A rival this many nats behind is not excluded (posterior odds 20 : 1).
NOT_EXCLUDED_NATS = 3.0
# The larger of two nested effects must gain this much more: nats, and share of the gain.
OCCAM_NATS, OCCAM_SHARE = 4.0, 0.02


class MechanismTrial(NamedTuple):
    """Mechanisms screened beside a fit, and those of them that were fitted with it."""

    screen: MechanismScreen
    tried: list[Tried]


class Refusal(NamedTuple):
    """An effect that was beyond the threshold and that folds refused."""

    gain: float  # nats
    loss: float  # nats in blocks that were not fitted


@dataclass
class Named:
    """What the search found."""

    nominal: HypothesisFit  # parameters as given
    base: HypothesisFit
    final: HypothesisFit
    accepted: list[Tried] = field(default_factory=list)
    tried: list[Tried] = field(default_factory=list)  # everything refitted in the first round
    losses: dict[str, float] = field(default_factory=dict)  # nats lost without each accepted effect
    without: dict[str, HypothesisFit] = field(default_factory=dict)
    others: list[HypothesisFit] = field(default_factory=list)  # of the accepted effects, with fewer of them
    scores: list[Score] = field(default_factory=list)  # first screen, best first
    screens: dict[int, Screen] = field(default_factory=dict)  # by the fit they are about (its id)
    left: list[Score] = field(default_factory=list)  # screen of the final fit
    grammar: MechanismScreen | None = None  # the last screen of mechanisms
    trials: list[MechanismTrial] = field(default_factory=list)  # of mechanisms beside what was found
    in_place: dict[str, MechanismScreen] = field(default_factory=dict)  # accepted -> mechanisms where it is taken out
    rivals: dict[str, list[tuple[str, float]]] = field(default_factory=dict)  # accepted -> (name, nats behind)
    refused: dict[str, tuple[str, ...]] = field(default_factory=dict)  # accepted -> rivals that folds refused
    refusals: dict[str, Refusal] = field(default_factory=dict)  # beyond the threshold, and refused; the last of each


def name_effects(
    train: Sequence[Stretch],
    library: Mapping[str, Effect],
    nominal: HypothesisFit,
    base: HypothesisFit,
    settings: Settings | None = None,
) -> Named:
    """The search; `nominal`, `base`: fits of the training stretches with parameters as given and re-estimated."""
    settings = settings or Settings()
    found = Named(nominal, base, base)
    judge = Judge(train, library, settings)
    for _ in range(MOST_ROUNDS):
        if len(found.accepted) >= (MOST_WHERE_FAR if far_beyond(found.final) else settings.most):
            break
        best = _next(found, judge)
        if best is None:
            break
        found.accepted.append(best)
        found.final = best.fit
        if len(found.accepted) > 1:
            reconsider(found, judge)
    widen_ranges(found, judge)
    taken_out(found, judge)
    found.refusals = {name: one for name, one in found.refusals.items() if name not in found.final.names}
    found.screens = {id(one): judge.screens[id(one)] for one in (base, found.final) if id(one) in judge.screens}
    return found


# ---------------------------------------------------------------------------------------------- forward


def _next(found: Named, judge: Judge) -> Tried | None:
    """The effect that the recordings ask for most, beside what was found; None when they ask for none."""
    settings, first = judge.settings, not found.accepted
    settings.progress("screening the library")
    found.left = scores = judge.proposals(found.final, found.final.names)
    chosen = _chosen(scores, judge)
    if first:
        found.scores = scores
    if is_far := far_beyond(found.final):
        # where disturbances explain everything, no way may lead from what is there to what is missing
        chosen += _held_starts(found.final, chosen, judge)
        chosen += _given_starts(found, chosen, judge) if first else []
    best = _best_of(found, judge, chosen)
    if best is None and first and not is_far:
        best = _best_of(found, judge, _given_starts(found, chosen, judge), found.tried)
    return best


def _best_of(found: Named, judge: Judge, chosen: Sequence[Score], known: Sequence[Tried] = ()) -> Tried | None:
    """The first that is taken of what was proposed and of what was fitted already."""
    every = sorted([*known, *tried_all(judge, found.final, chosen)], key=lambda one: -one.surprise)
    # of a name that was fitted from several starts the best
    best: dict[str, Tried] = {}
    for one in every:
        best.setdefault(one.effect.name, one)
    tried = [*best.values()]
    if not found.accepted:
        found.tried = tried
    return _taken(found, judge, tried)


def _given_starts(found: Named, chosen: Sequence[Score], judge: Judge) -> list[Score]:
    """Proposals from the parameters as given: a base bent by a large effect may hide it from its own screen, or lead a
    fit of the right name nowhere."""
    about = found.nominal
    more = _other_starts([], judge.proposals(about, about.names), judge)
    return more + (_held_starts(about, [*chosen, *more], judge) if far_beyond(about) else [])


def _held_starts(about: HypothesisFit, chosen: Sequence[Score], judge: Judge) -> list[Score]:
    """Proposals from a fit with disturbances that are held to the usual."""
    judge.settings.progress("screening with usual disturbances")
    held = stiffened(about)
    return _other_starts(chosen, deflated(judge.proposals(held, about.names), held), judge)


def _taken(found: Named, judge: Judge, tried: Sequence[Tried]) -> Tried | None:
    """The first that the folds do not refuse, with its rivals."""
    refused: list[str] = []
    for one in _in_order(tried):
        if one.surprise < judge.settings.threshold:
            continue
        loss = judge.fold_loss(found.final, one.fit, one.gain)
        if loss is None:
            gap = [(other.effect.name, one.gain - other.gain) for other in tried if other is not one]
            found.rivals[one.effect.name], found.refused[one.effect.name] = gap, tuple(refused)
            return one
        refused.append(one.effect.name)
        found.refusals[one.effect.name] = Refusal(one.gain, loss)
    return None


def _chosen(scores: Sequence[Score], judge: Judge) -> list[Score]:
    """Proposals worth a fit: those above half the threshold and near the best, and the simpler form of each."""
    surprises = {s.member.effect.name: surprise_of(s, s.gain, judge.train) for s in scores}
    best = max(surprises.values(), default=0.0)
    least = max(judge.settings.threshold / 2.0, NEAR_SHARE * best)
    chosen = [s for s in scores if surprises[s.member.effect.name] >= least][:MOST_REFITS]
    wanted = {name for s in chosen for name in s.member.effect.contains}
    chosen += [s for s in scores if s.member.effect.name in wanted and s not in chosen]
    chosen += _near(chosen, scores)
    # of effects that are never told apart one is enough
    kept: list[Score] = []
    for score in chosen:
        if not any(score.member.effect.name in one.member.effect.same_as for one in kept):
            kept.append(score)
    return kept


def _near(chosen: Sequence[Score], scores: Sequence[Score]) -> list[Score]:
    """Of what is hardly told from the best, what is not among those chosen."""
    if not chosen:
        return []
    best, taken = chosen[0].member.effect, {s.member.effect.name for s in chosen}
    others = [s for s in scores if s.member.effect.name not in taken]
    return [s for s in others if _alike(best, s.member.effect)][:MOST_NEAR]


def _alike(one: Effect, other: Effect) -> bool:
    return other.name in one.near or one.name in other.near


def _other_starts(chosen: Sequence[Score], scores: Sequence[Score], judge: Judge) -> list[Score]:
    """The best proposals that are not among those already."""
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


def reconsider(found: Named, judge: Judge, *, swaps: bool = True) -> None:
    """Each earlier effect against being left out, and (`swaps`) against another in its place."""
    for one in list(found.accepted[:-1]):
        rest = _others(found, one)
        judge.settings.progress(f"reconsidering {one.effect.name}")
        without = fit(judge.train, rest, found.final.values, like=found.final, noise=found.final.noise)
        loss = without.criterion - found.final.criterion
        if surprise_of(one.score, loss, judge.train) < judge.settings.threshold:
            found.accepted.remove(one)
            found.final = without
            continue
        rival = _better(found, judge, one, without, loss) if swaps else None
        if rival is not None:
            found.accepted[found.accepted.index(one)] = rival
            found.final = rival.fit


def _others(found: Named, one: Tried) -> list[Effect]:
    """The base's effects and all accepted ones but one."""
    return [*found.base.effects, *(other.effect for other in found.accepted if other is not one)]


def _better(found: Named, judge: Judge, one: Tried, without: HypothesisFit, loss: float) -> Tried | None:
    scores = judge.proposals(without, (*without.names, one.effect.name))
    for score in scores[:2]:
        if score.gain < 0.8 * loss:
            return None
        other = judge.tried(without, score)
        ahead = other.surprise > surprise_of(one.score, loss, judge.train) + OCCAM_NATS
        # what folds may lose is a share of what the swap gains, not of all that the other explains
        if ahead and judge.fold_loss(found.final, other.fit, found.final.criterion - other.fit.criterion) is None:
            return other
    return None


def widen_ranges(found: Named, judge: Judge) -> None:
    """Those of accepted effects on whose ends the last fit stands: beside the later ones the earlier have moved."""
    wider = in_wider_ranges(found.final, judge.train, [one.effect.name for one in found.accepted])
    if wider is found.final:
        return
    found.final, own = wider, {effect.name: effect for effect in wider.effects}
    found.accepted = [replace(one, effect=own[one.effect.name]) for one in found.accepted]


def leave_out_worthless(found: Named, judge: Judge) -> None:
    """Each accepted effect without which the others explain as much goes, the one first that is worth least."""
    while found.losses:
        worth = [(surprise_of(one.score, found.losses[one.effect.name], judge.train), one) for one in found.accepted]
        least, one = min(worth, key=lambda each: each[0])
        if least >= judge.settings.threshold:
            return
        found.final = found.without[one.effect.name]
        found.accepted.remove(one)
        taken_out(found, judge)


def taken_out(found: Named, judge: Judge) -> None:
    """What each accepted effect is worth beside the others."""
    found.losses.clear()
    found.without.clear()
    for one in found.accepted:
        rest = _others(found, one)
        if len(found.accepted) == 1:
            without = found.base
        else:
            judge.settings.progress(f"without {one.effect.name}")
            without = fit(judge.train, rest, found.final.values, like=found.final, noise=found.final.noise)
        found.without[one.effect.name] = without
        found.losses[one.effect.name] = without.criterion - found.final.criterion
