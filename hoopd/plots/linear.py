"""Figures of a linear model: Bode, Nyquist, pole-zero map, step response, with the margins marked.

Rules of this file: a system of one input and one output in, a figure out; every number that stands in a figure comes
from `hoopd.design`. The states that the output does not see are left out of every curve.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import control
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from hoopd.design.analysis import minimal
from hoopd.design.speed import step_info
from hoopd.ident.transfer_functions import zeros
from hoopd.plots.frequency import bode_on, curve_on, nyquist_on, response_curve, unit
from hoopd.plots.style import BLUE, GREEN, GREY, NOTE_PT, VERMILION, figure, labelled, legend, named

Array = NDArray[Any]

WORDS = {"theta": "hoop angle", "dtheta": "hoop speed", "psi": "ball angle", "dpsi": "ball speed"}


def draw_bode(system: control.StateSpace, title: str = "", delay_s: float = 0.0) -> Figure:
    """Gain and phase with crossovers, margins and both bandwidths."""
    made = figure(7.5, 6.0, rows=2, sharex=True, title=title)
    bode_on(made.axes[0], made.axes[1], system, delay_s)
    return made


def draw_nyquist(system: control.StateSpace, title: str = "", delay_s: float = 0.0) -> Figure:
    """The whole curve, and the part around -1 with the unit circle and the nearest approach."""
    made = figure(10.0, 5.2, columns=2, title=title)
    whole, near = made.axes
    nyquist_on(near, system, delay_s)
    curve_on(whole, response_curve(system, delay_s)[1])
    whole.plot(-1.0, 0.0, "+", color=VERMILION, markersize=10, markeredgewidth=2)
    whole.set_aspect("equal", adjustable="datalim")
    labelled(whole, "Re L", "Im L", "Nyquist, whole curve")
    return made


def draw_poles(system: control.StateSpace, title: str = "") -> Figure:
    """Poles and zeros with their values."""
    made = figure(6.5, 5.5, title=title)
    poles_on(made.axes[0], system)
    return made


def draw_step(system: control.StateSpace, title: str = "") -> Figure:
    """Response to a torque of 1 N m with peak, final value and settling."""
    made = figure(7.5, 4.2, title=title)
    step_on(made.axes[0], system)
    return made


def draw_overview(system: control.StateSpace, title: str = "") -> Figure:
    """All four on one page."""
    made = figure(12.5, 9.0, mosaic=[["gain", "nyquist"], ["phase", "nyquist"], ["step", "poles"]], title=title)
    axes = named(made)
    axes["gain"].sharex(axes["phase"])
    bode_on(axes["gain"], axes["phase"], system)
    nyquist_on(axes["nyquist"], system)
    step_on(axes["step"], system)
    poles_on(axes["poles"], system)
    return made


DRAWINGS: dict[str, Callable[..., Figure]] = {
    "overview": draw_overview,
    "bode": draw_bode,
    "nyquist": draw_nyquist,
    "poles": draw_poles,
    "step": draw_step,
}


# ---------------------------------------------------------------------------------------------- poles and zeros


def poles_on(axes: Axes, system: control.StateSpace) -> None:
    """Poles x, zeros o with values; what cancels by name is grey."""
    less, discrete = minimal(system), system.isdtime(strict=True)
    poles, roots = less.system.poles(), zeros(less.system)
    if discrete:
        axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=GREY, linestyle="--", linewidth=0.9))
        axes.set_aspect("equal", adjustable="datalim")
    else:
        axes.axvline(0.0, color=GREY, linewidth=0.9, linestyle="--")
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    # near z = 1 there is no room beside the marks: values go into the legend
    texts = [f"poles {_values(poles)}", f"zeros {_values(roots)}"] if discrete else ["poles", "zeros"]
    axes.plot(poles.real, poles.imag, "x", color=BLUE, markersize=9, markeredgewidth=2, label=texts[0])
    axes.plot(roots.real, roots.imag, "o", color=VERMILION, markersize=8, fillstyle="none", label=texts[1])
    if less.unseen:
        centre = 1.0 if discrete else 0.0
        text = f"cancelled: {', '.join(less.unseen)}"
        axes.plot(
            [centre] * 2,
            [0.0] * 2,
            marker="s",
            fillstyle="none",
            color=GREY,
            markersize=13,
            linestyle="none",
            label=text,
        )
    if not discrete:
        _name_roots(axes, poles, BLUE)
        _name_roots(axes, roots, VERMILION)
    axes.margins(0.25)
    part = "of z" if discrete else "(1/s)"
    labelled(axes, f"real part {part}", f"imaginary part {part}", "poles and zeros")
    legend(axes)


def _name_roots(axes: Axes, roots: Array, colour: str) -> None:
    """Values beside the upper half's, zeros' below and poles' above the axis."""
    for root in roots[roots.imag >= 0.0]:
        place: dict[str, Any] = {
            "xytext": (0, 10 if colour == BLUE else -18),
            "textcoords": "offset points",
            "ha": "center",
        }
        axes.annotate(_value(root), (root.real, root.imag), fontsize=NOTE_PT, color=colour, **place)


