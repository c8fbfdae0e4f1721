"""What could stand in the place of a named effect, and how likely each of it is.

Beside everything else that was named, along the final fit's trajectories, the whole library and the whole grammar are
screened in the effect's place; what was refitted there counts as it was fitted, and what the screen has nearly as
likely as the name is refitted. Gains are told the colour that the residual has along the named effect's own change.
Screens keep the final fit's noise, where a refit without the effect takes more of it: their gains are scaled so that
the named effect gains in them what it lost when it was taken out.
What lies less than a nat apart from it is no rival but another word.

Rules of this file: screens and their geometry; how gains become probabilities stands in `probabilities`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.unknown_effects import Survey
from hoopd.diagnose.proof.not_excluded import late_together
from hoopd.diagnose.proof.probabilities import Option
from hoopd.diagnose.proof.separation import own_columns, without_effect
from hoopd.diagnose.record import NONE_OF_THESE, PARAMETERS
from hoopd.diagnose.search.candidates import Judge, Settings, Tried, columns_of, surprise_of
from hoopd.diagnose.search.chance import colour
from hoopd.diagnose.search.fits_side_by_side import tried_all
from hoopd.diagnose.search.mechanism_screen import COLOURED, MechanismScreen, ProposedMechanism
from hoopd.diagnose.search.mechanism_search import score_of_proposal
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.screen import Score, Screen, best_scores, orthonormal, whitened_changes
from hoopd.diagnose.search.surprise import surprise
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanism import Mechanism
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]

# Of the mechanisms that the search has screened in a name's place, so many are looked at again: twice what a screen
# proposes, as the noise is another.
MOST_NEAR = 2 * COLOURED
# Less than this between two explanations, and nothing tells them apart.
ALIKE_NATS = 1.0
# What a screen has in the place within so many nats of the name is refitted, so many at a time, at most so many times.
NEARLY_NATS, MOST_REFITTED, MOST_TIMES = 3.0, 4, 3
# A name of the library is near when it makes this share of the squared change.
NEAR_COSINE = 0.5


class EffectTakenOut:
    """One named effect, taken out, and what was screened in its place."""

    def __init__(
        self, named: Named, one: Tried, library: Mapping[str, Effect], mechanisms: Sequence[Mechanism]
    ) -> None:
        self.named, self.one, self.library = named, one, library
        self.about = without_effect(named.final, one.effect, named.without[one.effect.name])
        self.stretches = [track.stretch for track in self.about.tracks]
        others = [name for name in named.final.names if name != one.effect.name]
        self.screen = Screen(self.about, [e for e in library.values() if e.name not in others])
        self.grammar = self._screened_grammar([m for m in mechanisms if m.name not in others])
        columns = own_columns(self.about, one.effect, named.final.values)
        change = whitened_changes(self.about, [(one.effect, column) for column in columns]).sum(axis=1)
        self.change: Array = self.screen.projected(change[:, None])[:, 0]
        self.colour = _colour_along(self.change, named.final)
        loss, screened = named.losses[one.effect.name], self._screened
        # a name that is worth nothing, or goes against the residual, says nothing about the screens' noise
        self.scale = min(1.0, loss / screened) if loss > 0.0 and screened > 0.0 else 1.0

    def options(self, threshold: float, beside_base: Survey | None = None) -> list[Option]:
        """Everything that could stand there; `beside_base`: curves, where nothing else was named."""
        found = [*self._own(), *self._refitted(), *self._library(), *self._mechanisms()]
        seen: dict[str, Option] = {}
        for option in found:
            seen.setdefault(option.name, option)
        seen = self._refitted_now(seen, threshold)
        # without any evidence, parameters are as likely as a name that just passes
        curves = beside_base.curves[:1] if beside_base is not None else []
        return [*seen.values(), Option(PARAMETERS, threshold), *(Option(NONE_OF_THESE, c.surprise) for c in curves)]

    def nearest(self) -> str | None:
        """The library's name whose change is most parallel; None where none is near."""
        return nearest(self.screen, self.change, (self.one.effect.name,))

    # ------------------------------------------------------------------------------------------ what there is

    def _screened_grammar(self, wanted: Sequence[Mechanism]) -> MechanismScreen:
        """Beside the fit that lacks the effect alone; where the search has screened all of them without it, under the
        noise that was left then, those that were nearest there."""
        name, count = self.one.effect.name, len(wanted)
        known = self.named.in_place.get(name)
        if known is not None and known.fit is self.named.without[name]:
            near = {one.name for one in known.nearest(MOST_NEAR)} | {name}
            wanted = [one for one in wanted if one.name in near]
        return MechanismScreen(self.about, wanted, level=False, among=count)

    @property
    def _screened(self) -> float:
        """Nats that the effect gains as it is in the screens, whose noise is that of the final fit."""
        along, size = float(self.change @ self.screen.residual), float(self.change @ self.change)
        return along**2 / (2.0 * size) if along > 0.0 and size > 0.0 else 0.0

    def _own(self) -> Iterator[Option]:
        name, loss = self.one.effect.name, self.named.losses[self.one.effect.name]
        mine = self._proposed.get(name)
        if mine is not None:
            worth = self._worth(mine, loss)
        elif name in self.library:
            worth = surprise_of(self.one.score, loss / self.colour, self.stretches)
        else:
            worth = surprise_of(self.one.score, loss, self.stretches)
        yield Option(name, worth, True)

    def _refitted(self) -> Iterator[Option]:
        """What was fitted in its place: by how much it was behind."""
        loss = self.named.losses[self.one.effect.name]
        refused = self.named.refused.get(self.one.effect.name, ())
        for name, behind in self.named.rivals.get(self.one.effect.name, []):
            if name in self.named.final.names:
                continue
            gain = max(loss - behind, 0.0)
            if name in refused:
                # held-out data say no
                yield Option(name, 0.0)
            elif name in self.library:
                yield Option(name, self._refitted_worth(name, gain), self._same(self.library[name], abs(behind)))
            elif (proposed := self._proposed.get(name)) is not None:
                alike = not proposed.mechanism.textbook and abs(behind) < ALIKE_NATS
                yield Option(name, self._worth(proposed, gain), alike)

    def _refitted_now(self, screened: dict[str, Option], threshold: float) -> dict[str, Option]:
        """Options; what only a screen has, nearly as likely as the name or likelier, as it is fitted there: a screen is
        linear about a reference that has the name in it, and a scale of all that moves is like whatever moves it."""
        own, without = self.one.effect.name, self.named.without[self.one.effect.name]
        judge = Judge(self.stretches, self.library, Settings(threshold))
        known = {own, *(name for name, _ in self.named.rivals.get(own, ()))}
        for _ in range(MOST_TIMES):
            least = screened[own].worth - NEARLY_NATS
            every = sorted(screened.values(), key=lambda option: -option.worth)
            near = [one.name for one in every if one.name not in known and not one.alike and one.worth > least]
            if not near:
                break
            some = near[:MOST_REFITTED]
            fitted = tried_all(judge, without, [self._start(name, without) for name in some])
            for name, tried in zip(some, fitted, strict=True):
                known.add(name)
                if isfinite(tried.fit.criterion):
                    proposed, gain = self._proposed.get(name), max(tried.gain, 0.0)
                    worth = self._refitted_worth(name, gain) if proposed is None else self._worth(proposed, gain)
                    screened = {**screened, name: screened[name]._replace(worth=worth)}
        return screened

    def _start(self, name: str, without: HypothesisFit) -> Score:
        proposed = self._proposed.get(name)
        score = self._scores[name] if proposed is None else score_of_proposal(proposed, without)
        return replace(score, origin=without)

    def _refitted_worth(self, name: str, gain: float) -> float:
        """Of a name that was fitted: what was looked at to find it (the times of a push) is many things."""
        tried = next((one for one in self.named.tried if one.effect.name == name), None)
        if tried is not None:
            return surprise_of(tried.score, gain / self.colour, self.stretches)
        return surprise(gain / self.colour, *columns_of(self.library[name], self.stretches))

    def _library(self) -> Iterator[Option]:
        for score in self._scores.values():
            effect = score.member.effect
            worth = surprise_of(score, self.scale * score.gain / self.colour, self.stretches)
            yield Option(effect.name, worth, self._same(effect, self._apart(score.vector)))

    def _mechanisms(self) -> Iterator[Option]:
        for one in self._proposed.values():
            # a textbook's law is another one, however little these recordings tell them apart
            alike = not one.mechanism.textbook and self._apart(one.vector) < ALIKE_NATS
            yield Option(one.effect.name, self._worth(one, self.scale * one.gain), alike)

    @cached_property
    def _scores(self) -> Mapping[str, Score]:
        return {score.member.effect.name: score for score in self.screen.scores()}

    @cached_property
    def _proposed(self) -> Mapping[str, ProposedMechanism]:
        return {one.effect.name: one for one in self.grammar.proposals}

    def _worth(self, one: ProposedMechanism, gain: float) -> float:
        return surprise(gain / self.colour, one.columns, one.looked_at) - one.cost

    def _same(self, other: Effect, apart: float) -> bool:
        """Whether nothing tells a name of the library from the effect."""
        mine = self.one.effect
        if other.name in mine.same_as or other.name in self._late:
            return True
        return (other.name in mine.near or mine.name in other.near) and apart < ALIKE_NATS

    @cached_property
    def _late(self) -> frozenset[str]:
        found = late_together(self.named.final, self.one.effect, self.library)
        return frozenset(one.name for one in found)

    def _apart(self, vector: Array) -> float:
        """Nats by which a change of this direction (rows,) misses the effect's."""
        size = float(vector @ vector)
        along = float(self.change @ vector) ** 2 / size if size > 0.0 else 0.0
        return self.scale * (float(self.change @ self.change) - along) / 2.0


def _colour_along(change: Array, final: HypothesisFit) -> float:
    """What the final residual's colour makes of gains along a change (rows,)."""
    size = float(np.sqrt(change @ change))
    if size <= 0.0:
        return 1.0
    rows = final.stacked()
    known = orthonormal(rows[:, 1:])
    residual = rows[:, 0] - known @ (known.T @ rows[:, 0])
    return colour(change[:, None] / size, residual, [(len(t.z), len(t.composite.channels)) for t in final.tracks])


def nearest(screen: Screen, change: Array, but: Sequence[str] = ()) -> str | None:
    """The library's name that makes most of a change (rows,), if it makes more than half of it."""
    found = best_scores(screen.members, screen.vectors, change)
    others = [one for one in found if one.member.effect.name not in but]
    best = max(others, key=lambda one: one.gain, default=None)
    is_near = best is not None and best.gain > NEAR_COSINE * float(change @ change) / 2.0
    return best.member.effect.name if best is not None and is_near else None
