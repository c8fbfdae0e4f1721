"""The web page: from its options to the server.

Rules of this file: heavy imports are made inside; the configuration says where the daemon is, and how one gets in.
"""

from __future__ import annotations

import typer

from hoopd.commands.options.dashboard import DashboardOptions


def dashboard(options: DashboardOptions) -> None:
    """Serve the page until the process is told to end."""
    from hoopd.dashboard.process import serve
    from hoopd.shell.config import load

    telemetry = load(options.config, sim=False, overrides=list(options.sets)).telemetry
    # Of zenoh's keys a reader shares user, password and certificates with the daemon, not where it listens.
    extras = {key: value for key, value in telemetry.zenoh.items() if key.partition("/")[0] == "transport"}
    serve(options.connect or (telemetry.endpoint,), extras, options.listen, lambda at: typer.echo(f"dashboard: {at}"))
