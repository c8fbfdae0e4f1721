"""Figure of a calibration by a test signal: what was measured, and what was foretold.

Rules of this file: draws what it is given and computes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from hoopd.plots.style import BLACK, VERMILION, figure, legend

WIDTH_IN, ROW_IN, HEAD_IN = 8.0, 2.0, 0.6


def draw_moving(name: str, drawings: Sequence[Mapping[str, Any]]) -> Figure:
    """Drawings (`x`, `y`, `curves` of points, lines or steps) below each other; `name`: of the recording."""
    made = figure(WIDTH_IN, HEAD_IN + ROW_IN * len(drawings), rows=len(drawings), title=name, squeeze=False)
    for axes, drawing in zip(made.axes, drawings, strict=True):
        for curve in drawing["curves"]:
            if curve["kind"] == "points":
                axes.plot(curve["x"], curve["y"], ".", color=BLACK, markersize=2.2, label=curve["label"])
            else:
                style = "steps-post" if curve["kind"] == "steps" else "default"
                axes.plot(curve["x"], curve["y"], drawstyle=style, color=VERMILION, linewidth=1.0, label=curve["label"])
        axes.set_xlabel(drawing["x"])
        axes.set_ylabel(drawing["y"])
        legend(axes, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1, markerscale=3)
    return made
