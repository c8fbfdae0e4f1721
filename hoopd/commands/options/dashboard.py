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
    control: tuple[str, ...] = option(
        "--control",
        text="Endpoint of a daemon's telemetry.control, in the order of --connect: who logs in commands there.",
        metavar="tcp/HOST:PORT",
        default=(),
    )
    listen: str = option(
        "--listen",
        text="Where the page is served; beyond this machine with TLS only.",
        metavar="HOST:PORT",
        default="127.0.0.1:8765",
    )
    names: tuple[str, ...] = option(
        "--name",
        text="Name by which browsers reach the page, beside its address.",
        metavar="HOST",
        default=(),
    )
    certificate: Path | None = option("--certificate", text="Certificate of the page's server (PEM).", metavar="FILE")
    key: Path | None = option("--key", text="Its private key (PEM).", metavar="FILE")
    audit: Path | None = option(
        "--audit", text="Who commanded what, a line of JSON each; without it on standard error.", metavar="FILE"
    )
    recordings: Path | None = option(
        "--recordings",
        text="Folder of recordings to list, plot and work on; without it the page has no bench.",
        metavar="FOLDER",
    )
    results: Path | None = option(
        "--results",
        text="Where jobs and remarks are kept; hoopd-results in the recordings' folder by default.",
        metavar="FOLDER",
    )
    controllers: Path | None = option(
        "--controllers",
        text="The daemon's folder of controllers, where this machine has it: jobs' controllers are laid in.",
        metavar="FOLDER",
    )
    follow: tuple[Path, ...] = option(
        "--follow",
        text="Folder of a `hoopd learn` or `hoopd heal` to show, once for each.",
        metavar="FOLDER",
        default=(),
    )
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
