"""Runs of the whole device by name: ball angle as the camera sees it, hoop speed, torque.

Rules of this file: draws what it is given; a run is columns of one length, missing pictures are NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hoopd.plots import style

Array = NDArray[np.float64]


class DeviceRun(NamedTuple):
    """One row a tick."""

    t: Array  # s
    psi: Array  # rad, NaN without a new picture
    dtheta: Array  # rad/s
    u: Array  # N m
    reference: Array | None = None  # rad


LABELS = ("ball angle (rad)", "hoop speed (rad/s)", "torque (N m)")


def draw_device(
    runs: Mapping[str, DeviceRun],
    title: str = "",
    *,
    colours: tuple[str, ...] = style.COLOURS,
    psi_label: str = LABELS[0],
    psi_limits: tuple[float, float] | None = None,
    torque_limits: tuple[float, float] | None = None,
) -> Figure:
    """Three panels over one time; the first run below the others, a common reference dashed."""
    figure = style.figure(7.0, 6.2, rows=3, sharex=True, title=title)
    ball, hoop, torque = figure.axes
    for (name, run), colour in zip(runs.items(), colours, strict=False):
        seen = np.isfinite(run.psi)
        ball.plot(run.t[seen], run.psi[seen], color=colour, linewidth=1.1)
        hoop.plot(run.t, run.dtheta, color=colour, linewidth=1.3, label=name)
        torque.step(run.t, run.u, where="post", color=colour, linewidth=0.9)
    first = next(iter(runs.values()))
    if first.reference is not None:
        ball.step(
            first.t, first.reference, where="post", color=style.BLACK, linewidth=1.0, linestyle="--", label="reference"
        )
        style.legend(ball)
    for axes, label in zip(figure.axes, (psi_label, *LABELS[1:]), strict=True):
        axes.set_ylabel(label)
    for axes, limits in ((ball, psi_limits), (torque, torque_limits)):
        if limits is not None:
            axes.set_ylim(*limits)
    torque.set_xlabel("time (s)")
    torque.set_xlim(first.t[0], first.t[-1])
    style.legend(hoop, loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=len(runs), borderaxespad=0.1)
    figure.align_ylabels()
    return figure
