"""A disturbance far beyond the usual where nothing has a name: something acts, and no law of it was shown.

A disturbance may be anything, so a free one explains a drag that grows all through one fall as well as the drag does.
That is no reason to call the model right. Where the recordings are less likely by several nats with disturbances that
stay within a few times the usual (and noise of the readings as large as it likes), a finding without a law says how
much acts, and where. Which laws would take most of it, were disturbances usual, is told beside it; the likelihood with
free disturbances has not chosen them, so none is named.

What lasts no longer than a few readings is not told from errors of the readings that last as long: no finding. Nor is
there one where nobody said how far and how fast the plant usually moves: the usual is then what was recorded, of a slow
recording less than pushes on the same plant are.

Rules of this file: names stay what the search has found; there is none where this is asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from hoopd.diagnose.curves.missing_force import missing_force
from hoopd.diagnose.record import NONE_OF_THESE, Diagnosis, EffectFinding, Evidence, Location, Quantity, Unexplained
from hoopd.diagnose.report_curves import MissingForce
from hoopd.diagnose.search.bounded_disturbance import FAR_BEYOND, far_beyond, usual_noise
from hoopd.diagnose.search.candidates import Judge, Tried
from hoopd.diagnose.search.naming import MOST_REFITS, NOT_EXCLUDED_NATS, Named
from hoopd.plants.effects.usual_sizes import turns
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.noise_tuning import FORCE_FACTOR
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
        """Of the force, or of the rate of a first-order state."""
        return self.track.stretch.plant.disturbance_unit(self.state)

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
        slot, state, plant = self.largest.slot, self.largest.state, self.largest.track.stretch.plant
        # an angle that turns is drawn in one turn, which says nothing of one that swings
        over = [f"d{state}", *([] if state in plant.coordinates and turns(plant, state) else [state])]
        there = [i for i, track in enumerate(base.tracks) if slot in track.stretch.plant.slots]
        first = sorted(there, key=lambda i: base.tracks[i].stretch.recording != self.largest.track.stretch.recording)
        return [missing_force(base, i, slot, over) for i in first[:MOST_DRAWN]]

    def told_in(self, diagnosis: Diagnosis) -> Diagnosis:
        """A diagnosis that found nothing, with this as all that acts."""
        slot, channel, evidence = self.largest.slot, self.largest.channel, diagnosis.location.evidence
        return replace(
            diagnosis,
            verdict="unknown_physics",
            location=Location(slot=slot, channel=channel, segments=None, depends_on=[], evidence=evidence),
            effects=[self.finding()],
            unexplained=Unexplained(fires=True, slot=slot, curve=None, probability=self.probability),
            # what a law would take is not called invisible
            power={name: one for name, one in diagnosis.power.items() if name not in self.laws},
            notes=[],
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
                "size": Quantity(value=size.force, unit=size.unit, ci95=None, nominal=None),
                "usual": Quantity(value=size.force / size.times, unit=size.unit, ci95=None, nominal=None),
                "duration": Quantity(value=size.time_s, unit="s", ci95=None, nominal=None),
            },
            evidence=Evidence(log_likelihood_gain=self.nats, threshold=NOT_EXCLUDED_NATS, heldout_gain_percent=None),
            not_excluded=[],
            statement=f"a disturbance of {self._size()}, {size.times:.0f} times the usual one, {self._laws_sentence()}",
            nearest=near,
            status="untested",
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


def large_disturbance(named: Named, judge: Judge) -> LargeDisturbance | None:
    """Beside a fit without any name; None where disturbances are as usual, or might be."""
    base = named.final
    if not far_beyond(base):
        return None
    lasting = list(_lasting(base))
    largest = max(lasting, key=lambda one: one.times, default=None)
    if largest is None or largest.times <= FAR_BEYOND:
        return None
    held = held_to_usual(base, lasting)
    nats = held.criterion - base.criterion
    return LargeDisturbance(largest, nats, _laws(held, judge, nats)) if nats >= NOT_EXCLUDED_NATS else None


def held_to_usual(found: HypothesisFit, lasting: Sequence[Size]) -> HypothesisFit:
    """The same hypothesis with the disturbances of `lasting` at most FAR_BEYOND times the usual, the others and the
    noise of the readings as large as they like."""
    usual, most, noise = usual_noise(found), {}, {}
    capped = {(one.track.stretch.recording, one.state) for one in lasting}
    for recording, level in found.noise.items():
        plant = next(track.stretch.plant for track in found.tracks if track.stretch.recording == recording)
        times = np.array([FAR_BEYOND if (recording, x) in capped else FORCE_FACTOR for x in plant.disturbed])
        most[recording] = times * usual[recording].force
        noise[recording] = Noise(np.minimum(level.force, most[recording]), level.time_s, level.reading)
    stretches = [track.stretch for track in found.tracks]
    return fit(stretches, found.effects, found.values, like=found, noise=noise, free=found.free, most_force=most)


def _lasting(found: HypothesisFit) -> Iterator[Size]:
    """Disturbances of a known usual size that last for more than a few readings of what they move."""
    usual = usual_noise(found)
    for recording, noise in found.noise.items():
        tracks = [track for track in found.tracks if track.stretch.recording == recording]
        plant = tracks[0].stretch.plant
        for i, state in enumerate(plant.disturbed):
            force, time_s, known = noise.force[i], noise.time_s[i], usual[recording].force[i]
            lasts = time_s >= FEWEST_READINGS * _between_readings_s(tracks, state)
            if lasts and plant.recorded.isdisjoint((state, f"d{state}")):
                yield Size(tracks[0], state, float(force), float(time_s), float(force / known))


def _between_readings_s(tracks: Sequence[Track], state: str) -> float:
    """Usual time between two readings of what reads a state or its rate, of any channel where none does."""
    channels = [*tracks[0].stretch.plant.channels.values()]
    own = [i for i, one in enumerate(channels) if one.state in (state, f"d{state}")] or [*range(len(channels))]
    steps = [
        np.diff(track.stretch.t[np.isfinite(track.stretch.y[:, i])]) for track in tracks for i in own
    ]  # fmt: skip
    known = np.concatenate(steps)
    return float(np.median(known)) if len(known) else np.inf


def _laws(held: HypothesisFit, judge: Judge, nats: float) -> dict[str, LawPart]:
    """Of the library, those that take at least half of it."""
    scores = [one for one in judge.proposals(held, held.names) if one.member.effect.slot != ANYTHING]
    tried = [judge.tried(held, one) for one in scores[:MOST_REFITS]]
    # the best of a whole library gains some nats by chance
    takes = [one for one in tried if one.gain >= LEAST_PART * nats and one.surprise >= NOT_EXCLUDED_NATS]
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
