"""Figures of identification: measured and predicted, residuals, frequency responses, roots, impulse responses, orders.

Rules of this file: drawing only; arrays, models and tests come in. Bands are drawn where the numbers have them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse
from numpy.typing import NDArray

from hoopd.ident.data import Data
from hoopd.ident.measures import fit_percent
from hoopd.ident.normal import Z95
from hoopd.ident.residualtests import ResidualReport, Test
from hoopd.ident.spectral import Correlation
from hoopd.plots import style

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

WIDTH_IN = 8.0
# Standard deviations of a 95 % band, and of an ellipse that holds two numbers together with 95 %.
SIGMAS, ELLIPSE_SIGMAS = Z95, 2.448
# Longest part of a record that is drawn sample by sample.
MOST_SAMPLES = 5000
# Broad and light, so that what follows it exactly can still be told from it.
MEASURED = "#BBBBBB"
# The z-plane is drawn this far out; what lies beyond is named at the edge.
FAR = 1.3
# Of the range of the curves, above and below them.
ROOM = 0.15


@dataclass(frozen=True)
class Response:
    """Frequency response h (k,) at w (k,) rad/s; `gain_sd` (k,) of |h| relative to it, `phase_sd` (k,) in rad."""

    name: str
    w: Array
    h: Complex
    gain_sd: Array | None = None
    phase_sd: Array | None = None


@dataclass(frozen=True)
class Roots:
    """Poles and zeros in z with the covariances (2, 2) of real and imaginary part, where they are known."""

    name: str
    poles: Complex
    zeros: Complex
    pole_covariances: Sequence[Array] | Array = ()
    zero_covariances: Sequence[Array] | Array = ()


def draw_said(
    data: Data, said: Mapping[str, Array], how: str, title: str = "", units: Mapping[str, str] | None = None
) -> Figure:
    """Each output with what models say of it (n, ny) by name, the fit in the legend; `how`: "simulated" or the like."""
    names = data.outputs
    made = style.figure(WIDTH_IN, 1.0 + 2.2 * len(names), rows=len(names), columns=1, title=title, sharex=True)
    part = slice(0, MOST_SAMPLES)
    for i, (axes, name) in enumerate(zip(made.axes, names, strict=True)):
        axes.plot(data.t[part], data.y[part, i], color=MEASURED, linewidth=3.0, label="measured")
        for own, one in said.items():
            percent = fit_percent(data.y[:, i], one[:, i])[0]
            axes.plot(data.t[part], one[part, i], linewidth=1.1, label=f"{own}, {how}: {percent:.1f} %")
        unit = (units or {}).get(name)
        style.labelled(axes, "time (s)" if axes is made.axes[-1] else "", f"{name} ({unit})" if unit else name)
        style.legend(axes, ncols=2)
    return made


def draw_residuals(report: ResidualReport, title: str = "Residuals") -> Figure:
    """Autocorrelations of the residuals and their correlations with the inputs, past and future, with 95 % bands."""
    pairs = list(zip(report.feedback, report.independent, strict=True))
    rows = len(report.white) + len(pairs)
    made = style.figure(WIDTH_IN, 0.8 + 1.7 * rows, rows=rows, columns=1, title=title)
    for axes, test in zip(made.axes, report.white, strict=False):
        _stems(axes, test.lags, test.values, test.band, style.BLUE)
        _say(axes, [("white", test)])
        style.labelled(axes, "", test.name)
    for axes, (before, after) in zip(made.axes[len(report.white) :], pairs, strict=True):
        _stems(axes, before.lags, before.values, before.band, style.VERMILION)
        _stems(axes, after.lags, after.values, after.band, style.BLUE)
        _say(axes, [("no feedback", before), ("independent of the input", after)])
        style.labelled(axes, "", after.name)
    made.axes[-1].set_xlabel("lag (samples); below 0: the input follows the residual")
    return made


def _stems(axes: Axes, lags: NDArray[np.int_], values: Array, band: float, colour: str) -> None:
    axes.vlines(lags, 0.0, values, color=colour, linewidth=1.4)
    axes.plot(lags, values, "o", color=colour, markersize=3)
    axes.fill_between([lags[0] - 0.5, lags[-1] + 0.5], -band, band, color=style.GREY, alpha=0.18, linewidth=0.0)
    axes.axhline(0.0, color=style.GREY, linewidth=0.8)


def _say(axes: Axes, tests: Sequence[tuple[str, Test]]) -> None:
    said = "   ".join(f"{what}: {'yes' if one.passed else 'no'} (p = {one.chance:.2g})" for what, one in tests)
    axes.set_title(said, fontsize=style.NOTE_PT, loc="right")


def draw_responses(responses: Sequence[Response], title: str = "Frequency response", unit: str = "") -> Figure:
    """Gain in dB and phase in degrees over rad/s, with 95 % bands."""
    made = style.figure(WIDTH_IN, 5.4, rows=2, columns=1, title=title, sharex=True)
    gain, phase = made.axes
    limits = [(np.inf, -np.inf)] * 2
    for one, colour in zip(responses, _colours(len(responses)), strict=True):
        size, angle = 20.0 * np.log10(np.abs(one.h)), np.degrees(np.unwrap(np.angle(one.h)))
        gain.semilogx(one.w, size, color=colour, label=one.name)
        phase.semilogx(one.w, angle, color=colour)
        if one.gain_sd is not None:
            # d 20 log10 |h| = 8.69 d|h|/|h|
            _band(gain, one.w, size, SIGMAS * 20.0 / np.log(10.0) * one.gain_sd, colour)
        if one.phase_sd is not None:
            _band(phase, one.w, angle, SIGMAS * np.degrees(one.phase_sd), colour)
        limits = [_wider(limits[0], size), _wider(limits[1], angle)]
    # a band that leaves the picture says that nothing is known there; the curves are to be seen all the same
    for axes, (low, high) in zip((gain, phase), limits, strict=True):
        axes.set_ylim(low - ROOM * (high - low) - 1.0, high + ROOM * (high - low) + 1.0)
    style.labelled(gain, "", f"gain (dB{', ' + unit if unit else ''})")
    style.labelled(phase, "frequency (rad/s)", "phase (deg)")
    style.legend(gain)
    return made


def _wider(limits: tuple[float, float], values: Array) -> tuple[float, float]:
    return min(limits[0], float(values.min())), max(limits[1], float(values.max()))


def draw_roots(models: Sequence[Roots], title: str = "Poles and zeros") -> Figure:
    """Poles (crosses) and zeros (rings) in the z-plane with 95 % ellipses and the unit circle; how many lie farther."""
    made = style.figure(6.0, 6.0, title=title)
    axes, far = made.axes[0], 0
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color=style.GREY, linewidth=1.0))
    for one, colour in zip(models, _colours(len(models)), strict=True):
        label: str | None = one.name
        for roots, mark in ((one.poles, "x"), (one.zeros, "o")):
            if len(roots):
                axes.plot(
                    roots.real, roots.imag, mark, color=colour, markersize=7, markeredgewidth=1.5, fillstyle="none",
                    label=label,
                )  # fmt: skip
                label = None
            far += int((~_near(roots)).sum())
        for roots, sizes in ((one.poles, one.pole_covariances), (one.zeros, one.zero_covariances)):
            for root, covariance, near in zip(roots, sizes, _near(roots), strict=False):
                # of a root far out only a corner of its ellipse would show
                if near:
                    axes.add_patch(_ellipse(root, covariance, colour))
    axes.set_aspect("equal")
    axes.set_xlim(-FAR, FAR)
    axes.set_ylim(-FAR, FAR)
    style.labelled(axes, f"real part{f' ({far} farther out)' if far else ''}", "imaginary part")
    style.legend(axes, loc="upper left")
    return made


def _near(roots: Complex) -> NDArray[np.bool_]:
    return np.asarray(np.maximum(np.abs(roots.real), np.abs(roots.imag)) <= FAR)


def _ellipse(pole: complex, covariance: Array, colour: str) -> Ellipse:
    spread, axes = np.linalg.eigh(covariance)
    width, height = 2.0 * ELLIPSE_SIGMAS * np.sqrt(np.maximum(spread, 0.0))
    angle = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
    return Ellipse((pole.real, pole.imag), width, height, angle=angle, color=colour, alpha=0.25, linewidth=0.0)


def draw_impulse(
    t: Array, values: Mapping[str, Array], sd: Array | None = None, title: str = "Impulse response"
) -> Figure:
    """Impulse responses (k,) over t; `sd` (k,): the band about zero that chance alone would stay in."""
    made = style.figure(WIDTH_IN, 3.4, title=title)
    axes = made.axes[0]
    if sd is not None:
        _band(axes, t, np.zeros_like(t), SIGMAS * sd, style.GREY)
    for (name, one), colour in zip(values.items(), _colours(len(values)), strict=True):
        axes.plot(t, one, marker="o", markersize=3, linewidth=1.0, color=colour, label=name)
    style.labelled(axes, "time (s)", "response (per unit and s)")
    style.legend(axes)
    return made


def draw_coherence(w: Array, coherence: Mapping[str, Array], title: str = "Coherence") -> Figure:
    """Squared coherences (k,) over rad/s: what of an output is linear in the input."""
    made = style.figure(WIDTH_IN, 3.2, title=title)
    axes = made.axes[0]
    for name, one in coherence.items():
        axes.semilogx(w[w > 0.0], one[w > 0.0], label=name)
    axes.set_ylim(0.0, 1.02)
    style.labelled(axes, "frequency (rad/s)", "squared coherence")
    style.legend(axes, loc="lower left")
    return made


def draw_spectra(
    w: Array, spectra: Mapping[str, tuple[Array, Array | None, Array | None]], title: str = "Spectrum"
) -> Figure:
    """Power spectra (k,) over rad/s by name with their lower and upper 95 % bounds, where there are any."""
    made = style.figure(WIDTH_IN, 3.4, title=title)
    axes, kept = made.axes[0], w > 0.0
    for (name, (power, low, high)), colour in zip(spectra.items(), _colours(len(spectra)), strict=True):
        axes.loglog(w[kept], power[kept], color=colour, label=name)
        if low is not None and high is not None:
            axes.fill_between(w[kept], low[kept], high[kept], color=colour, alpha=0.2, linewidth=0.0)
    style.labelled(axes, "frequency (rad/s)", "power (unit2 s)")
    style.legend(axes)
    return made


def draw_correlation(found: Correlation, names: Sequence[tuple[str, str]], title: str = "Correlation") -> Figure:
    """Correlations of pairs of channels over the lag with the band that unrelated white ones stay in.

    `names`: the pairs, second channel running faster, as the values lie.
    """
    values = found.values.reshape(len(found.lag), -1)
    made = style.figure(WIDTH_IN, 0.8 + 1.8 * len(names), rows=len(names), columns=1, title=title, sharex=True)
    for axes, own, (one, other) in zip(made.axes, values.T, names, strict=True):
        _stems(axes, found.lag, own, found.bound, style.BLUE)
        style.labelled(axes, "", f"{one}, {other}")
    made.axes[-1].set_xlabel("lag (samples); above 0: the first follows the second")
    return made


def draw_spectrogram(t: Array, w: Array, density: Array, title: str = "Spectrogram", unit: str = "unit2/Hz") -> Figure:
    """A density (nt, nw) in dB over time and frequency: of `model_spectrum`, or of `scipy.signal.spectrogram`'s."""
    made = style.figure(WIDTH_IN, 4.0, title=title)
    axes = made.axes[0]
    power = 10.0 * np.log10(np.maximum(density, np.finfo(float).tiny))
    top = float(power.max())
    image = axes.pcolormesh(t, w, power.T, shading="nearest", cmap="viridis", vmin=max(float(power.min()), top - 80.0))
    axes.grid(visible=False)
    bar = made.colorbar(image, ax=axes)
    bar.set_label(f"density (dB, {unit})", fontsize=style.NOTE_PT)
    style.labelled(axes, "time (s)", "frequency (rad/s)")
    return made


