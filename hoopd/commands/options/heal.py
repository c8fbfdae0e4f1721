"""Options of `hoopd heal`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.running import config_option, sets_option
from hoopd.commands.options.shared import json_option


@dataclass(frozen=True, kw_only=True)
class HealOptions:
    """Follow a running daemon: diagnose what changed, propose a model and a controller, try them, go back by itself."""

    action: str = argument("watch, list, show, accept, leave or restore.", metavar="ACTION", default="watch")
    number: str = argument("show, accept, leave, restore: a version's number.", metavar="NUMBER", default="")
    out: Path = option(
        "--out", text="Folder of the versions; what was broken off goes on.", default=Path("healed"), metavar="FOLDER"
    )
    recordings: Path | None = option(
        "--recordings", text="watch: folder into which the daemon records.", metavar="FOLDER", python=False
    )
    controllers: Path | None = option(
        "--controllers", text="watch, restore: the daemon's folder of controllers.", metavar="FOLDER", python=False
    )
    policy: Path | None = option(
        "--policy", text="watch: what may be learned without a person (hoopd.policy/1).", metavar="FILE"
    )
    memory: Path | None = option(
        "--memory",
        text="watch: what is known of this device (hoopd.memory/1): each diagnosis's prior; what is kept is added.",
        metavar="FILE",
        python=False,
    )
    connect: str | None = option(
        "--connect",
        text="watch: endpoint of the daemon's telemetry; without it the configuration's.",
        metavar="tcp/HOST:PORT",
    )
    window_s: float = option("--window", min=20.0, max=600.0, text="Seconds that are diagnosed.", default=40.0)
    every_s: float = option(
        "--every",
        min=0.0,
        text="Diagnose so often, s, without a drift, too; 0: only when the model drifts.",
        default=0.0,
    )
    trial_s: float = option("--trial", min=5.0, max=600.0, text="Seconds of a trial that count.", default=30.0)
    by: str = option("--by", text="What the promise is of: ball (its error), or cost (of the design).", default="ball")
    grammar: bool = option(
        "--grammar/--library-only", text="Also look for mechanisms that the library has no name for.", default=False
    )
    jobs: int = option("--jobs", min=1, max=64, text="Processes that share a diagnosis.", default=1)
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    json_path: Path | None = json_option()
