"""A recording judged by itself before any model: what its samples are worth, and which of them count.

Rules of this file: no model and no knowledge of one file; nothing is changed or filled in, masks say what counts;
everything set aside is counted and has a reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.channel_course import lagged
from hoopd.diagnose.quality.jumps import Jump, are_usual, jumps_of, without_jumps
from hoopd.diagnose.quality.late_frames import slow_stretches
from hoopd.diagnose.quality.noise_floor import quantum
from hoopd.diagnose.quality.outliers import bursts, inside, stretches
from hoopd.diagnose.quality.rate_choice import Speed, speed
from hoopd.diagnose.quality.sensor_samples import (
    JudgedSamples,
    absent_channel,
    camera_channel,
    counted_channel,
    weight_of,
)
from hoopd.diagnose.quality.sensors import Sensor, rates_of, sensors_of, turning_cameras
from hoopd.diagnose.quality.standstill import Clock, clock, reaches, saturated_share, unanswered
from hoopd.diagnose.quality.turns import turned
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.repeated_samples import HELD_COUNTS
from hoopd.plants.recording_doubts import plant_doubts
from hoopd.recording.recording import Recording
from hoopd.recording.spans import spans
from hoopd.recording.timeline import off_the_hoop, off_the_hoop_words

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A shorter stretch of equal angles is counted, and not worth a line of its own.
STUCK_S = 0.2
# Unevenness of sampling that is worth a line: at 20 rad/s more than an encoder's count.
JITTER_S = 1e-4
# A ball that was at rest is seen, when it begins to move, within this of where it was.
RESTED_SIGMAS = 8.0


@dataclass(frozen=True)
class Quality:
    """What a recording is worth."""

    recording: str
    channels: Mapping[str, JudgedSamples]
    segments: list[tuple[float, float, str]]  # s, s, reason
    plant: Plant  # with what moves in the recording
    sensors: Mapping[str, Sensor]  # of the channels
    speeds: Mapping[str, Speed] = field(default_factory=dict)  # measured rates that stand beside what they are rates of
    jumps: Mapping[str, list[Jump]] = field(default_factory=dict)  # of counted places, by channel
    notes: list[str] = field(default_factory=list)  # doubts in words

    def wrong_rate(self, channel: str) -> bool:
        """Whether a channel is no rate of what it is called the rate of."""
        return channel in self.speeds and self.speeds[channel].wrong

    @property
    def cameras(self) -> list[JudgedSamples]:
        """Channels that a camera sees."""
        return [one for name, one in self.channels.items() if self.sensors[name].is_camera]

    def data_quality(self) -> dict[str, Any]:
        """The part of the diagnosis's JSON: numbers of samples, of sensors that are there at all."""
        there = [one for one in self.channels.values() if not one.missing.all()]
        total = {kind: sum(one.numbers[kind] for one in there) for kind in ("missing", "outliers")}
        return {
            "missing": total["missing"],
            "late_frames": sum(one.numbers["late"] for one in self.cameras),
            "outliers": total["outliers"],
            "segments_ignored": [list(one) for one in self.segments],
            "samples": sum(len(one.missing) for one in there),
            "frames": sum(len(one.missing) for one in there if one in self.cameras),
        }


def assess(recording: Recording, plant: Plant) -> Quality:
    """Judge a recording of a plant by itself; `plant.judges` says what the plant knows of it beside its sensors."""
    judges = plant.judges
    whole = turned(recording, turning_cameras(sensors_of(plant, plant)))
    moving = plant if judges.moving is None else judges.moving(whole)
    sensors = sensors_of(plant, moving)
    every = {
        name: jumps_of(whole.t, whole.column(name), one.resolution) for name, one in sensors.items() if _is_counted(one)
    }
    jumps = {name: [] if are_usual(found, len(whole)) else found for name, found in every.items()}
    whole = without_jumps(whole, jumps)
    silent = _silent(whole, plant, moving, sensors) if judges.stops else []
    body, force = _body(plant), plant.input_word
    segments = [(*_span(whole, a, b), f"the {body} does not answer the {force}") for a, b in silent]
    flown = [(a, b - 1) for a, b in spans(off_the_hoop(whole))]
    segments += [(*_span(whole, a, b), "the ball is off the outer hoop") for a, b in flown]
    judged = _judged(whole, plant, sensors, inside(len(whole), [*silent, *flown]))
    channels = {name: _without_bursts(whole, channel, segments) for name, channel in judged.items()}
    for name in [name for name, one in sensors.items() if one.is_camera]:
        channels[name] = _rested(whole, channels[name], sensors)
        segments += _stuck(whole, channels[name])
    clean = cleaned_channels(whole, channels)
    return Quality(
        recording.source,
        channels,
        sorted(segments),
        moving,
        sensors,
        {rate: speed(clean, place, rate, channels[place].sigma) for rate, place in rates_of(sensors).items()},
        jumps,
        [
            *plant_doubts(recording, plant),
            *off_the_hoop_words(recording),
            *_told(clock(recording)),
            *_limited(recording, plant),
            *(note for name, one in sensors.items() if one.is_camera for note in _slow_camera(whole, channels[name])),
            *(note for name, one in sensors.items() if _is_counted(one) for note in _uneven(channels[name])),
            *(_jumped(whole, name, found, plant.channels[name].unit) for name, found in every.items() if found),
        ],
    )


