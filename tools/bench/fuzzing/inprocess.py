"""Cases one after the other in a process that may end at any of them.

Rules of this file: a case gets a folder, an alarm and a limit on memory; what it prints goes to a file that is looked
through; what it leaves behind is thrown away with the folder, and with the process after some cases.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import resource
import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from fuzzing import cases, outcome
from fuzzing.outcome import Outcome

LIMIT_BYTES = 2**31  # above what the process has: what a case asks for beyond this is a MemoryError
LOOK_S = 1.0  # of the processor: what computes by then is taken for accepted; what still reads has until the bound
WAITS_S = 0.002  # of the processor, between two looks of the clock
LOADED = (
    *(
        f"hoopd.commands.{name}"
        for name in ("convert", "design", "diagnose", "fit", "identify", "linearize", "simulate")
    ),
    "hoopd.commands.calibrate",
    "hoopd.daemon.experiment",
    "hoopd.daemon.replay",
    "hoopd.plants.hoop.recordings.suspicions",
    "hoopd.plots.style",
    "hoopd.recording.hdf5",
    "hoopd.recording.mat_file",
    "scipy.signal",
)
# Packages that read: who is at work in one of them has not accepted its input yet.
READING = (
    "hoopd/recording/",
    "hoopd/files/",
    "hoopd/plants/model_file.py",
    "hoopd/plants/plant_model.py",
    "hoopd/plants/plant_file.py",
    "hoopd/plants/plant_equations.py",
    "hoopd/commands/calibrate.py",
)


class Cut(BaseException):
    """The alarm: `still` is where the program was reading, empty when it computed."""

    def __init__(self, still: str) -> None:
        self.still = still


def serve(pipe: Connection, seed: str, sounds: Path, kinds: tuple[str, ...]) -> None:
    """Take numbers, send outcomes, until None comes."""
    _silence()
    warm()  # free where the fork server has loaded it
    _limit()
    pipe.send("ready")
    while (number := pipe.recv()) is not None:
        pipe.send(try_case(seed, number, sounds, kinds))


def warm() -> None:
    """Load what the commands load, so that a case is charged for itself alone, and no alarm falls into an import."""
    for name in LOADED:
        importlib.import_module(name)


def _limit() -> None:
    """No core files, and an end of the memory."""
    soft = _resident("VmSize") + LIMIT_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (soft, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _silence() -> None:
    handle = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(handle, descriptor)
    os.close(handle)


def try_case(seed: str, number: int, sounds: Path, kinds: tuple[str, ...]) -> Outcome:
    """One case in a folder of its own."""
    here, folder = Path.cwd(), Path(tempfile.mkdtemp(prefix="hoopd-fuzz-"))
    try:
        case = cases.make(seed, number, sounds, folder, whole=False, kinds=kinds)
        os.chdir(folder)
        return _tried(number, case)
    finally:
        os.chdir(here)
        shutil.rmtree(folder, ignore_errors=True)


def _tried(number: int, case: cases.Case) -> Outcome:
    before, begun = _forget_peak(), time.process_time()
    try:
        with _alarms(begun):
            verdict, told = run(case.arguments)
    except Cut as cut:  # it came between two of our own lines
        verdict, told = _of_cut(cut)
    seconds = time.process_time() - begun
    added = max(0, _resident("VmHWM") - before) / 1e6
    return outcome.judged(Outcome(number, case.kind, verdict, seconds, added, told), outcome.MAX_ADDED_BYTES)


def run(arguments: list[str]) -> tuple[str, str]:
    """Verdict of one call of the command line, and its line."""
    import typer

    from hoopd.commands.cli import UsageError, app
    from hoopd.files.reading import InputError

    try:
        code = app(arguments, standalone_mode=False)
    except (InputError, UsageError) as error:
        line = str(error) if isinstance(error, InputError) else error.format_message()
        fine = line.strip() and len(line) <= outcome.MAX_LINE_CHARS and "\n" not in line
        return (outcome.REFUSED if fine else outcome.UNFORESEEN), line
    except (typer.Exit, SystemExit) as end:
        code = getattr(end, "exit_code", getattr(end, "code", 0))
    except typer.Abort:
        return outcome.REFUSED, "aborted"
    except Cut as cut:
        return _of_cut(cut)
    except BaseException as error:
        return outcome.UNFORESEEN, _where(error)
    return (outcome.REFUSED if code == 2 else outcome.ACCEPTED), f"exit code {code or 0}"


def _of_cut(cut: Cut) -> tuple[str, str]:
    return (outcome.BEYOND, f"still reading: {cut.still}") if cut.still else (outcome.ACCEPTED, "cut")


@contextlib.contextmanager
def _alarms(begun: float) -> Iterator[None]:
    """Look at what goes on once a second of the processor; what waits for ever is cut by the machine's clock.

    A long call of a library answers both alarms after it, one behind the other: each has a memory of its own, and one
    alone cuts. Who waits for a processor does not wait for ever.
    """
    used, starved, cut = begun, _starved_s(), False

    def work(number: int, frame: Any) -> None:
        nonlocal cut
        still = _reading(frame)
        if not cut and (not still or time.process_time() - begun > outcome.MAX_SECONDS):
            cut = True
            raise Cut(still)

    def rest(number: int, frame: Any) -> None:
        nonlocal used, starved, cut
        was, used = used, time.process_time()
        before, starved = starved, _starved_s()
        if not cut and used - was < WAITS_S and starved - before < outcome.STILL_S / 2:
            cut = True
            raise Cut(_reading(frame) or "waits for ever")

    signal.signal(signal.SIGPROF, work)
    signal.signal(signal.SIGALRM, rest)
    signal.setitimer(signal.ITIMER_PROF, LOOK_S, LOOK_S)
    signal.setitimer(signal.ITIMER_REAL, outcome.STILL_S, outcome.STILL_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _starved_s() -> float:
    """Seconds that this process has waited for a processor; 0 where the kernel does not count them."""
    with contextlib.suppress(OSError, IndexError, ValueError):
        return int(Path("/proc/self/schedstat").read_text().split()[1]) * 1e-9
    return 0.0


def _reading(frame: Any) -> str:
    """Where the program reads, empty when it does something else."""
    while frame is not None:
        name = frame.f_code.co_filename
        if "/hoopd/" in name:
            return f"{name}:{frame.f_lineno}" if any(part in name for part in READING) else ""
        frame = frame.f_back
    return ""


def _where(error: BaseException) -> str:
    text = " ".join(str(error).split())[:200]
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "/hoopd/" in frame.filename and "fuzzing" not in frame.filename]
    place = f" at {Path(ours[-1].filename).name}:{ours[-1].lineno} {ours[-1].name}" if ours else ""
    return f"{type(error).__name__}: {text}{place}"


def _forget_peak() -> int:
    """What the process holds, and the highest mark set back to it."""
    Path("/proc/self/clear_refs").write_text("5")
    return _resident("VmRSS")


def _resident(field: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) * 1024
    return 0
