"""Frequency pictures of a linear system: Bode and Nyquist, with margins and bandwidths marked.

Rules of this file: a system of one input and one output and axes in, marks on them out; every number that stands in a
figure comes from `hoopd.design`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import control
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.ticker import Locator, MaxNLocator, MultipleLocator
from numpy.typing import NDArray

from hoopd.design.analysis import minimal
from hoopd.design.margins import Margins, margins
from hoopd.design.response import frequency_grid, response
from hoopd.design.speed import bandwidth
from hoopd.ident.transfer_functions import zeros
from hoopd.plots.style import (
    BLUE,
    GREEN,
    GREY,
    NOTE_PT,
    ORANGE,
    PURPLE,
    TITLE_PT,
    VERMILION,
    labelled,
    legend,
    styled,
)

Array = NDArray[Any]

UNITS = {"theta": "rad", "dtheta": "rad/s", "psi": "rad", "dpsi": "rad/s"}
# Half the width of the picture around -1: the unit circle and as much again.
NEAR = 2.2
# An approach to -1 nearer than this is shown again, larger.
CLOSE = 0.15
# A curve beyond this many units is drawn by its way through the picture only.
RESONANCE = 1.2 * NEAR


# ---------------------------------------------------------------------------------------------- Bode


def bode_on(gain: Axes, phase: Axes, system: control.StateSpace, delay_s: float = 0.0) -> None:
    """Gain in dB and phase in degrees over rad/s on two axes."""
    w, value = response_curve(system, delay_s)
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
    labelled(gain, "", f"gain (dB, {unit(system)} per N m)", "Bode")
    labelled(phase, "frequency (rad/s)", "phase (deg)")
    gain.tick_params(labelbottom=False)
    if not found.stable:
        gain.set_title("Bode (unit feedback: unstable)", fontsize=TITLE_PT)
    legend(gain, loc="lower left")
    legend(phase)


def _mark_phase_margin(gain: Axes, phase: Axes, found: Margins, angle: Callable[[float], float]) -> None:
    if not math.isfinite(found.phase_rad_s):
        return
    at, degrees = found.phase_rad_s, math.degrees(found.phase_rad)
    gain.plot(at, 0.0, "o", color=VERMILION, markersize=5)
    text = f"phase margin {degrees:.3g}° at {at:.4g} rad/s"
    turn = 360.0 * round((angle(at) + 180.0) / 360.0) - 180.0  # the nearest of -180, 180, -540, ...
    phase.plot([at, at], [angle(at), turn], color=VERMILION, linewidth=2.5)
    phase.plot(at, angle(at), "o", color=VERMILION, markersize=5, label=text)


def _mark_gain_margin(gain: Axes, phase: Axes, found: Margins, angle: Callable[[float], float]) -> None:
    words = ("gain margin", "gain may fall to") if found.stable else ("reaches -1 by a factor",) * 2
    ends = ((found.gain_up, found.gain_up_rad_s), (found.gain_down, found.gain_down_rad_s))
    for (factor, at), word in zip(ends, words, strict=True):
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


def _steps_of_45(angle: Array) -> Locator:
    """Ticks at multiples of 45 degrees, of 180 over a wide range; where the phase hardly moves at round numbers."""
    span = float(angle.max() - angle.min())
    if span < 60.0:
        return MaxNLocator(6)
    return MultipleLocator(45.0 if span <= 400.0 else 180.0 * max(1, round(span / 1600.0)))


# ---------------------------------------------------------------------------------------------- Nyquist


def nyquist_on(axes: Axes, system: control.StateSpace, delay_s: float = 0.0) -> None:
    """The curve around -1; what leaves the picture near a resonance is said, not squeezed in."""
    _, value = response_curve(system, delay_s)
    found = margins(system, delay_s)
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=GREY, linestyle="--", linewidth=0.9))
    curve_on(axes, value)
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
    curve_on(inset, value)
    inset.plot(-1.0, 0.0, "+", color=VERMILION, markersize=12, markeredgewidth=2)
    _mark_nearest(inset, system, found, delay_s)
    inset.set_aspect("equal", adjustable="box")
    inset.set_xlim(-1.0 - reach, -1.0 + reach)
    inset.set_ylim(-reach, reach)
    inset.locator_params(nbins=4)
    inset.tick_params(labelsize=NOTE_PT - 1.5)


def curve_on(axes: Axes, value: Array) -> None:
    axes.plot(value.real, value.imag, color=BLUE, label="ω > 0")
    axes.plot(value.real, -value.imag, color=BLUE, linestyle=":", linewidth=1.0, label="ω < 0")
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.axvline(0.0, color=GREY, linewidth=0.6)


def _mark_nearest(axes: Axes, system: control.StateSpace, found: Margins, delay_s: float) -> None:
    """The nearest approach to -1 and the point on the unit circle that gives the phase margin."""
    w = found.peak_sensitivity_rad_s
    nearest = complex(response(minimal(system).system, w, delay_s)) if math.isfinite(w) else 0j
    where = f"at {w:.4g} rad/s" if math.isfinite(w) else "at high frequency"
    text = f"1/Ms = {1.0 / found.peak_sensitivity:.3g} {where}"
    axes.plot([-1.0, nearest.real], [0.0, nearest.imag], color=VERMILION, linewidth=1.5, label=text)
    for crossing in found.gain_crossovers:
        if crossing.w_rad_s == found.phase_rad_s:
            text = f"phase margin {math.degrees(found.phase_rad):.3g}° at {crossing.w_rad_s:.4g} rad/s"
            axes.plot(crossing.value.real, crossing.value.imag, "o", color=GREEN, markersize=5, label=text)


def _say_what_is_outside(axes: Axes, system: control.StateSpace, value: Array, delay_s: float) -> None:
    far = int(np.argmax(np.abs(value)))
    if abs(value[far]) > RESONANCE:
        w = response_curve(system, delay_s)[0][far]
        text = f"leaves the picture: |L| up to {abs(value[far]):.3g} at {w:.3g} rad/s"
        axes.text(0.02, 0.02, text, transform=axes.transAxes, fontsize=NOTE_PT, color=GREY)


# ---------------------------------------------------------------------------------------------- common


def response_curve(system: control.StateSpace, delay_s: float) -> tuple[Array, Array]:
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


def unit(system: control.StateSpace) -> str:
    return UNITS.get(system.output_labels[0], "1")