def _is_counted(sensor: Sensor) -> bool:
    """Whether a channel counts the way along a coordinate."""
    return sensor.is_place and not sensor.is_camera


def _body(plant: Plant) -> str:
    """What the drive moves, in a word."""
    named = (name for name, one in plant.slots.items() if one.kind == "body" and one.coordinate == plant.driven)
    return next(named, plant.name)


def _silent(recording: Recording, plant: Plant, moving: Plant, sensors: Mapping[str, Sensor]) -> list[tuple[int, int]]:
    """Rows in which what is driven and moves does not answer its input."""
    counted = [one for one in sensors.values() if _is_counted(one) and one.coordinate == moving.driven]
    if not counted or not plant.inputs:
        return []
    sensor, force = counted[0], recording.column(plant.inputs[0].name)
    place = recording.column(sensor.name)
    step = sensor.resolution or quantum(place[np.isfinite(place)])
    return unanswered(recording.t, place, force, step) if np.isfinite(step) else []


def _judged(
    recording: Recording, plant: Plant, sensors: Mapping[str, Sensor], ignored: Mask
) -> dict[str, JudgedSamples]:
    """Every sensor by itself; only what drives comes from the inputs, and from what a camera sees turning."""
    columns = [recording.column(one.name) for one in plant.inputs]
    drives = np.hstack([np.zeros((len(recording), 0)), *map(lagged, columns)])
    again = np.zeros(len(recording), dtype=bool)
    if plant.judges.repeated is not None:
        again[plant.judges.repeated(recording)] = True
    seen, inputs = dict[str, JudgedSamples](), drives
    for name, sensor in sensors.items():
        if not sensor.is_camera:
            continue
        if not sensor.moves:
            seen[name] = absent_channel(recording, name, ignored)
            continue
        seen[name], course = camera_channel(recording, sensor, inputs, ignored)
        if course is not None and sensor.turns:  # the weight of what turns pulls at the rest, too
            drives = np.column_stack([drives, weight_of(course)])
    return {
        name: seen[name]
        if name in seen
        else counted_channel(recording, sensor, drives, () if sensor.coordinate else columns, ignored, again)
        for name, sensor in sensors.items()
    }


def cleaned(recording: Recording, quality: Quality) -> Recording:
    """The recording with every sample that does not count as NaN, angles unwrapped and jumps of a place taken out."""
    whole = without_jumps(turned(recording, turning_cameras(quality.sensors)), quality.jumps)
    return cleaned_channels(whole, quality.channels)


def cleaned_channels(recording: Recording, channels: Mapping[str, JudgedSamples]) -> Recording:
    """The recording with NaN where a channel does not count."""
    return recording.replaced(
        **{name: np.where(one.counts, recording.column(name), np.nan) for name, one in channels.items()}
    )


# ---------------------------------------------------------------------------------------------- segments


def _span(recording: Recording, first: int, last: int) -> tuple[float, float]:
    return float(recording.t[first]), float(recording.t[last])


def _without_bursts(
    recording: Recording, channel: JudgedSamples, segments: list[tuple[float, float, str]]
) -> JudgedSamples:
    """Bursts of false values become segments and leave the share."""
    found = bursts(channel.outliers, channel.counts | channel.outliers)
    if not found:
        return channel
    segments += [
        (*_span(recording, a, b), f"{channel.name}: values off the course of those about them") for a, b in found
    ]
    inner = inside(len(recording), found)
    outside = channel.outliers & ~inner
    return replace(channel, counts=channel.counts & ~inner, outliers=outside, ignored=channel.ignored | inner)


def _stuck(recording: Recording, camera: JudgedSamples) -> list[tuple[float, float, str]]:
    """Stretches in which the camera gives one and the same value."""
    if not camera.counts.any():
        return []
    spans = [_span(recording, max(a - 1, 0), b) for a, b in stretches(camera.stuck)]
    reason = f"{camera.name}: the camera repeats itself"
    return [(*span, reason) for span in spans if span[1] - span[0] >= STUCK_S]


