"""A disturbance far beyond the usual where nothing has a name: something acts, and no law of it was shown.

A disturbance may be anything, so a free one explains a drag that grows all through one fall as well as the drag does.
That is no reason to call the model right. Where the recordings are less likely by several nats with disturbances that
stay within a few times the usual (and noise of the readings as large as it likes), a finding without a law says how
much acts, and where. Which laws would take most of it, were disturbances usual, is told beside it; the likelihood with
free disturbances has not chosen them, so none is named.

What lasts no longer than a few readings is not told from errors of the readings that last as long: no finding.

Rules of this file: names stay what the search has found; there is none where this is asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hoopd.diagnose.curves.missing_force import missing_force
from hoopd.diagnose.record import NONE_OF_THESE, EffectFinding, Evidence, Location, Quantity, Unexplained
from hoopd.diagnose.report_curves import MissingForce
from hoopd.diagnose.search.bounded_disturbance import FAR_BEYOND, disturbance_unit, far_beyond
from hoopd.diagnose.search.candidates import Judge, Tried
from hoopd.diagnose.search.naming import MOST_REFITS, NOT_EXCLUDED_NATS, Named
from hoopd.plants.declaration import Plant
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.noise_tuning import first_noise
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plots.number_format import listed, value_text

# What lasts shorter than so many readings may be their own error.
FEWEST_READINGS = 4.0
# A law that takes less than this part of it is not told.
LEAST_PART, WHOLE, MOST_LAWS = 0.5, 0.995, 2
# Recordings whose disturbance is drawn.
MOST_DRAWN = 4
# Slots that a state has beside the one of what moves, and the one where what acts is no law.
ELSEWHERE, ANYTHING = ("actuator", "sensor", "frame", "push"), "external"


class Size(NamedTuple):
    """Of one recording's disturbance of one state."""

    track: Track
    state: str
    force: float
    time_s: float
    times: float  # the usual one

    @property
    def unit(self) -> str:
        """Of the force."""
        return disturbance_unit(self.track.stretch.plant, self.state)

    @property
    def slot(self) -> str:
        """Where it acts."""
        slots = self.track.stretch.plant.slots
        own = [name for name, one in slots.items() if one.coordinate == self.state and one.kind not in ELSEWHERE]
        return own[0] if own else ANYTHING

    @property
    def channel(self) -> str | None:
        """That shows it."""
        channels = self.track.stretch.plant.channels
        return next((name for name, one in channels.items() if self.state in (name, one.state)), None)


class LawPart(NamedTuple):
    """What a law would take of it, were disturbances held to a few times the usual."""

    part: float  # of the nats, 0 to 1
    sizes: str  # its parameters, in words

    def __str__(self) -> str:
        whole = "all of it" if self.part >= WHOLE else f"{100.0 * self.part:.0f} %"
        return f"{whole}{f' with {self.sizes}' if self.sizes else ''}"


@dataclass(frozen=True)
class LargeDisturbance:
    """What acts beyond the usual, the nats by which the recordings ask for it, and what laws would take of them."""

    largest: Size
    nats: float
    laws: Mapping[str, LawPart]  # largest first

    @property
    def name(self) -> str:
        """As a finding."""
        return f"unknown.{self.largest.slot}"

    @cached_property
    def probability(self) -> float:
        """That more than a few times the usual acts."""
        return float(1.0 / (1.0 + np.exp(-self.nats)))

    def forces(self, base: HypothesisFit) -> list[MissingForce]:
        """The disturbance over position and rate, recording by recording."""
        slot, coordinate = self.largest.slot, self.largest.state
        over = [f"d{coordinate}", coordinate]
        there = [i for i, track in enumerate(base.tracks) if slot in track.stretch.plant.slots]
        return [missing_force(base, i, slot, over) for i in there[:MOST_DRAWN]]

    def location(self, evidence: Mapping[str, float | None]) -> Location:
        """Where it acts; `evidence`: nats by slot."""
        return Location(
            slot=self.largest.slot, channel=self.largest.channel, segments=None, depends_on=[], evidence=dict(evidence)
        )

    def shares(self, candidates: Mapping[str, float]) -> dict[str, float]:
        """Probabilities of candidates: what has no name has at least its own, all others what is left."""
        none = candidates.get(NONE_OF_THESE, 0.0)
        mine = max(none, self.probability)
        left = (1.0 - mine) / (1.0 - none) if none < 1.0 else 0.0
        return {name: mine if name == NONE_OF_THESE else left * one for name, one in candidates.items()}

    def finding(self) -> EffectFinding:
        """As an effect without a name and without a law."""
        size = self.largest
        near = next(iter(self.laws), None)
        return EffectFinding(
            name=self.name,
            slot=size.slot,
            parameters={
                "size": Quantity(value=size.force, unit=size.unit, ci95=None, nominal=size.force / size.times),
                "duration": Quantity(value=size.time_s, unit="s", ci95=None, nominal=None),
            },
            evidence=Evidence(log_likelihood_gain=self.nats, threshold=NOT_EXCLUDED_NATS, heldout_gain_percent=None),
            not_excluded=[],
            statement=f"a disturbance of {self._size()}, {size.times:.0f} times the usual one, {self._laws_sentence()}",
            nearest=near,
            explained=self.laws[near].part if near else None,
            in_model=False,
        )

    def _size(self) -> str:
        size = self.largest
        value = value_text(Quantity(value=size.force, unit=size.unit, ci95=None, nominal=None))
        return f"{value} that changes within {size.time_s:.2g} s"

    def _laws_sentence(self) -> str:
        """What would explain it, and why it is no name."""
        if not self.laws:
            return "which none of the library's laws would explain"
        told = listed((f"{name} ({one})" for name, one in [*self.laws.items()][:MOST_LAWS]), "or")
        return (
            f"which {told} would explain if no disturbance is larger than {FAR_BEYOND:g} times the usual; "
            "a chance push of this size and length would explain it as well, so that no law is proven"
        )

    def unexplained(self) -> Unexplained:
        """As what remains: no curve was fitted to it."""
        return Unexplained(fires=True, slot=self.largest.slot, curve=None, probability=self.probability)


