"""Where in time a mismatch sits: what the re-fitted base needs of every body, and leaves of every sensor's readings.

Rules of this file: arrays for `report_curves`, nothing judged and nothing fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.unusual_energy import robust_level
from hoopd.diagnose.quality.unusual_intervals import disturbance, signals_by_name
from hoopd.diagnose.record import Ignored
from hoopd.diagnose.report_curves import Strip
from hoopd.plants.declaration import Plant
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]

# A page shows so many recordings; more are in its tables.
MOST_RECORDINGS = 6


def strips(base: HypothesisFit, final: HypothesisFit, ignored: Mapping[str, Sequence[Ignored]]) -> Iterator[Strip]:
    """What the re-fitted base needs of every body, as multiples of what the final model still needs."""
    for name in base.recordings[:MOST_RECORDINGS]:
        before, after = _disturbances(base, name), _disturbances(final, name)
        plant = next(track.stretch.plant for track in base.tracks if track.stretch.recording == name)
        t = _times(base, name)
        for column, q in enumerate(plant.disturbed):
            level = max(robust_level(after[:, column]), 1e-300)
            strength = np.abs(before[:, column]) / level
            yield Strip(name, body_on(plant, q), t, strength, ignored.get(name, ()))
        yield from _sensor_strips(base, final, name, ignored.get(name, ()))


def _sensor_strips(base: HypothesisFit, final: HypothesisFit, name: str, ignored: Sequence[Ignored]) -> Iterator[Strip]:
    """What the re-fitted base leaves of each sensor's readings, as multiples of what the final model usually leaves."""
    before, after = _errors(base, name), _errors(final, name)
    for slot, (t, error) in before.items():
        usual = after[slot][1][np.isfinite(after[slot][1])] if slot in after else np.zeros(0)
        # a sensor that counts may err by nothing half of the time
        level = (robust_level(usual) or float(np.std(usual))) if len(usual) else 0.0
        if level > 0.0 and np.isfinite(error).any():
            yield Strip(name, slot, t, np.abs(error) / level, ignored)


def _errors(found: HypothesisFit, recording: str) -> dict[str, tuple[Array, Array]]:
    """Of each sensor: times and innovations, of its channels the first, in the unit of its reading; NaN: none."""
    every = signals_by_name(found, recording)
    plant = next(track.stretch.plant for track in found.tracks if track.stretch.recording == recording)
    channels = next(track.composite.channels for track in found.tracks if track.stretch.recording == recording)
    noise = dict(zip(channels, found.noise[recording].reading.tolist(), strict=True))
    parts: dict[str, tuple[Array, Array]] = {}
    for (where, kind), pieces in every.items():
        slot = plant.channels[where].sensor if kind == "channel" and where in plant.channels else ""
        if slot and slot not in parts:
            t, error = (np.concatenate(column) for column in zip(*pieces, strict=True))
            parts[slot] = t, noise[where] * error
    return parts


def _disturbances(found: HypothesisFit, recording: str) -> Array:
    """(n, nq) over all stretches of a recording."""
    parts = [i for i, track in enumerate(found.tracks) if track.stretch.recording == recording]
    return np.concatenate([disturbance(found, i) for i in parts])


def _times(found: HypothesisFit, recording: str) -> Array:
    return np.concatenate([track.stretch.t for track in found.tracks if track.stretch.recording == recording])


def body_on(plant: Plant, q: str) -> str:
    """Name of the slot that moves along a coordinate."""
    kinds = ("body", "rolling_ball")
    return next((name for name, slot in plant.slots.items() if slot.coordinate == q and slot.kind in kinds), q)
