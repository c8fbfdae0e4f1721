"""Recordings made ready for the search: judged, cleaned, and cut into stretches of a declared plant.

Rules of this file: what does not count is NaN from here on; names are those of the files as given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hoopd.diagnose.quality.recording_quality import Quality, assess, cleaned
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.fit_data import once_at_rest
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.stretches import SHORTEST_S, Stretch, stretch_of
from hoopd.recording.recording import Recording
from hoopd.recording.timeline import Timeline, timelines

# Fewer readings than this are no recording to judge a model by.
FEWEST_READINGS = 50


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


def hoop_source(
    name: str,
    recording: Recording,
    structure: str,
    values: Mapping[str, float],
    *,
    encoder_counts: int = 4096,
    torque_limit: float = 0.7,
) -> Source:
    """A recording of the hoop; InputError when there is nothing to judge a model by."""
    quality = assess(recording, encoder_counts)
    plant = hoop_plant(structure, values, quality.moving, torque_limit)
    clean = cleaned(recording, quality)
    try:
        parts = timelines(clean)
    except ValueError as error:
        raise InputError(name, "u", str(error)) from None
    begin = float(recording.t[0])
    stretches = tuple(one for part in parts if _enough(one := _stretch(name, plant, part, begin, quality)))
    if sum(one.samples for one in stretches) < FEWEST_READINGS:
        raise InputError(name, ", ".join(plant.channels), f"fewer than {FEWEST_READINGS} readings to judge a model by")
    return Source(name, recording, quality, stretches)


def source_of(name: str, recording: Recording, model: ModelFile) -> Source:
    """A recording of the device that a model file describes; InputError as in `hoop_source`."""
    device = model.device
    return hoop_source(
        name,
        recording,
        model.structure,
        model.values(),
        encoder_counts=device.encoder_counts,
        torque_limit=device.torque_limit_nm,
    )


def _stretch(name: str, plant: Plant, part: Timeline, begin: float, quality: Quality) -> Stretch:
    readings = {}
    for channel in plant.channels:
        if channel == "dtheta" and quality.speed.wrong:
            continue  # whatever it is, it is not the rate of theta
        nodes, values = part.channels[channel]
        if channel == "theta" and len(values):
            # at rest an encoder's error is one and the same: it counts once
            once = once_at_rest(values)
            nodes, values = nodes[once], values[once]
        readings[channel] = (nodes, values)
    found = stretch_of(name, plant, part.t - begin, part.u, readings)
    for channel, one in quality.channels.items():
        if channel in plant.channels and np.isfinite(one.quantum):
            found = found.unevenly_sampled(channel, one.jitter_s, one.quantum / np.sqrt(12.0))
    return found


def _enough(stretch: Stretch) -> bool:
    return len(stretch.t) > 2 and stretch.t[-1] - stretch.t[0] >= SHORTEST_S and stretch.samples >= FEWEST_READINGS // 2