def large_disturbance(named: Named, judge: Judge) -> LargeDisturbance | None:
    """Beside a fit without any name; None where disturbances are as usual, or might be."""
    base = named.final
    if not far_beyond(base):
        return None
    largest = max(_lasting(base), key=lambda one: one.times, default=None)
    if largest is None or largest.times <= FAR_BEYOND:
        return None
    held = held_to_usual(base)
    nats = held.criterion - base.criterion
    return LargeDisturbance(largest, nats, _laws(held, judge, nats)) if nats >= NOT_EXCLUDED_NATS else None


def held_to_usual(found: HypothesisFit) -> HypothesisFit:
    """The same hypothesis with disturbances that are at most FAR_BEYOND times the usual, readings as noisy as they
    like."""
    usual = first_noise(found.tracks, found.values)
    most = {name: FAR_BEYOND * usual[name].force for name in found.noise}
    noise = {
        name: Noise(np.minimum(one.force, most[name]), one.time_s, one.reading) for name, one in found.noise.items()
    }
    stretches = [track.stretch for track in found.tracks]
    return fit(stretches, found.effects, found.values, like=found, noise=noise, free=found.free, most_force=most)


def _lasting(found: HypothesisFit) -> Iterator[Size]:
    """Disturbances that last for more than a few readings."""
    usual = first_noise(found.tracks, found.values)
    for recording, noise in found.noise.items():
        track = next(one for one in found.tracks if one.stretch.recording == recording)
        step_s = float(np.median(np.diff(track.stretch.t)))
        states = moved(track.stretch.plant)
        for state, force, time_s, known in zip(states, noise.force, noise.time_s, usual[recording].force, strict=True):
            if time_s >= FEWEST_READINGS * step_s:
                yield Size(track, state, float(force), float(time_s), float(force / known))


def moved(plant: Plant) -> Sequence[str]:
    """States that a disturbance moves, in its order."""
    return (*plant.coordinates, *plant.first_order)


def _laws(held: HypothesisFit, judge: Judge, nats: float) -> dict[str, LawPart]:
    """Of the library, those that take at least half of it."""
    scores = [one for one in judge.proposals(held, ()) if one.member.effect.slot != ANYTHING]
    tried = [judge.tried(held, one) for one in scores[:MOST_REFITS]]
    takes = [one for one in tried if one.gain >= LEAST_PART * nats]
    # of laws that take as much, to a hundredth, the one with fewer numbers first
    takes.sort(key=lambda one: (-round(min(one.gain / nats, 1.0), 2), len(one.effect.parameters)))
    return {one.effect.name: LawPart(min(one.gain / nats, 1.0), _sizes(one)) for one in takes}


def _sizes(tried: Tried) -> str:
    """Parameters of a law as they were fitted."""
    known = {
        p.name: Quantity(value=tried.fit.values[tried.effect.key(p.name)], unit=p.unit, ci95=None, nominal=None)
        for p in tried.effect.parameters
        if p.role != "phase" and tried.effect.key(p.name) in tried.fit.values
    }
    return listed(f"{name} = {value_text(one)}" for name, one in known.items())
