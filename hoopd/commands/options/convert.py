"""Options of `hoopd convert`.

Rules of this file: the record and its way to the command.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import check_files, columns_option, finish, hold_option, json_option, plant_option


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """Convert a recording between formats; cut and resample on the way."""

    source: Path = argument("Recording: .mcap, .mat, .h5 (also FILE.h5:Exp2) or .csv.", metavar="IN")
    target: Path = argument("Where it goes; the extension says the format.", metavar="OUT")
    plant: str | None = plant_option()
    columns: str | None = columns_option()
    hold: str = hold_option()
    experiment: str | None = option("--experiment", text="Group of an .h5 file, e.g. Exp2; struct of a .mat file.")
    start: float | None = option("--from", text="First second to keep.")
    end: float | None = option("--to", text="Last second to keep.")
    step: float | None = option("--step", text="Resample to this step in seconds.")
    json_path: Path | None = json_option()


def convert(options: ConvertOptions) -> None:
    """Run the command."""
    from hoopd.commands.convert import run

    check_files([options.source], target=options.target, json=options.json_path)
    finish(run(options), options.json_path)
