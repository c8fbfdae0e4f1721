"""Curves by name over one pair of axes.

Rules of this file: draws what it is given.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from hoopd.plots import style


def draw_curves(curves: Mapping[str, tuple[Any, Any]], x: str, y: str, title: str = "") -> Figure:
    """Lines through (x, y) by name; `x` and `y` label the axes, units in brackets."""
    figure = style.figure(8.0, 4.2, title=title)
    axes = figure.axes[0]
    for name, (across, up) in curves.items():
        axes.plot(across, up, label=name or None)
    style.labelled(axes, x, y)
    axes.margins(x=0.0)
    style.legend(axes)
    return figure