def draw_orders(rows: Sequence[str], columns: Sequence[str], values: Array, name: str, title: str = "Order") -> Figure:
    """A criterion (rows, columns) above its least value; the least is marked. NaN: not tried."""
    made = style.figure(max(4.0, 1.6 + 0.55 * len(columns)), max(2.6, 1.4 + 0.42 * len(rows)), title=title)
    axes, above = made.axes[0], values - np.nanmin(values)
    image = axes.imshow(np.log10(1.0 + above), cmap="viridis_r", aspect="auto")
    best = np.unravel_index(int(np.nanargmin(values)), values.shape)
    axes.plot(best[1], best[0], "o", color=style.VERMILION, markersize=9, fillstyle="none", markeredgewidth=2.0)
    axes.set_xticks(range(len(columns)), list(columns))
    axes.set_yticks(range(len(rows)), list(rows))
    axes.grid(visible=False)
    bar = made.colorbar(image, ax=axes)
    bar.set_label(f"log10(1 + {name} above the least)", fontsize=style.NOTE_PT)
    return made


def _band(axes: Axes, x: Array, middle: Array, half: Array, colour: str) -> None:
    axes.fill_between(x, middle - half, middle + half, color=colour, alpha=0.2, linewidth=0.0)


def _colours(count: int) -> list[str]:
    return [style.COLOURS[i % len(style.COLOURS)] for i in range(count)]
