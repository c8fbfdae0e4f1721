"""Commands to a running daemon: by its socket, or over zenoh where a configuration names that way.

Rules of this file: one request, one answer, printed; no decision is taken here.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from hoopd.commands.options.running import (
    AcceptOptions,
    ArmOptions,
    ClearOptions,
    ControllerOptions,
    DaemonOptions,
    DisarmOptions,
    RefOptions,
    RevertOptions,
    StatusOptions,
    StopOptions,
    TuneOptions,
)
from hoopd.commands.output import check_json, print_result, write_json
from hoopd.files.reading import InputError

if TYPE_CHECKING:
    from hoopd.shell.config import Config

# The daemon takes a trial back when its supervisor was silent for five seconds.
ALIVE_S = 1.0


def ask(request: dict[str, Any], config: Path | None, sets: Sequence[str]) -> dict[str, Any]:
    """The daemon's answer; InputError where there is no daemon or it refuses."""
    from hoopd.shell import config as configuration, operator

    settings = configuration.load_to_ask(config, list(sets))
    try:
        return operator.ask(request, settings.device.name, settings.commands.socket)
    except operator.NoDaemonError:
        answer = _ask_over_zenoh(request, settings)
        if answer is None:
            raise
        return answer


def _ask_over_zenoh(request: dict[str, Any], settings: Config) -> dict[str, Any] | None:
    """The other way: where a configuration names the session of control, and for what is taken from everybody."""
    from hoopd.shell.commands import ALWAYS
    from hoopd.shell.operator import NoDaemonError
    from hoopd.shell.remote import send

    telemetry, name = settings.telemetry, request["command"]
    places = [(telemetry.control.endpoint, telemetry.control.zenoh)] if name != "status" else []
    places += [(telemetry.endpoint, telemetry.zenoh)] if name in ALWAYS else []
    for endpoint, zenoh in places:
        # Of zenoh's keys an operator shares user, password and certificates with the daemon, not where it listens.
        extras = {key: value for key, value in zenoh.items() if key.partition("/")[0] == "transport"}
        with contextlib.suppress(NoDaemonError):
            if endpoint:
                value, key = request.get("value"), request.get("key", "")
                return send(name, value, endpoint, settings.device.name, key=key, extras=extras)
    return None


def _command(request: dict[str, Any], options: DaemonOptions | RefOptions | TuneOptions) -> None:
    """Send it and print how the daemon stood once it had obeyed."""
    answer = ask(request, options.config, options.sets)
    typer.echo(f"{request['command']}: {answer['mode']}, reference {answer['reference']:g} rad")


def arm(options: ArmOptions) -> None:
    """Arm."""
    _command({"command": "arm"}, options)


def disarm(options: DisarmOptions) -> None:
    """Disarm."""
    _command({"command": "disarm"}, options)


def stop(options: StopOptions) -> None:
    """Brake, then disarm."""
    _command({"command": "stop"}, options)


def clear(options: ClearOptions) -> None:
    """Acknowledge what is over."""
    _command({"command": "clear"}, options)


def ref(options: RefOptions) -> None:
    """Set the reference."""
    _command({"command": "reference", "value": options.value}, options)


def tune(options: TuneOptions) -> None:
    """Change a parameter of the law."""
    _command({"command": "tune", "key": options.key, "value": options.value}, options)


def controller(options: ControllerOptions) -> None:
    """Load a controller; of one on trial, say every second that somebody watches."""
    from hoopd.files.controller_folder import key_of

    if options.trial and options.experiment:
        raise InputError("--trial", "", "not with --experiment, which ends by itself")
    name = "trial" if options.trial else "experiment" if options.experiment else "controller"
    key = options.file if "@" in options.file else key_of(Path(options.file))
    answer = ask({"command": name, "key": key}, options.config, options.sets)
    typer.echo(f"{name}: {answer['mode']}, {answer['key']}")
    if options.trial:
        _supervise(options)


def _supervise(options: ControllerOptions) -> None:
    """Until the trial is over; who interrupts takes it back."""
    from hoopd.shell.operator import CommandError

    try:
        while True:
            time.sleep(ALIVE_S)
            ask({"command": "alive"}, options.config, options.sets)
    except KeyboardInterrupt:
        ask({"command": "revert"}, options.config, options.sets)
        typer.echo("revert: the accepted controller is back")
    except CommandError as error:
        typer.echo(f"{error}; in force: {_in_force(options)}")


def _in_force(options: ControllerOptions) -> str:
    """The file that acts now."""
    told = ask({"command": "status"}, options.config, options.sets)["status"]["controller"]
    return f"{told['file']}@{told['sha256'][:12]} since {told['since']:.2f} s"


def accept(options: AcceptOptions) -> None:
    """Keep what is on trial."""
    _command({"command": "accept"}, options)


def revert(options: RevertOptions) -> None:
    """Back to what was accepted."""
    _command({"command": "revert"}, options)


def status(options: StatusOptions) -> None:
    """Show how it stands."""
    check_json(options.json_path)
    answer = ask({"command": "status"}, options.config, options.sets)
    fields = {**answer["status"], "session": answer["session"]}
    write_json(options.json_path, fields)
    print_result(fields)
