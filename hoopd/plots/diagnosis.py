"""Figures of a diagnosis that say how sure it is: where it sits, what was tried, how large, what would be seen.

Rules of this file: draws what it is given; SI units on every axis; names come from files, so no text is read as a
formula. Figures of the curves themselves are in `diagnosis_curves`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hoopd.plots import style
from hoopd.plots.number_format import amount, brief, nats, safe, value_text

if TYPE_CHECKING:
    from hoopd.diagnose.record import Candidate, EffectFinding, Ignored, Number, Quantity, Visible
    from hoopd.diagnose.report_curves import Strip

WIDTH_IN, ROW_IN = 8.0, 0.28
MOST_CANDIDATES = 14
# A disturbance of this many times the usual one is drawn as dark as any larger one.
DARKEST = 6.0
LEAST_TIME_S = 1e-3  # an axis has two ends even where there is one sample
# Columns of a strip: more than a page can show apart are averaged.
COLUMNS = 400
LEAST_SPAN_NATS = 30.0  # of a linear one: what chance reaches does not fill it
LEAST_NATS = 0.5  # left end of a logarithmic axis of nats
# An interval wider than this runs out of the picture: the parameter is hardly known.
WIDEST_PERCENT = 60.0
LEAST_SHARE = 1e-3
ROOM_PERCENT = 3.0  # right of this a label fits beside a mark


def plain(text: object) -> str:
    """Text for a figure: no control characters, and a dollar is a dollar."""
    return safe(text).replace("$", r"\$")


def draw_evidence_by_slot(evidence: Mapping[str, Number]) -> Figure:
    """A bar for each slot: the surprise, in nats, of the best law or curve there."""
    known = sorted(((gain, slot) for slot, gain in evidence.items() if gain is not None), reverse=True)
    figure = style.figure(WIDTH_IN, 0.8 + ROW_IN * len(known))
    axes = figure.axes[0]
    _rows(axes, [slot for _, slot in known])
    axes.barh(range(len(known)), [gain for gain, _ in known], color=style.BLUE, height=0.6)
    for row, (gain, _) in enumerate(known):
        axes.annotate(nats(gain), (max(gain, 0.0), row), (4, 0), textcoords="offset points", va="center",
                      fontsize=style.NOTE_PT)  # fmt: skip
    axes.set_xlim(0.0, max(LEAST_SPAN_NATS, 1.1 * max(gain for gain, _ in known)))
    style.labelled(axes, "surprise (nats)", "")
    return figure


def draw_strips(strips: Sequence[Strip]) -> Figure:
    """Size of the smoothed disturbance over time, slot by slot for each recording; hatched: set aside."""
    recordings = list(dict.fromkeys(one.recording for one in strips))
    groups = [[one for one in strips if one.recording == name] for name in recordings]
    heights = [len(group) for group in groups]
    figure = style.figure(WIDTH_IN, 0.75 + sum(0.3 * n + 0.45 for n in heights), rows=len(groups), sharex=True,
                          squeeze=False, height_ratios=heights)  # fmt: skip
    for axes, name, group in zip(figure.axes, recordings, groups, strict=True):
        image = _strip_rows(axes, group)
        axes.set_title(plain(brief(name)), fontsize=style.NOTE_PT, loc="left")
    figure.axes[-1].set_xlabel("time (s)")
    bar = figure.colorbar(image, ax=figure.axes, pad=0.01, aspect=12, extend="max")
    bar.set_label("disturbance / usual", fontsize=style.NOTE_PT)
    bar.ax.tick_params(labelsize=style.NOTE_PT)
    return figure


def _strip_rows(axes: Axes, group: Sequence[Strip]):  # type: ignore[no-untyped-def]
    """One recording's strips over each other; returns the image that the colour bar belongs to."""
    start = min(float(one.t_s[0]) for one in group)
    end = max(start + LEAST_TIME_S, *(float(one.t_s[-1]) for one in group))
    edges = np.linspace(start, end, min(COLUMNS, max(len(one.t_s) for one in group)) + 1)
    rows = np.array([_binned_size(one, edges) for one in group])
    image = axes.imshow(rows, aspect="auto", cmap="OrRd", vmin=0.0, vmax=DARKEST, interpolation="nearest",
                        extent=(start, end, len(group) - 0.5, -0.5))  # fmt: skip
    axes.set_yticks(range(len(group)), [plain(one.slot) for one in group])
    axes.grid(False)
    shade(axes, [span for one in group[:1] for span in one.ignored])
    return image


