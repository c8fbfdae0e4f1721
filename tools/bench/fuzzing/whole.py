"""Cases as processes of the installed program: what a terminal would show, what the machine had to give.

Rules of this file: judged from outside alone: exit code, standard error, time and memory by the kernel's account.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fuzzing import cases, outcome, sound
from fuzzing.outcome import Outcome

# The kernel counts into a child's peak what its parent held when it was born: a small one bears it and tells.
LAUNCHER = """
import json, os, signal, sys
child = os.posix_spawn(sys.argv[2], sys.argv[2:], os.environ)
signal.signal(signal.SIGTERM, lambda *_: os.kill(child, signal.SIGTERM))
while True:
    try:
        _, status, usage = os.wait4(child, 0)
        break
    except InterruptedError:
        pass
told = {"status": os.waitstatus_to_exitcode(status), "s": usage.ru_utime + usage.ru_stime, "kB": usage.ru_maxrss}
open(sys.argv[1], "w").write(json.dumps(told))
"""
WORKS, WORK_S = "cut", 10.0  # who has had so much of the processor is at work on what it accepted
MARK = "a mistake of this program"
CODES = {0: outcome.ACCEPTED, 1: outcome.ACCEPTED, 2: outcome.REFUSED, 3: outcome.REFUSED}


def try_case(seed: str, number: int, sounds: Path, kinds: tuple[str, ...]) -> Outcome:
    """One case as a process."""
    folder = Path(tempfile.mkdtemp(prefix="hoopd-fuzz-"))
    try:
        case = cases.make(seed, number, sounds, folder, whole=True, kinds=kinds)
        environment = os.environ | {
            "XDG_STATE_HOME": str(folder / "state"),
            "XDG_RUNTIME_DIR": str(folder),
            "PYTHONPATH": str(sound.ROOT),
        }
        return _watched(number, case, folder, environment)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _watched(number: int, case: cases.Case, folder: Path, environment: dict[str, str]) -> Outcome:
    told = folder / "told.json"
    program = [sys.executable, "-m", "hoopd", *case.arguments]
    with (folder / "stderr").open("wb+") as errors:
        child = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", LAUNCHER, str(told), *program],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            start_new_session=True,
        )
        why = _waited(child)
        errors.seek(0)
        said = errors.read(2**20).decode(errors="replace")
    if not told.exists():
        return Outcome(number, case.kind, outcome.BEYOND, 0.0, 0.0, f"does not end after SIGTERM: {said[-200:]}")
    figures = json.loads(told.read_text())
    verdict, line = _verdict(figures["status"], said, why)
    found = Outcome(number, case.kind, verdict, figures["s"], figures["kB"] * 1024 / 1e6, line)
    return outcome.judged(found, outcome.MAX_BYTES)


def _waited(launcher: subprocess.Popen[bytes]) -> str:
    """Why it had to be ended, empty when it ended by itself."""
    used, why, begun = -1.0, "", time.monotonic()
    while not why:
        try:
            launcher.wait(outcome.STILL_S)
            return ""
        except subprocess.TimeoutExpired:
            before, used = used, _used(launcher.pid)
            waits = time.monotonic() - begun > 2.0 * outcome.STILL_S and used == before
            why = "waits for ever" if waits else WORKS if used > WORK_S else ""
    for end in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(launcher.pid, end)
        with contextlib.suppress(subprocess.TimeoutExpired):
            launcher.wait(20.0)
    return why


def _used(launcher: int) -> float:
    """Ticks of the processor that the launcher's child has had."""
    with contextlib.suppress(OSError, IndexError):
        child = Path(f"/proc/{launcher}/task/{launcher}/children").read_text().split()[0]
        fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def _verdict(status: int, said: str, why: str) -> tuple[str, str]:
    if why:
        return (outcome.ACCEPTED if why == WORKS else outcome.BEYOND), why
    lines = said.strip().splitlines()
    last = lines[-1][: outcome.MAX_LINE_CHARS] if lines else ""
    if "Traceback" in said or MARK in said or status not in (*CODES, -signal.SIGTERM, 128 + signal.SIGINT):
        return outcome.UNFORESEEN, f"exit code {status}: {last}"
    if CODES.get(status) == outcome.REFUSED and len(lines) != 1:
        return outcome.UNFORESEEN, f"{len(lines)} lines: {last}"
    return CODES.get(status, outcome.ACCEPTED), last
