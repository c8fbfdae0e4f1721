"""Free runs of any declared plant under the inputs of a recording, and what its sensors would have shown.

Rules of this file: a start is given or estimated from the recording's own samples, never guessed silently; a simulated
value belongs to the instant at which the sensor was read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError
from hoopd.plants.fits.arbitrary_zero import SHORT_SAMPLES, Place, ZeroedSystem, fitted_zero, waves
from hoopd.plants.fits.output_error import fit_output_error
from hoopd.plants.fits.plant_fit import ChannelFit
from hoopd.plants.fits.plant_runs import ALL, PlantSystem, inputs_of, prepare_runs
from hoopd.plants.fits.runs import System
from hoopd.recording.recording import Recording, Signal, from_signals
from hoopd.recording.timeline import SAME_S, Timeline, begin_of, timelines

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlantSimulation:
    """Free runs over a recording."""

    simulated: Recording  # the recording's rows and inputs with simulated channels; NaN outside of the runs
    starts: tuple[Array, ...]  # (nx,) of every stretch, with what lags behind it where that is known
    percent: Mapping[str, ChannelFit]  # by channel; none where nothing was measured
    estimated: bool  # the starts were
    zeros: Mapping[str, float] = field(
        default_factory=dict
    )  # of coordinates, fitted to this recording (`in_recording`)


def simulate_plant(
    system: PlantSystem, recording: Recording, start: Mapping[str, float] | None = None
) -> PlantSimulation:
    """A plant run freely under a recording's inputs, and how well it repeats what was measured.

    Parameters
    ----------
    system
        The plant with its numbers and effects.
    recording
        With the plant's inputs; without any of its channels the run begins at rest.
    start
        States by name, the rest 0, in place of those that fit the recording best.

    Returns
    -------
    PlantSimulation

    Raises
    ------
    InputError
        An input that is missing, a start that is no state, or a run that leaves every bound.

    Examples
    --------
    >>> from hoopd.plants.registry import plant_named
    >>> pump = from_signals(np.arange(3.0), {"q": np.full(3, 5e-5)})
    >>> run = simulate_plant(PlantSystem(plant_named("tanks")), pump, {"h1": 0.2})
    >>> run.simulated.channels["h1"].values.round(4).tolist()
    [0.2, 0.2, 0.2001]
    """
    plant = system.plant
    for name in start or {}:
        if name not in plant.states:
            raise InputError("--x0", name, f"no state of {plant.name}; known: {', '.join(plant.states)}")
    begin = begin_of(recording)
    measured = any(np.isfinite(recording.channels[c].values).any() for c in plant.channels if c in recording.channels)
    whole = _with_every_sample(system, recording)
    try:
        parts = timelines(whole)
    except ValueError as error:
        raise InputError(recording.source, "", str(error)) from None
    estimated = start is None and measured
    turned, zeros = in_recording(system, recording) if estimated else (system, {})
    if estimated:
        runs = prepare_runs(plant, [recording])
        runs = runs if zeros else system.begun(runs)  # what lags behind an angle would be turned with it
        solution = fit_output_error(turned, (), runs)
        begun = {round(run.t[0] / SAME_S): x for run, x in zip(runs, solution.starts, strict=True)}
        parts = [part for part in parts if round((part.t[0] - begin) / SAME_S) in begun]
        starts = tuple(begun[round((part.t[0] - begin) / SAME_S)] for part in parts)
    else:
        if len(parts) > 1 and start is not None:
            words = f"one start is given and there are {len(parts)} stretches: cut it"
            raise InputError(recording.source, "--x0", words)
        starts = tuple(np.array([(start or {}).get(name, 0.0) for name in plant.states]) for _ in parts)
    model = turned.model(ALL, ())
    readings = [model.run((), x0, part.t - begin, part.u) for part, x0 in zip(parts, starts, strict=True)]
    if not all(np.isfinite(one).all() for one in readings):
        raise InputError(plant.name, "", "the free run leaves every bound")
    simulated = _as_recorded(system, whole, parts, readings)
    percent = _percent(system, recording, simulated) if measured else {}
    return PlantSimulation(simulated, starts, percent, estimated, zeros)


def in_recording(system: PlantSystem, recording: Recording) -> tuple[System, dict[str, float]]:
    """The system as a recording's sensors read it, and the zeros that were fitted: of coordinates that are counted from
    where the sensor was switched on, and that effects follow."""
    plant, turned, zeros = system.plant, cast(System, system), dict[str, float]()
    for q, follows in waves(plant, system.effects, system.values).items():
        runs = prepare_runs(plant, [recording], SHORT_SAMPLES * plant.time_scale_s)
        columns = tuple(i for i, name in enumerate(plant.channels) if plant.state_of(name) == q)
        place = Place(plant.states.index(q), columns)
        zeros[q] = fitted_zero(turned, place, follows, runs)
        turned = ZeroedSystem(turned, place, zeros[q])
    return turned, zeros


def _with_every_sample(system: PlantSystem, recording: Recording) -> Recording:
    """The same rows with nothing missing among the plant's channels, so that each row has its node."""
    plant, channels = system.plant, {}
    for name, declared in plant.channels.items():
        when = recording.channels[name].t if name in recording.channels else recording.t
        when = np.where(np.isfinite(when), when, recording.t)
        channels[name] = Signal(np.zeros(len(recording)), when, declared.unit)
    return from_signals(recording.t, inputs_of(plant, recording), channels, source=f"simulated from {recording.source}")


def _as_recorded(system: PlantSystem, whole: Recording, parts: list[Timeline], readings: list[Array]) -> Recording:
    channels = {}
    for column, (name, signal) in enumerate(whole.channels.items()):
        values = np.full(len(whole), np.nan)
        for part, found in zip(parts, readings, strict=True):
            inside = (signal.t >= part.t[0] - SAME_S) & (signal.t <= part.t[-1] + SAME_S)
            nodes = np.maximum(np.searchsorted(part.t, signal.t[inside] + SAME_S) - 1, 0)
            values[inside] = found[nodes, column]
        channels[name] = Signal(values, signal.t, signal.unit)
    return from_signals(whole.t, dict(whole.inputs), channels, source=whole.source)


def _percent(system: PlantSystem, recording: Recording, simulated: Recording) -> dict[str, ChannelFit]:
    """Fit by channel, where both are there."""
    out = {}
    for name in system.plant.channels:
        if name in recording.channels:
            y, yhat = recording.channels[name].values, simulated.channels[name].values
            both = np.isfinite(y) & np.isfinite(yhat)
            out[name] = ChannelFit.between(y[both], yhat[both], system.plant.channels[name].unit)
    return out
