"""Runs of the whole device by name: ball angle as the camera sees it, hoop speed, torque.

Rules of this file: draws what it is given; a run is columns of one length, missing pictures are NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hoopd.plots import style

Array = NDArray[np.float64]
LABELS = ("ball angle (rad)", "hoop speed (rad/s)", "torque (N m)")


class DeviceRun(NamedTuple):
    """One row a tick."""

    t: Array  # s
    ball_angle: Array  # rad, NaN without a new picture
    dtheta: Array  # rad/s
    u: Array  # N m
    reference: Array | None = None  # rad


def draw_device(
    runs: Mapping[str, DeviceRun],
    title: str = "",
    *,
    colours: tuple[str, ...] = style.COLOURS,
    widths_pt: tuple[float, ...] = (1.3,) * len(style.COLOURS),
    psi_label: str = LABELS[0],
) -> Figure:
    """Three panels over one time; a reference that all follow is dashed."""
    figure = style.figure(7.0, 6.2, rows=3, sharex=True, title=title)
    ball, hoop, torque = figure.axes
    for (name, run), colour, width in zip(runs.items(), colours, widths_pt, strict=False):
        seen = np.isfinite(run.ball_angle)
        look: dict[str, Any] = {"color": colour, "linewidth": width}
        ball.plot(run.t[seen], run.ball_angle[seen], label=name, **look)
        hoop.plot(run.t, run.dtheta, **look)
        torque.step(run.t, run.u, where="post", **look)
    first = next(iter(runs.values()))
    if first.reference is not None:
        look = {"color": style.BLACK, "linewidth": 1.0, "linestyle": "--"}
        ball.step(first.t, first.reference, where="post", label="reference", **look)
    for axes, label in zip(figure.axes, (psi_label, *LABELS[1:]), strict=True):
        axes.set_ylabel(label)
    torque.set_xlabel("time (s)")
    torque.set_xlim(first.t[0], first.t[-1])
    style.legend(ball, loc="lower left", bbox_to_anchor=(-0.02, 0.99), ncols=len(runs) + 1, borderaxespad=0.1,
                 handlelength=1.4, columnspacing=1.2)  # fmt: skip
    figure.align_ylabels()
    return figure
