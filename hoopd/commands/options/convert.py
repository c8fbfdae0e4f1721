"""Options of `hoopd convert`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import columns_option, hold_option, json_option, plant_option


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
