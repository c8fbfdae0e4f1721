"""Beyond the library: which mechanism of the grammar is still asked for beside the names that were accepted.

A library's name that explains most of a mismatch leaves a rest. When a mechanism explains more of that rest than the
best of all of them would by chance, and than it costs to say which it is, it is fitted with everything that is there;
what was accepted before goes when it is worth nothing beside it. Where a name stands for another law, a mechanism that
explains clearly more takes its place.

Rules of this file: proposals come from `mechanism_screen`, fits and folds from `candidates`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import exp

from hoopd.diagnose.search.bounded_disturbance import far_beyond, left_variance, stiffened
from hoopd.diagnose.search.candidates import Judge, Tried, surprise_of
from hoopd.diagnose.search.fits_side_by_side import tried_all
from hoopd.diagnose.search.mechanism_screen import MechanismScreen, ProposedMechanism
from hoopd.diagnose.search.naming import (
    NEAR_SHARE,
    OCCAM_NATS,
    MechanismTrial,
    Named,
    Refusal,
    reconsider,
    taken_out,
    widen_ranges,
)
from hoopd.diagnose.search.scan_score import scanned
from hoopd.diagnose.search.screen import Member, Score, Screen
from hoopd.diagnose.search.surprise import log_chance, surprise
from hoopd.plants.effects.grammar.mechanism import Mechanism
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

# Mechanisms in one explanation; proposals of a screen that are refitted.
MOST_MECHANISMS, MOST_REFITS = 2, 3
# Of those that were screened along a fit with usual disturbances, so many are refitted.
MOST_HELD = 2
# Names in whose place mechanisms are tried, those that explain most, and mechanisms that are fitted there.
MOST_SWAPS = 2
# Beside no other effect the first order of a screen is rough: a mechanism that explains this share is fitted in place
# of all names.
WORTH_SHARE = 0.5
# What a textbook's law must explain beyond a name whose place it takes, its cost paid: three nats together, with which
# a name is excluded. To first order one that has sunk into the fit's noise is that much ahead, in nats or as a share.
TEXTBOOK_NATS, FIRST_ORDER_NATS, FIRST_ORDER_SHARE = 1.0, 3.0, 0.1
# A law is itself within so many times the constants that a screen tries of it.
BEYOND_TRIED = 2.0
# How often the best of all mechanisms may be as surprising by chance.
CHANCE = 0.01


def name_mechanisms(found: Named, judge: Judge, mechanisms: Sequence[Mechanism]) -> None:
    """Mechanisms that the recordings ask for beside what was found, put into it."""
    before = found.final
    if far_beyond(found.base):
        _settle(found, judge)
    if len(found.accepted) > 1:
        # of two things that act, a law that stands for the larger one explains little of the other
        alone = found.base.criterion - max((one.gain for one in found.tried), default=0.0)
        _instead_of(found, judge, mechanisms, found.accepted, alone)
    for _ in range(MOST_MECHANISMS):
        best = _next(found, judge, [one for one in mechanisms if one.name not in found.final.names])
        if best is None:
            break
        before_it = found.final.criterion
        found.accepted.append(best)
        found.final = best.fit
        if len(found.accepted) > 1:
            reconsider(found, judge, swaps=False)
        same = [one for one in found.accepted if one.effect.slot == best.effect.slot]
        if len(same) > 1:
            _instead_of(found, judge, mechanisms, same, before_it)
    if found.final is not before:
        widen_ranges(found, judge)
        taken_out(found, judge)
    for one in sorted(found.accepted, key=lambda one: -found.losses[one.effect.name])[:MOST_SWAPS]:
        rival = _in_its_place(found, judge, one, mechanisms)
        if rival is not None:
            found.accepted[found.accepted.index(one)] = rival
            found.final = rival.fit
            taken_out(found, judge)


def _settle(found: Named, judge: Judge) -> None:
    """What was found, fitted on until that gains nothing: beside disturbances that were far too large, levels had a
    long way to go."""
    final = judge.settled(found.final) if found.accepted else found.final
    if final is not found.final:
        found.final = final
        taken_out(found, judge)


def _instead_of(
    found: Named, judge: Judge, mechanisms: Sequence[Mechanism], these: Sequence[Tried], fewer: float
) -> None:
    """Puts one mechanism into the place of several names, where it explains what they do together: names of a library,
    or of a library and of the grammar, add up to a law that is none of theirs. Every name beyond the first has to be
    worth the threshold, and at least half of what they explain beyond the best without all of them (`fewer`, its
    criterion) has to be explained."""
    every = len(these) == len(found.accepted)
    judge.settings.progress(f"one mechanism in place of {', '.join(one.effect.name for one in these)}")
    kept = [one for one in found.accepted if one not in these]
    rest = [*found.base.effects, *(one.effect for one in kept)]
    about = found.base
    if not every:
        about = fit(judge.train, rest, found.final.values, like=found.final, noise=found.final.noise)
    # what each name cost to be looked for is taken off, as it is of the mechanism
    costs = sum(one.gain - one.surprise for one in these)
    whole = about.criterion - found.final.criterion
    needed = whole - costs - judge.settings.threshold * (len(these) - 1)
    alone = about.criterion - fewer
    wanted = [one for one in mechanisms if one.name not in about.names]
    screen = MechanismScreen(about, wanted, level=False)
    worthy = [one for one in _scores(screen, about)[:MOST_SWAPS] if _worth(one) >= WORTH_SHARE * needed]
    held = [one for one in _held_scores(about, wanted, judge) if _worth(one) >= WORTH_SHARE * needed]
    for other in sorted(_best_fits(judge, screen, worthy, held), key=lambda one: -one.surprise):
        more = found.final.criterion - other.fit.criterion
        if (
            other.surprise < needed
            or other.gain < (alone + whole) / 2.0
            or judge.fold_loss(found.final, other.fit, max(more, 0.0)) is not None
        ):
            continue
        found.rivals[other.effect.name] = []
        found.accepted, found.final = [*kept, other], other.fit
        return


def _in_its_place(found: Named, judge: Judge, one: Tried, mechanisms: Sequence[Mechanism]) -> Tried | None:
    """A mechanism that explains what a name does, and clearly more: the name stands for another law."""
    judge.settings.progress(f"mechanisms in place of {one.effect.name}")
    without, loss = found.without[one.effect.name], found.losses[one.effect.name]
    wanted = {each.name: each for each in mechanisms if each.name not in found.final.names}
    earlier = next((trial for trial in found.trials if trial.screen.fit is without), None)
    screen = MechanismScreen(without, [*wanted.values()], level=False) if earlier is None else earlier.screen
    found.in_place[one.effect.name] = screen
    own, own_worth = _in_its_own_place(without, one, mechanisms, loss, judge)
    scores = [score for score in _scores(screen, without) if score.member.effect.name in wanted]
    near = [score for score in scores if _is_near(score, own, wanted[score.member.effect.name])]
    known = [] if earlier is None else earlier.tried
    held = _held_scores(without, [*wanted.values()], judge) if earlier is None and far_beyond(found.base) else []
    tried = _tried_beside(judge, screen, near[:MOST_SWAPS], held, known)
    others = [other for other in tried if _is_itself(screen, other)]
    found.rivals.setdefault(one.effect.name, []).extend((other.effect.name, loss - other.gain) for other in others)
    for other in sorted(tried, key=lambda other: -_fitted_worth(screen, other)):
        needed = own_worth + swap_nats(wanted[other.effect.name])
        more = found.final.criterion - other.fit.criterion
        if _fitted_worth(screen, other) < needed or other.surprise < judge.settings.threshold:
            continue
        if judge.fold_loss(found.final, other.fit, more) is None:
            rest = [(each.effect.name, other.gain - each.gain) for each in others if each is not other]
            found.rivals[other.effect.name] = [(one.effect.name, more), *rest]
            return other
    return None


def _tried_beside(
    judge: Judge, screen: MechanismScreen, scores: Sequence[Score], held: Sequence[Score], known: Sequence[Tried]
) -> list[Tried]:
    """Fits of what was proposed, in its order; what is `known` was fitted there before."""
    found = {one.effect.name: one for one in known}
    new, more = ([score for score in some if score.member.effect.name not in found] for some in (scores, held))
    found |= {one.effect.name: one for one in _best_fits(judge, screen, new, more)}
    return [found[name] for name in dict.fromkeys(score.member.effect.name for score in (*scores, *held))]


def _best_fits(
    judge: Judge, screen: MechanismScreen, scores: Sequence[Score], held: Sequence[Score] = ()
) -> list[Tried]:
    """Every proposal fitted beside what was screened, from all of its starts; of each the best."""
    about, proposed = screen.fit, {one.effect.name: one for one in screen.proposals}
    starts: dict[str, list[Score]] = {}
    for score in scores:
        others = screen.other_starts(proposed[score.member.effect.name])
        starts[score.member.effect.name] = [score, *(score_of_proposal(one, about) for one in others)]
    for score in held:
        starts.setdefault(score.member.effect.name, []).append(score)
    fitted = iter(tried_all(judge, about, [one for some in starts.values() for one in some]))
    return [max((next(fitted) for _ in some), key=lambda one: one.gain) for some in starts.values()]


def _in_its_own_place(
    without: HypothesisFit, one: Tried, mechanisms: Sequence[Mechanism], loss: float, judge: Judge
) -> tuple[float, float]:
    """What a name gains to first order, as mechanisms are screened there, and what it is worth as it was fitted."""
    mine = [each for each in mechanisms if each.name == one.effect.name]
    if not mine:
        own = max((score.gain for score in Screen(without, [one.effect]).scores()), default=loss)
        return own, surprise_of(one.score, loss, judge.train)
    screen = MechanismScreen(without, mine, level=False, among=len(mechanisms))
    own = max((each.gain for each in screen.proposals), default=loss)
    return own, _worth_of(screen, one.effect.name, loss, surprise_of(one.score, loss, judge.train))


def _fitted_worth(screen: MechanismScreen, one: Tried) -> float:
    """What a fitted mechanism is worth beside others: the residual's colour, which a screen took at constants that
    were not fitted yet, is the same to all of them."""
    return _worth_of(screen, one.effect.name, one.gain, one.surprise)


def _worth_of(screen: MechanismScreen, name: str, gain: float, otherwise: float) -> float:
    """`otherwise`: of what this screen does not propose (it was proposed along usual disturbances)."""
    proposed = next((each for each in screen.proposals if each.effect.name == name), None)
    return otherwise if proposed is None else surprise(gain, proposed.columns, proposed.looked_at) - proposed.cost


def _is_itself(screen: MechanismScreen, one: Tried) -> bool:
    """Whether a fit has left a mechanism what it is: far beyond the constants that were tried it is another law, as
    often as not the name in whose place it was fitted."""
    return all(
        low / BEYOND_TRIED <= one.fit.values[one.effect.key(name)] <= BEYOND_TRIED * high
        for name, (low, high) in screen.tried(one.effect.name).items()
        if 0.0 < low < high
    )


def swap_nats(mechanism: Mechanism) -> float:
    """Nats that a mechanism must explain beyond a name whose place it takes, its cost paid."""
    return TEXTBOOK_NATS if mechanism.textbook else OCCAM_NATS


def _is_near(score: Score, own: float, mechanism: Mechanism) -> bool:
    """Whether a fit may show that it explains more than a name which gains `own` to first order."""
    if mechanism.textbook:
        return score.gain > own - max(FIRST_ORDER_NATS, FIRST_ORDER_SHARE * own)
    return score.gain > own + OCCAM_NATS


def _next(found: Named, judge: Judge, mechanisms: Sequence[Mechanism]) -> Tried | None:
    judge.settings.progress("screening mechanisms")
    screen = found.grammar = MechanismScreen(found.final, mechanisms)
    level = max(judge.settings.threshold, screen.null.threshold(CHANCE))
    proposals = [one for one in _scores(screen, found.final) if _worth(one) >= level / 2.0]
    held = [one for one in _held_scores(found.final, mechanisms, judge) if _worth(one) >= level / 2.0]
    if not (proposals or held):
        return None
    best = max((_worth(one) for one in proposals), default=0.0)
    near = [one for one in proposals if _worth(one) >= NEAR_SHARE * best]
    tried = _best_fits(judge, screen, near[:MOST_REFITS], held)
    found.trials.append(MechanismTrial(screen, tried))
    tried.sort(key=lambda one: -_fitted_worth(screen, one))
    for one in tried:
        if one.surprise < level:
            continue
        if (loss := judge.fold_loss(found.final, one.fit, one.gain)) is None:
            gaps = [(other.effect.name, one.gain - other.gain) for other in tried if other is not one]
            found.rivals[one.effect.name] = gaps
            return one
        found.refusals[one.effect.name] = Refusal(one.gain, loss)
    return None


def _worth(score: Score) -> float:
    return surprise_of(score, score.gain, ())


def _scores(screen: MechanismScreen, about: HypothesisFit) -> list[Score]:
    """Proposals as scores: what they cost, and the residual's colour, are so many more places looked at."""
    found = [score_of_proposal(one, about) for one in screen.proposals]
    return sorted(found, key=lambda one: -_worth(one))


def _held_scores(about: HypothesisFit, mechanisms: Sequence[Mechanism], judge: Judge) -> list[Score]:
    """The best proposals along a fit with usual disturbances, where those of `about` are far beyond them: such ones
    follow the readings whatever is missing, and no column is like it. What colours the residual there is what is
    looked for."""
    if not far_beyond(about):
        return []
    judge.settings.progress("screening mechanisms with usual disturbances")
    held = stiffened(about)
    left = left_variance(held)
    found = [score_of_proposal(one, held, left) for one in MechanismScreen(held, mechanisms, level=False).proposals]
    return sorted(found, key=lambda one: -_worth(one))[:MOST_HELD]


def score_of_proposal(one: ProposedMechanism, about: HypothesisFit, left: float | None = None) -> Score:
    """A proposal as what a fit begins with; `left`: variance of the rows about which it was screened, where they are
    not whitened by a likeliest noise."""
    member, gain = Member(one.effect, dict(one.constants), ()), one.gain / (left or 1.0)
    worth = one.worth if left is None else surprise(gain, one.columns, one.looked_at) - one.cost
    places = exp(min(-log_chance(gain, one.columns) - worth, 600.0))
    return replace(scanned(Score(member, gain, one.start, one.vector), one.columns, places), origin=about)
