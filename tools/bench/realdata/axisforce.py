"""The force that a model of a driven axis leaves unexplained, from measured positions: no simulation, no fit.

    e = (a_model(x, x', F) - x'') / (da_model/dF),    residual = rms(low-passed e) / rms(low-passed F)

x' and x'' are central differences; the low-pass is a Butterworth filter of fourth order at 40 Hz, run forward and
backward; 0.2 s at both ends do not count. What the model says is asked of it by an instantaneous step from the
measured state; states that no sensor reads (what lags, what has a memory) are carried along.

Rules of this file: a model is what its file says; samples stand at equal times.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.plant_model import PlantModel
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

LOW_PASS_HZ, ORDER, ENDS_S = 40.0, 4, 0.2
# Of a sample: so short that nothing but the rates changes, so long that their change keeps ten digits.
INSTANT = 1e-3
# The axis's own states; what effects add stands behind them.
POSITION, RATE = 0, 1
FITTED = 2.0 / 3.0


class Residual(NamedTuple):
    """Share of the force that is not explained."""

    fitted: float  # over the first two thirds
    held_out: float  # over the last third
    all: float


class Motion(NamedTuple):
    """A sampled run of the axis: s, N, m."""

    t: Array
    force: Array
    x: Array

    @property
    def step_s(self) -> float:
        """Between two samples."""
        return float(np.median(np.diff(self.t)))

    @property
    def rate(self) -> Array:
        """x' by central differences; at the ends one-sided."""
        return np.gradient(self.x, self.step_s)

    @property
    def acceleration(self) -> Array:
        """x'' by central differences; at the ends that of the neighbour."""
        inner = np.diff(self.x, 2) / self.step_s**2
        return np.concatenate([inner[:1], inner, inner[-1:]])


def low_passed(values: Array, step_s: float) -> Array:
    """Below 40 Hz, without a shift in time; as it is where it has nothing above."""
    if 2.0 * LOW_PASS_HZ * step_s >= 1.0:
        return values
    filtered: Array = scipy.signal.sosfiltfilt(
        scipy.signal.butter(ORDER, LOW_PASS_HZ, fs=1.0 / step_s, output="sos"), values
    )
    return filtered


def residual_of(error: Array, motion: Motion) -> Residual:
    """Of a force error at every sample."""
    t, step_s = motion.t - motion.t[0], motion.step_s
    e, f = low_passed(error, step_s), low_passed(motion.force, step_s)
    inside = (t >= ENDS_S) & (t <= t[-1] - ENDS_S)
    late = t >= FITTED * t[-1]
    return Residual(*(_share(e, f, inside & part) for part in (~late, late, np.ones_like(late))))


def _share(error: Array, force: Array, part: NDArray[np.bool_]) -> float:
    return float(np.sqrt(np.mean(error[part] ** 2) / np.mean(force[part] ** 2)))


def force_error(model: PlantModel, motion: Motion) -> Array:
    """Force (n,) in N that the model has too much, in units of the demanded force."""
    known = known_effects(model.plant, [one.name for one in model.effects])
    composite = Composite(model.plant, [known[one.name] for one in model.effects], substeps=1)
    read = sensed(composite, model.values, motion)
    late = composite.delay_s(model.values)
    force = np.interp(motion.t - late, motion.t, motion.force) if late else motion.force
    states = _states(composite, model.values, read, force)
    here = _accelerations(composite, model.values, read, force, states)
    return (here - read.acceleration) / _answer(composite, model.values, read, force)


def _answer(composite: Composite, values: Mapping[str, float], motion: Motion, force: Array) -> float:
    """What a newton more does to x'', for good: any lag has settled."""
    found = []
    for more in (0.0, 1.0):
        x = np.zeros((len(force), composite.nx))
        x[:, POSITION], x[:, RATE] = motion.x, motion.rate
        settled = np.array([composite.beginning(row, u) for row, u in zip(x, force + more, strict=True)])
        found.append(_accelerations(composite, values, motion, force + more, settled))
    return float(np.median((found[1] - found[0])[motion.rate != 0.0]))


def sensed(composite: Composite, values: Mapping[str, float], motion: Motion) -> Motion:
    """Where the axis was when its sensor read x: late readings put back, a map of the readings taken off."""
    (channel,) = composite.channels
    late = composite.latency_s(channel, values)
    x = np.interp(motion.t + late, motion.t, motion.x) if late else motion.x
    p, z = composite.vector(values), np.zeros(composite.nz)
    if not any(one.sensor for one in composite.effects):
        return motion._replace(x=x)
    wrong = np.empty_like(x)
    for k, (t, here) in enumerate(zip(motion.t - motion.t[0], x, strict=True)):
        z[POSITION] = here
        wrong[k] = float(composite.reading_function(z, t, p)) - here
    return motion._replace(x=x - wrong)


def _accelerations(
    composite: Composite, values: Mapping[str, float], motion: Motion, force: Array, states: Array
) -> Array:
    """The model's x'' at every sample, from the states there."""
    instant, t = INSTANT * motion.step_s, motion.t - motion.t[0]
    step = composite.step_function.map(len(t))
    rest, p = np.zeros((composite.nw, 1)), composite.vector(values)[:, np.newaxis]
    after: Array = step(states.T, force[np.newaxis, :], rest, instant, t[np.newaxis, :], p).full()
    return (after[RATE] - states[:, RATE]) / instant


def _states(composite: Composite, values: Mapping[str, float], motion: Motion, force: Array) -> Array:
    """States (n, nz): position and rate as measured, the others as the model goes on from sample to sample."""
    states = np.zeros((len(motion.t), composite.nz))
    states[:, POSITION], states[:, RATE] = motion.x, motion.rate
    carried = [i for i in range(composite.nz) if i not in (POSITION, RATE)]
    if carried:
        p, rest = composite.vector(values), np.zeros(composite.nw)
        for k, t in enumerate(motion.t[:-1] - motion.t[0]):
            after = composite.step_function(states[k], force[k], rest, motion.step_s, t, p).full()[:, 0]
            states[k + 1, carried] = after[carried]
    return states


def with_dry_friction(motion: Motion) -> tuple[Array, Array]:
    """What least squares on the first two thirds make of M x'' + Fv x' + Fc sign(x') + offset: numbers (4,) and the
    error (n,) in N."""
    columns = (motion.acceleration, motion.rate, np.sign(motion.rate), np.ones_like(motion.x))
    terms = np.column_stack(columns)
    seen = np.column_stack([low_passed(one, motion.step_s) for one in columns])
    t = motion.t - motion.t[0]
    part = (t >= ENDS_S) & (t < FITTED * t[-1])
    numbers = np.linalg.lstsq(seen[part], low_passed(motion.force, motion.step_s)[part], rcond=None)[0]
    return numbers, motion.force - terms @ numbers


def averaged(motion: Motion, count: int) -> Motion:
    """Means over so many samples: each of the time over which its forces were held, the place as it went straight from
    sample to sample."""
    rows = (len(motion.t) - 1) // count
    middles = ((np.asarray(one[:-1]) + np.asarray(one[1:])) / 2.0 for one in (motion.t, motion.x))
    t, x = (one[: rows * count].reshape(rows, count).mean(axis=1) for one in middles)
    return Motion(t, np.asarray(motion.force[: rows * count]).reshape(rows, count).mean(axis=1), x)