def _value(root: complex) -> str:
    return f"{root.real:.4g}" + (f" ± {root.imag:.4g}j" if root.imag > 0.0 else "")


def _values(roots: Array) -> str:
    return ", ".join(dict.fromkeys(_value(root) for root in roots if root.imag >= 0.0)) or "none"


# ---------------------------------------------------------------------------------------------- step


def step_on(axes: Axes, system: control.StateSpace) -> None:
    """Response to 1 N m, as long as it takes to settle; of what does not settle, its beginning."""
    less, discrete = minimal(system).system, system.isdtime(strict=True)
    info = step_info(system)
    time, value = control.step_response(less, _time_axis(less, info))
    axes.plot(time, np.asarray(value), color=BLUE, drawstyle="steps-post" if discrete else "default")
    if info is not None:
        _mark_step(axes, info)
    output = system.output_labels[0]
    labelled(axes, "time (s)", f"{WORDS.get(output, output)} ({unit(system)})", "step of 1 N m (linear model)")
    axes.set_xlim(0.0, float(np.asarray(time)[-1]))
    final = 0.0 if info is None else info["SteadyStateValue"]
    legend(axes, loc="lower right" if final > 0.0 else "upper right")  # a swing about the final value ends there


def _mark_step(axes: Axes, info: dict[str, float]) -> None:
    final = info["SteadyStateValue"]
    axes.axhline(final, color=GREY, linewidth=0.9, linestyle="--", label=f"final value {final:.4g}")
    if final == 0.0:  # nothing is relative to it
        return
    axes.axhspan(0.98 * final, 1.02 * final, color=GREY, alpha=0.2, linewidth=0.0)
    text = f"peak {info['Peak']:.4g} at {info['PeakTime']:.3g} s, overshoot {info['Overshoot']:.3g} %"
    axes.plot(info["PeakTime"], info["Peak"], "o", color=VERMILION, markersize=5, label=text)
    text = f"within 2 % after {info['SettlingTime']:.4g} s"
    axes.axvline(info["SettlingTime"], color=GREEN, linewidth=1.2, linestyle="-.", label=text)


def _time_axis(system: control.StateSpace, info: dict[str, float] | None) -> Array:
    """To a fifth beyond settling, or five time constants of the fastest growth, 5 s at most."""
    discrete = system.isdtime(strict=True)
    poles = system.poles()
    rate = np.log(np.maximum(np.abs(poles), 1e-9)) / system.dt if discrete else poles.real
    if info is None:
        end = 5.0 / max(float(rate.max(initial=0.0)), 1.0)
    elif np.isnan(info["SettlingTime"]):
        end = -5.0 / float(rate.max())
    else:
        end = 1.2 * max(info["SettlingTime"], info["PeakTime"])
    return np.arange(0.0, end + system.dt, system.dt) if discrete else np.linspace(0.0, end, 3000)
