"""A daemon as a process on the machine's clock, with its rig: start it, disturb it, and read what it left behind.

Rules of this file: times are of the monotonic clock, as in the board's log; only processes that were started here are
signalled; every wait has a bound.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

import psutil
import yaml

from harness.runs import Run, load
from harness.timing import on_the_clock
from harness.witness import Witness
from hoopd.shell.operator import ask

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tools")))}
WIRE_S = 8 * 10 / 115200
FIFO_PRIORITY = 40
START_S = 20.0  # until it controls: interpreter and imports on a busy machine, then a second of good pictures
EXIT_S = 8.0  # a controlled stop, closing of recorder and telemetry, and the interpreter's end


@cache
def fifo_granted() -> bool:
    """This machine lets us run with real-time priority: other load then cannot look like a late daemon."""
    chrt = shutil.which("chrt")
    return chrt is not None and subprocess.call([chrt, "--fifo", str(FIFO_PRIORITY), "true"], stderr=-3) == 0


class Daemon:
    """One run; ended with the block whatever happens."""

    def __init__(
        self,
        folder: Path,
        *,
        direct: bool = True,
        fifo: bool = False,
        config: dict[str, Any] | None = None,
        seed: int = 0,
        terminal: int | None = None,
        **sim: Any,
    ) -> None:
        """`fifo`: with the real-time priority that the unit grants (needs the right to it); `terminal`: descriptor of
        the one that controls it; `sim`: keys of the rig."""
        self.folder, self.record = folder, folder / "rec"
        self.record.mkdir(parents=True, exist_ok=True)
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.socket = Path(tempfile.mkdtemp(prefix="hoopd-")) / "hoop.sock"  # short: an address has 107 bytes at most
        content = {
            "log": {"format": "json"},
            "telemetry": {"endpoint": self.endpoint},
            "commands": {"socket": str(self.socket)},
            **(config or {}),
            "sim": {"directory": str(folder), **sim},
        }
        (folder / "run.yaml").write_text(yaml.safe_dump(content))
        self._direct, self._seed, self._fifo, self._terminal = direct, seed, fifo, terminal
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Daemon:
        command = [sys.executable, "-m", "hoopd", "--sim", "--config", str(self.folder / "run.yaml")]
        command += [
            "--record",
            str(self.record),
            "--seed",
            str(self._seed),
            "--json",
            str(self.folder / "summary.json"),
        ]
        command += ["--camera", "direct"] if self._direct else []
        command = [*(["chrt", "--fifo", str(FIFO_PRIORITY)] if self._fifo else []), *command]
        command = [*(["setsid", "--ctty"] if self._terminal is not None else []), *command]
        with (self.folder / "log.jsonl").open("wb") as log, (self.folder / "out.txt").open("wb") as out:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL if self._terminal is None else self._terminal,
                stdout=out,
                stderr=log,
                env=ENVIRONMENT,
                cwd=self.folder,
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        family = [*self.family(), self.process]
        for member in family:
            if member.poll() is None if isinstance(member, subprocess.Popen) else member.is_running():
                member.kill()
        self.process.wait()
        shutil.rmtree(self.socket.parent, ignore_errors=True)

    def command(self, name: str, **fields: Any) -> dict[str, Any]:
        """What the daemon answers to a command of an operator."""
        return ask({"command": name, **fields}, "hoop", str(self.socket))

    @property
    def process(self) -> subprocess.Popen[bytes]:
        assert self._process is not None
        return self._process

    def family(self, part: str = "") -> list[psutil.Process]:
        """Processes of the rig whose command line holds `part`."""
        try:
            children = psutil.Process(self.process.pid).children(recursive=True)
            return [child for child in children if part in " ".join(child.cmdline())]
        except psutil.Error:
            return []

    def log(self) -> list[dict[str, Any]]:
        """Facts on standard error so far."""
        lines = (self.folder / "log.jsonl").read_text(errors="replace").splitlines()
        return [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]

    def wait_for(self, timeout_s: float = START_S, **fields: Any) -> dict[str, Any]:
        """The first fact with these fields; AssertionError with the log when it does not come in time."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            for line in self.log():
                if fields.items() <= line.items():
                    return line
            time.sleep(0.02)
        with on_the_clock():
            log = (self.folder / "log.jsonl").read_text()
            raise AssertionError(f"no {fields} within {timeout_s} s:\n{log[-2000:]}")

    def wait_running(self) -> None:
        """Until it controls, and the largest part of the release is over."""
        self.wait_for(event="mode", mode="RUNNING")
        time.sleep(0.4)

    def signal(self, number: signal.Signals) -> float:
        """Send it; when."""
        now = time.monotonic()
        self.process.send_signal(number)
        return now

    def wait_exit(self, timeout_s: float = EXIT_S) -> int:
        """Exit code; AssertionError when it does not end in time."""
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            with on_the_clock():
                raise AssertionError(f"did not end within {timeout_s} s") from None

    def stop(self) -> int:
        """SIGTERM and the exit code."""
        self.signal(signal.SIGTERM)
        return self.wait_exit()

    def result(self) -> Run:
        """What it left behind, once the board has ended too."""
        for board in self.family("boardprocess"):
            board.wait(2.0)
        time.sleep(0.3)  # a board whose host was killed lingers until its own time-out
        path = self.folder / "summary.json"
        summary = json.loads(path.read_text()) if path.exists() else {}
        return load(self.folder, self.record, (self.folder / "log.jsonl").read_text(errors="replace"), summary)


def zero_of(run: Run) -> float:
    """Monotonic time of run time zero: torques that were sent once, in the recording and in the board's log."""
    sent = _once((_f32(tick.u), tick.t) for tick in run.ticks if tick.u)
    got = _once((row.torque_nm, row.t) for row in run.torque.rows if row.torque_nm)
    return min((got[u] - sent[u] for u in sent.keys() & got.keys()), default=math.nan) - WIRE_S


def _once(pairs: Iterable[tuple[float, float]]) -> dict[float, float]:
    """Times of the values that come only once."""
    found: dict[float, list[float]] = {}
    for value, t in pairs:
        found.setdefault(value, []).append(t)
    return {value: times[0] for value, times in found.items() if len(times) == 1}


def _f32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def gaps_in(run: Run, start: float, stop: float) -> list[tuple[float, int]]:
    """Missed ticks between two run times, as (run time, how many)."""
    pairs: Iterable[Any] = zip(run.ticks, run.ticks[1:], strict=False)
    return [(b.t, b.id - a.id - 1) for a, b in pairs if b.id - a.id > 1 and start <= b.t <= stop]


def undelayed(run: Run, witness: Witness, start: float, stop: float) -> None:
    """No tick was missed but where the machine stood still."""
    zero = zero_of(run)
    alone = [(t, n) for t, n in gaps_in(run, start - zero, stop - zero) if not witness.gaps(zero + t - 0.2, zero + t)]
    with on_the_clock():
        assert alone == []


def free_port() -> int:
    """A port of loopback that nobody listens to."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