def _binned_size(strip: Strip, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean square of the strength between the edges; NaN where nothing was sampled."""
    known = np.isfinite(strip.strength)
    inside = np.clip(np.digitize(strip.t_s[known], edges) - 1, 0, len(edges) - 2)
    count = np.bincount(inside, minlength=len(edges) - 1)
    power = np.bincount(inside, strip.strength[known] ** 2, minlength=len(edges) - 1)
    mean = np.divide(power, count, out=np.full(len(count), np.nan), where=count > 0)
    return np.asarray(np.sqrt(mean), float)


def shade(axes: Axes, ignored: Sequence[Ignored]) -> None:
    """Intervals that were set aside, hatched."""
    for start, end, _ in ignored:
        axes.axvspan(start, end, facecolor="#BBBBBB", alpha=0.55, hatch="////", edgecolor="#777777", linewidth=0.0)


def draw_candidates(
    candidates: Sequence[Candidate], findings: Sequence[EffectFinding], not_excluded: Collection[str]
) -> Figure:
    """What each explanation gains on its own, against what it would need; the best of them only.

    A finding beside it: what the model of all of them loses without it.
    """
    known = sorted(
        (one for one in candidates if one.log_likelihood_gain is not None),
        key=lambda one: -(one.log_likelihood_gain or 0.0),
    )
    alone = {one.name: one for one in known}
    found = {one.name: one for one in findings if one.evidence.log_likelihood_gain is not None}
    names = [*found, *(name for name in alone if name not in found)][:MOST_CANDIDATES]
    figure = style.figure(WIDTH_IN, 1.2 + ROW_IN * len(names))
    axes = figure.axes[0]
    axes.set_xscale("log")
    _rows(axes, names)
    for row, name in enumerate(names):
        if name in found:
            _finding(axes, row, alone.get(name), found[name])
        else:
            _candidate(axes, row, alone[name], *_look(name, not_excluded))
    gains = [one.log_likelihood_gain for one in known] + [one.evidence.log_likelihood_gain for one in found.values()]
    axes.set_xlim(LEAST_NATS, 2.5 * max([10.0, *(gain or 0.0 for gain in gains)]))
    _thresholds(axes, [_needed(alone[name]) if name in alone else found[name].evidence.threshold for name in names])
    style.labelled(axes, "gain over the re-fitted base (nats)", "")
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    # from the right: names of explanations may be long, and the axes begin behind them
    style.legend(axes, handles=list(once.values()), labels=list(once), loc="lower right", bbox_to_anchor=(1.0, 1.0),
                 ncols=3, borderaxespad=0.1)  # fmt: skip
    return figure


def _needed(one: Candidate) -> Number:
    """What its gain is compared with; in files that do not tell it, a threshold of all."""
    return one.threshold if one.needed is None else one.needed


def _look(name: str, not_excluded: Collection[str]) -> tuple[str, str]:
    """Colour and word of a candidate."""
    return (style.ORANGE, "not excluded") if name in not_excluded else (style.BLUE, "not named")


def _candidate(axes: Axes, row: int, one: Candidate, colour: str, label: str) -> None:
    gain = max(one.log_likelihood_gain or 0.0, LEAST_NATS)
    axes.plot((LEAST_NATS, gain), (row, row), color=colour, linewidth=1.2, alpha=0.6)
    axes.plot(gain, row, "o", color=colour, markersize=6, label=label)
    axes.annotate(nats(one.log_likelihood_gain), (gain, row), (7, 0), textcoords="offset points", va="center",
                  fontsize=style.NOTE_PT)  # fmt: skip


def _finding(axes: Axes, row: int, alone: Candidate | None, found: EffectFinding) -> None:
    """Hollow what it gains on its own, full what it does beside all others."""
    denied = found.status == "not_confirmed"
    colour, word = (style.GREY, "denied by held-out data") if denied else (style.VERMILION, "named")
    own = None if alone is None else alone.log_likelihood_gain
    gain = max(found.evidence.log_likelihood_gain or 0.0, LEAST_NATS)
    axes.plot((LEAST_NATS, gain), (row, row), color=colour, linewidth=1.2, alpha=0.6)
    if own is not None:
        axes.plot(max(own, LEAST_NATS), row, "o", color=colour, markersize=9, markerfacecolor="none",
                  label=f"{word}, on its own")  # fmt: skip
    axes.plot(gain, row, "o", color=colour, markersize=6, label=f"{word}, beside all others")
    axes.annotate(nats(found.evidence.log_likelihood_gain), (max(gain, own or 0.0), row), (9, 0),
                  textcoords="offset points", va="center", fontsize=style.NOTE_PT)  # fmt: skip


def _thresholds(axes: Axes, needed: Sequence[Number]) -> None:
    """One line where all need the same, a mark in each row otherwise."""
    if len(set(needed)) == 1 and needed[0] is not None:
        axes.axvline(needed[0], color=style.GREY, linestyle="--", linewidth=1.2, label=f"needed: {nats(needed[0])}")
        return
    for row, threshold in enumerate(needed):
        if threshold is not None:
            axes.plot(threshold, row, "|", color=style.GREY, markersize=12, markeredgewidth=1.6, label="needed")


def draw_parameters(parameters: Mapping[str, Quantity]) -> Figure:
    """Each value with its 95 % interval and its nominal value, in percent of the value."""
    shown = {name: one for name, one in parameters.items() if one.value}
    figure = style.figure(WIDTH_IN, 1.2 + ROW_IN * len(shown))
    axes = figure.axes[0]
    _rows(axes, [f"{name} = {value_text(one)}" for name, one in shown.items()])
    for row, one in enumerate(shown.values()):
        _parameter(axes, row, one, first=row == 0)
    left, right = axes.get_xlim()
    axes.set_xlim(max(left, -WIDEST_PERCENT), min(right, WIDEST_PERCENT))
    style.labelled(axes, "from the estimated value (%)", "")
    style.legend(axes, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1)
    return figure


def _parameter(axes: Axes, row: int, one: Quantity, first: bool) -> None:
    value = one.value or 1.0
    if one.ci95 is not None and None not in one.ci95:
        ends = [100.0 * ((end or 0.0) - value) / abs(value) for end in one.ci95]
        axes.plot(ends, (row, row), color=style.BLUE, linewidth=6.0, alpha=0.45, solid_capstyle="butt",
                  label="95 % interval" if first else None)  # fmt: skip
    axes.plot(0.0, row, "o", color=style.BLUE, markersize=5, label="estimated" if first else None)
    if one.nominal:  # an effect's is zero: not there
        _nominal(axes, row, 100.0 * (one.nominal - value) / abs(value), "nominal (arrow: outside)" if first else None)


def _nominal(axes: Axes, row: int, off_percent: float, label: str | None) -> None:
    beyond = abs(off_percent) > WIDEST_PERCENT
    marker = ("<" if off_percent < 0.0 else ">") if beyond else "D"
    inside = np.clip(off_percent, -WIDEST_PERCENT, WIDEST_PERCENT)
    axes.plot(inside, row, marker, color=style.VERMILION, markersize=5, markerfacecolor="none", clip_on=False,
              label=label)  # fmt: skip


def draw_power(power: Mapping[str, Visible]) -> Figure:
    """Smallest size of each effect that these recordings would have shown, as a share of the largest expected."""
    shown = {name: one for name, one in power.items() if one.largest}
    figure = style.figure(WIDTH_IN, 0.9 + ROW_IN * len(shown))
    axes = figure.axes[0]
    axes.set_xscale("log")
    axes.set_xlim(100.0 * LEAST_SHARE, 1500.0)
    axes.set_xticks([0.1, 1.0, 10.0, 100.0], ["0.1", "1", "10", "100"])
    _rows(axes, list(shown))
    for row, one in enumerate(shown.values()):
        _visible(axes, row, one)
    style.labelled(axes, "smallest visible size (% of the largest expected)", "")
    return figure


def _visible(axes: Axes, row: int, one: Visible) -> None:
    """From the smallest seen to the largest expected; empty when nothing of that would be seen."""
    seen = one.smallest is not None and one.largest is not None and abs(one.smallest) < abs(one.largest)
    text = f"{one.parameter} from {amount(one.smallest, one.unit, 2)}" if seen else "not visible at any size"
    left = 100.0 * max(abs((one.smallest or 0.0) / (one.largest or 1.0)), LEAST_SHARE) if seen else 100.0
    if seen:
        axes.plot((left, 100.0), (row, row), color=style.GREEN, linewidth=6.0, alpha=0.4, solid_capstyle="butt")
    colour = style.GREEN if seen else style.VERMILION
    axes.plot(left, row, "o", color=colour, markersize=5, markerfacecolor=colour if seen else "none")
    # beside the bar, where there is room
    at, offset, side = (left, -7, "right") if left > ROOM_PERCENT else (100.0, 7, "left")
    axes.annotate(plain(text), (at, row), (offset, 0), textcoords="offset points", ha=side, va="center",
                  fontsize=style.NOTE_PT)  # fmt: skip


def _rows(axes: Axes, names: Sequence[str]) -> None:
    """A named row for each, the first on top."""
    axes.set_yticks(range(len(names)), [plain(brief(name)) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(False, axis="y")
