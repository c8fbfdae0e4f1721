"""Fitted parameters with their intervals.

Rules of this file: draws what it is given; the only sum is a quotient, value by value.
"""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from hoopd.plots import style

# Beyond this many percent an interval runs out of the picture: the parameter is hardly known.
WIDEST_PERCENT = 100.0


def draw_intervals(
    values: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
    truth: Mapping[str, float] | None = None,
    title: str = "95 % intervals, relative to the fitted value",
) -> Figure:
    """One row a parameter: its interval in percent of its value, and where the true value lies."""
    names = list(intervals)[::-1]
    figure = style.figure(8.0, 1.3 + 0.4 * len(names), title=title)
    axes = figure.axes[0]
    for row, name in enumerate(names):
        low, high = (100.0 * (end / values[name] - 1.0) for end in intervals[name])
        axes.plot((low, high), (row, row), color=style.BLUE, linewidth=5.0, alpha=0.5, solid_capstyle="butt")
        axes.plot(0.0, row, "o", color=style.BLUE, label="fitted" if row == 0 else None)
        if truth is not None and name in truth:
            axes.plot(
                100.0 * (truth[name] / values[name] - 1.0), row, "x", color=style.VERMILION, markeredgewidth=2,
                label="true" if row == 0 else None,
            )  # fmt: skip
    axes.set_yticks(range(len(names)), [f"{name} = {values[name]:.4g}" for name in names])
    left, right = axes.get_xlim()
    axes.set_xlim(max(left, -WIDEST_PERCENT), min(right, WIDEST_PERCENT))
    style.labelled(axes, "deviation (%)", "")
    style.legend(axes)
    return figure
