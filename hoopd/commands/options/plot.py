"""Options of `hoopd plot`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, names_of, option
from hoopd.commands.options.shared import SLICE, age_option, columns_option, hold_option, json_option, plant_option


@dataclass(frozen=True, kw_only=True)
class PlotOptions:
    """Draw recordings: channels below each other, recordings over each other."""

    recordings: tuple[str, ...] = argument(f"Recordings: {SLICE}.", metavar="REC...")
    channels: tuple[str, ...] = option(
        "--channels",
        text="What is drawn, in this order; all that was measured by default.",
        metavar="NAME,...",
        default="",
        read=names_of,
    )
    out: Path | None = option(
        "--out",
        text="The picture: .png, .svg or .pdf, or .html, a page to zoom in; NAME-plot.png of the first by default.",
        metavar="FILE",
    )
    from_zero: bool = option("--from-zero", text="Let every recording begin at zero.", default=False)
    compare: bool = option(
        "--compare",
        text="Two recordings: aligned by their inputs, with the difference below each channel, and its figures.",
        default=False,
    )
    plant: str | None = plant_option()
    columns: str | None = columns_option()
    hold: str = hold_option()
    age: str = age_option()
    json_path: Path | None = json_option()
