"""The figure of a free run: torque, measured against simulated, and what is left.

Rules of this file: draws what it is given and computes nothing but differences.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hoopd.plants.hoop.fitting.fit_percent import ChannelTrace, FitScore
from hoopd.plants.hoop.recordings.recorded_runs import SimulatedStretch
from hoopd.plots.style import BLACK, BLUE, GREY, VERMILION, figure, legend
from hoopd.recording.recording import Recording

LABELS = {"theta_rate": ("hoop speed", "rad/s"), "psi": ("ball angle", "rad")}
# The state that a channel shows, where there is nothing to compare with.
STATE = {"theta_rate": 1, "psi": 2}
WIDTH_IN, ROW_IN, REST_IN = 8.0, 1.9, 1.1


def draw_simulation(found: FitScore, recording: Recording, model: str) -> Figure:
    """Torque, hoop speed and ball angle (those that move) and the residuals below, over one time axis."""
    names = [name for name in LABELS if name in found.traces or not found.traces]
    heights = [REST_IN + 0.2, *(size for name in names for size in _heights(name in found.traces))]
    made = figure(
        WIDTH_IN,
        sum(heights) + 0.6,
        rows=len(heights),
        title=f"{recording.source}: free run of the model {model}",
        sharex=True,
        height_ratios=heights,
    )
    axes = iter(made.axes)
    _torque(next(axes), recording)
    for name in names:
        _channel(next(axes), name, found)
        if name in found.traces:
            _residual(next(axes), name, found.traces[name])
    made.axes[-1].set_xlabel("time (s)")
    made.axes[-1].set_xlim(recording.t[0], recording.t[-1])
    made.align_ylabels(made.axes)
    return made


def _heights(compared: bool) -> tuple[float, ...]:
    return (ROW_IN, REST_IN) if compared else (ROW_IN,)


def _torque(axes: Axes, recording: Recording) -> None:
    axes.step(recording.t, recording.u, where="post", color=BLACK, linewidth=0.5)
    axes.set_ylabel("torque\n(N m)")


def _channel(axes: Axes, name: str, found: FitScore) -> None:
    what, unit = LABELS[name]
    axes.set_ylabel(f"{what}\n({unit})")
    trace = found.traces.get(name)
    if trace is not None:
        axes.plot(*_seen(trace), ".", color=BLACK, markersize=2.2, label="measured")
        _aside(axes, trace)
    for index, run in enumerate(found.runs):
        axes.plot(*_smooth(run, name), color=VERMILION, label="simulated" if index == 0 else None)
    if trace is not None:
        percent = found.channels[name].nrmse_percent
        axes.set_title(f"fit {percent:.1f} %" if np.isfinite(percent) else "", loc="right", fontsize=9, color=GREY)
    # beside the curves: measured points lie everywhere
    legend(axes, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1, markerscale=3)


def _aside(axes: Axes, trace: ChannelTrace) -> None:
    if not trace.fresh.all():
        t, values = trace.t[~trace.fresh], trace.measured[~trace.fresh]
        axes.plot(t, values, ".", color=BLUE, markersize=2.2, label="repeated, does not count")


def _seen(trace: ChannelTrace) -> tuple[np.ndarray, np.ndarray]:
    return trace.t[trace.fresh], trace.measured[trace.fresh]


def _smooth(run: SimulatedStretch, name: str) -> tuple[np.ndarray, np.ndarray]:
    return run.part.t, run.states[:, STATE[name]]


def _residual(axes: Axes, name: str, trace: ChannelTrace) -> None:
    rest = np.where(trace.fresh, trace.measured - trace.simulated, np.nan)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.plot(trace.t, rest, color=BLUE, linewidth=0.9)
    axes.set_ylabel(f"difference\n({LABELS[name][1]})")
