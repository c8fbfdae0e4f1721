"""Another name of the same slot in the place of one that held-out data deny.

A law may be nearly right: of a friction that falls with speed the part that does not. Before such a name is given up,
its neighbours are asked: the training data choose among them, those that are hardly behind it there and hold in folds
beside it, the one with the most evidence first. Held-out data say no more than whether they deny it, too; the first
that they do not deny takes the place. Where there is none, the name stays as it was found, and so does one that
barely passed: of what chance may have brought no neighbour is to be made true.

Rules of this file: no name of an effect is written here; nothing is ranked by held-out data.
"""

from __future__ import annotations

from hoopd.diagnose.proof.confirmation import beside_the_others, surprise_in
from hoopd.diagnose.proof.denial import denial
from hoopd.diagnose.proof.fit_tables import Played
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.search.candidates import Judge, Tried
from hoopd.diagnose.search.naming import NOT_EXCLUDED_NATS, Named, taken_out
from hoopd.diagnose.search.neighbours import neighbours


def replace_denied(named: Named, held: HeldOut, judge: Judge, seed: int = 0) -> None:
    """Puts neighbours into the places of the denied names."""
    if not named.accepted or not held.stretches:
        return
    for name, why in beside_the_others(named, _played(named, held), seed).items():
        one = next(one for one in named.accepted if one.effect.name == name)
        if not why.asks_for_another(surprise_in(named, one), judge.settings.threshold):
            continue
        neighbour = _neighbour(named, held, judge, one, seed)
        if neighbour is not None:
            named.rivals[neighbour.effect.name] = [(name, named.final.criterion - neighbour.fit.criterion)]
            named.accepted[named.accepted.index(one)] = neighbour
            named.final = neighbour.fit
            taken_out(named, judge)


def _played(named: Named, held: HeldOut) -> dict[str, Played]:
    wanted = {"named": named.final, **{f"without {name}": one for name, one in named.without.items()}}
    return {name: run for name, one in wanted.items() if (run := held.played_of(one)) is not None}


def _neighbour(named: Named, held: HeldOut, judge: Judge, one: Tried, seed: int) -> Tried | None:
    """The first that neither folds nor held-out data refuse."""
    without, before = named.without[one.effect.name], held.played_of(named.without[one.effect.name])
    least = max(judge.settings.threshold, surprise_in(named, one) - NOT_EXCLUDED_NATS)
    for other in neighbours(named, judge, one):
        if other.surprise < least:
            return None
        ahead = max(named.final.criterion - other.fit.criterion, 0.0)
        if judge.fold_loss(named.final, other.fit, ahead) is not None:
            continue
        after = held.played_of(other.fit)
        if before is not None and after is not None:
            gain = without.criterion - other.fit.criterion
            if denial(before, after, gain, len(named.accepted), seed) is None:
                return other
    return None
