"""Which effects make one free run over each whole stretch better: forward and backward, by the run itself.

The search names effects by the likelihood of innovations, in which disturbances and a filter forgive what a long run
does not; the two need not agree. Here sets are judged by the run. An effect is tried when it gains more of the error
than the best of the whole library would by chance; how far along the way that leads the set is kept, the training error
says, every parameter charged. Held-out stretches are simulated once, with the set that was chosen: on them nothing is.

Rules of this file: nothing here is a name of the verdict; it is evidence that a simulation gets better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import log

import numpy as np

from hoopd.diagnose.proof.free_run_refinement import LENGTHS_S, SETTLED, Refined, refine
from hoopd.diagnose.proof.sensitivity import Sensitivity, independent, states_of
from hoopd.diagnose.search.candidates import free_of_recordings
from hoopd.diagnose.search.screen import Score
from hoopd.plants.effects.base import Effect, ranges_of
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch

# Of the library's best by their first-order gain so many are simulated.
TRIES = 4
# So many sets are carried on at a time: the best next effect is not always on the best way.
WAYS = 2
MOST_EFFECTS = 6
# How often the best of the library may gain as much by chance, to first order. Of the eight blocks that a short run is
# cut into, the best of some 25 effects is seldom rarer than 1 in 50 however much it explains: not less than 1 in 20.
CHANCE = 0.05
# ln(error) must fall by this for each parameter, over the error's independent samples (Akaike 1974).
PRICE = 2.0
# An effect starts at least at this share of its usual size: from its neutral value a phase has no slope.
LEAST_START = 0.01
# Shares of the screen's amplitude, and of what the other parameters move with it, that a run starts from.
STARTS = ((1.0, 0.0), (0.25, 0.0), (1.0, 1.0))
# What is tried is refined until a step takes less than this share of the error; what is taken, to the end.
ROUGHLY = 3e-3


@dataclass(frozen=True)
class Step:
    """One effect taken or left out: its share of the error, and how often the library's best does so by chance."""

    effect: str
    taken: bool
    fitted: float
    chance: float


@dataclass
class Selected:
    """A set of effects with the parameters that simulate best."""

    effects: tuple[Effect, ...]
    refined: Refined
    steps: list[Step] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(effect.name for effect in self.effects)


class Selection:
    """The stretches, and how a set of effects is tried on them."""

    def __init__(
        self, train: Sequence[Stretch], heldout: Sequence[Stretch], library: Mapping[str, Effect], seed: int = 0
    ) -> None:
        self.train, self.heldout, self.library, self.seed = list(train), list(heldout), dict(library), seed
        self._references = [Track(one).z for one in self.train]
        self._held_references = [Track(one).z for one in self.heldout]

    def run(self, named: Sequence[Effect], values: Mapping[str, float]) -> Selected:
        """From the named set with its values, without what the run does not need."""
        base = Selected((), self.grown((), values))
        here = self._best(base, Selected(tuple(named), self.fitted(named, values, base.refined))) if named else base
        pool = _distinct([base, self._thinned(here)])
        ways, samples = pool[-1:], independent(base.refined.runs)
        for _ in range(MOST_EFFECTS):
            known = {frozenset(one.names) for one in pool}
            more = _distinct([self._thinned(one) for here in ways for one in self._more(here)])
            ways = [one for one in more if frozenset(one.names) not in known]
            ways = sorted(ways, key=lambda one: charged(one.refined, samples))[:WAYS]
            pool += ways
        return min(pool, key=lambda one: charged(one.refined, samples))

    # ------------------------------------------------------------------------------------------ one set

    def grown(self, effects: Sequence[Effect], values: Mapping[str, float]) -> Refined:
        """Refined through growing windows."""
        free = self._free(effects)
        return refine(self.train, self._references, effects, _complete(effects, values, free), free, LENGTHS_S)

    def further(
        self, effects: Sequence[Effect], values: Mapping[str, float], at: Refined, settled: float = SETTLED
    ) -> Refined:
        """Refined from the runs of another hypothesis, whole stretches only: never led away by short windows."""
        free = self._free(effects)
        here = _complete(effects, values, free)
        return refine(self.train, states_of(at.runs), effects, here, free, (None,), settled)

    def fitted(self, effects: Sequence[Effect], values: Mapping[str, float], near: Refined) -> Refined:
        """The best of several starts: growing windows, the near run with these values, and with no effect yet."""
        own = {k: v for k, v in values.items() if "." in k}
        weak = {e.key(p.name): p.neutral for e in effects for p in e.parameters if p.role == "amplitude"}
        starts = [self.grown(effects, {**values, **near.values, **own})]
        starts += [self.further(effects, {**some, **own}, near) for some in (near.values, values)]
        if weak:
            starts.append(self.further(effects, {**near.values, **own, **weak}, near))
        return min(starts, key=lambda one: one.cost)

    def on_heldout(self, one: Selected) -> Refined:
        """Held-out stretches: their starts are fitted, and phases of a recording that is new."""
        known = {s.recording for s in self.train}
        own = [n for n in free_of_recordings(one.effects, self.heldout) if n.split("@", 1)[1] not in known]
        values = _complete(one.effects, one.refined.values, own)
        return refine(self.heldout, self._held_references, one.effects, values, own)

    def _free(self, effects: Sequence[Effect]) -> tuple[str, ...]:
        plant = max((s.plant for s in self.train), key=lambda p: len(p.free))
        own = [e.key(p.name) for e in effects for p in e.parameters if not p.discrete and not p.per_recording]
        return (*plant.free, *own, *free_of_recordings(effects, self.train))

    def _best(self, *sets: Selected) -> Selected:
        return min(sets, key=lambda one: one.refined.cost)

    # ------------------------------------------------------------------------------------------ moves

    def _more(self, here: Selected) -> list[Selected]:
        """Sets with one effect more, those of WAYS different effects that are worth most."""
        if len(here.effects) >= MOST_EFFECTS:
            return []
        screen = Sensitivity(here.refined, here.effects, self._others(here), self.seed)
        by_chance = {s.member.effect.name: screen.chance(s.member.effect.name, s.gain) for s in screen.scores()}
        likely = [s for s in screen.scores() if by_chance[s.member.effect.name] <= CHANCE]
        tried = [self._with(here, score, screen.beside(score)) for score in likely[:TRIES]]
        samples = independent(here.refined.runs)
        tried = [one for one in tried if worth(one.refined, here.refined, samples)]
        tried = _unlike(sorted(tried, key=lambda one: charged(one.refined, samples)))[:WAYS]
        return [self._taken(one, here, by_chance[one.names[-1]]) for one in tried]

    def _taken(self, one: Selected, here: Selected, chance: float) -> Selected:
        """Refined to the end, with its evidence."""
        refined = self.further(one.effects, one.refined.values, one.refined)
        step = Step(one.names[-1], True, 1.0 - refined.cost / here.refined.cost, chance)
        return Selected(one.effects, refined, [*here.steps, step])

    def _with(self, here: Selected, score: Score, beside: Mapping[str, float]) -> Selected:
        """One effect more, from where the screen says and from less of it: a long run is no straight line."""
        effects, best = (*here.effects, score.member.effect), None
        for share, along in STARTS:
            start = {**_moved(here, beside, along), **_start(score, share)}
            found = self.further(effects, start, here.refined, ROUGHLY)
            best = found if best is None or found.cost < best.cost else best
            if here.refined.cost - best.cost > score.gain:  # half of what the straight line promised
                break
        assert best is not None
        return Selected(effects, best, here.steps)

    def _others(self, here: Selected) -> list[Effect]:
        """Effects that could come beside those of the set."""
        taken = {name for e in here.effects for name in (e.name, *e.same_as, *e.contains)}
        slots = {slot for one in self.train for slot in one.plant.slots}
        wanted = [e for e in self.library.values() if e.found_by == "screen" and e.slot in slots]
        return [e for e in wanted if e.name not in taken]

    def _thinned(self, here: Selected) -> Selected:
        """Without effects that the run does not need."""
        for effect in here.effects:
            rest = tuple(e for e in here.effects if e is not effect)
            less = Selected(rest, self.further(rest, here.refined.values, here.refined))
            lost = 1.0 - here.refined.cost / less.refined.cost
            if not worth(here.refined, less.refined, independent(here.refined.runs)):
                less.steps = [*here.steps, Step(effect.name, False, lost, 1.0)]
                return self._thinned(less)
        return here


