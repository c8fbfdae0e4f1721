"""What the recordings do not exclude beside each effect that was named, and why.

Three reasons: the two are the same for every sensor; the other was refitted and is hardly behind; the other was not
refitted, but on these data its change is so parallel that no fit could be far behind. A rival that folds of the
training data refused is excluded by them, however much it explains of what it was fitted to.

Rules of this file: no name of an effect is written here; what is equal or near stands in the effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import hypot

from hoopd.diagnose.proof.separation import nats_apart, rows_beside, without_effect
from hoopd.diagnose.record import Alternative, EffectFinding, Quantity, Visible
from hoopd.diagnose.search.candidates import Tried
from hoopd.diagnose.search.naming import NOT_EXCLUDED_NATS, Named
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plots.number_format import value_text

# A rival that a screen saw at less than this share of the effect's own gain is not parallel to it.
PARALLEL_SHARE = 0.5
# Two times are the same when they differ by less than this many standard errors.
SAME_ERRORS = 2.0

SAME = "nothing that is recorded tells them apart"


@dataclass(frozen=True)
class Separation:
    """One named effect beside everything else."""

    effect: Effect
    alternatives: tuple[Alternative, ...]  # not excluded, the nearest first
    never: tuple[str, ...]  # those among them that no recording of these sensors excludes
    nats: Mapping[str, float]  # to every rival that was looked at: refitted, else expected

    @property
    def not_excluded(self) -> list[str]:
        """Names, the nearest first."""
        return [one.name for one in self.alternatives]

    @property
    def open(self) -> list[str]:
        """Alternatives that another recording may exclude, the nearest first."""
        return [name for name in self.not_excluded if name not in self.never]


def separations(named: Named, library: Mapping[str, Effect]) -> dict[str, Separation]:
    """By the name of the effect."""
    return {one.effect.name: _separation(named, one, library) for one in named.accepted}


def parameter_notes(library: Mapping[str, Effect], power: Mapping[str, Visible]) -> list[str]:
    """What is to be said when other parameters are enough: effects that do the same, never told from these; `power`:
    what would have been seen."""
    names = [
        name for name, effect in library.items()
        if effect.as_parameters and (name not in power or power[name].smallest is None)
    ]  # fmt: skip
    return [f"{name} does the same as other parameters: these recordings do not tell which it is" for name in names]


def one_body_notes(effects: Sequence[EffectFinding]) -> list[str]:
    """Findings at different places that swing at one frequency: what swings may be one body, or the frame."""
    every = {one.name: one.parameters.get("w") for one in effects}
    swings = {name: w for name, w in every.items() if w is not None and w.unit == "rad/s"}
    return [
        f"{one} and {other} swing at one and the same frequency ({value_text(found)}): it may be one "
        "body, or the frame, that moves both"
        for (one, found), (other, beside) in combinations(swings.items(), 2)
        if one.partition(".")[0] != other.partition(".")[0] and _overlap(found, beside)
    ]


def _overlap(one: Quantity, other: Quantity) -> bool:
    """Whether two intervals have a value in common."""
    ends = [end for each in (one, other) for end in each.ci95 or () if end is not None]
    if len(ends) < 4:
        return False
    low, high, least, most = ends
    return max(low, least) <= min(high, most)


def _separation(named: Named, one: Tried, library: Mapping[str, Effect]) -> Separation:
    effect = one.effect
    rivals = {name: behind for name, behind in named.rivals.get(effect.name, []) if name not in named.final.names}
    expected = _expected(named, one, [e for e in _candidates(named, one, library) if e.name not in rivals])
    refused = named.refused.get(effect.name, ())
    refitted = {name: behind for name, behind in rivals.items() if name not in refused}
    exact = [*_equal(effect, library), *late_together(named.final, effect, library)]
    found = [*exact, *_refitted(effect, refitted, library), *_parallel(expected)]
    found += _equals_of(found, library)
    alternatives = {other.name: other for other in reversed(found) if other.name != effect.name}
    nearest = sorted(alternatives.values(), key=lambda other: (other.behind_nats or 0.0, other.name))
    never = tuple(other.name for other in exact)
    return Separation(effect, tuple(nearest), never, {**expected, **refitted})


# ---------------------------------------------------------------------------------------------- equal for every sensor


def _equal(effect: Effect, library: Mapping[str, Effect]) -> list[Alternative]:
    reason = f"{SAME}; what does: {effect.best_experiment}"
    return [Alternative(name=name, behind_nats=0.0, reason=reason) for name in effect.same_as if name in library]


def _equals_of(found: Sequence[Alternative], library: Mapping[str, Effect]) -> list[Alternative]:
    """What is the same as an alternative."""
    return [
        Alternative(name=name, behind_nats=other.behind_nats, reason=f"the same as {other.name}: {SAME}")
        for other in found if other.name in library
        for name in library[other.name].same_as if name in library
    ]  # fmt: skip


def late_together(final: HypothesisFit, effect: Effect, library: Mapping[str, Effect]) -> list[Alternative]:
    """A late input is all sensors late by the same time."""
    channels = {channel for track in final.tracks for channel in track.composite.channels}
    late = [one for one in library.values() if one.latency]
    for group in _covering(late, channels):
        reason = "a late input and every sensor late by the same time are one and the same"
        if effect.delay:
            names = [one.name for one in group if one.name not in final.names]
            return [Alternative(name=name, behind_nats=0.0, reason=f"{_with(name, group)}: {reason}") for name in names]
        if effect in group and _same_time(final, group):
            delays = [one.name for one in library.values() if one.delay and one.name not in final.names]
            return [Alternative(name=name, behind_nats=0.0, reason=reason) for name in delays]
    return []


def _covering(late: Sequence[Effect], channels: set[str]) -> list[tuple[Effect, ...]]:
    """Smallest groups of latencies that make every channel late."""
    for size in range(1, len(late) + 1):
        found = [g for g in combinations(late, size) if channels <= {c for one in g for c in one.latency}]
        if found:
            return found
    return []


def _with(name: str, group: Sequence[Effect]) -> str:
    others = [one.name for one in group if one.name != name]
    return f"together with {' and '.join(others)} of the same time" if others else "alone"


def _same_time(final: HypothesisFit, group: Sequence[Effect]) -> bool:
    """Whether all of a group were named, with times that agree within their errors."""
    keys = [one.key(next(iter(one.latency.values()))) for one in group]
    if any(key not in final.free for key in keys):
        return False
    return all(
        abs(final.values[a] - final.values[b]) < SAME_ERRORS * hypot(final.deviation(a), final.deviation(b))
        for a, b in combinations(keys, 2)
    )


# ---------------------------------------------------------------------------------------------- equal on these data


def _refitted(effect: Effect, behind: Mapping[str, float], library: Mapping[str, Effect]) -> list[Alternative]:
    close = {name: nats for name, nats in behind.items() if nats < NOT_EXCLUDED_NATS}
    return [
        Alternative(name=name, behind_nats=nats, reason=_reason(effect, library.get(name), nats))
        for name, nats in close.items()
    ]


def _reason(effect: Effect, rival: Effect | None, behind: float) -> str:
    if rival is not None and effect.name in rival.contains:
        return f"contains {effect.name}; what it explains beyond that is too little to ask for it"
    if behind < 0.0:
        return "fitted in its place it explains as much or more, too little more to take it"
    return "fitted in its place it explains nearly as much"


def _parallel(expected: Mapping[str, float]) -> list[Alternative]:
    reason = "in these recordings its effect runs parallel, so that a fit of it would be hardly behind"
    close = {name: nats for name, nats in expected.items() if nats < NOT_EXCLUDED_NATS}
    return [Alternative(name=name, behind_nats=nats, reason=reason) for name, nats in close.items()]


def _candidates(named: Named, one: Tried, library: Mapping[str, Effect]) -> list[Effect]:
    """Effects that may run parallel: of a single effect the first screen leaves out most."""
    slots = {slot for track in named.final.tracks for slot in track.stretch.plant.slots}
    every = [e for e in library.values() if e.found_by == "screen" and e.slot in slots]
    every = [e for e in every if e.name not in named.final.names]
    gains = {score.member.effect.name: score.gain for score in named.scores}
    if len(named.accepted) > 1 or one.effect.name not in gains:
        return every
    least = PARALLEL_SHARE * gains[one.effect.name]
    return [e for e in every if gains.get(e.name, 0.0) >= least or e.name in one.effect.near]


def _expected(named: Named, one: Tried, rivals: Sequence[Effect]) -> dict[str, float]:
    if not rivals:
        return {}
    about = without_effect(named.final, one.effect, named.without[one.effect.name])
    return nats_apart([rows_beside(about, one.effect, named.final.values, rivals, about.recordings)])
