"""Curves and recordings by name, over each other.

Rules of this file: draws what it is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hoopd.plots import style
from hoopd.recording.recording import Recording

# Of each row of a figure of recordings: signal, its times, label.
ROWS = (
    ("psi", "psi_t", "ball angle (rad)"),
    ("dtheta", "y_t", "hoop speed (rad/s)"),
    ("u", "t", "torque (N m)"),
)


def draw_curves(curves: Mapping[str, tuple[Any, Any]], x: str, y: str, title: str = "") -> Figure:
    """Lines through (x, y) by name; `x` and `y` label the axes, units in parentheses."""
    figure = style.figure(8.0, 4.2, title=title)
    axes = figure.axes[0]
    for name, (across, up) in curves.items():
        axes.plot(across, up, label=name or None)
    style.labelled(axes, x, y)
    axes.margins(x=0.0)
    style.legend(axes)
    return figure


def draw_recordings(recordings: Mapping[str, Recording], title: str = "") -> Figure:
    """Ball angle, hoop speed and torque of recordings by name, missing samples left out."""
    figure = style.figure(9.0, 7.0, rows=3, title=title, sharex=True)
    for axes, (signal, times, label) in zip(figure.axes, ROWS, strict=True):
        for name, recording in recordings.items():
            t, values = getattr(recording, times), getattr(recording, signal)
            known = np.isfinite(t) & np.isfinite(values)
            how = "steps-post" if signal == "u" else "default"
            axes.plot(t[known], values[known], label=name, drawstyle=how, linewidth=1.0)
        axes.set_ylabel(label)
        axes.margins(x=0.0)
    _wanted(figure.axes[0], next(iter(recordings.values())))
    figure.align_ylabels(figure.axes)
    figure.axes[-1].set_xlabel("time (s)")
    style.legend(figure.axes[0], loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(recordings) + 1)
    return figure


def _wanted(axes: Axes, recording: Recording) -> None:
    """The reference, where one was asked for."""
    reference = np.asarray(recording.extra.get("reference", ()), float)
    if np.any(reference):
        axes.step(recording.t, reference, where="post", color=style.GREY, linestyle=":", linewidth=1.2, label="wanted")
