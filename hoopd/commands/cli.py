"""The command line.

Rules of this file: parse, call, print; no decision is taken here. Heavy imports are made inside the commands, so
that the daemon starts fast. Unusable input is one line on standard error and exit code 2; a missing port, 3.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import typer

from hoopd.commands import device, offline, operator
from hoopd.commands.compare import compare
from hoopd.commands.dashboard import dashboard
from hoopd.commands.heal import heal
from hoopd.commands.options.calibrate import CalibrateOptions
from hoopd.commands.options.calibration import CalibrationOptions
from hoopd.commands.options.compare import CompareOptions
from hoopd.commands.options.convert import ConvertOptions
from hoopd.commands.options.dashboard import DashboardOptions
from hoopd.commands.options.declaration import add_command, command_of
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.commands.options.experiment import ExperimentOptions
from hoopd.commands.options.fit import FitOptions
from hoopd.commands.options.heal import HealOptions
from hoopd.commands.options.identify import IdentifyOptions
from hoopd.commands.options.learn import LearnOptions
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.options.plant import PlantOptions
from hoopd.commands.options.plot import PlotOptions
from hoopd.commands.options.replay import ReplayOptions
from hoopd.commands.options.running import (
    AcceptOptions,
    ArmOptions,
    CheckOptions,
    ClearOptions,
    ControllerOptions,
    DisarmOptions,
    RefOptions,
    RevertOptions,
    RunOptions,
    StatusOptions,
    StopOptions,
    TuneOptions,
)
from hoopd.commands.options.simulate import SimulateOptions
from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.options.watch import WatchOptions
from hoopd.commands.output import check_json, write_json
from hoopd.commands.run_options import run_options
from hoopd.commands.watch import watch
from hoopd.exit_codes import DONE, FAILED, PORT_MISSING, UNUSABLE_INPUT
from hoopd.files.reading import InputError, PortMissingError
from hoopd.linear_algebra import settle

# Before numpy is imported.
settle()
# OpenCV would unpack a picture of a gigapixel before anyone could refuse it; 4096 x 4096, before cv2 is imported.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(4096 * 4096))
# What OpenCV and its video library find wrong with an input comes as our one line.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

# What the parser of the command line raises: unknown options, values that do not fit.
UsageError: Any = typer.BadParameter.__base__

app = typer.Typer(
    add_completion=True,
    no_args_is_help=False,
    pretty_exceptions_enable=False,
    help="Real-time controller daemon for a ball in a hoop. Without a command it runs the daemon.",
    epilog="Exit codes: 0 done; 1 the answer is no, or a mistake of this program; 2 unusable input or a refused "
    "command; 3 the board's port is not there.",
)


def run(context: typer.Context, options: RunOptions) -> None:
    """Run the daemon, unless a command was named."""
    if context.invoked_subcommand is not None:
        _refuse_misplaced(context)
        return
    if options.version:
        from hoopd import __version__

        typer.echo(__version__)
        return
    _end_at_once()
    from hoopd.daemon.app import run_daemon

    asked = run_options(options, duration_s=options.duration, record=options.record, arm=options.arm)
    check_json(options.json_path)
    summary = run_daemon(asked)
    write_json(options.json_path, summary)
    if summary["exit"]:
        raise typer.Exit(int(summary["exit"]))


def _end_at_once() -> None:
    """Until the daemon unwinds by itself nothing is open: Ctrl-C ends the process.

    As an exception it could be raised in a destructor while modules are imported, and nobody would hear of it.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _refuse_misplaced(context: typer.Context) -> None:
    """An option before a command would be silently without effect: `hoopd --sim check` would check the device."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if source is not None and source.name == "COMMANDLINE":
            option = parameter.opts[0]
            raise InputError(option, "", f"belongs after the command: hoopd {context.invoked_subcommand} {option} ...")


def check(options: CheckOptions) -> None:
    """Check the device or the rig."""
    _end_at_once()
    from hoopd.daemon.app import check_device

    raise typer.Exit(check_device(options.config, list(options.sets), sim=options.sim, json_path=options.json_path))


# Groups of commands on the page of help, in its order: the record of the options and what it is handed to.
COMMANDS: Mapping[str, Sequence[tuple[type, Callable[..., None]]]] = {
    "Files: recordings, models, controllers": (
        (ConvertOptions, offline.convert),
        (PlotOptions, offline.plot),
        (FitOptions, offline.fit),
        (SimulateOptions, offline.simulate),
        (LinearizeOptions, offline.linearize),
        (DesignOptions, offline.design),
        (TrajectoryOptions, offline.trajectory),
        (DiagnoseOptions, offline.diagnose),
        (IdentifyOptions, offline.identify),
        (PlantOptions, offline.plant),
    ),
    "Device and rig": (
        (CheckOptions, check),
        (CalibrateOptions, device.calibrate),
        (CalibrationOptions, device.calibration),
        (ReplayOptions, device.replay),
        (ExperimentOptions, device.experiment),
        (CompareOptions, compare),
        (ManeuverOptions, device.maneuver),
        (LearnOptions, device.learn),
    ),
    "A running daemon": (
        (ArmOptions, operator.arm),
        (DisarmOptions, operator.disarm),
        (StopOptions, operator.stop),
        (ClearOptions, operator.clear),
        (RefOptions, operator.ref),
        (TuneOptions, operator.tune),
        (ControllerOptions, operator.controller),
        (AcceptOptions, operator.accept),
        (RevertOptions, operator.revert),
        (StatusOptions, operator.status),
        (WatchOptions, watch),
        (DashboardOptions, dashboard),
        (HealOptions, heal),
    ),
}
# A negative number is a value, not an option.
NUMBERS = frozenset({"ref", "tune", "trajectory"})

app.callback(invoke_without_command=True)(command_of(RunOptions, run, context=True))
for panel, commands in COMMANDS.items():
    for record, execute in commands:
        add_command(app, record, execute, panel=panel, negative_numbers=execute.__name__ in NUMBERS)


def _own_streams() -> None:
    """Something stands at descriptors 0 to 2: a serial port that got one of them would be sent the log."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, this one
    sys.stdin = sys.stdin or Path(os.devnull).open(encoding="utf-8")  # noqa: SIM115
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
        context = getattr(error, "ctx", None)
        _refuse(f"{error.format_message()} (see {context.command_path if context else 'hoopd'} --help)")
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
        sys.exit(FAILED)
    else:
        sys.exit(code or DONE)


def _refuse(line: str, code: int = UNUSABLE_INPUT) -> NoReturn:
    sys.stderr.write(f"hoopd: {line}\n")
    sys.exit(code)
