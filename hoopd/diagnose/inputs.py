"""Recordings made ready for the search: judged, cleaned, and cut into stretches of a declared plant.

Rules of this file: what does not count is NaN from here on; names are those of the files as given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hoopd.diagnose.quality.recording_quality import Quality, assess, cleaned
from hoopd.diagnose.quality.sensors import ENCODER
from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.repeated_samples import once_at_rest
from hoopd.plants.likelihood.reading_interval import spaced
from hoopd.plants.likelihood.stretches import Stretch, fewest_readings, is_long_enough, read_too_rarely, stretch_of
from hoopd.recording.board_limits import torque_slew
from hoopd.recording.doubts import constant, finite
from hoopd.recording.recording import Recording
from hoopd.recording.timeline import Timeline, timelines


@dataclass(frozen=True)
class Source:
    """One recording: as given, judged, and as stretches."""

    name: str
    recording: Recording
    quality: Quality
    stretches: tuple[Stretch, ...]

    @property
    def start_s(self) -> float:
        """Time of the recording's first row; stretches count from there."""
        return float(self.recording.t[0])

    @property
    def seconds(self) -> float:
        """Length of what is used."""
        return float(sum(one.t[-1] - one.t[0] for one in self.stretches))

    def part(self, first_s: float, last_s: float) -> Source:
        """The stretches within these seconds."""
        cut = [one.seconds(first_s, last_s) for one in self.stretches]
        return replace(self, stretches=tuple(one for one in cut if _enough(one)))


def source_of(name: str, recording: Recording, plant: Plant) -> Source:
    """A recording of a plant; InputError when there is nothing to judge a model by."""
    if missing := [one for one in (*(i.name for i in plant.inputs), *plant.channels) if one not in recording.signals]:
        raise InputError(name, missing[0], f"no signal of this name; {plant.name} has it (--columns)")
    if reason := read_too_rarely(recording.t, plant):
        raise InputError(name, "t", reason)
    if all(constant(finite(recording.column(one))) for one in plant.channels):
        raise InputError(name, ", ".join(plant.channels), "never changes: nothing to judge a model by")
    quality = assess(recording, plant)
    clean = cleaned(recording, quality)
    try:
        parts = timelines(clean)
    except ValueError as error:
        raise InputError(name, plant.inputs[0].name if plant.inputs else "t", str(error)) from None
    begin, slew = float(recording.t[0]), torque_slew(recording)
    stretches = tuple(one for part in parts if _enough(one := _stretch(name, part, begin, quality, slew)))
    if sum(one.samples for one in stretches) < (fewest := fewest_readings(plant)):
        raise InputError(name, ", ".join(quality.plant.channels), f"fewer than {fewest} readings to judge a model by")
    return Source(name, recording, quality, stretches)


def _stretch(name: str, part: Timeline, begin: float, quality: Quality, slew: float) -> Stretch:
    readings, plant = {}, quality.plant
    for channel in plant.channels:
        if quality.wrong_rate(channel):
            continue  # whatever it is, it is not the rate of the coordinate
        nodes, values = part.channels[channel]
        sensor = quality.sensors[channel]
        if sensor.is_place and sensor.device == ENCODER and len(values):
            # at rest an encoder's error is one and the same: it counts once
            once = once_at_rest(values)
            nodes, values = nodes[once], values[once]
        readings[channel] = (nodes, values)
    held = part.u if plant.inputs else np.zeros(len(part.t) - 1)
    found = stretch_of(name, plant, part.t - begin, held, readings, part.unresolved if plant.inputs else None)
    found = replace(found, slew=slew)
    for channel, one in quality.channels.items():
        if channel in plant.channels and np.isfinite(one.even_sigma):
            found = found.unevenly_sampled(channel, one.jitter_s, one.even_sigma)
    return spaced(found)


def _enough(stretch: Stretch) -> bool:
    return len(stretch.t) > 2 and is_long_enough(stretch) and stretch.samples >= fewest_readings(stretch.plant) // 2
