"""Options of `hoopd watch`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import option
from hoopd.commands.options.running import config_option, sets_option
from hoopd.commands.options.shared import json_option


@dataclass(frozen=True, kw_only=True)
class WatchOptions:
    """Show a running daemon in the terminal, live, until Ctrl-C: mode, faults, angles, lateness."""

    connect: str | None = option(
        "--connect",
        text="Endpoint of the daemon's telemetry; without it the configuration's.",
        metavar="tcp/HOST:PORT",
    )
    once: bool = option("--once", text="Show it once and end.", default=False)
    lines: bool = option("--lines", text="One line a second, as where no terminal is.", default=False)
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    json_path: Path | None = json_option()
