"""A declared plant as a fit asks for it, and recordings of it cut into runs.

Rules of this file: a channel is compared where it was measured and nothing else is made of it; what a laboratory's
sensors do beside is for the plant's judges or its effects to say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, ranges_of
from hoopd.plants.fits.free_parameters import Scale, scale_within
from hoopd.plants.fits.runs import FEWEST, SHORTEST_ROWS, ChannelSeries, Run
from hoopd.plants.free_run import FreeRun
from hoopd.plants.lag_starts import line_at_start, read_at_start
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.trajectory import Trajectory
from hoopd.recording.recording import Recording, Signal, from_signals
from hoopd.recording.timeline import Timeline, begin_of, timelines

Array = NDArray[np.float64]

# All of a declared plant moves.
ALL = "all"
# A first guess of a state is the straight line through so many samples.
FIRST_SAMPLES = 5


@dataclass(frozen=True)
class PlantSystem:
    """A plant with its numbers, and what it has beside its equations."""

    plant: Plant
    effects: tuple[Effect, ...] = ()
    changed: Mapping[str, float] = field(default_factory=dict)  # values that are not the nominal ones
    step_s: float | None = None

    @cached_property
    def nominal(self) -> Mapping[str, float]:
        """Every parameter as declared, of effects the neutral ones."""
        return {**self.plant.values, **{e.key(n): v for e in self.effects for n, v in e.neutral().items()}}

    @cached_property
    def values(self) -> Mapping[str, float]:
        """Every parameter of the plant and its effects."""
        return {**self.nominal, **self.changed}

    @property
    def columns(self) -> Mapping[str, int]:
        """Of the readings, in the plant's order."""
        return {channel: index for index, channel in enumerate(self.plant.channels)}

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Of every parameter that has some."""
        return {**self.plant.bounds, **ranges_of(self.effects)}

    def model(self, moving: str, free: Sequence[str]) -> PlantReadings:
        """What simulates its readings; all of it moves."""
        return PlantReadings(FreeRun(self.plant, self.effects, free, values=self.values, step_s=self.step_s))

    def scale(self, names: Sequence[str]) -> Scale:
        return scale_within(names, self.values, self.bounds)

    def free_starts(self, run: Run) -> list[int]:
        """All: a component that no channel sees stays at its first guess."""
        return list(range(len(self.plant.states)))

    def begun(self, runs: Sequence[Run]) -> list[Run]:
        """The runs with first guesses of what lags behind the plant: readings where sensors lag."""
        composite = FreeRun(self.plant, self.effects, values=self.values).composite if self._lagging else None
        return list(runs) if composite is None else [self._begun(run, composite) for run in runs]

    @property
    def _lagging(self) -> bool:
        return any(one.sensor_lag for one in self.effects)

    def _begun(self, run: Run, composite: Composite) -> Run:
        z = composite.beginning(run.start, float(np.ravel(run.u)[0]) if run.u.size else 0.0)
        shown = composite.reading_function(z, run.t[0], composite.vector(self.values)).full().ravel()
        for i, (channel, lag) in enumerate(zip(composite.followed, composite.lags, strict=True), start=composite.nx):
            if channel is not None and channel in run.series:
                one = run.series[channel]
                first = read_at_start(run.t[[0, *one.nodes]], np.array([np.nan, *one.values]), self.values[lag])
                added = shown[composite.channels.index(channel)] - z[i]  # beside what lags: an offset
                z[i] = first - added if np.isfinite(first) else z[i]
        return replace(run, start=z)


class PlantReadings:
    """The readings of a plant's free runs."""

    def __init__(self, model: FreeRun) -> None:
        self._model = model

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        return self._model.run(p, x0, t, u).readings

    def states(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        """(n, nx) in the plant's order."""
        return self._model.run(p, x0, t, u).states

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        found, m = self._model.run_with_sensitivity(p, x0, t, u), len(self._model.free)
        return Trajectory(found.readings, found.readings_by[:, :, :m], found.readings_by[:, :, m:])


# ---------------------------------------------------------------------------------------------- recordings


def prepare_runs(plant: Plant, recordings: Sequence[Recording], window_s: float | None = None) -> list[Run]:
    """Runs of the recordings, whole or in windows; InputError when one of them holds nothing to compare."""
    runs: list[Run] = []
    for recording in recordings:
        parts = stretches_of(plant, recording)
        pieces = parts if window_s is None else [piece for part in parts for piece in part.windows(window_s)]
        found = [run for part in pieces if (run := run_of(plant, recording.source, part)) is not None]
        if not found:
            wanted = ", ".join(plant.channels)
            raise InputError(recording.source, wanted, f"no stretch of {SHORTEST_ROWS} samples to fit")
        runs += found
    return runs


def stretches_of(plant: Plant, recording: Recording) -> list[Timeline]:
    """The recording's stretches with the plant's inputs in its order, timed from its first row, as the `t` of equations
    is; InputError names what is missing."""
    begin = begin_of(recording)
    try:
        return [part._replace(t=part.t - begin) for part in timelines(_of_plant(plant, recording))]
    except ValueError as error:
        raise InputError(recording.source, "", str(error)) from None


def _of_plant(plant: Plant, recording: Recording) -> Recording:
    """Its inputs and channels of the plant alone; the daemon's own ticks as they are, whose times belong together."""
    inputs = inputs_of(plant, recording)
    channels = {name: recording.channels[name] for name in plant.channels if name in recording.channels}
    if not channels:
        there, wanted = ", ".join(recording.channels) or "none", ", ".join(plant.channels)
        raise InputError(recording.source, wanted, f"no channel of {plant.name} is there, but {there}")
    if recording.is_tick:
        return recording
    return from_signals(recording.t, inputs, channels, source=recording.source)


def inputs_of(plant: Plant, recording: Recording) -> dict[str, Signal]:
    """The recording's inputs in the plant's order; InputError for one that is not there."""
    if missing := [one.name for one in plant.inputs if one.name not in recording.inputs]:
        there = ", ".join([*recording.inputs, *recording.channels]) or "nothing"
        raise InputError(recording.source, missing[0], f"{plant.name} has this input, the recording {there}")
    return {one.name: recording.inputs[one.name] for one in plant.inputs}


def run_of(plant: Plant, source: str, part: Timeline) -> Run | None:
    """A stretch made ready; None when it has too few measurements for a start of its own."""
    seen = {name: part.channels[name] for name in plant.channels if name in part.channels}
    series = {
        name: ChannelSeries(name, one.nodes, one.values) for name, one in seen.items() if len(one.values) >= FEWEST
    }
    if sum(len(one.values) for one in series.values()) < SHORTEST_ROWS:
        return None
    return Run(source, ALL, part.t, part.u, series, first_state(plant, part.t, series), {})


def first_state(plant: Plant, t: Array, series: Mapping[str, ChannelSeries]) -> Array:
    """(nx,) a first guess: lines through the first samples of what reads a state, its slope where nobody reads that;
    of a first-order state that nobody reads its usual size."""
    lines = {plant.state_of(name): _line(t, one) for name, one in series.items() if plant.state_of(name)}
    guess = {name: plant.scales.get(name, 0.0) for name in plant.first_order}
    for name in plant.coordinates:
        if name in lines:
            guess[f"d{name}"] = lines[name][1]
    guess |= {name: value for name, (value, _) in lines.items()}
    return np.array([guess.get(name, 0.0) for name in plant.states])


def _line(t: Array, series: ChannelSeries) -> tuple[float, float]:
    """Value at the first node, and slope."""
    return line_at_start(t[series.nodes[:FIRST_SAMPLES]] - t[0], series.values[:FIRST_SAMPLES])
