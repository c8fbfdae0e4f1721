"""A recording against free runs of several models: torque, hoop angle, hoop speed, ball angle, percent of fit.

Rules of this file: draws what it is given and computes nothing; several stretches of one experiment share the axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hoopd.plants.hoop.fitting.fit_percent import FitScore
from hoopd.plots import style
from hoopd.recording.recording import Recording

# Models in their order, the same in every figure: as printed, as fitted here, further ones.
LOOKS = (style.VERMILION, style.BLUE, style.GREEN)
STATE = {"theta": 0, "theta_rate": 1, "psi": 2}
LABELS = {"theta": "hoop angle (rad)", "theta_rate": "hoop speed\n(rad/s)", "psi": "ball angle (rad)"}
TORQUE_IN, SIGNAL_IN = 0.8, 1.5
BEYOND = 0.35  # of the measured range: a run that leaves it by more would squeeze the data

Runs = Mapping[str, Sequence[FitScore]]


def draw_fits(
    recordings: Sequence[Recording], runs: Runs, title: str = "", *, detail_s: tuple[float, float] | None = None
) -> Figure:
    """Stretches of one experiment, and for each model by name its scores on them, in the same order.

    detail_s: a part of the time for which the last signal is drawn once more, larger.
    """
    rows = _rows(next(iter(runs.values())))
    with_torque = any(np.ptp(one.u[np.isfinite(one.u)]) > 0.0 for one in recordings)
    details = [rows[-1]] if detail_s is not None else []
    heights = [*([TORQUE_IN] if with_torque else []), *([SIGNAL_IN] * len([*rows, *details]))]
    tall_in = sum(heights) + 0.9 + 0.2 * len(heights)
    figure = style.figure(7.0, tall_in, rows=len(heights), height_ratios=heights, title=title)
    axes = list(figure.axes)
    if with_torque:
        _torque(axes[0], recordings)
    for one, name in zip(axes[int(with_torque) :], (*rows, *details), strict=True):
        _signal(one, name, recordings, runs)
    whole = axes[: len(axes) - len(details)]
    for one in whole:
        one.set_xlim(recordings[0].t[0], recordings[-1].t[-1])
        one.tick_params(labelbottom=one is whole[-1])
    if detail_s is not None:
        axes[-1].set_xlim(*detail_s)
        if (shown := axes[-1].get_legend()) is not None:
            shown.remove()
    axes[-1].set_xlabel("time (s)")
    figure.align_ylabels(axes)
    return figure


def _rows(scores: Sequence[FitScore]) -> tuple[str, ...]:
    """Signals that move."""
    return {"both": ("theta", "theta_rate", "psi"), "hoop": ("theta", "theta_rate"), "ball": ("psi",)}[scores[0].moving]


def _torque(axes: Axes, recordings: Sequence[Recording]) -> None:
    for one in recordings:
        axes.step(one.t, one.u, where="post", color=style.BLACK, linewidth=0.5)
    axes.set_ylabel("torque\n(N m)")


def _signal(axes: Axes, name: str, recordings: Sequence[Recording], runs: Runs) -> None:
    """Measured points with the models' free runs over them."""
    low, high = _measured(axes, name, recordings, next(iter(runs.values())))
    for (model, scores), colour in zip(runs.items(), LOOKS, strict=False):
        label: str | None = f"{model}{_percent(scores, name)}"
        for one in scores:
            for run in one.runs:
                axes.plot(run.part.t, run.states[:, STATE[name]], color=colour, linewidth=1.0, label=label)
                label = None
    room = BEYOND * (high - low)
    axes.set_ylim(max(axes.get_ylim()[0], low - room), min(axes.get_ylim()[1], high + room))
    axes.set_ylabel(LABELS[name])
    # above the axes: there is data everywhere inside
    style.legend(axes, loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=4, borderaxespad=0.1, markerscale=3.0,
                 handlelength=1.2, columnspacing=1.2)  # fmt: skip


def _measured(
    axes: Axes, name: str, recordings: Sequence[Recording], scores: Sequence[FitScore]
) -> tuple[float, float]:
    """Lowest and highest of what was measured; samples that are no measurement are grey."""
    parts = [_points(name, recording, score) for recording, score in zip(recordings, scores, strict=True)]
    t, y, fresh = (np.concatenate(column) for column in zip(*parts, strict=True))
    axes.plot(t[fresh], y[fresh], ".", color=style.BLACK, markersize=1.8, label="measured")
    if not fresh.all():
        axes.plot(t[~fresh], y[~fresh], ".", color="#AAAAAA", markersize=1.8, label="set aside")
    return float(y[fresh].min()), float(y[fresh].max())


def _points(
    name: str, recording: Recording, score: FitScore
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    if name == "theta":
        angle = recording.channels[name]
        known = np.isfinite(angle.values)
        return angle.t[known], angle.values[known], np.ones(int(known.sum()), bool)
    trace = score.traces[name]
    return trace.t, trace.measured, trace.fresh


def _percent(scores: Sequence[FitScore], name: str) -> str:
    """Fit of each stretch; the hoop angle has none of its own, its rate is judged."""
    if name not in scores[0].channels:
        return ""
    return ": " + ", ".join(f"{one.channels[name].nrmse_percent:.1f}" for one in scores) + " %"
