"""Options of `hoopd calibration`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.running import config_option, sets_option
from hoopd.commands.options.shared import json_option


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """List the accepted calibrations of a device, show one, add one, or restore an earlier one."""

    action: str = argument("list, show, add or restore.", metavar="ACTION")
    what: str = argument(
        "show, restore: a version's number; add: a file as `hoopd calibrate --save` writes it.",
        metavar="NUMBER|FILE",
        default="",
    )
    why: str = option("--why", text="add: the occasion, in a few words.", default="", metavar="TEXT")
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    json_path: Path | None = json_option()
