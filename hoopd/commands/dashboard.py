"""The web page: from its options to the server.

Rules of this file: heavy imports are made inside; the configuration says where the daemon is, and how one gets in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

from hoopd.commands.options.dashboard import DashboardOptions
from hoopd.files.reading import InputError

if TYPE_CHECKING:
    from hoopd.dashboard.work.bench import Bench
    from hoopd.shell.config import ControlSession

RESULTS = "hoopd-results"


def dashboard(options: DashboardOptions) -> None:
    """Serve the page until the process is told to end."""
    from hoopd.dashboard.audit import Audit
    from hoopd.dashboard.feed import Feed
    from hoopd.dashboard.guide.guide import KeptCalibrations
    from hoopd.dashboard.operators import Operators
    from hoopd.dashboard.process import ServerAddress, serve
    from hoopd.shell.config import calibrations, load_to_ask

    config = load_to_ask(options.config, list(options.sets))
    telemetry, kept = config.telemetry, calibrations(options.config, list(options.sets))
    endpoints = options.connect or (telemetry.endpoint,)
    # Of zenoh's keys a reader shares user, password and certificates with the daemon, not where it listens.
    extras = {key: value for key, value in telemetry.zenoh.items() if key.partition("/")[0] == "transport"}
    where = ServerAddress(listen=options.listen, names=options.names, certificate=options.certificate, key=options.key)
    operators = Operators(_controls(options, endpoints, telemetry.control))
    bench = _bench(options)
    feed, audit = Feed(endpoints, extras), Audit(options.audit)
    serve(
        feed,
        operators,
        audit,
        where,
        lambda at: typer.echo(f"dashboard: {at}"),
        bench,
        KeptCalibrations(kept, config.device.name),
        options.follow,
    )


def _bench(options: DashboardOptions) -> Bench | None:
    from hoopd.dashboard.work.bench import Bench

    if options.recordings is None:
        for name, given in (("--results", options.results), ("--controllers", options.controllers)):
            if given is not None:
                raise InputError(name, "", "goes with --recordings")
        return None
    return Bench(options.recordings, options.results or options.recordings / RESULTS, options.controllers)


def _controls(
    options: DashboardOptions, endpoints: Sequence[str], control: ControlSession
) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """Where the daemon of each endpoint takes commands, with zenoh's keys for it."""
    told = options.control or ((control.endpoint,) if control.endpoint and not options.connect else ())
    if len(told) > len(endpoints):
        raise InputError("--control", "", f"{len(told)} endpoints of control beside {len(endpoints)} of telemetry")
    return {endpoint: (one, control.zenoh) for endpoint, one in zip(endpoints, told, strict=False)}
