"""What does not belong to a recording: set aside before the search, and looked at again with what was found.

A strong effect that is left out looks like a hand now and then: the base sets aside what the law behind it explains.
Intervals that are no longer beyond the usual under the final hypothesis come back, and everything is fitted again.

Rules of this file: `quality.unusual_intervals` says what is unusual; here is what becomes of the data and the fits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from hoopd.diagnose.quality.excluded_stretches import leaving_enough, often_notes, set_aside, still_unusual, without
from hoopd.diagnose.quality.left_modes import left_modes
from hoopd.diagnose.quality.unusual_intervals import Interval, UnusualSignal
from hoopd.diagnose.search.bounded_disturbance import likeliest
from hoopd.diagnose.search.candidates import free_of_recordings, surprise_of
from hoopd.diagnose.search.lost_commands import LostCommands
from hoopd.diagnose.search.naming import Named
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.scales import motion_scale

# A disturbance of the drive's coordinate that began within these seconds is a start-up. Named as a push it is one that
# is over within so long, and takes as long at least.
START_UP_S, LONGEST_START_UP_S, SHORTEST_START_UP_S = 0.3, 2.0, 1.0


@dataclass(frozen=True)
class CountedData:
    """Recordings as they are, and what of them counts."""

    whole: Sequence[Stretch]
    kept: Sequence[Stretch]
    aside: Sequence[Interval] = field(default_factory=tuple)
    removed: Sequence[Interval] = field(default_factory=tuple)  # start-ups, modes that end: in none of them any more
    notes: Sequence[str] = field(default_factory=tuple)  # what could not be removed
    unheard: LostCommands = field(default_factory=LostCommands)  # the inputs are as the drive had them

    @property
    def ignored(self) -> list[Interval]:
        """All that does not count."""
        return [*self.removed, *self.aside]

    def brought_back(self, found: HypothesisFit) -> CountedData:
        """With the intervals that a hypothesis, as it is fitted, explains."""
        if not self.aside:
            return self
        new = [name for name in free_of_recordings(found.effects, self.whole) if name not in found.values]
        again = fit(self.whole, found.effects, found.values, noise=found.noise, free=new, tune_noise=False)
        still = still_unusual(self.aside, again, found)
        return self if len(still) == len(self.aside) else replace(self, kept=without(self.whole, still), aside=still)

    def begun_later(self, early: Sequence[Interval]) -> CountedData:
        """Without these start-ups."""
        return replace(
            self, whole=without(self.whole, early), kept=without(self.kept, early), removed=[*self.removed, *early]
        )


def without_events(
    stretches: Sequence[Stretch],
    refit: Callable[[Sequence[Stretch]], HypothesisFit],
    first: HypothesisFit | None = None,
) -> tuple[CountedData, HypothesisFit]:
    """The data without what does not belong to them, and the fit of the rest.

    First go the intervals in which the plant's equations end: what looks unusual there is not judged.
    """
    found = refit(stretches) if first is None else first
    removed, notes = left_modes(found)
    whole = without(stretches, removed) if removed else stretches
    kept, aside, found, often = set_aside(
        whole, refit, None if removed else found, lambda one: does_not_belong(one, whole)
    )
    return CountedData(whole, kept, aside, removed, [*notes, *often_notes(often)]), found


def does_not_belong(one: Interval, stretches: Sequence[Stretch]) -> bool:
    """A hand, a lost camera, a start-up: a push on the driven coordinate later than that is an effect."""
    mine = [s for s in stretches if s.recording == one.recording]
    if one.kind == "force" and mine and one.where == mine[0].plant.driven:
        return one.t0 < float(mine[0].t[0]) + START_UP_S * motion_scale(mine[0].plant)
    return True


def start_ups(named: Named, starts: Mapping[str, float]) -> list[Interval]:
    """Beginnings of recordings (`starts`, s) with a named push on the driven coordinate: the drive was not up yet."""
    found = []
    for effect in (one.effect for one in named.accepted):
        for recording, plant in {t.stretch.recording: t.stretch.plant for t in named.final.tracks}.items():
            slot, first = plant.slots.get(effect.slot), starts[recording]
            t0, t1 = (named.final.values.get(f"{effect.key(name)}@{recording}", 0.0) for name in ("t0", "t1"))
            if slot is None or (slot.kind, slot.coordinate) != ("push", plant.driven):
                continue
            slower = motion_scale(plant)
            if t0 < min(t1, first + START_UP_S * slower) and first < t1 <= first + LONGEST_START_UP_S * slower:
                until = max(t1, first + SHORTEST_START_UP_S * slower)
                found.append(Interval(recording, first, until, (UnusualSignal(slot.coordinate, "force", 0.0, 0.0),)))
    return leaving_enough([track.stretch for track in named.final.tracks], found)


def looked_at_again(named: Named, data: CountedData, threshold: float) -> tuple[Named, CountedData]:
    """The same findings with the intervals back that they explain; as before where a finding does not survive that."""
    more = data.brought_back(named.final) if named.accepted else data
    if more is data:
        return named, data
    again = fitted_again(named, more.kept)
    held = all(surprise_of(one.score, again.losses[one.effect.name], more.kept) >= threshold for one in again.accepted)
    return (again, more) if held else (named, data)


def fitted_again(named: Named, stretches: Sequence[Stretch]) -> Named:
    """Nominal, base, final and every ablation on other stretches of the same recordings."""

    def of(found: HypothesisFit) -> HypothesisFit:
        return fit(stretches, found.effects, found.values, noise=found.noise)

    nominal = fit(stretches, named.nominal.effects, named.nominal.values, move=False)
    base, final = likeliest(of(named.base)), of(named.final)
    without_each = {name: base if one is named.base else of(one) for name, one in named.without.items()}
    losses = {name: one.criterion - final.criterion for name, one in without_each.items()}
    accepted = [replace(one, fit=final) if one.fit is named.final else one for one in named.accepted]
    return replace(
        named, nominal=nominal, base=base, final=final, accepted=accepted, without=without_each, losses=losses,
        screens={}, left=[],
    )  # fmt: skip
