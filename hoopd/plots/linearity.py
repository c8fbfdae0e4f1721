"""The linear model against the nonlinear plant: released at several angles, and with recorded torques.

Rules of this file: draws what it is given and computes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hoopd.plots import style

Array = NDArray[np.float64]
BEYOND = 1.6  # of the nonlinear run's range: a linear swing may run away from the picture


class ComparedRuns(NamedTuple):
    """Ball angle (rad) of both over the same time; measured samples with their nodes where there are any."""

    name: str
    t: Array
    nonlinear: Array
    linear: Array
    measured_t: Array | None = None
    measured: Array | None = None
    nodes: NDArray[np.int64] | None = None


def draw_linearity(released: Sequence[ComparedRuns], played: Sequence[ComparedRuns], title: str = "") -> Figure:
    """Released runs side by side above, played ones one below the other."""
    tops = [f"released {k}" for k in range(len(released))]
    rows = [[f"played {k}"] * len(tops) for k in range(len(played))]
    figure = style.figure(7.0, 2.3 + 2.0 * len(played), mosaic=[tops, *rows], title=title)
    axes = style.named(figure)
    for one, compared in zip([axes[name] for name in tops], released, strict=True):
        _compare(one, compared)
    for (name, *_), compared in zip(rows, played, strict=True):
        _compare(axes[name], compared)
    below = axes[rows[0][0]] if rows else axes[tops[0]]
    style.legend(below, loc="lower right", bbox_to_anchor=(1.01, 0.98), ncols=3, borderaxespad=0.1, markerscale=3.0)
    figure.align_ylabels()
    return figure


def _compare(axes: Axes, one: ComparedRuns) -> None:
    if one.measured is not None and one.measured_t is not None:
        axes.plot(one.measured_t, one.measured, ".", color=style.BLACK, markersize=1.8, label="measured")
    axes.plot(one.t, one.nonlinear, color=style.BLUE, linewidth=1.2, label="nonlinear")
    axes.plot(one.t, one.linear, color=style.ORANGE, linewidth=1.2, linestyle="--", label="linear")
    largest = BEYOND * float(np.abs(one.nonlinear).max())
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, -largest), min(high, largest))
    style.labelled(axes, "time (s)", "ball angle (rad)")
    axes.set_title(one.name, loc="left", fontsize=style.TITLE_PT)
    axes.set_xlim(one.t[0], one.t[-1])
