"""An alternating run of two controllers: what decides, by pair, and the change with its interval as pairs were added.

Rules of this file: draws a result as it was told; computes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hoopd.plots import style

# By what decides: its place in a result, an axis' label, a name.
MEASURES = {
    "ball": ("ball_rms_rad", "ball's error (rad rms)", "the ball's error"),
    "cost": ("cost", "mean cost of a tick", "cost"),
}


def draw_comparison(result: Mapping[str, Any]) -> Figure:
    """Pairs of what decides at the left, at the right what the candidate changes, in percent, after each pair."""
    figure = style.figure(9.0, 3.8, columns=2, title=f"The candidate is {result['verdict'] or 'being tried'}")
    measure, unit, name = MEASURES[result.get("judged_by", "cost")]
    _pairs(figure.axes[0], [one[measure] for one in result["pairs"]], unit)
    _change(figure.axes[1], result[measure]["intervals_percent"], result[measure]["change_percent"], name)
    return figure


def _pairs(axes: Axes, pairs: list[dict[str, float]], unit: str) -> None:
    places = range(1, len(pairs) + 1)
    for name, colour, mark in (("accepted", style.BLUE, "o"), ("candidate", style.VERMILION, "s")):
        axes.plot(places, [one[name] for one in pairs], mark, color=colour, label=name)
    for place, one in zip(places, pairs, strict=True):
        axes.plot([place, place], list(one.values()), color=style.GREY, linewidth=0.8, zorder=1)
    style.labelled(axes, "pair", unit, "both blocks of each pair")
    axes.margins(y=0.3)
    axes.set_xticks(list(places))
    style.legend(axes)


def _change(axes: Axes, intervals: list[list[float | None]], change: float | None, name: str) -> None:
    known = [(k, low, high) for k, (low, high) in enumerate(intervals, 1) if low is not None and high is not None]
    for k, low, high in known:
        axes.plot([k, k], [low, high], color=style.BLUE, solid_capstyle="butt", linewidth=3.0)
    if change is not None and known:
        axes.plot([known[-1][0]], [change], "o", color=style.BLACK)
    axes.axhline(0.0, color=style.GREY, linestyle="--", linewidth=0.9)
    axes.set_xlim(0.5, max(1, len(intervals)) + 0.5)
    axes.set_xticks(range(1, len(intervals) + 1))
    style.labelled(axes, "pairs so far", f"change of {name} (%)", "candidate against accepted, with its interval")
