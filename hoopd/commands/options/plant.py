"""Options of `hoopd plant`.

Rules of this file: the record and its way to the command.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import typer

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import figure_option, json_option


@dataclass(frozen=True, kw_only=True)
class PlantOptions:
    """Write a new plant file, check one, or show what a plant is (docs/guides/your_plant.md)."""

    action: str = argument("new, check or show.", metavar="ACTION")
    plant: str = argument(
        "Plant file (.yaml, or .py, which is run as code); to check or show also hoop, pendulum, axis, tanks, falling.",
        metavar="FILE",
    )
    kind: str = option("--kind", text="new: mechanical or first-order.", default="mechanical", metavar="KIND")
    figure: Path | None = figure_option("check, show: draw a free run into this file (.png, .svg or .pdf).")
    json_path: Path | None = json_option()


def plant(options: PlantOptions) -> None:
    """Run the command; exit code 1 when a check says no."""
    from hoopd.commands.options.shared import check_files, finish
    from hoopd.commands.plant import run, shown

    inputs = [] if options.action == "new" else [options.plant]
    check_files(inputs, figure=options.figure, json=options.json_path)
    result = run(options)
    finish(result, options.json_path, shown(result))
    if result.get("good") is False:
        raise typer.Exit(1)
