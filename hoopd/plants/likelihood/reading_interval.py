"""Readings that come far more often than the motion has anything to say: how far apart those are that judge a model.

A filter judges a model by what it predicts from one reading to the next. A millisecond after the last one that is the
noise and whatever happens within a millisecond (the way in which friction turns round, a ripple of the drive); a force
that is wrong for a second hardly shows, and the disturbance that follows the readings takes it. So predictions reach as
far as the usual sample of a plant of this speed, where the readings are so fine that each of them alone tells more than
a usual disturbance does in that time; the inputs keep all their samples. A noisy sensor keeps all its readings.

Rules of this file: what is left out is NaN in the stretch; the noise of the readings is told by all of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.likelihood.noise_tuning import FIRST_ACCELERATION, roughness
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.scales import motion_scale, rate_scale

Array = NDArray[np.float64]

# From reading to reading, of a plant that moves by 1 rad at 10 rad/s.
INTERVAL_S = 0.02
# So many readings of a channel are left at least.
FEWEST = 200


def spaced(stretch: Stretch) -> Stretch:
    """The same with readings no closer than predictions are to reach; as it is where they are not."""
    y, changed = stretch.y.copy(), False
    for column, state in enumerate(stretch.plant.states_read):
        seen = np.flatnonzero(np.isfinite(y[:, column]))
        count = _one_of(stretch, seen)
        if count > 1 and roughness([y[:, column]], [stretch.scatter[:, column]]) < _moved(stretch.plant, state):
            left_out = np.ones(len(seen), dtype=bool)
            left_out[::count] = False
            y[seen[left_out], column] = np.nan
            changed = True
    return replace(stretch, y=y, every=stretch.y) if changed else stretch


def _one_of(stretch: Stretch, seen: NDArray[np.int_]) -> int:
    """Of so many readings one is kept; all, where they do not fill the interval twice."""
    if len(seen) < 2:
        return 1
    between = float(np.median(np.diff(stretch.t[seen])))
    filled = INTERVAL_S * motion_scale(stretch.plant) / between
    return max(1, min(round(filled), len(seen) // FEWEST)) if filled >= 2.0 - 1e-6 else 1


def _moved(plant: Plant, state: str | None) -> float:
    """How far a usual disturbance moves a state from one reading to the next; 0 for what is no place and no rate."""
    slower = motion_scale(plant)
    h = INTERVAL_S * slower
    for q in plant.coordinates:
        acceleration = FIRST_ACCELERATION * rate_scale(plant, q) / slower
        if state == q:
            return acceleration * h**2 / 2.0
        if state == f"d{q}":
            return acceleration * h
    return 0.0