def charged(one: Refined, samples: float) -> float:
    """ln(error) and the price of the parameters."""
    return log(one.cost) + PRICE * len(one.free) / samples


def worth(more: Refined, less: Refined, samples: float) -> bool:
    """Whether the parameters that one has more are worth the fall of the error."""
    return charged(more, samples) < charged(less, samples)


def _distinct(sets: Sequence[Selected]) -> list[Selected]:
    """One of each set of names."""
    return list({frozenset(one.names): one for one in reversed(sets)}.values())[::-1]


def _unlike(sets: Sequence[Selected]) -> list[Selected]:
    """The first of those whose last effects are the same thing, or one a case of the other."""
    kept: list[Selected] = []
    for one in sets:
        effect = one.effects[-1]
        alike = {effect.name, *effect.contains, *effect.same_as, *effect.near}
        if not any(alike & {o.name, *o.contains, *o.same_as} for o in (other.effects[-1] for other in kept)):
            kept.append(one)
    return kept


def _complete(effects: Sequence[Effect], values: Mapping[str, float], own: Sequence[str]) -> dict[str, float]:
    """Values for every parameter of the effects, each recording's own too."""
    neutral = {e.key(p.name): p.neutral for e in effects for p in e.parameters}
    full = {**neutral, **values}
    return {**full, **{name: full.get(name, full[name.split("@")[0]]) for name in own}}


def _moved(here: Selected, beside: Mapping[str, float], share: float) -> dict[str, float]:
    """Values with a share of what the free parameters move, each within its range."""
    ranges = ranges_of(here.effects)
    out = dict(here.refined.values)
    for name, move in beside.items():
        low, high = ranges.get(name.split("@")[0], (-np.inf, np.inf))
        out[name] = float(np.clip(out[name] + share * move, low, high))
    return out


def _start(score: Score, share: float) -> dict[str, float]:
    """Where a screen says to start, every amplitude moved off its neutral value."""
    start, effect = dict(score.start), score.member.effect
    for p in effect.parameters:
        key = effect.key(p.name)
        if p.role != "amplitude":
            continue
        off = share * (start.get(key, p.neutral) - p.neutral)
        start[key] = float(
            np.clip(p.neutral + (off if abs(off) > LEAST_START * p.size else LEAST_START * p.size), p.low, p.high)
        )
    for key, value in score.member.shape.items():
        start.setdefault(effect.key(key), value)
    return start
