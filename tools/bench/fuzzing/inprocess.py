"""Cases one after the other in a process that may end at any of them.

Rules of this file: a case gets a folder, an alarm and a limit on memory; what it prints goes to a file that is looked
through; what it leaves behind is thrown away with the folder, and with the process after some cases.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from fuzzing import cases, outcome
from fuzzing.outcome import Outcome

LIMIT_BYTES = 2**31  # above what the process has: what a case asks for beyond this is a MemoryError
WORK_S = 3.0  # then what computes is taken for accepted; what still reads is not
# Packages that read: who is at work in one of them has not accepted its input yet.
READING = ("hoopd/recording/", "hoopd/files.py", "hoopd/yamltext.py", "hoopd/modelfiles.py", "hoopd/calibrate.py")


class Cut(BaseException):
    """The alarm."""


def serve(pipe: Connection, seed: str, sounds: Path) -> None:
    """Take numbers, send outcomes, until None comes."""
    _silence()
    warm()
    pipe.send("ready")
    while (number := pipe.recv()) is not None:
        pipe.send(try_case(seed, number, sounds))


def warm() -> None:
    """Load what the commands load, so that a case is charged for itself alone."""
    import hoopd.bench.convert
    import hoopd.bench.design
    import hoopd.bench.diagnose
    import hoopd.bench.fit
    import hoopd.bench.identify
    import hoopd.bench.linearize
    import hoopd.bench.simulate
    import hoopd.calibrate
    import hoopd.experiment
    import hoopd.plots.style
    import hoopd.replay  # noqa: F401

    sys.setrecursionlimit(1000)
    soft = _resident("VmSize") + LIMIT_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (soft, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _silence() -> None:
    handle = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(handle, descriptor)
    os.close(handle)


def try_case(seed: str, number: int, sounds: Path) -> Outcome:
    """One case in a folder of its own."""
    here, folder = Path.cwd(), Path(tempfile.mkdtemp(prefix="hoopd-fuzz-"))
    try:
        case = cases.make(seed, number, sounds, folder, whole=False)
        os.chdir(folder)
        return _tried(number, case)
    finally:
        os.chdir(here)
        shutil.rmtree(folder, ignore_errors=True)


def _tried(number: int, case: cases.Case) -> Outcome:
    before, begun = _forget_peak(), time.process_time()
    signal.signal(signal.SIGALRM, _cut)
    signal.setitimer(signal.ITIMER_REAL, WORK_S, 0.5)
    try:
        verdict, told = run(case.arguments)
    except Cut:  # between two statements of ours
        verdict, told = outcome.ACCEPTED, "cut"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    seconds = time.process_time() - begun
    added = max(0, _resident("VmHWM") - before) / 1e6
    return outcome.judged(Outcome(number, case.kind, verdict, seconds, added, told), outcome.MAX_ADDED_BYTES)


def run(arguments: list[str]) -> tuple[str, str]:
    """Verdict of one call of the command line, and its line."""
    import typer

    from hoopd.cli import UsageError, app
    from hoopd.files import InputError

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
    except Cut as error:
        return _still(error)
    except BaseException as error:
        return outcome.UNFORESEEN, _where(error)
    return (outcome.REFUSED if code == 2 else outcome.ACCEPTED), f"exit code {code or 0}"


def _still(error: BaseException) -> tuple[str, str]:
    """What was going on at the alarm."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/hoopd/" in frame.filename]
    last = frames[-1] if frames else None
    if last is not None and any(part in last.filename for part in READING):
        return outcome.BEYOND, f"still reading after {WORK_S:g} s: {last.filename}:{last.lineno} {last.name}"
    return outcome.ACCEPTED, "cut"


def _where(error: BaseException) -> str:
    text = " ".join(str(error).split())[:200]
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "/hoopd/" in frame.filename and "fuzzing" not in frame.filename]
    place = f" at {Path(ours[-1].filename).name}:{ours[-1].lineno} {ours[-1].name}" if ours else ""
    return f"{type(error).__name__}: {text}{place}"


def _cut(*_: Any) -> None:
    raise Cut


def _forget_peak() -> int:
    """What the process holds, and the highest mark set back to it."""
    Path("/proc/self/clear_refs").write_text("5")
    return _resident("VmRSS")


def _resident(field: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) * 1024
    return 0
