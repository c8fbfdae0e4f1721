"""The picture of recordings as a figure: channels below each other, recordings over each other, modes behind them.

Rules of this file: draws what it is given.
"""

from __future__ import annotations

from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from hoopd.plots import style
from hoopd.plots.panels import DrawnCurve, RecordingPicture

WIDTH_IN, PANEL_IN, REST_IN = 9.0, 1.75, 1.1
# Behind a mode: RUNNING is what one looks for, and stays white.
SHADES: Final = {"DISARMED": "#E4E4E4", "READY": "#DCEBF7", "STOPPING": "#FBE8CC", "FAULT": "#F6D3C2"}
# Fewer samples are shown one by one.
FEW_SAMPLES = 200


def draw_picture(shown: RecordingPicture) -> Figure:
    """One axes a channel over one time, with a legend of recordings and modes above them."""
    rows = len(shown.panels)
    title = shown.recordings[0] if len(shown.recordings) == 1 else ""
    figure = style.figure(WIDTH_IN, REST_IN + PANEL_IN * rows, rows=rows, title=title, sharex=True)
    for axes, panel in zip(figure.axes, shown.panels, strict=True):
        for curve in panel.curves:
            _draw(axes, curve, shown.curve_name(curve.recording), style.COLOURS[curve.recording % len(style.COLOURS)])
        if panel.wanted is not None:
            axes.step(*panel.wanted[1:3], where="post", color=style.GREY, linestyle=":", linewidth=1.2, label="wanted")
        for span in shown.modes:
            if span.mode in SHADES:
                top = 1.0 - span.recording / len(shown.recordings)
                band = {"ymin": top - 1.0 / len(shown.recordings), "ymax": top}
                axes.axvspan(span.start_s, span.end_s, color=SHADES[span.mode], linewidth=0, zorder=0, **band)
        axes.set_ylabel(panel.label.replace(", ", "\n", 1))
        axes.margins(x=0.0)
    figure.align_ylabels(figure.axes)
    figure.axes[-1].set_xlabel("time (s)")
    _legend(figure.axes[0], shown)
    return figure


def _draw(axes: Axes, curve: DrawnCurve, name: str, colour: str) -> None:
    marker = "." if len(curve.t) <= FEW_SAMPLES else ""
    how = "steps-post" if curve.held else "default"
    axes.plot(
        curve.t, curve.values, label=name, color=colour, drawstyle=how, linewidth=1.0, marker=marker, markersize=3
    )


def _legend(axes: Axes, shown: RecordingPicture) -> None:
    """Recordings where there are several, what was wanted, and the modes that are shaded."""
    modes = dict.fromkeys(span.mode for span in shown.modes if span.mode in SHADES)
    handles, labels = axes.get_legend_handles_labels()
    kept = [
        (one, label)
        for one, label in zip(handles, labels, strict=True)
        if len(shown.recordings) > 1 or label == "wanted"
    ]
    kept += [(Patch(facecolor=SHADES[mode]), mode) for mode in modes]
    if kept:
        style.legend(
            axes, handles=[one for one, _ in kept], labels=[label for _, label in kept],
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=min(len(kept), 4), borderaxespad=0.1,
        )  # fmt: skip
