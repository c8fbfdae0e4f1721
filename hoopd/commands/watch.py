"""`hoopd watch`: a running daemon in the terminal, live.

Rules of this file: it listens as any subscriber does and commands nothing; a daemon that is gone is waited for. Ctrl-C
is its ordinary end.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import typer

from hoopd.commands.options.watch import WatchOptions
from hoopd.files.reading import InputError

if TYPE_CHECKING:
    from hoopd.commands.watched import WatchedDaemon
    from hoopd.dashboard.feed import Connection
    from hoopd.shell.config import TelemetryConfig

REFRESH_S: Final = 0.25
LINE_S: Final = 1.0
WAITING_S: Final = 10.0  # between two lines that say that nothing comes
# A status comes every second, and a connection takes a moment.
FIRST_S: Final = 4.0


class DaemonWatch:
    """A connection, the daemon that is watched over it, and what became of it since the look before."""

    def __init__(self, connection: Connection, wanted: str) -> None:
        """`wanted`: name of the device; another one is taken where that one never came."""
        from hoopd.commands.watched import WatchedDaemon

        self.connection, self._wanted = connection, wanted
        self.daemon: WatchedDaemon = WatchedDaemon()
        self.news = ""
        self._was_there, self._gone_since_s = False, time.monotonic()
        self._run: str | None = None  # that was there last

    def look(self) -> str:
        """Take what came; one line when the daemon is gone, or back, since the look before."""
        devices = self.connection.devices
        device = devices.get(self._wanted) or next(iter(devices.values()), None)
        if device is not None:
            self.daemon.update(device, time.time())
        changed = self.daemon.there != self._was_there
        told = self._told() if changed else ""
        if changed:
            self._was_there = self.daemon.there
        if not self.daemon.there:
            waited_s = time.monotonic() - self._gone_since_s
            self.news = f"no daemon for {waited_s:.0f} s, waiting: {self._trouble()}"
        elif told:
            self.news = told
        return told

    def _told(self) -> str:
        if not self.daemon.there:
            self._gone_since_s = time.monotonic()
            return f"the daemon is gone: {self._trouble()}"
        before, self._run = self._run, self.daemon.run
        if before is None:
            return ""
        return f"the daemon is back, {'the same' if before == self.daemon.run else 'another'} run"

    def _trouble(self) -> str:
        return self.connection.trouble or "it says nothing"


def watch(options: WatchOptions) -> None:
    """Show it until Ctrl-C, or once."""
    from hoopd.shell.config import load_to_ask

    if options.json_path is not None and not options.once:
        raise InputError("--json", "", "only with --once")
    config = load_to_ask(options.config, list(options.sets))
    with _connected(options, config.telemetry) as connection:
        shown = DaemonWatch(connection, config.device.name)
        if options.once:
            _once(shown, options)
            return
        with contextlib.suppress(KeyboardInterrupt):
            _lines(shown) if options.lines else _live(shown)


@contextlib.contextmanager
def _connected(options: WatchOptions, telemetry: TelemetryConfig) -> Iterator[Connection]:
    from hoopd.dashboard.feed import Connection

    # Of zenoh's keys a reader shares user, password and certificates with the daemon, not where it listens.
    extras = {key: value for key, value in telemetry.zenoh.items() if key.partition("/")[0] == "transport"}
    connection = Connection(options.connect or telemetry.endpoint, extras)
    connection.start()
    try:
        yield connection
    finally:
        connection.close()


def _once(shown: DaemonWatch, options: WatchOptions) -> None:
    """The first status and the tables; InputError when there is none in time."""
    from rich.console import Console

    from hoopd.commands.output import check_json, write_json
    from hoopd.commands.watch_view import view

    check_json(options.json_path)
    end = time.monotonic() + FIRST_S
    while not (shown.daemon.there and shown.daemon.status and shown.daemon.numbers):
        if time.monotonic() > end:
            raise InputError(shown.connection.endpoint, "", shown.connection.trouble or "no daemon says anything there")
        time.sleep(0.05)
        shown.look()
    record: dict[str, Any] = {"endpoint": shown.connection.endpoint, **shown.daemon.record()}
    write_json(options.json_path, record)
    Console().print(view(shown.daemon, shown.connection.endpoint, ""))


def _live(shown: DaemonWatch) -> None:
    """Tables that are drawn anew in their place; without a terminal one line a second."""
    from rich.console import Console
    from rich.live import Live

    from hoopd.commands.watch_view import view

    console = Console()
    if not console.is_terminal:
        return _lines(shown)
    with Live(console=console, auto_refresh=False) as live:
        while True:
            shown.look()
            live.update(view(shown.daemon, shown.connection.endpoint, shown.news), refresh=True)
            time.sleep(REFRESH_S)


def _lines(shown: DaemonWatch) -> None:
    """A line a second, and one for whatever becomes of the daemon."""
    from hoopd.commands.watch_view import fault_lines, line

    faults: list[str] = []
    due_s = waits_s = time.monotonic() + LINE_S
    while True:
        if told := shown.look():
            typer.echo(told)
        now_s = time.monotonic()
        if shown.daemon.there and now_s >= due_s:
            told_faults = fault_lines(shown.daemon)
            typer.echo("\n".join([line(shown.daemon), *(told_faults if told_faults != faults else [])]))
            due_s, faults = now_s + LINE_S, told_faults
        elif not shown.daemon.there and now_s >= waits_s:
            typer.echo(shown.news)
            waits_s = now_s + WAITING_S
        time.sleep(REFRESH_S)
