"""Options of the web page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import option
from hoopd.commands.options.running import config_option, sets_option


@dataclass(frozen=True, kw_only=True)
class DashboardOptions:
    """Show running daemons on a web page, live; a process of its own."""

    connect: tuple[str, ...] = option(
        "--connect",
        text="Endpoint of a daemon's telemetry, once for each; without it the configuration's.",
        metavar="tcp/HOST:PORT",
        default=(),
    )
    listen: str = option(
        "--listen", text="Where the page is served, on this machine.", metavar="HOST:PORT", default="127.0.0.1:8765"
    )
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
