"""The command line.

Rules of this file: parse, call, print; no decision is taken here. Heavy imports are made inside the commands, so
that the daemon starts fast. Unusable input is one line on standard error and exit code 2; a missing port, 3.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
import threading
import warnings
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer

from hoopd.commands import cli_bench
from hoopd.commands.cli_options import JsonOption
from hoopd.commands.output import print_result, write_json
from hoopd.files.reading import PORT_MISSING, InputError, PortMissingError

if TYPE_CHECKING:
    from hoopd.shell.config import Config

# Matrices of four by four gain nothing from threads, and lose milliseconds to them; before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# OpenCV would unpack a picture of a gigapixel before anyone could refuse it; 4096 x 4096, before cv2 is imported.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(4096 * 4096))
# What OpenCV and its video library find wrong with an input comes as our one line.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

# What the parser of the command line raises: unknown options, values that do not fit.
UsageError: Any = typer.BadParameter.__base__

# Groups of commands on the page of help.
RUNNING, DEVICE = "A running daemon", "Device and rig"

app = typer.Typer(
    add_completion=True,
    no_args_is_help=False,
    pretty_exceptions_enable=False,
    help="Real-time controller daemon for a ball in a hoop. Without a command it runs the daemon.",
    epilog="Exit codes: 0 done; 1 the answer is no, or a mistake of this program; 2 unusable input or a refused "
    "command; 3 the board's port is not there.",
)

cli_bench.register(app)

ConfigOption = Annotated[Path | None, typer.Option("--config", help="Configuration file (YAML).", metavar="FILE")]
SetOption = Annotated[list[str], typer.Option("--set", help="Override one key: a.b=value.", metavar="KEY=VALUE")]
SpeedOption = Annotated[str, typer.Option("--speed", help="1: real time; max: lock-step virtual time (--sim).")]
CameraOption = Annotated[
    str | None, typer.Option("--camera", help="direct: the rig's ball angle without pictures (--sim).")
]
ArmOption = Annotated[bool, typer.Option("--arm", help="Arm by itself once everything is well (terminal only).")]


@app.callback(invoke_without_command=True)
def run(
    context: typer.Context,
    sim: Annotated[bool, typer.Option("--sim", help="Run against the simulated rig.")] = False,
    config: ConfigOption = None,
    duration: Annotated[
        float | None, typer.Option("--duration", min=0.1, help="Seconds to run; without it until stopped.")
    ] = None,
    record: Annotated[Path | None, typer.Option("--record", help="Existing folder for the recording.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random in the rig.")] = 0,
    sets: SetOption = [],  # noqa: B006 (typer copies it)
    speed: SpeedOption = "1",
    camera: CameraOption = None,
    arm: ArmOption = False,
    json_path: JsonOption = None,
    version: Annotated[bool, typer.Option("--version", help="Print the version and end.")] = False,
) -> None:
    """Run the daemon, or one of the commands below."""
    if context.invoked_subcommand is not None:
        _refuse_misplaced(context)
        return
    if version:
        from hoopd import __version__

        typer.echo(__version__)
        return
    from hoopd.daemon.app import Options, run_daemon

    chosen, direct = _speed(speed), _direct(camera)
    _check_json(json_path)
    if duration is not None and not isfinite(duration):
        raise InputError("--duration", "", "must be a finite number of seconds")
    options = Options(sim, config, tuple(sets), duration, record, seed, chosen, direct, arm)
    summary = run_daemon(options)
    write_json(json_path, summary)
    if summary["exit"]:
        raise typer.Exit(int(summary["exit"]))


def _refuse_misplaced(context: typer.Context) -> None:
    """An option before a command would be silently without effect: `hoopd --sim check` would check the device."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if source is not None and source.name == "COMMANDLINE":
            option = parameter.opts[0]
            raise InputError(option, "", f"belongs after the command: hoopd {context.invoked_subcommand} {option} ...")


@app.command(rich_help_panel=DEVICE)
def check(
    config: ConfigOption = None,
    sets: SetOption = [],  # noqa: B006
    sim: Annotated[bool, typer.Option("--sim", help="Check the simulated rig.")] = False,
    json_path: JsonOption = None,
) -> None:
    """Show what is configured and what is granted; proves the board's time-out by going silent."""
    from hoopd.daemon.app import check_device

    raise typer.Exit(check_device(config, sets, sim=sim, json_path=json_path))


def _ask(request: dict[str, Any], config: Path | None, sets: list[str]) -> dict[str, Any]:
    from hoopd.shell import config as configuration
    from hoopd.shell.operator import NoDaemonError, ask

    settings = configuration.load(config, sim=False, overrides=sets)
    try:
        return ask(request, settings.device.name, settings.commands.socket)
    except NoDaemonError:
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


def _command(request: dict[str, Any], config: Path | None, sets: list[str]) -> None:
    """Send it and print how the daemon stood once it had obeyed."""
    answer = _ask(request, config, sets)
    typer.echo(f"{request['command']}: {answer['mode']}, reference {answer['reference']:g} rad")


