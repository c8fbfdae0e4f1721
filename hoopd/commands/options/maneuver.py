"""Options of `hoopd maneuver`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import option
from hoopd.commands.options.running import (
    arm_option,
    camera_option,
    config_option,
    sets_option,
    speed_option,
)
from hoopd.commands.options.shared import figure_option, json_option
from hoopd.commands.options.trajectory import kind_argument


@dataclass(frozen=True, kw_only=True)
class ManeuverOptions:
    """Play a planned maneuver from rest at the bottom and back, record and judge it."""

    kind: str = kind_argument()
    trajectory: Path | None = option(
        "--trajectory", text="Of `hoopd trajectory`; planned on the filter's model without.", metavar="FILE"
    )
    repeat: int = option("--repeat", min=1, max=1000, text="So often, one after another.", default=1)
    practice: int = option(
        "--practice",
        min=0,
        max=3,
        text="throw: so many practice throws first, from which the restitution is identified and used in the plan.",
        default=0,
    )
    correction: Path | None = option(
        "--correction",
        text="Play --trajectory with what --learn wrote beside it, and leave that as it is.",
        metavar="FILE",
    )
    learn: bool = option(
        "--learn",
        text="loop, swing: each attempt is played with what the ones before have taught, written beside --trajectory.",
        default=False,
    )
    sim: bool = option("--sim", text="On the simulated rig.", default=False)
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    seed: int = option("--seed", min=0, text="Seed of everything random in the rig.", default=0)
    record: Path | None = option("--record", text="Existing folder for the recording.")
    out: Path | None = option("--out", text="The recording's file (.mcap).", metavar="FILE")
    figure: Path | None = figure_option("Draw plan, estimate and measurement.")
    speed: str = speed_option()
    camera: str | None = camera_option()
    arm: bool = arm_option()
    json_path: Path | None = json_option()
