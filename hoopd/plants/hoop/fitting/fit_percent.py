"""How well a model repeats a recording: one free run and windows of two seconds, percent of fit per channel.

    NRMSE = 100 (1 - |y - yhat| / |y - mean y|),

100 is a perfect run, 0 as good as the mean of the measurement, below 0 worse than that.
Rules of this file: the measure is one for every model and structure; samples that are no measurement are set aside and
counted, and the figure with all of them stands beside.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.nrmse import nrmse_percent
from hoopd.plants.hoop.recordings.fit_data import UNITS, channels_of, fresh_angles, moving_of
from hoopd.plants.hoop.recordings.recorded_runs import SimulatedStretch, Subject, free_runs
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANNELS = ("theta_rate", "dtheta", "psi")
# One and a half swings of the ball: long enough to show its frequency, too short to hide a wrong one in a new start.
WINDOW_S = 2.0


@dataclass(frozen=True)
class ChannelTrace:
    """One channel measured and simulated at the same instants; `fresh`: what counts."""

    t: Array  # (k,) s
    measured: Array  # (k,)
    simulated: Array  # (k,)
    fresh: Mask  # (k,)


@dataclass(frozen=True)
class ChannelScore:
    """Fit of one channel; NaN where the measurement never changes."""

    nrmse_percent: float  # over the samples that count
    nrmse_all_percent: float  # over all samples
    rmse: float  # over the samples that count, in the channel's unit
    unit: str
    samples: int  # that count
    set_aside: int


@dataclass(frozen=True)
class FitScore:
    """A model against a recording: starts, fit and traces per channel."""

    recording: str
    moving: str  # both, hoop or ball
    window_s: float | None  # None: one free run over the whole recording
    channels: dict[str, ChannelScore]
    traces: dict[str, ChannelTrace]
    runs: tuple[SimulatedStretch, ...]
    zero: float | None = None  # of the recording's theta, where effects follow theta and it was fitted

    @property
    def nrmse_percent(self) -> dict[str, float]:
        """Fit per channel over the samples that count."""
        return {name: one.nrmse_percent for name, one in self.channels.items()}


def score(
    subject: Subject,
    recording: Recording,
    *,
    window_s: float | None = None,
    start: Mapping[str, float] | None = None,
    moving: str | None = None,
    encoder_counts: int = 4096,
) -> FitScore:
    """Free run of `subject` over the recording, or over windows of `window_s`, each from its own estimated start.

    start: states by name (theta, dtheta, psi, dpsi; rad, rad/s) instead of the estimate; `moving`: what moves, where
    the recording shall not say it. InputError when there is nothing to simulate.
    """
    moving = moving or moving_of(recording, encoder_counts)
    subject = subject if start is not None else subject.in_recording(recording, moving)
    runs = free_runs(subject, recording, moving, window_s=window_s, start=start)
    return replace(scored(recording.source, runs, moving, window_s), zero=subject.zero)


def scored(source: str, runs: Sequence[SimulatedStretch], moving: str, window_s: float | None = None) -> FitScore:
    """The measure on runs that are simulated already."""
    traces = {}
    for name in channels_of(moving, CHANNELS):
        found = [trace for run in runs if (trace := _TRACES[name](run)) is not None]
        if found:
            traces[name] = _joined(found)
    channels = {name: _channel_score(name, trace) for name, trace in traces.items()}
    return FitScore(source, moving, window_s, channels, traces, tuple(runs))


def _channel_score(name: str, trace: ChannelTrace) -> ChannelScore:
    measured, simulated = trace.measured[trace.fresh], trace.simulated[trace.fresh]
    rmse = float(np.sqrt(np.mean((measured - simulated) ** 2))) if len(measured) else float("nan")
    return ChannelScore(
        nrmse_percent(measured, simulated),
        nrmse_percent(trace.measured, trace.simulated),
        rmse,
        UNITS[name],
        len(measured),
        int((~trace.fresh).sum()),
    )


def _joined(traces: Sequence[ChannelTrace]) -> ChannelTrace:
    """One after the other; the sample on the seam of two windows counts once."""
    columns = [np.concatenate(column) for column in zip(*map(_columns, traces), strict=True)]
    _, once = np.unique(columns[0], return_index=True)
    return ChannelTrace(*(column[once] for column in columns))


def _columns(trace: ChannelTrace) -> tuple[Array, Array, Array, Mask]:
    return trace.t, trace.measured, trace.simulated, trace.fresh


# ---------------------------------------------------------------------------------------------- channels


def _theta_rate(run: SimulatedStretch) -> ChannelTrace | None:
    """Slope of theta over the board's own instants, of measurement and simulation alike (second order, as
    numpy.gradient): the column dtheta is data to be judged, theta is counted."""
    nodes, theta = run.part.channels["theta"]
    if len(nodes) < 3:
        return None
    t = run.part.t[nodes]
    return ChannelTrace(t, np.gradient(theta, t), np.gradient(run.states[nodes, 0], t), np.ones(len(t), bool))


def _dtheta(run: SimulatedStretch) -> ChannelTrace | None:
    nodes, values = run.part.channels["dtheta"]
    return (
        ChannelTrace(run.part.t[nodes], values, run.states[nodes, 1], np.ones(len(nodes), bool)) if len(nodes) else None
    )


def _psi(run: SimulatedStretch) -> ChannelTrace | None:
    nodes, values = run.part.channels["psi"]
    return ChannelTrace(run.part.t[nodes], values, run.states[nodes, 2], fresh_angles(run.part)) if len(nodes) else None


_TRACES: Mapping[str, Callable[[SimulatedStretch], ChannelTrace | None]] = {
    "theta_rate": _theta_rate,
    "dtheta": _dtheta,
    "psi": _psi,
}
