"""Where the zero of a coordinate lies in a recording whose sensor counts from where it was switched on.

What follows such a coordinate (a cogging, an uneven scale) has its phase against the zero of the recordings in which it
was found. In another recording the same place reads otherwise, by one number d for all that follows it:

    reading(t) = q(t; q(0) + d) - d

d is fitted in least squares over short runs, in which the simulated coordinate stays near the measured one. The waves
of an effect make about as many minima as they have periods: a grid over d comes first, and the best of it are followed.

Rules of this file: numbers in, numbers out; a zero belongs to a recording and never enters a model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import gcd, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.usual_sizes import turns
from hoopd.plants.fits.free_parameters import Scale
from hoopd.plants.fits.output_error import Solution, fit_output_error
from hoopd.plants.fits.runs import Run, RunModel, System
from hoopd.plants.trajectory import Trajectory

Array = NDArray[np.float64]

ZERO = "zero"
# Runs of so many usual sample times say where a zero is: over four times as many a wave holds, or lets go, what moves
# slowly, and the search ends in one of many minima.
SHORT_SAMPLES = 25
# Of the shortest wave: a minimum is a third of it wide.
POINTS_A_WAVE = 6
# What is no wave has its edges somewhere on a turn: points of a turn at least.
POINTS_A_TURN = 24
# Runs that are asked which minimum it is, spread over the recording: all of them say where in it.
MOST_ASKED = 24
# Minima of the grid that are followed to their ends.
MOST_FOLLOWED = 3
# They are told from each other, no more: the starts are fitted again at the one that is taken.
ROUNDS, SMALLEST_GAIN = 2, 1e-3


class Place(NamedTuple):
    """Where a coordinate stands."""

    state: int  # in a start
    columns: tuple[int, ...]  # of a model's run that read it


class Waves(NamedTuple):
    """What follows a coordinate: zeros that can be told apart lie in one period, and so many points find them."""

    period: float
    points: int

    @property
    def grid(self) -> Array:
        """(points,) beginning with 0."""
        return np.arange(self.points) * self.period / self.points


def waves(plant: Plant, effects: Sequence[Effect], values: Mapping[str, float]) -> dict[str, Waves]:
    """By turning coordinate with an arbitrary zero; none for a coordinate that no effect follows."""
    found = {}
    for q in plant.arbitrary_zeros:
        follow = [effect for effect in effects if q in effect.depends_on]
        if follow and turns(plant, q):
            found[q] = _waves(follow, values)
    return found


def _waves(effects: Sequence[Effect], values: Mapping[str, float]) -> Waves:
    """Of a turning coordinate: whole numbers of periods a turn, one where an effect tells none."""
    numbers = [max(1, round(values.get(effect.key("n"), 1.0))) for effect in effects]
    sines = all(any(p.role == "phase" for p in effect.parameters) for effect in effects)
    once = gcd(*numbers) if sines else 1
    points = POINTS_A_WAVE * max(numbers) if sines else max(POINTS_A_TURN, POINTS_A_WAVE * max(numbers))
    return Waves(tau / once, points // once)


class ZeroedModel:
    """Runs of a model as a sensor with another zero reads them; `free`: the last parameter is added to that zero."""

    def __init__(self, model: RunModel, place: Place, zero: float, *, free: bool) -> None:
        self._model, self._place, self._zero, self._free = model, place, zero, free

    def _turned(self, p: ArrayLike, x0: ArrayLike) -> tuple[Array, Array, float]:
        p, x0 = np.asarray(p, float), np.array(x0, float)
        zero = self._zero + (float(p[-1]) if self._free else 0.0)
        x0[self._place.state] += zero
        return p[: len(p) - self._free], x0, zero

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        p, x0, zero = self._turned(p, x0)
        x = self._model.run(p, x0, t, u).copy()
        x[:, list(self._place.columns)] -= zero
        return x

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        p, x0, zero = self._turned(p, x0)
        found = self._model.run_with_sensitivity(p, x0, t, u)
        x, columns = found.x.copy(), list(self._place.columns)
        x[:, columns] -= zero
        if not self._free:
            return found._replace(x=x)
        # d reading / d zero: what the start does, less one where the coordinate itself is read
        by_zero = found.by_start[:, :, self._place.state].copy()
        by_zero[:, columns] -= 1.0
        return Trajectory(x, np.concatenate([found.by_parameters, by_zero[:, :, None]], axis=2), found.by_start)


@dataclass(frozen=True)
class ZeroedSystem:
    """A system whose coordinate is read from a zero of its own; `ZERO` may be fitted, and is added to it."""

    system: System
    place: Place
    zero: float

    @property
    def values(self) -> Mapping[str, float]:
        return {**self.system.values, ZERO: 0.0}

    @property
    def columns(self) -> Mapping[str, int]:
        return self.system.columns

    def model(self, moving: str, free: Sequence[str]) -> RunModel:
        inner = self.system.model(moving, [name for name in free if name != ZERO])
        return ZeroedModel(inner, self.place, self.zero, free=ZERO in free)

    def scale(self, names: Sequence[str]) -> Scale:
        if ZERO not in names:
            return self.system.scale(names)
        if len(names) > 1:
            raise ValueError("a zero is fitted alone")
        return Scale((ZERO,), np.zeros(1), np.zeros(1, dtype=bool))

    def free_starts(self, run: Run) -> list[int]:
        return self.system.free_starts(run)


def fitted_zero(system: System, place: Place, follows: Waves, runs: Sequence[Run]) -> float:
    """The zero that makes short runs of a recording fit best, each from its best start.

    Parameters
    ----------
    system
        The plant with its effects.
    place
        The coordinate.
    follows
        What follows it.
    runs
        Short runs of one recording.

    Returns
    -------
    float
        What is added to a reading to have the model's own coordinate, within half a period of 0.
    """
    asked = runs[:: -(-len(runs) // MOST_ASKED)]
    first = _fit(ZeroedSystem(system, place, 0.0), (), asked)
    begun = [replace(run, start=start) for run, start in zip(asked, first.starts, strict=True)]
    costs = [_misfit(system, place, zero, begun) for zero in follows.grid]
    ends = []
    for zero in follows.grid[_minima(np.array(costs))]:
        found = _fit(ZeroedSystem(system, place, float(zero)), (ZERO,), begun)
        ends.append((badness(found), float(zero) + found.values[ZERO]))
    best = min(ends)[1]
    last = best + _fit(ZeroedSystem(system, place, best), (ZERO,), runs).values[ZERO]
    half = follows.period / 2.0
    return float((last + half) % follows.period - half)


def badness(solution: Solution) -> float:
    """sum n log sigma^2: the likelihood of residuals whose spread was estimated along."""
    return _likelihood(solution.residuals)


def _likelihood(errors: Sequence[Mapping[str, Array]]) -> float:
    total = 0.0
    for name in dict.fromkeys(name for run in errors for name in run):
        every = np.concatenate([run[name] for run in errors if name in run])
        total += len(every) * float(np.log(max(float(np.mean(every**2)), 1e-24)))
    return total if np.isfinite(total) else np.inf


def _fit(system: System, names: Sequence[str], runs: Sequence[Run]) -> Solution:
    return fit_output_error(system, names, runs, rounds=ROUNDS, smallest_gain=SMALLEST_GAIN)


def _misfit(system: System, place: Place, zero: float, runs: Sequence[Run]) -> float:
    """At a zero, from the runs' own starts."""
    turned, errors = ZeroedSystem(system, place, float(zero)), []
    models = {moving: turned.model(moving, ()) for moving in {run.moving for run in runs}}
    for run in runs:
        x = models[run.moving].run((), run.start, run.t, run.u)
        errors.append({name: one.of(x[:, turned.columns[name]]) - one.values for name, one in run.series.items()})
    return _likelihood(errors)


def _minima(costs: Array) -> list[int]:
    """Points of a closed grid no worse than their neighbours, best first; where it began is always among them."""
    low = np.flatnonzero((costs <= np.roll(costs, 1)) & (costs <= np.roll(costs, -1)))
    best = sorted(low.tolist(), key=lambda index: costs[index])[:MOST_FOLLOWED]
    return list(dict.fromkeys([*best, 0]))
