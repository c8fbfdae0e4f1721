"""Figures of a linear model: Bode, Nyquist, pole-zero map, step response, with the margins marked.

Rules of this file: a system of one input and one output in, a figure out; every number that stands in a figure comes
from `hoopd.design`. The states that the output does not see are left out of every curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import control
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from hoopd.design.analysis import minimal, zeros
from hoopd.design.margins import Margins, bandwidth, frequency_grid, margins, response, step_info
from hoopd.plots.style import (
    BLUE,
    GREEN,
    GREY,
    NOTE_PT,
    ORANGE,
    PURPLE,
    VERMILION,
    figure,
    labelled,
    legend,
    named,
    styled,
)

Array = NDArray[Any]

UNITS = {"theta": "rad", "dtheta": "rad/s", "psi": "rad", "dpsi": "rad/s"}
WORDS = {"theta": "hoop angle", "dtheta": "hoop speed", "psi": "ball angle", "dpsi": "ball speed"}
# Half the width of the picture around -1: the unit circle and as much again.
NEAR = 2.2
# An approach to -1 nearer than this is shown again, larger.
CLOSE = 0.15
# A curve beyond this many units is drawn by its way through the picture only.
RESONANCE = 1.2 * NEAR


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
    _curve_on(whole, _response_curve(system, delay_s)[1])
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


# ---------------------------------------------------------------------------------------------- Bode


def bode_on(gain: Axes, phase: Axes, system: control.StateSpace, delay_s: float = 0.0) -> None:
    """Gain in dB and phase in degrees over rad/s on two axes."""
    w, value = _response_curve(system, delay_s)
    size, angle = _db(value), np.degrees(np.unwrap(np.angle(value)))
    gain.semilogx(w, size, color=BLUE)
    phase.semilogx(w, angle, color=BLUE)
    gain.axhline(0.0, color=GREY, linewidth=0.8)
    phase.set_xlim(w[0], w[-1])
    phase.yaxis.set_major_locator(_steps_of_45(angle))
    found = margins(system, delay_s)
    _mark_phase_margin(gain, phase, found, lambda at: float(np.interp(at, w, angle)))
    _mark_gain_margin(gain, phase, found, lambda at: float(np.interp(at, w, angle)))
    _mark_bandwidths(gain, system)
    _levels(phase, angle)
    labelled(gain, "", f"gain [dB, {_unit(system)}/(N m)]", "Bode")
    labelled(phase, "frequency [rad/s]", "phase [deg]")
    gain.tick_params(labelbottom=False)
    for axes in (gain, phase):
        legend(axes, loc="lower left")


def _mark_phase_margin(gain: Axes, phase: Axes, found: Margins, angle: Callable[[float], float]) -> None:
    if not math.isfinite(found.phase_rad_s):
        return
    at, degrees = found.phase_rad_s, math.degrees(found.phase_rad)
    gain.plot(at, 0.0, "o", color=VERMILION, markersize=5)
    text = f"phase margin {degrees:.3g}° at {at:.4g} rad/s"
    phase.plot([at, at], [angle(at), angle(at) - degrees], color=VERMILION, linewidth=2.5)
    phase.plot(at, angle(at), "o", color=VERMILION, markersize=5, label=text)


def _mark_gain_margin(gain: Axes, phase: Axes, found: Margins, angle: Callable[[float], float]) -> None:
    for factor, at, word in (
        (found.gain_up, found.gain_up_rad_s, "gain margin"),
        (found.gain_down, found.gain_down_rad_s, "gain may fall to"),
    ):
        if math.isfinite(at) and at > 0.0:
            level = -20.0 * math.log10(factor)
            gain.plot(
                [at, at], [level, 0.0], color=PURPLE, linewidth=2.5, label=f"{word} {factor:.3g} at {at:.4g} rad/s"
            )
            phase.plot(at, angle(at), "s", color=PURPLE, markersize=5)


def _mark_bandwidths(gain: Axes, system: control.StateSpace) -> None:
    wide = bandwidth(system)
    level = -10.0 * math.log10(2.0)
    if 0.0 < wide.absolute_rad_s < math.inf:
        text = f"|P| = 1/√2 at {wide.absolute_rad_s:.4g} rad/s"
        gain.plot(wide.absolute_rad_s, level, "v", color=GREEN, markersize=6, label=text)
    if 0.0 < wide.below_dc_rad_s < math.inf:
        below = level + 20.0 * math.log10(abs(wide.dc_gain))
        text = f"3 dB below DC at {wide.below_dc_rad_s:.4g} rad/s"
        gain.plot(wide.below_dc_rad_s, below, "D", color=ORANGE, markersize=5, label=text)


def _levels(phase: Axes, angle: Array) -> None:
    """Lines where the phase is an odd multiple of 180 degrees, within the picture."""
    low, high = angle.min() - 10.0, angle.max() + 10.0
    for turn in range(math.floor(low / 360.0) - 1, math.ceil(high / 360.0) + 1):
        if low <= 360.0 * turn + 180.0 <= high:
            phase.axhline(360.0 * turn + 180.0, color=GREY, linewidth=0.8, linestyle="--")


def _steps_of_45(angle: Array) -> Any:
    from matplotlib.ticker import MultipleLocator

    span = float(angle.max() - angle.min())
    return MultipleLocator(45.0 if span <= 400.0 else 180.0 * max(1, round(span / 1600.0)))


# ---------------------------------------------------------------------------------------------- Nyquist


def nyquist_on(axes: Axes, system: control.StateSpace, delay_s: float = 0.0) -> None:
    """The curve around -1; what leaves the picture near a resonance is said, not squeezed in."""
    _, value = _response_curve(system, delay_s)
    found = margins(system, delay_s)
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=GREY, linestyle="--", linewidth=0.9))
    _curve_on(axes, value)
    axes.plot(-1.0, 0.0, "+", color=VERMILION, markersize=12, markeredgewidth=2, label="-1")
    _mark_nearest(axes, system, found, delay_s)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(-NEAR, NEAR)
    axes.set_ylim(-NEAR, NEAR)
    _say_what_is_outside(axes, system, value, delay_s)
    labelled(axes, "Re L", "Im L", "Nyquist, near -1")
    legend(axes, loc="upper right")
    if 1.0 / found.peak_sensitivity < CLOSE:
        _enlarged(axes, system, value, found, delay_s)


def _enlarged(axes: Axes, system: control.StateSpace, value: Array, found: Margins, delay_s: float) -> None:
    """The surroundings of -1, three times as wide as the nearest approach on each side."""
    inset = styled(axes.inset_axes((0.56, 0.12, 0.42, 0.36)))
    reach = 3.0 / found.peak_sensitivity
    inset.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=GREY, linestyle="--", linewidth=0.9))
    _curve_on(inset, value)
    inset.plot(-1.0, 0.0, "+", color=VERMILION, markersize=12, markeredgewidth=2)
    _mark_nearest(inset, system, found, delay_s)
    inset.set_aspect("equal", adjustable="box")
    inset.set_xlim(-1.0 - reach, -1.0 + reach)
    inset.set_ylim(-reach, reach)
    inset.locator_params(nbins=4)
    inset.tick_params(labelsize=NOTE_PT - 1.5)


def _curve_on(axes: Axes, value: Array) -> None:
    axes.plot(value.real, value.imag, color=BLUE, label="ω > 0")
    axes.plot(value.real, -value.imag, color=BLUE, linestyle=":", linewidth=1.0, label="ω < 0")
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.axvline(0.0, color=GREY, linewidth=0.6)


def _mark_nearest(axes: Axes, system: control.StateSpace, found: Margins, delay_s: float) -> None:
    """The nearest approach to -1 and the point on the unit circle that gives the phase margin."""
    w = found.peak_sensitivity_rad_s
    nearest = complex(response(minimal(system).system, w, delay_s)) if math.isfinite(w) else 0j
    text = f"1/Ms = {1.0 / found.peak_sensitivity:.3g} at {found.peak_sensitivity_rad_s:.4g} rad/s"
    axes.plot([-1.0, nearest.real], [0.0, nearest.imag], color=VERMILION, linewidth=1.5, label=text)
    for crossing in found.gain_crossovers:
        if crossing.w_rad_s == found.phase_rad_s:
            text = f"phase margin {math.degrees(found.phase_rad):.3g}° at {crossing.w_rad_s:.4g} rad/s"
            axes.plot(crossing.value.real, crossing.value.imag, "o", color=GREEN, markersize=5, label=text)


def _say_what_is_outside(axes: Axes, system: control.StateSpace, value: Array, delay_s: float) -> None:
    far = int(np.argmax(np.abs(value)))
    if abs(value[far]) > RESONANCE:
        w = _response_curve(system, delay_s)[0][far]
        text = f"leaves the picture: |L| up to {abs(value[far]):.3g} at {w:.3g} rad/s"
        axes.text(0.02, 0.02, text, transform=axes.transAxes, fontsize=NOTE_PT, color=GREY)


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
    part = "of z" if discrete else "[1/s]"
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
    labelled(axes, "time [s]", f"{WORDS.get(output, output)} [{_unit(system)}]", "step of 1 N m (linear model)")
    axes.set_xlim(0.0, float(np.asarray(time)[-1]))
    legend(axes, loc="upper right")


def _mark_step(axes: Axes, info: dict[str, float]) -> None:
    final = info["SteadyStateValue"]
    axes.axhline(final, color=GREY, linewidth=0.9, linestyle="--", label=f"final value {final:.4g}")
    axes.axhspan(0.98 * final, 1.02 * final, color=GREY, alpha=0.2, linewidth=0.0)
    text = f"peak {info['Peak']:.4g} at {info['PeakTime']:.3g} s, overshoot {info['Overshoot']:.3g} %"
    axes.plot(info["PeakTime"], info["Peak"], "o", color=VERMILION, markersize=5, label=text)
    text = f"within 2 % after {info['SettlingTime']:.4g} s"
    axes.axvline(info["SettlingTime"], color=GREEN, linewidth=1.2, linestyle="-.", label=text)


def _time_axis(system: control.StateSpace, info: dict[str, float] | None) -> Array:
    """To a fifth beyond settling, or five time constants of the fastest growth, 5 s at most."""
    discrete = system.isdtime(strict=True)
    if info is not None:
        end = 1.2 * max(info["SettlingTime"], info["PeakTime"])
    else:
        poles = system.poles()
        rate = np.log(np.maximum(np.abs(poles), 1e-9)) / system.dt if discrete else poles.real
        end = 5.0 / max(float(rate.max(initial=0.0)), 1.0)
    return np.arange(0.0, end + system.dt, system.dt) if discrete else np.linspace(0.0, end, 3000)


# ---------------------------------------------------------------------------------------------- common


def _response_curve(system: control.StateSpace, delay_s: float) -> tuple[Array, Array]:
    """Frequencies and values that show every feature: two decades about the poles and zeros, to Nyquist's at most."""
    less = minimal(system).system
    grid = frequency_grid(less, delay_s, points=2000)
    features = np.abs(np.concatenate([less.poles(), zeros(less)]))
    if less.isdtime(strict=True):
        roots = np.concatenate([less.poles(), zeros(less)]).astype(complex)
        features = np.abs(np.log(roots[np.abs(roots) > 1e-9]) / less.dt)
    kept = features[features > 1e-6 * features.max(initial=0.0)]
    low, high = (kept.min() / 20.0, kept.max() * 20.0) if kept.size else (1e-2, 1e2)
    w = grid[(grid >= low) & (grid <= high)]
    return w, response(less, w, delay_s)


def _db(value: Array) -> Array:
    decibels: Array = 20.0 * np.log10(np.maximum(np.abs(value), 1e-15))
    return decibels


def _unit(system: control.StateSpace) -> str:
    return UNITS.get(system.output_labels[0], "1")
