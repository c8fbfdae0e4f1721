"""The picture of recordings as a page that stands alone: zoom, cursor and values, without a network or a server.

Rules of this file: one file holds numbers, script and library; nothing is fetched, and the page forbids it by its own
policy; every text is escaped; the same recordings give the same bytes. uPlot draws (its licence goes with it).
"""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from hoopd.plots.panels import DIFFERENCE, DifferenceRow, DrawnCurve, RecordingPicture
from hoopd.recording.recording import Column

HERE: Final = Path(__file__).parent
# The library is shipped once, with the web page of running daemons.
UPLOT: Final = HERE.parent / "dashboard" / "static" / "uplot"
POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
# A screen is 4000 px wide at most; beyond this a curve's extremes of every bit of time are as good as all of it.
MOST_SAMPLES: Final = 60_000
DIGITS: Final = 7
MICROSECOND: Final = 6


def recording_page(shown: RecordingPicture) -> bytes:
    """The page as UTF-8."""
    names = html.escape(", ".join(shown.recordings))
    licence = _text(UPLOT / "LICENSE").replace("--", "- -")
    # A text inside a script must not end it.
    data = json.dumps(_data(shown), ensure_ascii=False, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{names}</title>
<!-- uPlot:
{licence}-->
<style>{_text(UPLOT / "uPlot.min.css")}</style>
<style>
{_text(HERE / "recording_page.css")}</style>
</head>
<body>
<header>
<h1>{names}</h1>
<p id="key"></p>
{_figures(shown)}<p class="how">Drag over a chart to zoom all of them, double-click to see everything again.
<button>Everything</button></p>
</header>
<main></main>
<noscript>The charts are drawn by a script, which this browser does not run.</noscript>
<script type="application/json" id="data">{data}</script>
<script>{_text(UPLOT / "uPlot.iife.min.js")}</script>
<script>
{_text(HERE / "recording_page.js")}</script>
</body>
</html>
""".encode()


FIGURES: Final = ("channel", "rms, first", "rms, second", "rms of the difference", "its mean", "its largest")


def _figures(shown: RecordingPicture) -> str:
    """How two were laid over each other, and how far they are apart."""
    note = f"<p>{html.escape(shown.note)}</p>\n" if shown.note else ""
    if not shown.figures:
        return note
    head = "".join(f'<th scope="col">{name}</th>' for name in FIGURES)
    rows = "".join(f"<tr>{_row(one)}</tr>\n" for one in shown.figures)
    table = f"<table><thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table>"
    return f'{note}<div class="figures" tabindex="0" role="region" aria-label="Differences">{table}</div>\n'


def _row(one: DifferenceRow) -> str:
    label = html.escape(f"{one.channel} ({one.unit})" if one.unit else one.channel)
    numbers = (one.first_rms, one.second_rms, one.rms, one.mean, one.largest)
    return f'<th scope="row">{label}</th>' + "".join(f"<td>{value:.4g}</td>" for value in numbers)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _data(shown: RecordingPicture) -> dict[str, Any]:
    panels = [
        {
            "label": panel.label,
            "curves": [_numbers(curve) for curve in panel.curves],
            **({"wanted": _numbers(panel.wanted)} if panel.wanted else {}),
        }
        for panel in shown.panels
    ]
    return {"recordings": shown.recordings, "neither": DIFFERENCE, "panels": panels, "modes": shown.modes}


def _numbers(curve: DrawnCurve) -> dict[str, Any]:
    t, values = thinned(curve.t, curve.values)
    rounded = [None if np.isnan(value) else float(f"{value:.{DIGITS}g}") for value in values]
    return {"recording": curve.recording, "held": curve.held, "t": np.round(t, MICROSECOND).tolist(), "y": rounded}


def thinned(t: Column, values: Column, most: int = MOST_SAMPLES) -> tuple[Column, Column]:
    """At most so many samples: of every bit of the curve its smallest and its largest, gaps kept."""
    if len(t) <= most:
        return t, values
    bits = np.array_split(np.arange(len(t)), most // 3)
    kept: set[int] = {0, len(t) - 1}
    for bit in bits:
        part = values[bit]
        gaps = np.isnan(part)
        if gaps.any():
            kept.add(int(bit[int(np.argmax(gaps))]))
        if not gaps.all():
            kept |= {int(bit[int(np.nanargmin(part))]), int(bit[int(np.nanargmax(part))])}
    rows = np.array(sorted(kept))
    return t[rows], values[rows]
