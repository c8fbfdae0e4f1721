"""A name whose extra constants do nothing told under the simpler name: Stribeck's friction with no peak is Coulomb's.

In a joint fit a constant may end where its law is another, simpler one: at its neutral value, at a bound, or so far
off that the recordings never see it (a threshold at zero, a limit that nothing reaches). What a name contains is
declared; of a mechanism, the limits of its shape are the laws that its constants can lead to: those of the library in
its slot, and of the grammar with the same variables and fewer constants. Each is fitted in its place, and takes it
when the recordings lose less than the larger law must gain, in folds as well.

Rules of this file: simpler laws only; which law is right beyond that is decided in `naming` and `mechanism_search`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from hoopd.diagnose.search.candidates import Judge, Tried, surprise_of
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.mechanism_search import swap_nats
from hoopd.diagnose.search.naming import OCCAM_NATS, OCCAM_SHARE, Named, taken_out
from hoopd.diagnose.search.screen import Score
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanism import Mechanism
from hoopd.plants.likelihood.fitting import fit

# Limits of a mechanism that are fitted, those that explain most of what it does.
MOST_TRIED = 2


def tell_simply(found: Named, judge: Judge, mechanisms: Sequence[Mechanism] = ()) -> None:
    """Puts simpler names into the places of those that are one of them in what was found; `mechanisms`: those that
    may be told."""
    for one in list(found.accepted):
        simple = _simpler(found, judge, one, {each.name: each for each in mechanisms})
        if simple is None:
            continue
        found.rivals[simple.effect.name] = [(one.effect.name, found.final.criterion - simple.fit.criterion)]
        found.accepted[found.accepted.index(one)] = simple
        found.final = simple.fit
        taken_out(found, judge)


def _simpler(found: Named, judge: Judge, one: Tried, mechanisms: Mapping[str, Mechanism]) -> Tried | None:
    """The simpler law that explains most beyond chance, of those that lose less than the larger one must gain."""
    mine = mechanisms.get(one.effect.name)
    best: Tried | None = None
    # a mechanism for which more speaks, told how much was looked at, is none of its limits
    own = 0.0 if mine is None else surprise_of(one.score, found.losses[one.effect.name], judge.train)
    least = max(judge.settings.threshold, own)
    for other in _contained(found, judge, one) if mine is None else _limits(found, judge, one, mine, mechanisms):
        lost = other.fit.criterion - found.final.criterion
        allowed = _allowed(found.losses[one.effect.name], one.effect, other.effect, mine)
        if lost >= allowed or other.surprise < least:
            continue
        # in blocks that were not fitted it loses no more than chance explains
        if judge.fold_loss(found.final, other.fit, max(-lost, 0.0)) is not None:
            continue
        # by what chance gives each: of two that explain as much the one with fewer constants
        if best is None or other.surprise > best.surprise:
            best = other
    return best


def _allowed(gain: float, larger: Effect, simple: Effect, mine: Mechanism | None) -> float:
    """Nats that the larger law must gain beyond the simple one; `mine`: it as a mechanism."""
    if mine is not None:
        return swap_nats(mine) + larger.cost_nats - simple.cost_nats
    return max(OCCAM_NATS, OCCAM_SHARE * gain)


def _contained(found: Named, judge: Judge, one: Tried) -> Iterator[Tried]:
    """Declared cases of an effect, in its place."""
    names = [name for name in one.effect.contains if name in judge.library and name not in found.final.names]
    for score in _scores(found, judge, one.effect.name, [judge.library[name] for name in names]):
        yield _from_the_larger(found, judge, one, _tried(found, judge, one.effect.name, score))


def _from_the_larger(found: Named, judge: Judge, larger: Tried, simple: Tried) -> Tried:
    """The simpler law as it was fitted, or as it ends from where the larger one did, which has found its way on."""
    final, without = found.final, found.without[larger.effect.name]
    shared = {p.name for p in simple.effect.parameters} & {p.name for p in larger.effect.parameters}
    start = {simple.effect.key(name): final.values[larger.effect.key(name)] for name in shared}
    again = fit(
        judge.train, simple.fit.effects, {**simple.fit.values, **final.values, **start}, like=final, noise=final.noise
    )
    if again.criterion >= simple.fit.criterion:
        return simple
    gain = without.criterion - again.criterion
    return replace(simple, fit=again, gain=gain, surprise=surprise_of(simple.score, gain, judge.train))


def _limits(
    found: Named, judge: Judge, larger: Tried, mine: Mechanism, mechanisms: Mapping[str, Mechanism]
) -> Iterator[Tried]:
    """What a mechanism's constants can lead to, as far as it explains as much to first order."""
    without = found.without[mine.name]
    own = max((one.gain for one in MechanismScreen(without, [mine], level=False).proposals), default=0.0)
    known = [e for name, e in judge.library.items() if e.slot == mine.site.slot and name not in found.final.names]
    known += [each.effect for each in mechanisms.values() if _is_limit(each, mine) and each.name not in without.names]
    every = _scores(found, judge, mine.name, known)
    behind = dict(found.rivals.get(mine.name, []))
    near = []
    for score in every:
        allowed = _allowed(own, mine.effect, score.member.effect, mine)
        # what was fitted in its place already, and lost more, is not fitted again
        if score.gain > own - allowed and behind.get(score.member.effect.name, 0.0) < allowed:
            near.append(score)
    for score in near[:MOST_TRIED]:
        yield _from_the_larger(found, judge, larger, _tried(found, judge, mine.name, score))


def _is_limit(simple: Mechanism, mine: Mechanism) -> bool:
    """The same place and variables, and fewer constants."""
    axes = ({one.name for one in (each.axis, each.factor, each.dry) if one is not None} for each in (simple, mine))
    return simple.site == mine.site and next(axes) <= next(axes) and len(simple.constants) < len(mine.constants)


def _scores(found: Named, judge: Judge, name: str, effects: Sequence[Effect]) -> list[Score]:
    """Of effects in the place of a name, most evidence first."""
    without = found.without[name]
    asked = Judge(judge.train, {one.name: one for one in effects}, judge.settings)
    return asked.proposals(without, without.names) if effects else []


def _tried(found: Named, judge: Judge, name: str, score: Score) -> Tried:
    judge.settings.progress(f"{score.member.effect.name} in place of {name}")
    return judge.tried(found.without[name], score)
