"""Options of `hoopd plant`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import figure_option, json_option


@dataclass(frozen=True, kw_only=True)
class PlantOptions:
    """Write a new plant file, check one, or show what a plant is (docs/guides/your_plant.md)."""

    action: str = argument("new, check or show.", metavar="ACTION")
    plant: str = argument(
        "Plant file (.yaml, or .py, which is run as code); to check or show also hoop, pendulum, axis, tanks, falling, "
        "circuit, drives.",
        metavar="FILE",
    )
    kind: str = option("--kind", text="new: mechanical or first-order.", default="mechanical", metavar="KIND")
    figure: Path | None = figure_option("check, show: draw a free run into this file (.png, .svg or .pdf).")
    json_path: Path | None = json_option()
