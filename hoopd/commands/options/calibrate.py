"""Options of `hoopd calibrate`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import json_option


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """Propose colour weights, threshold, circle and zero angle, drawn on the picture."""

    picture: Path | None = argument("One picture of the hoop with the ball at rest.", default=None)
    positions: Path | None = option(
        "--positions", text="Recorded ball positions (.csv, .npy or .mcap).", metavar="FILE"
    )
    moving: Path | None = option(
        "--moving", text="Recorded test signal: signs, torque and the camera's delay.", metavar="REC"
    )
    model: Path | None = option(
        "--model", text="With --moving: the model in force; a shipped one by default.", metavar="MODEL"
    )
    json_path: Path | None = json_option()
    figure: Path | None = option("--figure", text="Where the drawn proposal goes.")
    save: Path | None = option("--save", text="Save the proposal as a configuration file.")
