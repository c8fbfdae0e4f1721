"""What was believed after each run of a campaign.

Rules of this file: draws numbers as they were told; computes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from hoopd.plots import style

NOBODY_KNOWS = "none of these"
Shares = Sequence[tuple[str, float]]


def draw_beliefs(runs: Sequence[tuple[str, Shares]]) -> Figure:
    """A bar for every run, stacked of the probabilities of what was thought likely: the same colour is the same law."""
    figure = style.figure(8.0, 1.3 + 0.55 * len(runs), title="What was believed after each run")
    (axes,) = figure.axes
    colours = _colours(runs)
    shown: set[str] = set()
    for place, (_, shares) in enumerate(runs):
        left = 0.0
        for name, share in _at_most_one(shares):
            label = None if name in shown else name
            axes.barh(place, share, left=left, color=colours[name], edgecolor="white", height=0.62, label=label)
            shown.add(name)
            left += share
    axes.set_yticks(range(len(runs)), [name for name, _ in runs])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.0)
    style.labelled(axes, "probability", "")
    style.legend(axes, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _colours(runs: Sequence[tuple[str, Shares]]) -> dict[str, str]:
    names = dict.fromkeys(name for _, shares in runs for name, _ in shares if name != NOBODY_KNOWS)
    return {NOBODY_KNOWS: "#BBBBBB", **{name: style.COLOURS[k % len(style.COLOURS)] for k, name in enumerate(names)}}


def _at_most_one(shares: Shares) -> list[tuple[str, float]]:
    """Several laws may act at once: then each has its share of the bar."""
    total = max(1.0, sum(share for _, share in shares))
    return [(name, share / total) for name, share in shares]
