"""Recordings made ready for a fit: what moved, which samples count, which runs are simulated from a start of their own.

Rules of this file: a recording is judged by itself, never by a model; every sample that is set aside is counted and
said; nothing of the input is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import tau

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError
from hoopd.plants.fits.repeated_samples import HELD_COUNTS, equal_stretches, not_stuck, once_at_rest
from hoopd.plants.fits.runs import FEWEST, SHORTEST_ROWS, ChannelSeries, Run
from hoopd.recording.recording import Recording
from hoopd.recording.timeline import ChannelNodes, Timeline, begin_of, timelines

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHANNELS = ("theta", "theta_rate", "dtheta", "psi")
STATES = {"theta": 0, "theta_rate": 0, "dtheta": 1, "psi": 2}
UNITS = {"theta": "rad", "theta_rate": "rad/s", "dtheta": "rad/s", "psi": "rad"}
# A ball that stayed within this was never seen to move: 5 camera quanta.
STILL_PSI_RAD = 0.005


def was_measured(recording: Recording) -> bool:
    """Whether one of the two angles was read at all."""
    return bool(np.isfinite(recording.theta).any() or np.isfinite(recording.psi).any())


def moving_of(recording: Recording, encoder_counts: int = 4096) -> str:
    """Whether ball and hoop move: both, hoop or ball."""
    psi, theta = _seen(recording.psi), _seen(recording.theta)
    ball = len(psi) > SHORTEST_ROWS and np.ptp(psi) > STILL_PSI_RAD
    return "hoop" if not ball else "ball" if _still(theta, encoder_counts) else "both"


def prepare(
    recordings: Sequence[Recording],
    channels: Sequence[str] = ("theta_rate", "psi"),
    window_s: float | None = None,
    encoder_counts: int = 4096,
) -> list[Run]:
    """Runs of the recordings, whole or in windows; InputError when a recording holds nothing to fit."""
    runs = []
    for recording in recordings:
        _refuse_unseen_hoop(recording)
        moving = moving_of(recording, encoder_counts)
        wanted = channels_of(moving, channels)
        found = [run for part in pieces(recording, window_s) if (run := run_of(recording, part, moving, wanted))]
        if not found:
            raise InputError(recording.source, ", ".join(wanted), f"no stretch of {SHORTEST_ROWS} samples to fit")
        runs += found
    return runs


def _refuse_unseen_hoop(recording: Recording) -> None:
    """A hoop that a torque turned and nobody measured was not held."""
    if not np.isfinite(recording.theta).any() and np.any(np.nan_to_num(recording.u) != 0.0):
        raise InputError(recording.source, "theta", "is missing throughout, although a torque turned the hoop")


def channels_of(moving: str, channels: Sequence[str]) -> list[str]:
    """Those of the channels that say something about what moves."""
    if moving == "ball":
        return ["psi"]
    return [name for name in channels if name != "psi" or moving == "both"]


def pieces(recording: Recording, window_s: float | None = None) -> list[Timeline]:
    """Stretches with a torque, whole or in windows; InputError when there is none."""
    try:
        whole = timelines(recording)
    except ValueError as error:
        raise InputError(recording.source, "u", str(error)) from None
    return whole if window_s is None else [piece for part in whole for piece in part.windows(window_s)]


def run_of(recording: Recording, part: Timeline, moving: str, wanted: Sequence[str]) -> Run | None:
    """A piece made ready; None when it has too few measurements for a start of its own."""
    series, aside = {}, {}
    for name in wanted:
        channel = part.channels["theta" if name == "theta_rate" else name]
        if name == "psi":
            fresh = fresh_angles(part)
            aside[name] = int((~fresh).sum())
            channel = ChannelNodes(channel.nodes[fresh], channel.values[fresh])
        if name == "theta":
            counts = once_at_rest(channel.values)
            aside[name] = int((~counts).sum())
            channel = ChannelNodes(channel.nodes[counts], channel.values[counts])
        if len(channel.values) >= FEWEST:
            series[name] = _rate(part, channel) if name == "theta_rate" else ChannelSeries(name, *channel)
    if sum(len(one.values) for one in series.values()) < SHORTEST_ROWS:
        return None
    t = part.t - begin_of(recording)
    return Run(recording.source, moving, t, part.u, series, _start(part, moving), aside)


def _rate(part: Timeline, theta: ChannelNodes) -> ChannelSeries:
    """(theta_k+1 - theta_k-1) / (t_k+1 - t_k-1), the same of the simulation: no derivative is guessed."""
    after, before = theta.nodes[2:], theta.nodes[:-2]
    span = part.t[after] - part.t[before]
    return ChannelSeries("theta_rate", after, (theta.values[2:] - theta.values[:-2]) / span, before, span)


def fresh_angles(part: Timeline) -> NDArray[np.bool_]:
    """Which angles of the ball count: a value that repeats is a camera that has lost it (the first counts), or, when
    the hoop is still too, a ball at rest (the first and the last count)."""
    good, channel, theta = not_stuck(part.channels["psi"].values), part.channels["psi"], part.channels["theta"]
    edges, _ = equal_stretches(channel.values)
    for first, last in pairwise(edges):
        if good[first:last].all() or len(theta.values) == 0:
            continue
        a, b = np.searchsorted(theta.nodes, [channel.nodes[first], channel.nodes[last - 1] + 1])
        if _still(theta.values[a:b]):
            good[last - 1] = True  # with the first: the same error all the time, but where it was and that it rested
    return good


def _still(theta: Array, encoder_counts: int = 4096) -> bool:
    return len(theta) == 0 or float(np.ptp(theta)) < HELD_COUNTS * tau / encoder_counts


def _start(part: Timeline, moving: str) -> Array:
    """State at the first node by straight lines through the first samples."""
    theta, dtheta = _line(part, part.channels["theta"])
    psi, dpsi = _line(part, part.channels["psi"])
    if moving == "hoop":
        psi = dpsi = 0.0
    return np.array([theta, 0.0 if moving == "ball" else dtheta, psi, dpsi])


def _line(part: Timeline, channel: ChannelNodes, samples: int = 5) -> tuple[float, float]:
    t, y = part.t[channel.nodes[:samples]] - part.t[0], channel.values[:samples]
    if len(t) < 2:
        return (float(y[0]) if len(y) else 0.0), 0.0
    slope, value = np.polyfit(t, y, 1)
    return float(value), float(slope)


def _seen(values: Array) -> Array:
    return values[np.isfinite(values)]
