"""A Bode plot whose exact phase margin stands beside a printed one, enlarged where the two differ.

Rules of this file: draws what `hoopd.design` found and what was printed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import control
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hoopd.design.analysis import minimal
from hoopd.design.margins import margins
from hoopd.design.response import response
from hoopd.plots import style
from hoopd.plots.linear import draw_bode

REACH = 4.0  # width of the enlarged part, in distances between the two points


class PrintedMargin(NamedTuple):
    """A phase margin as somebody printed it."""

    w_rad_s: float
    degrees: float


def draw_bode_beside(system: control.StateSpace, printed: PrintedMargin, title: str = "") -> Figure:
    """Bode of a plant with unit feedback; inset: phase above -180 degrees near the crossover."""
    figure = draw_bode(system, title)
    phase = figure.axes[1]
    _enlarged(phase, system, printed)
    style.legend(phase, loc="upper left", bbox_to_anchor=(0.08, 0.94))
    return figure


def _enlarged(axes: Axes, system: control.StateSpace, printed: PrintedMargin) -> None:
    inset = style.styled(axes.inset_axes((0.10, 0.22, 0.40, 0.52)))
    found = margins(system)
    reach = REACH * abs(printed.w_rad_s - found.phase_rad_s)
    w = np.linspace(found.phase_rad_s - reach, found.phase_rad_s + reach, 50)
    above = np.degrees(np.angle(-response(minimal(system).system, w)))
    inset.plot(w, above, color=style.BLUE)
    exact = math.degrees(found.phase_rad)
    inset.plot(found.phase_rad_s, exact, "o", color=style.VERMILION, markersize=5, label=f"|P| = 1: {exact:.4f}°")
    inset.plot(printed.w_rad_s, printed.degrees, "s", color=style.PURPLE, markersize=5,
               label=f"printed: {printed.degrees:.4f}°")  # fmt: skip
    inset.set_title("phase + 180° (deg) near the crossover (rad/s)", fontsize=style.NOTE_PT)
    inset.tick_params(labelsize=style.NOTE_PT - 1.5)
    inset.ticklabel_format(useOffset=False)
    inset.locator_params(axis="x", nbins=4)
    style.legend(inset, loc="lower left", fontsize=style.NOTE_PT - 1.0)
