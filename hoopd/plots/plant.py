"""The figure of a plant's free run.

Rules of this file: draws what it is given and computes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from hoopd.plots.style import BLUE, figure

WIDTH_IN, ROW_IN, HEAD_IN = 8.0, 1.5, 0.8


def draw_free_run(name: str, units: Mapping[str, str], t: Any, states: Any) -> Figure:
    """States (n, nx) over t (n,) s, one below the other; `units`: by the names of the states in their order."""
    made = figure(
        WIDTH_IN, HEAD_IN + ROW_IN * len(units), rows=len(units), title=f"{name}: free run", sharex=True, squeeze=False
    )
    for row, (axes, (state, unit)) in enumerate(zip(made.axes, units.items(), strict=True)):
        axes.plot(t, states[:, row], color=BLUE)
        axes.set_ylabel(f"{state}\n({unit})" if unit else state)
    made.axes[-1].set_xlabel("time (s)")
    made.axes[-1].set_xlim(t[0], t[-1])
    made.align_ylabels(made.axes)
    return made