@app.command(rich_help_panel=RUNNING)
def arm(config: ConfigOption = None, sets: SetOption = []) -> None:  # noqa: B006
    """Arm the running daemon (acknowledges faults that are over)."""
    _command({"command": "arm"}, config, sets)


@app.command(rich_help_panel=RUNNING)
def disarm(config: ConfigOption = None, sets: SetOption = []) -> None:  # noqa: B006
    """Switch the running daemon's drive off at once."""
    _command({"command": "disarm"}, config, sets)


@app.command(rich_help_panel=RUNNING)
def stop(config: ConfigOption = None, sets: SetOption = []) -> None:  # noqa: B006
    """Let the running daemon brake the hoop, then disarm."""
    _command({"command": "stop"}, config, sets)


@app.command(rich_help_panel=RUNNING)
def clear(config: ConfigOption = None, sets: SetOption = []) -> None:  # noqa: B006
    """Acknowledge the running daemon's faults that are over; it stays disarmed."""
    _command({"command": "clear"}, config, sets)


@app.command(rich_help_panel=RUNNING, context_settings={"ignore_unknown_options": True})
def ref(
    value: Annotated[float, typer.Argument(help="Ball angle in rad.", metavar="RAD")],
    config: ConfigOption = None,
    sets: SetOption = [],  # noqa: B006
) -> None:
    """Set the running daemon's reference."""
    _command({"command": "reference", "value": _number(value)}, config, sets)


@app.command(rich_help_panel=RUNNING, context_settings={"ignore_unknown_options": True})
def tune(
    key: Annotated[str, typer.Argument(help="Parameter of the running law.", metavar="KEY")],
    value: Annotated[float, typer.Argument(help="Its new value.", metavar="VALUE")],
    config: ConfigOption = None,
    sets: SetOption = [],  # noqa: B006
) -> None:
    """Change a parameter of the running daemon's law."""
    _command({"command": "tune", "key": key, "value": _number(value)}, config, sets)


@app.command(rich_help_panel=RUNNING)
def status(config: ConfigOption = None, sets: SetOption = [], json_path: JsonOption = None) -> None:  # noqa: B006
    """Show the running daemon's mode, faults and what clears them, reference, lateness and counts."""
    _check_json(json_path)
    answer = _ask({"command": "status"}, config, sets)
    fields = {**answer["status"], "session": answer["session"]}
    write_json(json_path, fields)
    print_result(fields)


def _number(value: float) -> float:
    if not isfinite(value):
        raise InputError("VALUE", "", f"must be a finite number, not {value}")
    return value


@app.command(rich_help_panel=DEVICE)
def calibrate(
    picture: Annotated[Path | None, typer.Argument(help="One picture of the hoop with the ball at rest.")] = None,
    positions: Annotated[
        Path | None, typer.Option("--positions", help="Recorded ball positions (.csv, .npy or .mcap).", metavar="FILE")
    ] = None,
    json_path: JsonOption = None,
    figure: Annotated[Path | None, typer.Option("--figure", help="Where the drawn proposal goes.")] = None,
    save: Annotated[Path | None, typer.Option("--save", help="Save the proposal as a configuration file.")] = None,
) -> None:
    """Propose colour weights, threshold, circle and zero angle, drawn on the picture."""
    from hoopd.commands.calibrate import run as propose

    print_result(propose(picture, positions, json_path, figure, save))


@app.command(rich_help_panel=DEVICE)
def replay(
    recording: Annotated[Path, typer.Argument(help="A recording (.mcap) made by the daemon.")],
    json_path: JsonOption = None,
    run_law: Annotated[bool, typer.Option("--run-law", help="Run the user's own law in the recording: code.")] = False,
) -> None:
    """Recompute every command from the recorded inputs and compare bit for bit."""
    from hoopd.daemon.replay import replay as repeat

    result = repeat(recording, run_law=run_law)
    write_json(json_path, result)
    print_result(result)
    raise typer.Exit(0 if result["equal"] else 1)


