"""What in a recording of a plant is worth a doubt: what holds for every recording, and what the plant says of itself.

Rules of this file: sentences for a person; nothing is changed, refused or set aside.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.recording.doubts import doubts, finite, plural
from hoopd.recording.recording import Column, Recording

# Times the usual size that nothing moves by.
UNUSUAL = 100.0
# An input beyond its limit by more than rounding.
BEYOND = 1.01
# A sample alone lies so many usual distances off both its neighbours, and by this share of all that the channel moves.
LONE_DISTANCES, LONE_SHARE = 20.0, 0.2
FEWEST = 20  # samples, to know what is usual
NAMED = 3  # places that a sentence names


def plant_doubts(recording: Recording, plant: Plant) -> list[str]:
    """One sentence each; a plant that has its own doubts says them in place of the usual ones."""
    own = plant.judges.doubts
    told = (
        [*doubts(recording), *_beyond(recording, plant), *_alone(recording, plant)] if own is None else own(recording)
    )
    return [*told, *_in_other_units(recording, plant)]


def _beyond(recording: Recording, plant: Plant) -> Iterator[str]:
    for one in plant.inputs:
        there = finite(recording.column(one.name))
        most = float(np.abs(there).max()) if len(there) else 0.0
        if one.limit is not None and most > BEYOND * one.limit:
            yield f"{one.name} reaches {most:.3g} {one.unit}, its limit is {one.limit:g}: another unit?"


def _alone(recording: Recording, plant: Plant) -> Iterator[str]:
    for name in plant.channels:
        if len(places := _lone_rows(recording.column(name))):
            named = [f"{recording.t[k]:.6g}" for k in places[:NAMED]]
            where = ", ".join([*named, "..."] if len(places) > NAMED else named)
            yield f"{name} has {len(places)} sample{plural(places)} far from both neighbours (at {where} s)"


def _lone_rows(column: Column) -> NDArray[np.int64]:
    """Rows that lie on one side of both rows beside them, far beyond what is usual between rows."""
    rows = np.flatnonzero(np.isfinite(column))
    if len(rows) < FEWEST:
        return rows[:0]
    steps = np.diff(column[rows])
    off = np.where(steps[:-1] * steps[1:] < 0.0, np.minimum(np.abs(steps[:-1]), np.abs(steps[1:])), 0.0)
    low, high = np.percentile(column[rows], [1.0, 99.0])
    least = max(LONE_DISTANCES * float(np.median(np.abs(steps))), LONE_SHARE * float(high - low))
    found: NDArray[np.int64] = rows[1:-1][off > least] if high > low else rows[:0]
    return found


def _in_other_units(recording: Recording, plant: Plant) -> Iterator[str]:
    """A place that moves by a hundred times of what is said to be usual is told in another unit, as likely as not; an
    angle may turn on and on."""
    for name, channel in plant.channels.items():
        usual = plant.scales.get(channel.state, np.inf)
        if not plant.is_length(channel.state) or channel.state in plant.recorded:
            continue
        seen = finite(recording.column(name))
        span = float(np.ptp(seen)) if len(seen) else 0.0
        if span > UNUSUAL * usual:
            yield (
                f"{name} moves by {span:.3g} {channel.unit}, {span / usual:.0f} times what {plant.name} calls usual: "
                f"is it told in {channel.unit} (--columns {name}=NAME:UNIT)?"
            )
