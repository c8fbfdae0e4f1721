"""Curves of a diagnosis: the missing force over what it follows, its harmonics, held-out data before and after.

Rules of this file: draws what it is given; SI units on every axis; long series are thinned evenly, never smoothed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from hoopd.plots import style
from hoopd.plots.number_format import unit_text

if TYPE_CHECKING:
    from hoopd.diagnose.record import Curve
    from hoopd.diagnose.report_curves import Comparison, Harmonics, MissingForce, Regressor, Trace
from hoopd.plots.diagnosis import LEAST_TIME_S, WIDTH_IN, plain, shade

Array = NDArray[np.float64]

# More dots than this hide one another, more points of a line are narrower than a pixel.
MOST_DOTS, MOST_POINTS = 700, 4000
MOST_PANELS = 3
# Of the measured range: a simulation that leaves it by more would squeeze the data.
BEYOND = 0.4


def draw_force(force: MissingForce) -> Figure:
    """The smoothed missing force over each regressor, with bins and the named law, and over time."""
    panels = list(force.regressors)[:MOST_PANELS]
    names = [f"over {index}" for index in range(len(panels))]
    rows = [names, ["time"] * len(names)] if names else [["time"]]
    figure = style.figure(WIDTH_IN, 5.0 if names else 2.0, mosaic=rows, height_ratios=[3, 1.4][-len(rows) :])
    axes = style.named(figure)
    for name, regressor in zip(names, panels, strict=True):
        _over(axes[name], force, regressor)
    for name in names[1:]:
        axes[name].sharey(axes[names[0]])
    thin = slice(None, None, 1 + len(force.t_s) // MOST_POINTS)
    axes["time"].plot(force.t_s[thin], force.value[thin], color=style.BLUE, linewidth=0.7)
    axes["time"].margins(x=0.0)
    style.labelled(axes["time"], "time (s)", _label(force.unit, "missing", f"in {force.slot}"))
    if names:
        handles, labels = axes[names[0]].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=style.NOTE_PT, frameon=False)
        axes[names[0]].set_ylabel(_label(force.unit, f"{'error of' if force.reading else 'missing in'} {force.slot}"))
    return figure


def _over(axes: Axes, force: MissingForce, regressor: Regressor) -> None:
    thin = slice(None, None, 1 + len(force.value) // MOST_DOTS)
    axes.plot(regressor.value[thin], force.value[thin], ".", color=style.SKY, markersize=2.2, label="smoothed")
    if (bins := regressor.binned) is not None:
        error = [bins.mean - bins.low, bins.high - bins.mean]
        axes.errorbar(bins.x, bins.mean, error, fmt="o", color=style.BLUE, markersize=3.5, capsize=2,
                      linewidth=1.0, label="mean, 95 % band")  # fmt: skip
    if (law := regressor.law) is not None:
        if law.is_curve:
            axes.plot(law.x, law.y, color=style.VERMILION, linewidth=2.0, label=plain(law.label))
        else:
            axes.plot(law.x[thin], law.y[thin], ".", color=style.VERMILION, markersize=3.0, label=plain(law.label))
    axes.set_title(_what_it_is(regressor), fontsize=style.NOTE_PT, loc="left")
    axes.set_xlabel(_label(regressor.unit, regressor.name))


def _what_it_is(regressor: Regressor) -> str:
    """What a panel shows, in words."""
    return f"over one turn of {plain(regressor.name)}" if regressor.turning else f"over {plain(regressor.name)}"


def draw_curve(curve: Curve) -> Figure:
    """The fitted curve of an unknown effect with its band."""
    figure = style.figure(WIDTH_IN, 3.0)
    axes = figure.axes[0]
    x, y, low, high = (np.array(column, float) for column in (curve.x, curve.y, curve.low, curve.high))
    if len(low) == len(high) == len(x):
        axes.fill_between(x, low, high, color=style.BLUE, alpha=0.2, linewidth=0.0, label="95 % band")
    axes.plot(x, y, color=style.BLUE, label="fitted")
    style.labelled(axes, _label(curve.regressor_unit, curve.regressor), _label(curve.unit, "unknown effect"))
    style.legend(axes)
    return figure


def draw_harmonics(harmonics: Harmonics) -> Figure:
    """Amplitude by order of the angle."""
    figure = style.figure(WIDTH_IN, 2.6)
    axes = figure.axes[0]
    axes.bar(harmonics.order, harmonics.amplitude, color=style.BLUE, width=0.35)
    if harmonics.threshold is not None:
        axes.step(harmonics.order, harmonics.threshold, where="mid", color=style.GREY, linestyle="--",
                  label="what noise reaches")  # fmt: skip
    style.labelled(axes, f"periods in a turn of {plain(harmonics.angle)}", _label(harmonics.unit, "amplitude"))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    style.legend(axes)
    return figure


def draw_comparison(comparison: Comparison) -> Figure:
    """Measured and simulated channels, and below each what remains of them."""
    traces = [one for one in comparison.traces if len(one.t_s)]
    figure = style.figure(WIDTH_IN, 0.7 + 2.6 * len(traces), rows=2 * len(traces), sharex=True,
                          height_ratios=[1.7, 1.0] * len(traces))  # fmt: skip
    for index, trace in enumerate(traces):
        _simulated(figure.axes[2 * index], trace)
        _residual(figure.axes[2 * index + 1], trace)
    for axes in figure.axes:
        axes.margins(x=0.0)
        axes.set_xlim(*_span(comparison))
        shade(axes, comparison.ignored)
    style.legend(figure.axes[0], loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=3, borderaxespad=0.1)
    figure.axes[-1].set_xlabel("time (s)")
    figure.align_ylabels(figure.axes)
    return figure


def cut_s(comparison: Comparison) -> float | None:
    """Seconds that are drawn of a comparison that is too long to be drawn whole; None for all others."""
    longest = max((one.t_s for one in comparison.traces), key=len)
    return _last(longest) - float(longest[0]) if len(longest) > MOST_POINTS else None


def _last(t: Array) -> float:
    """Where a trace (n,) ends as far as it is drawn: a pen that is lifted there has no time."""
    return float(np.nanmax(t[:MOST_POINTS]))


def _span(comparison: Comparison) -> tuple[float, float]:
    """Start and end of what is drawn [s]."""
    times = [one.t_s for one in comparison.traces if len(one.t_s)]
    start, end = min(float(t[0]) for t in times), max(map(_last, times))
    return start, max(end, start + LEAST_TIME_S)


def _simulated(axes: Axes, trace: Trace) -> None:
    trace = _first(trace)
    axes.plot(trace.t_s, trace.measured, color="#B0B0B0", linewidth=3.0, label="measured")
    axes.plot(trace.t_s, trace.before, color=style.VERMILION, linewidth=0.9, label="before: base re-fitted")
    if trace.after is not None:
        axes.plot(trace.t_s, trace.after, color=style.BLUE, linewidth=0.9, label="after: with the effects")
    _within(axes, trace.measured)
    axes.set_ylabel(_label(trace.unit, trace.name))


def _residual(axes: Axes, trace: Trace) -> None:
    """Measured less simulated."""
    trace = _first(trace)
    rest = [(trace.before, style.VERMILION), (trace.after, style.BLUE)]
    for simulated, colour in rest:
        if simulated is not None:
            axes.plot(trace.t_s, trace.measured - simulated, color=colour, linewidth=0.7)
    _within(axes, trace.measured - trace.before)
    axes.set_ylabel(_label(trace.unit, "rest"))


def _first(trace: Trace) -> Trace:
    """As many samples as are drawn."""
    part = slice(MOST_POINTS)
    after = None if trace.after is None else trace.after[part]
    cut = {name: getattr(trace, name)[part] for name in ("t_s", "measured", "before")}
    return replace(trace, **cut, after=after)


def _within(axes: Axes, measured: Array) -> None:
    """Limits that hold the data whatever a simulation does."""
    known = measured[np.isfinite(measured)]
    if len(known) and (room := BEYOND * float(np.ptp(known))) > 0.0:
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, known.min() - room), min(high, known.max() + room))


def _label(unit: str, *lines: str) -> str:
    """An axis label: "psi (rad)", on several lines where there are several."""
    raised = unit_text(unit)
    return "\n".join([*map(plain, lines[:-1]), plain(f"{lines[-1]} ({raised})" if raised else lines[-1])])
