"""Figures of identification: measured and predicted, residuals, frequency responses, roots, impulse responses, orders.

Rules of this file: drawing only; arrays, models and tests come in. Bands are drawn where the numbers have them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
from hoopd.ident.step_responses import TimeResponse
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
    colour: str = ""  # of what stands behind the models, such as the data's own; else each has its own


@dataclass(frozen=True)
class Roots:
    """Poles and zeros in z with the covariances (2, 2) of real and imaginary part, where they are known."""

    name: str
    poles: Complex
    zeros: Complex
    pole_covariances: Sequence[Array] | Array = ()
    zero_covariances: Sequence[Array] | Array = ()


def draw_said(
    each: Sequence[Data], said: Mapping[str, Sequence[Array]], how: str, title: str = "",
    units: Mapping[str, str] | None = None, offsets: Mapping[str, float] | None = None,
) -> Figure:  # fmt: skip
    """Each output of each experiment with what models say of it (n, ny) by name, the fit there in the legend.

    `how`: "simulated" or the like; `offsets`: the operating point by output that data and models are about, added.
    """
    names, part = each[0].outputs, slice(0, MOST_SAMPLES)
    rows = [(k, i) for k in range(len(each)) for i in range(len(names))]
    made = style.figure(WIDTH_IN, 1.0 + 2.2 * len(rows), rows=len(rows), columns=1, title=title, sharex=len(each) == 1)
    for axes, (k, i) in zip(made.axes, rows, strict=True):
        data, name = each[k], names[i]
        offset = (offsets or {}).get(name, 0.0)
        axes.plot(data.t[part], data.y[part, i] + offset, color=MEASURED, linewidth=3.0, label="measured")
        for own, one in said.items():
            with np.errstate(all="ignore"):
                percent = fit_percent(data.y[:, i], one[k][:, i])[0]
            told = f"{percent:.1f} %" if np.isfinite(percent) else "diverges"
            axes.plot(data.t[part], one[k][part, i] + offset, linewidth=1.1, label=f"{own}, {how}: {told}")
        _show_measured(axes, data.y[part, i] + offset)
        called = name if len(each) == 1 else f"{name}, experiment {k + 1}"
        unit = (units or {}).get(name)
        last = (k, i) == rows[-1] or (len(each) > 1 and i == len(names) - 1)
        style.labelled(axes, "time (s)" if last else "", f"{called} ({unit})" if unit else called)
        style.legend(axes, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return made


def _show_measured(axes: Axes, measured: Array) -> None:
    """What a model says may leave the picture; what was measured may not."""
    known = measured[np.isfinite(measured)]
    if len(known) and np.ptp(known) > 0.0:
        low, high = float(known.min()), float(known.max())
        bottom, top = axes.get_ylim()
        reach = high - low
        axes.set_ylim(max(bottom, low - reach), min(top, high + reach))


def draw_data(each: Mapping[str, Data], title: str = "", units: Mapping[str, str] | None = None) -> Figure:
    """Outputs and, held from sample to sample, inputs over time; several experiments over each other by name."""
    first = next(iter(each.values()))
    names = [*first.outputs, *first.inputs]
    made = style.figure(WIDTH_IN, 1.0 + 1.6 * len(names), rows=len(names), columns=1, title=title, sharex=True)
    part = slice(0, MOST_SAMPLES)
    for (label, data), colour in zip(each.items(), _colours(len(each)), strict=True):
        for i, axes in enumerate(made.axes):
            held: Any = {"drawstyle": "steps-post"} if i >= data.ny else {}
            values = data.y[part, i] if i < data.ny else data.u[part, i - data.ny]
            axes.plot(data.t[part], values, color=colour, linewidth=1.1, label=label, **held)
    for axes, name in zip(made.axes, names, strict=True):
        unit = (units or {}).get(name)
        kind = "" if name in first.outputs else "input "
        style.labelled(
            axes, "time (s)" if axes is made.axes[-1] else "", f"{kind}{name} ({unit})" if unit else f"{kind}{name}"
        )  # fmt: skip
    if len(each) > 1:
        style.legend(made.axes[0])
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
    return draw_response_matrix([[responses]], title, unit=unit)


def draw_response_matrix(
    matrix: Sequence[Sequence[Sequence[Response]]], title: str = "Frequency response", *, outputs: Sequence[str] = (),
    inputs: Sequence[str] = (), unit: str = "",
) -> Figure:  # fmt: skip
    """Gain over phase for each output (rows) and input (columns), curves of one model in one colour everywhere."""
    rows, columns = len(matrix), len(matrix[0])
    height = 5.4 if rows == 1 else 0.6 + 3.4 * rows
    made = style.figure(
        max(WIDTH_IN, 4.0 * columns), height, rows=2 * rows, columns=columns, title=title, sharex=True, squeeze=False
    )
    grid = np.array(made.axes).reshape(2 * rows, columns)
    for i, row in enumerate(matrix):
        for j, responses in enumerate(row):
            gain, phase = grid[2 * i, j], grid[2 * i + 1, j]
            _responses_on(gain, phase, responses)
            pair = f"{outputs[i]} from {inputs[j]}" if rows * columns > 1 else ""
            style.labelled(gain, "", f"gain (dB{', ' + unit if unit else ''})" if j == 0 else "", pair)
            style.labelled(phase, "frequency (rad/s)" if i == rows - 1 else "", "phase (deg)" if j == 0 else "")
    style.legend(grid[0, 0])
    return made


def _responses_on(gain: Axes, phase: Axes, responses: Sequence[Response]) -> None:
    limits, colours, reference = [(np.inf, -np.inf)] * 2, iter(_colours(len(responses))), None
    for one in responses:
        colour = one.colour or next(colours)
        size, angle = 20.0 * np.log10(np.maximum(np.abs(one.h), 1e-300)), np.degrees(np.unwrap(np.angle(one.h)))
        reference = _first(angle) if reference is None else reference
        angle = angle - 360.0 * np.round((_first(angle) - reference) / 360.0)
        look: Any = {"color": colour, "linewidth": 3.0, "zorder": 1.0} if one.colour else {"color": colour}
        gain.semilogx(one.w, size, label=one.name, **look)
        phase.semilogx(one.w, angle, **look)
        if one.gain_sd is not None:
            # d 20 log10 |h| = 8.69 d|h|/|h|
            _band(gain, one.w, size, SIGMAS * 20.0 / np.log(10.0) * one.gain_sd, colour)
        if one.phase_sd is not None:
            _band(phase, one.w, angle, SIGMAS * np.degrees(one.phase_sd), colour)
        if not one.colour:
            limits = [_wider(limits[0], size), _wider(limits[1], angle)]
    # a band that leaves the picture says that nothing is known there; the curves are to be seen all the same
    for axes, (low, high) in zip((gain, phase), limits, strict=True):
        if np.isfinite(high - low):
            axes.set_ylim(low - ROOM * (high - low) - 1.0, high + ROOM * (high - low) + 1.0)


def _first(angle: Array) -> float:
    """Where a phase begins, in degrees."""
    known = angle[np.isfinite(angle)]
    return float(known[0]) if len(known) else 0.0


def _wider(limits: tuple[float, float], values: Array) -> tuple[float, float]:
    return min(limits[0], float(np.nanmin(values))), max(limits[1], float(np.nanmax(values)))


def draw_roots(models: Sequence[Roots], title: str = "Poles and zeros", *, continuous: bool = False) -> Figure:
    """Poles (crosses) and zeros (rings) with 95 % ellipses: in the z-plane with the unit circle, or in the s-plane.

    Roots of the z-plane that lie farther out are counted at the axis.
    """
    made = style.figure(6.0, 6.0, title=title)
    axes, far = made.axes[0], 0
    reach = np.inf if continuous else FAR
    if continuous:
        axes.axvline(0.0, color=style.GREY, linewidth=1.0)
    else:
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
            far += int((~_near(roots, reach)).sum())
        for roots, sizes in ((one.poles, one.pole_covariances), (one.zeros, one.zero_covariances)):
            for root, covariance, near in zip(roots, sizes, _near(roots, reach), strict=False):
                # of a root far out only a corner of its ellipse would show
                if near:
                    axes.add_patch(_ellipse(root, covariance, colour))
    if continuous:
        axes.margins(0.15)
    else:
        axes.set_aspect("equal")
        axes.set_xlim(-FAR, FAR)
        axes.set_ylim(-FAR, FAR)
    unit = " (rad/s)" if continuous else ""
    style.labelled(axes, f"real part{unit}{f' ({far} farther out)' if far else ''}", f"imaginary part{unit}")
    style.legend(axes, loc="upper left")
    return made


def _near(roots: Complex, reach: float) -> NDArray[np.bool_]:
    return np.asarray(np.maximum(np.abs(roots.real), np.abs(roots.imag)) <= reach)


def _ellipse(pole: complex, covariance: Array, colour: str) -> Ellipse:
    spread, axes = np.linalg.eigh(covariance)
    width, height = 2.0 * ELLIPSE_SIGMAS * np.sqrt(np.maximum(spread, 0.0))
    angle = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
    return Ellipse((pole.real, pole.imag), width, height, angle=angle, color=colour, alpha=0.25, linewidth=0.0)


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


def draw_time_responses(
    answers: Mapping[str, TimeResponse], outputs: Sequence[str], inputs: Sequence[str], title: str, to: str
) -> Figure:
    """Responses by name to a signal of each input, one picture for each output and input, with 95 % bands.

    `to`: "step" or "unit pulse".
    """
    rows, columns = len(outputs), len(inputs)
    size = (WIDTH_IN, 1.0 + 2.4 * rows)
    made = style.figure(*size, rows=rows, columns=columns, title=title, sharex=True, squeeze=False)
    for k, axes in enumerate(made.axes):
        i, j = divmod(k, columns)
        for (name, one), colour in zip(answers.items(), _colours(len(answers)), strict=True):
            axes.plot(one.t, one.y[:, i, j], color=colour, drawstyle="steps-post", label=name)
            if one.deviation is not None:
                half = SIGMAS * one.deviation[:, i, j]
                low, high = one.y[:, i, j] - half, one.y[:, i, j] + half
                axes.fill_between(one.t, low, high, step="post", color=colour, alpha=0.2, linewidth=0.0)
        style.labelled(axes, "time (s)" if i == rows - 1 else "", f"{outputs[i]} per {to} of {inputs[j]}")
    if len(answers) > 1:
        style.legend(made.axes[0])
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
