"""The levels of noise and disturbances that have the highest likelihood, from a first guess without a model.

Rules of this file: numbers in, numbers out; what a level is worth says `noise`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.effects.usual_sizes import store_rate
from hoopd.plants.held_input import mean_torque
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.noise_levels import Criterion
from hoopd.plants.likelihood.quasi_newton import Minimum, SearchEnds, lowest, positive
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.scales import motion_scale, rate_scale

Array = NDArray[np.float64]

# Noise levels are searched within these factors of their first guess; a disturbance slower than a second is physics.
FORCE_FACTOR, READING_FACTOR = 300.0, (0.4, 30.0)
TIMES_S = (0.03, 1.0)
# The search ends when a step gains less than this, in nats: what a fit compares is some nats.
LAST_GAIN = 0.003
# No level changes by more than this factor (its logarithm) in one step.
LONGEST_STEP = 2.0
ENDS = SearchEnds(LAST_GAIN, steps=40, longest=LONGEST_STEP)
DIFFERENCE, LEAST_CURVATURE = 1e-4, 1.0
FIRST_TIME_S = 0.15
# First guess of a disturbance: so many rad/s^2 on a coordinate that moves at 10 rad/s within 0.1 s (`plants.scales`).
FIRST_ACCELERATION = 1.0
# The same of a first-order state: this share of its usual rate.
FIRST_SHARE = 0.01
# Differences that leave noise of a smooth reading; what is late follows inputs of so many readings before them, too.
DIFFERENCED, BEFORE = 4, 4
WINDOW = DIFFERENCED + BEFORE
# Readings are even where none is so much longer after the one before it than usual.
EVEN = 1.5
# Rows for each column of inputs, and the least singular value of those, a share of the largest.
FEWEST_ROWS, SAME_COLUMN = 10, 1e-6
# Of what a reading does over a recording, steps that are none and noise that is none.
NOTHING = 1e-9


class Tuning(NamedTuple):
    """Where a search for levels has ended."""

    noise: Noise
    curvature: Array  # second derivatives by the logarithms of force, time_s and reading


def tuned(
    criteria: Sequence[Criterion],
    start: Noise,
    first: Noise,
    *,
    near: bool = False,
    slower: float = 1.0,
    curvature: Array | None = None,
    most: Array | None = None,
    quiet: Array | None = None,
) -> Tuning:
    """Levels of highest likelihood for all criteria together, from `start`, within the bounds about a first guess.

    `near`: the start is close to them already; otherwise a part of the data brings it there. `slower`: times of the
    plant's motion over usual ones. `curvature`: what an earlier search of the same data has come to; told in logarithms
    it hardly depends on the levels, so that one that is near needs no new one. `most`: disturbances (nq,) that are not
    to be exceeded; `quiet`: readings (channels,) about which the least bound lies where it is not the first guess.
    """
    nq = len(start.force)
    largest = first.force * FORCE_FACTOR if most is None else most
    least = READING_FACTOR[0] * (first.reading if quiet is None else quiet)
    low = np.log([*first.force / FORCE_FACTOR, *[TIMES_S[0] * slower] * nq, *least])
    high = np.log([*largest, *[TIMES_S[1] * slower] * nq, *first.reading * READING_FACTOR[1]])
    begin = np.clip(np.log(np.concatenate(start)), low, high)
    if curvature is None or not near:
        begin, curvature = _by_parts(criteria, begin, (low, high), near=near)
    found = _lowest(criteria, begin, curvature, (low, high))
    return Tuning(_levels(found.v, nq), found.curvature)


def _by_parts(
    criteria: Sequence[Criterion], begin: Array, bounds: tuple[Array, Array], *, near: bool
) -> tuple[Array, Array]:
    """Where a part of the data brings a start, and the curvature of all of them there; one that is near stays."""
    parts = [part for one in criteria for part in one.parts()]
    share = sum(len(one.model.c) for one in parts) / sum(len(one.model.c) for one in criteria)
    curvature = _curvature(parts, begin)
    if not near:
        begin = _lowest(parts, begin, curvature, bounds).v
        curvature = _curvature(parts, begin)
    return begin, curvature / share


def _levels(v: Array, nq: int) -> Noise:
    levels = np.exp(v)
    return Noise(levels[:nq], levels[nq : 2 * nq], levels[2 * nq :])


def _total(criteria: Sequence[Criterion], v: Array) -> tuple[float, Array]:
    """Value and gradient at the logarithms v of all levels."""
    each = [one.gradient(_levels(v, one.model.w.shape[2])) for one in criteria]
    value = sum(value for value, _ in each)
    return (value if np.isfinite(value) else np.inf), np.sum([slope for _, slope in each], axis=0)


def _curvature(criteria: Sequence[Criterion], v: Array) -> Array:
    """Second derivatives by differences of the gradient, made positive."""
    here = _total(criteria, v)[1]
    rows = np.array([_total(criteria, v + step)[1] - here for step in DIFFERENCE * np.eye(len(v))]) / DIFFERENCE
    return positive((rows + rows.T) / 2, least=LEAST_CURVATURE)


def _lowest(criteria: Sequence[Criterion], v: Array, curvature: Array, bounds: tuple[Array, Array]) -> Minimum:
    """Where the total is lowest."""
    return lowest(lambda levels: _total(criteria, levels), v, curvature, ends=ENDS, bounds=bounds)


# ---------------------------------------------------------------------------------------------- first guess


def first_noise(tracks: Sequence[Track], values: Mapping[str, float]) -> dict[str, Noise]:
    """By recording: readings from their roughness, disturbances of a usual size."""
    found = {}
    for track in tracks:
        if track.stretch.recording not in found:
            same = [t.stretch for t in tracks if t.stretch.recording == track.stretch.recording]
            reading = np.array(
                [
                    roughness([s.every[:, i] for s in same], [s.scatter[:, i] for s in same])
                    for i in range(same[0].y.shape[1])
                ]
            )
            plant, slower = track.stretch.plant, motion_scale(track.stretch.plant)
            usual = np.array([rate_scale(plant, q) for q in plant.coordinates]) / slower
            rates = np.array([store_rate(plant, name) for name in plant.first_order])
            force = np.concatenate([FIRST_ACCELERATION * usual / track.mobility(values), FIRST_SHARE * rates])
            found[track.stretch.recording] = Noise(force, np.full(len(force), FIRST_TIME_S * slower), reading)
    return found


def quiet_readings(stretches: Sequence[Stretch]) -> Array:
    """Noise of the channels (channels,) of one recording, without a model: roughness that steps of the inputs leave.

    A fast two-level input makes readings rougher than their noise: what the inputs about them explain of the fourth
    differences is taken out. Where that is little, or few readings follow each other evenly, it is their roughness.
    """
    return np.array([_quiet(stretches, column) for column in range(stretches[0].y.shape[1])])


def _quiet(stretches: Sequence[Stretch], column: int) -> float:
    rough = roughness([s.every[:, column] for s in stretches], [s.scatter[:, column] for s in stretches])
    rows = [_fourth_differences(one, column) for one in stretches]
    fourth, inputs = (np.concatenate(each) for each in zip(*rows, strict=True))
    if len(fourth) < FEWEST_ROWS * inputs.shape[1]:
        return rough
    left = fourth - inputs @ np.linalg.lstsq(inputs, fourth, rcond=SAME_COLUMN)[0]
    spread = _spread(left) * float(np.sqrt(len(left) / (len(left) - inputs.shape[1])))
    return rough * min(1.0, spread / max(_spread(fourth), NOTHING * rough))


def _fourth_differences(one: Stretch, column: int) -> tuple[Array, Array]:
    """Fourth differences (n,) of readings that follow each other evenly, and every input from some readings before
    them on (n, inputs): its means from reading to reading."""
    seen = np.flatnonzero(np.isfinite(one.every[:, column]))
    inputs = one.inputs
    count = max(len(seen) - DIFFERENCED - BEFORE, 0)
    if count == 0:
        return np.zeros(0), np.zeros((0, WINDOW * inputs.shape[1]))
    t = one.t[seen]
    held = np.column_stack([mean_torque(t, one.t, each) for each in inputs.T])
    even = np.diff(t) < EVEN * float(np.median(np.diff(t)))
    fourth = np.diff(one.every[seen, column], DIFFERENCED)[BEFORE:] / one.scatter[seen, column][BEFORE + 2 : -2]
    window = np.hstack([held[first : first + count] for first in range(WINDOW)])
    kept = np.all([even[first : first + count] for first in range(WINDOW)], axis=0)
    return fourth[kept], window[kept]


def _spread(values: Array) -> float:
    """Standard deviation by the median of sizes."""
    return float(1.4826 * np.median(np.abs(values)))


def roughness(parts: Sequence[Array], scatter: Sequence[Array] | None = None) -> float:
    """Standard deviation of a reading's noise without a model: fourth differences, whose variance is 70 sigma^2.

    scatter: of every reading, the noise over the level that is asked for; 1 without it.

    Not below the spread 1/sqrt(12) of the smallest step between two values, which is a sensor's count.
    """
    seen = [part[np.isfinite(part)] for part in parts]
    over = [np.ones(len(part)) for part in parts] if scatter is None else scatter
    wide = [one[np.isfinite(part)] for part, one in zip(parts, over, strict=True)]
    pairs = zip(seen, wide, strict=True)
    each = [np.diff(part, DIFFERENCED) / one[2:-2] for part, one in pairs if len(part) > DIFFERENCED]
    fourth = np.concatenate(each or [np.zeros(1)])
    steps = np.concatenate([np.abs(np.diff(part)) for part in seen if len(part) > 1] or [np.zeros(1)])
    nothing = NOTHING * max((float(np.ptp(part)) for part in seen if len(part)), default=0.0) or NOTHING
    count = float(np.min(steps[steps > nothing], initial=np.inf))
    spread: float = _spread(fourth) / 70.0**0.5
    least = count / np.sqrt(12.0) if np.isfinite(count) and np.mean(steps < nothing) > 0.02 else nothing
    return max(spread, least, nothing)