def _rested(recording: Recording, camera: JudgedSamples, sensors: Mapping[str, Sensor]) -> JudgedSamples:
    """The last of equal values counts where all that is counted is still too, and it goes on from there: at rest."""
    counted = [one for one in sensors.values() if _is_counted(one) and one.moves]
    if not counted or not sensors[camera.name].moves or not camera.counts.any():
        return camera
    column, counts, stuck = recording.column(camera.name), camera.counts.copy(), camera.stuck.copy()
    for first, last in stretches(camera.stuck):
        after = column[last + 1 : last + 2]
        near = len(after) > 0 and abs(float(after[0]) - float(column[last])) < RESTED_SIGMAS * camera.sigma
        still = min(_still_rows(recording, one, first, last) for one in counted)
        if near and still > 1:
            counts[first + still - 1], stuck[first + still - 1] = True, False
    return replace(camera, counts=counts, stuck=stuck)


def _still_rows(recording: Recording, sensor: Sensor, first: int, last: int) -> int:
    """How many rows from the first one on a reading stays where it is."""
    place = recording.column(sensor.name)
    step = sensor.resolution or quantum(place[np.isfinite(place)])
    moved = np.abs(place[first : last + 1] - place[first])
    return int(np.argmin(np.append(moved < HELD_COUNTS * step, False)))


def _told(found: Clock) -> list[str]:
    """What is wrong with the clock of the rows."""
    sentences = []
    if found.gaps:
        longest = max(b - a for a, b in found.gaps)
        sentences.append(f"rows are missing in {len(found.gaps)} places, for {longest:.3g} s at most")
    if found.not_increasing:
        sentences.append(f"{found.not_increasing} rows have a time that is not later than the row's before")
    if found.steps:
        sentences.append(f"the sensors' clock was set at {', '.join(f'{t:.6g} s' for t in found.steps)}")
    return sentences


def _limited(recording: Recording, plant: Plant) -> list[str]:
    """An input that stays at its largest value says nothing of what was asked for, and one that never moves nothing."""
    columns = {one.name: recording.column(one.name) for one in plant.inputs}
    shares = {one.name: saturated_share(columns[one.name], one.limit) for one in plant.inputs}
    words = {one.name: f"the {plant.input_word}" if one is plant.inputs[0] else one.name for one in plant.inputs}
    still = [name for name, u in columns.items() if np.isfinite(u).any() and np.nanmin(u) == np.nanmax(u)]
    return [
        *(f"{words[name]} is the same in all rows: the recording does not tell what it does" for name in still),
        *(
            f"{words[name]} stays at {_end(columns[one.name], one.limit)} in {100.0 * share:.2g} % of the rows"
            for one in plant.inputs if (share := shares[name := one.name])
        ),
    ]  # fmt: skip


def _end(u: Array, limit: float | None) -> str:
    """Where an input stays: at the limit that is known, or at one that its own largest value may be."""
    return "its limit" if reaches(u, limit) else f"its largest value ({np.nanmax(np.abs(u)):.3g})"


def _uneven(place: JudgedSamples) -> list[str]:
    """Samples whose scatter grows with the speed were not taken when their stamps say."""
    if place.jitter_s < JITTER_S:
        return []
    return [f"{place.name} scatters with its speed, as if taken {1e3 * place.jitter_s:.2g} ms too early or too late"]


# Jumps that a note names.
MOST_TOLD = 10


def _jumped(recording: Recording, name: str, jumps: list[Jump], unit: str) -> str:
    """Counts that were lost, or a coupling that slipped."""
    if are_usual(jumps, len(recording)):
        return f"{name} jumps {len(jumps)} times: so often is how it reads, and nothing was taken out"
    listed = ", ".join(f"by {one.size:.3g} {unit} at {recording.t[one.row]:.6g} s" for one in jumps[:MOST_TOLD])
    more = f", {len(jumps) - MOST_TOLD} times more" if len(jumps) > MOST_TOLD else ""
    return f"{name} jumps {listed}{more}, and goes on from there: lost counts, or what slipped; taken out of the rest"


def _slow_camera(recording: Recording, camera: JudgedSamples) -> list[str]:
    """A camera that for a while takes fewer frames than there are rows."""
    rate, sentences = 1.0 / recording.sample_time_s if len(recording) > 1 else 0.0, []
    for first, last, period in slow_stretches(camera.late):
        span = f"{recording.t[first]:.6g} to {recording.t[last]:.6g} s"
        frames = f"{rate * (period - 1) / period:.3g} frames a second"
        sentences.append(f"{camera.name}: from {span} one of {period} values is the one before: a camera of {frames}")
    return sentences