@app.command(rich_help_panel=DEVICE)
def experiment(
    kind: Annotated[str, typer.Argument(help="prbs, chirp, multisine, steps or decay.", metavar="KIND")],
    sim: Annotated[bool, typer.Option("--sim", help="On the simulated rig.")] = False,
    config: ConfigOption = None,
    sets: SetOption = [],  # noqa: B006
    duration: Annotated[
        float | None, typer.Option("--duration", help="Seconds of signal; 20, for decay 34.", min=0.5, max=1200.0)
    ] = None,
    amplitude: Annotated[
        float | None, typer.Option("--amplitude", help="Torque in N m; without it what the model lets through.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the signal, and of the rig.")] = 0,
    clock: Annotated[int, typer.Option("--clock", min=1, max=1000, help="prbs: ticks that a value is held.")] = 1,
    low: Annotated[float, typer.Option("--low", help="chirp, multisine: lowest frequency in Hz.")] = 0.3,
    high: Annotated[float, typer.Option("--high", help="chirp, multisine: highest frequency in Hz.")] = 5.0,
    hold: Annotated[float, typer.Option("--hold", min=0.02, max=600.0, help="steps: seconds of each.")] = 0.4,
    kick: Annotated[float, typer.Option("--kick", min=0.02, max=600.0, help="decay: seconds of torque.")] = 0.2,
    rest: Annotated[
        float, typer.Option("--rest", min=0.02, max=600.0, help="decay: seconds without, after each kick.")
    ] = 8.0,
    max_torque: Annotated[float, typer.Option("--max-torque", min=0.001, max=0.7, help="Limit in N m.")] = 0.3,
    max_speed: Annotated[
        float, typer.Option("--max-speed", min=0.1, help="Hoop speed in rad/s that ends the experiment.")
    ] = 45.0,
    max_angle: Annotated[
        float, typer.Option("--max-angle", min=0.01, max=3.2, help="Ball angle in rad that ends the experiment.")
    ] = 1.25,
    soft_start: Annotated[
        float, typer.Option("--soft-start", min=0.0, max=60.0, help="Seconds in which the amplitude rises.")
    ] = 1.0,
    soft_end: Annotated[float, typer.Option("--soft-end", min=0.0, max=60.0, help="Seconds in which it falls.")] = 0.5,
    centring: Annotated[
        float, typer.Option("--centring", min=0.0, max=0.05, help="Feedback that slows the hoop, N m per rad/s.")
    ] = 0.0,
    around: Annotated[
        Path | None, typer.Option("--around", help="On top of this holding law.", metavar="CONTROLLER")
    ] = None,
    no_ball: Annotated[bool, typer.Option("--no-ball", help="There is no ball in the hoop; no camera needed.")] = False,
    record: Annotated[Path | None, typer.Option("--record", help="Existing folder for the recording.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="The recording's file (.mcap).", metavar="FILE")] = None,
    figure: Annotated[Path | None, typer.Option("--figure", help="Draw what was recorded.", metavar="FILE")] = None,
    speed: SpeedOption = "1",
    camera: CameraOption = None,
    arm: ArmOption = False,
    json_path: JsonOption = None,
) -> None:
    """Play a test signal within limits of torque, hoop speed and ball angle, and record it."""
    from hoopd.daemon.app import Options
    from hoopd.daemon.experiment import Where, run
    from hoopd.plants.hoop.experiment_plan import DURATION_S, DURATIONS_S, Plan

    seconds = DURATIONS_S.get(kind, DURATION_S) if duration is None else duration
    plan = Plan(
        kind, seconds, amplitude, seed, clock, low, high, hold, kick, rest, max_torque, max_speed, max_angle,
        soft_start, soft_end, centring, around, not no_ball,
    )  # fmt: skip
    options = Options(sim, config, tuple(sets), None, None, seed, _speed(speed), _direct(camera), arm)
    _check_json(json_path)
    result = run(plan, options, Where(record, out), figure)
    write_json(json_path, result)
    print_result(result)
    raise typer.Exit(result["exit"])


def _speed(text: str) -> Literal["1", "max"]:
    if text not in ("1", "max"):
        raise InputError("--speed", "", f"must be 1 or max, not {text!r}")
    return "max" if text == "max" else "1"


def _direct(camera: str | None) -> bool:
    if camera not in (None, "direct"):
        raise InputError("--camera", "", f"must be direct, not {camera!r}")
    return camera == "direct"


def _check_json(path: Path | None) -> None:
    """Said before a run, not after it."""
    if path is not None and not path.parent.is_dir():
        raise InputError(path, "--json", "no such folder")


def _own_streams() -> None:
    """Something stands at descriptors 0 to 2: a serial port that got one of them would be sent the log."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, this one
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115


def main() -> None:
    """Entry point: one clear line and exit code 2 for unusable input, 3 for a missing port."""
    _own_streams()
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # what a library warns of comes as our one line, or in the result's notes
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        code = app(prog_name="hoopd", standalone_mode=False)
    except UsageError as error:
        _refuse(f"{error.format_message()} (see hoopd --help)")
    except PortMissingError as error:
        _refuse(str(error), PORT_MISSING)
    except InputError as error:
        _refuse(str(error))
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(128 + signal.SIGINT)
    except OSError as error:
        if error.filename is not None or error.errno not in (errno.ENOSPC, errno.EPIPE, errno.EIO):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or the interpreter tries again at its end
        sys.stderr.write(f"hoopd: standard output: {(error.strerror or '').lower()}\n")
        sys.exit(1)
    else:
        sys.exit(code or 0)


def _refuse(line: str, code: int = 2) -> NoReturn:
    sys.stderr.write(f"hoopd: {line}\n")
    sys.exit(code)
