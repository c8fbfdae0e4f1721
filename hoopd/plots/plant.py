"""Figures of a plant's free run, alone and against a recording.

Rules of this file: draws what it is given and computes nothing but differences.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from hoopd.plots.style import BLACK, BLUE, GREY, VERMILION, figure, legend
from hoopd.recording.recording import Recording, Signal

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


def draw_comparison(name: str, measured: Recording, simulated: Recording, percent: Mapping[str, float]) -> Figure:
    """Inputs, then each channel measured and simulated with the difference below; `percent`: fit by channel."""
    rows = len(simulated.inputs) + sum(2 if channel in percent else 1 for channel in simulated.channels)
    title = f"{measured.source}: free run of {name}"
    made = figure(WIDTH_IN, HEAD_IN + ROW_IN * rows, rows=rows, title=title, sharex=True, squeeze=False)
    axes = iter(made.axes)
    for label, signal in simulated.inputs.items():
        here = next(axes)
        here.step(signal.t, signal.values, where="post", color=BLACK, linewidth=0.7)
        here.set_ylabel(_label(label, signal))
    for label, signal in simulated.channels.items():
        here = next(axes)
        here.set_ylabel(_label(label, signal))
        if label in percent:
            seen = measured.channels[label]
            here.plot(seen.t, seen.values, ".", color=BLACK, markersize=2.2, label="measured")
            here.set_title(f"fit {percent[label]:.1f} %", loc="right", fontsize=9, color=GREY)
        here.plot(signal.t, signal.values, color=VERMILION, label="simulated")
        legend(here, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1, markerscale=3)
        if label in percent:
            rest = next(axes)
            rest.axhline(0.0, color=GREY, linewidth=0.8)
            rest.plot(signal.t, measured.channels[label].values - signal.values, color=BLUE, linewidth=0.9)
            rest.set_ylabel(f"difference\n({signal.unit})" if signal.unit else "difference")
    made.axes[-1].set_xlabel("time (s)")
    made.axes[-1].set_xlim(measured.t[0], measured.t[-1])
    made.align_ylabels(made.axes)
    return made


def _label(name: str, signal: Signal) -> str:
    return f"{name}\n({signal.unit})" if signal.unit else name
