"""What an experiment recorded: torque, hoop speed and ball angle over time, and where the torque's power lies.

Rules of this file: draws a recording, computes nothing but its spectrum; limits are drawn where data come near them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hoopd.ident.signals import spectrum
from hoopd.plots import style
from hoopd.recording.recording import Recording

NEAR = 0.6  # of a limit: below, its line would only squeeze the data
BAND = 2.0 ** (1.0 / 3.0)  # a third of an octave


class ExperimentLimits(NamedTuple):
    """What the experiment was allowed; no angle without a ball."""

    torque_nm: float
    hoop_speed_rad_s: float
    ball_angle_rad: float | None = None


def draw_experiment(recording: Recording, kind: str, limits: ExperimentLimits) -> Figure:
    """Three signals over time and the torque's spectrum while it was played; without a ball the angle is left out."""
    with_ball = limits.ball_angle_rad is not None
    figure = style.figure(7.5, 8.0 if with_ball else 6.4, rows=4 if with_ball else 3, title=f"Experiment: {kind}")
    *times, below = figure.axes
    played = np.asarray(recording.extra.get("mode", np.full(len(recording), "RUNNING"))) == "RUNNING"
    _signal(times[0], recording.t, recording.u, "torque (N m)", limits.torque_nm, steps=True)
    _signal(times[1], recording.y_t, recording.dtheta, "hoop speed (rad/s)", limits.hoop_speed_rad_s)
    if limits.ball_angle_rad is not None:
        ball = recording.channels["psi"]
        _signal(times[2], ball.t, ball.values, "ball angle (rad)", limits.ball_angle_rad)
    for axes in times[1:]:
        axes.sharex(times[0])
    _shade(times, recording.t, played)
    times[-1].set_xlabel("time (s)")
    _spectrum(below, recording.u[played], recording.sample_time_s)
    return figure


def _signal(
    axes: Axes, t: NDArray[np.float64], y: NDArray[np.float64], label: str, limit: float, *, steps: bool = False
) -> None:
    """One signal, missing samples left out, with its limits when it comes near them."""
    known = np.isfinite(t) & np.isfinite(y)
    axes.plot(t[known], y[known], drawstyle="steps-post" if steps else "default", linewidth=0.9)
    axes.set_ylabel(label)
    if known.any() and np.abs(y[known]).max() > NEAR * limit:
        for value in (limit, -limit):
            axes.axhline(value, color=style.GREY, linestyle="--", linewidth=0.9)


def _shade(times: list[Axes], t: NDArray[np.float64], played: NDArray[np.bool_]) -> None:
    """Grey where the signal was not played."""
    if not played.any():
        return
    first, last = t[played][[0, -1]]
    for axes in times:
        axes.axvspan(t[0], first, color="#EEEEEE", zorder=0)
        axes.axvspan(last, t[-1], color="#EEEEEE", zorder=0)
        axes.set_xlim(t[0], t[-1])


def _spectrum(axes: Axes, u: NDArray[np.float64], step_s: float) -> None:
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("torque power per\nthird octave (%)")
    axes.set_xscale("log")
    if len(u) < 4 or not np.any(u):
        return
    frequency, power = spectrum(u, step_s)
    frequency, share = frequency[1:], 100.0 * power[1:] / power[1:].sum()
    bands = 1 + int(np.ceil(np.log(frequency[-1] / frequency[0]) / np.log(BAND)))
    edges = frequency[0] / np.sqrt(BAND) * BAND ** np.arange(bands + 1)
    axes.stairs(np.histogram(frequency, edges, weights=share)[0], edges, fill=True, color=style.SKY)
