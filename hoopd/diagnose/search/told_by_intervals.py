"""What was set aside as not belonging, asked whether it tells a name from one that the rest hardly excludes.

A law may show itself once: the one demand below a dead zone is what no other law explains, looked unusual beside the
plain model, and was set aside; without it a constant torque explains as much.

Rules of this file: an interval comes back with a name that explains it, or not at all.
"""

from __future__ import annotations

from dataclasses import replace

from hoopd.diagnose.search.candidates import Judge, Tried
from hoopd.diagnose.search.excluded_intervals import CountedData, fitted_again
from hoopd.diagnose.search.naming import Named, taken_out
from hoopd.diagnose.search.neighbours import neighbours
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

# Of other slots, the laws that are fitted.
MOST_ALIKE = 8


def told_by_intervals(named: Named, data: CountedData, judge: Judge) -> tuple[Named, CountedData]:
    """The findings with a neighbour in the place of a name, where with it alone intervals are as they should be; the
    same without one."""
    if data.aside:
        for one in named.accepted:
            for other in _others(named, judge, one):
                behind = other.fit.criterion - named.final.criterion
                more = data.brought_back(other.fit) if behind <= judge.settings.threshold else data
                if more is not data and _ahead(named.final, other.fit, more) >= judge.settings.threshold:
                    return _with(named, one, other, more, judge), more
    return named, data


def _others(named: Named, judge: Judge, one: Tried) -> list[Tried]:
    """What could stand in its place, the likeliest first: of its slot; and where it is alone, of any slot what the
    screen sees as much of."""
    found = neighbours(named, judge, one)
    if len(named.accepted) == 1:
        least = one.score.gain - judge.settings.threshold
        known = {one.effect.name, *(other.effect.name for other in found)}
        alike = [score for score in named.scores if score.gain >= least and score.member.effect.name not in known]
        # their screen may have been of other intervals
        found += [judge.tried(named.base, replace(score, origin=None)) for score in alike[:MOST_ALIKE]]
    return sorted(found, key=lambda other: other.fit.criterion)


def _ahead(final: HypothesisFit, other: HypothesisFit, more: CountedData) -> float:
    """Nats, with the intervals that came back."""
    mine, theirs = (fit(more.kept, found.effects, found.values, noise=found.noise) for found in (final, other))
    return mine.criterion - theirs.criterion


def _with(named: Named, one: Tried, other: Tried, more: CountedData, judge: Judge) -> Named:
    instead = [other if found is one else found for found in named.accepted]
    swapped = replace(named, accepted=instead, final=other.fit)
    taken_out(swapped, judge)
    return fitted_again(swapped, more.kept)
