"""The closed loop of any plant in time, nonlinear against linear.

Rules of this file: data in, `Figure` out; nothing is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from hoopd.plots.plant import HEAD_IN, ROW_IN, WIDTH_IN
from hoopd.plots.style import BLUE, GREY, VERMILION, figure, legend


def draw_plant_loop(
    t: Any,
    nonlinear: Mapping[str, Any],
    linear: Mapping[str, Any],
    *,
    units: Mapping[str, str],
    inputs: Mapping[str, float | None],
    title: str,
) -> Figure:
    """Signals (n,) over t (n,) s by name, one below the other; `inputs`: those that are held, with their limits."""
    made = figure(
        WIDTH_IN, HEAD_IN + ROW_IN * len(nonlinear), rows=len(nonlinear), title=title, sharex=True, squeeze=False
    )
    for axes, (name, values) in zip(made.axes, nonlinear.items(), strict=True):
        drawn = axes.plot if name not in inputs else axes.step
        held: dict[str, Any] = {} if name not in inputs else {"where": "post"}
        drawn(t, values, color=BLUE, label="plant", **held)
        low, high = axes.get_ylim()
        drawn(t, linear[name], color=VERMILION, linestyle="--", label="linear model", **held)
        limit = inputs.get(name)
        for level in () if limit is None else (-limit, limit):
            if low <= level <= high:
                axes.axhline(level, color=GREY, linewidth=0.8, linestyle=":")
        unit = units.get(name, "")
        axes.set_ylabel(f"{name}\n({unit})" if unit else name)
        axes.margins(x=0.0)
    legend(made.axes[0], loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1)
    made.axes[-1].set_xlabel("time (s)")
    made.align_ylabels(made.axes)
    return made
