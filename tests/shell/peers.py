"""Telemetry on loopback, and the peers that ask and listen."""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zenoh

from hoopd.core.records import Command, TickRecord
from hoopd.core.tick import Note
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.commandserver import StatusTicket
from hoopd.shell.session import connecting
from hoopd.shell.telemetry import Telemetry, TelemetrySettings

ROOT = Path(__file__).resolve().parents[2]
RANGES = Ranges((-1.0, 1.0), {"q_psi": (0.0, 10.0)})
MODES = {"arm": "READY", "disarm": "DISARMED", "stop": "STOPPING", "clear": "DISARMED"}


def free_endpoint() -> str:
    """A loopback port that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


OPERATOR = {"transport/auth/usrpwd/user": "operator", "transport/auth/usrpwd/password": "turn"}


def controlled(folder: Path) -> TelemetrySettings:
    """Telemetry for everybody, and control for the operator with a password."""
    users = folder / "users.txt"
    users.write_text("viewer:look\noperator:turn\n", encoding="utf-8")
    proof = {"transport": {"auth": {"usrpwd": {"user": "hoop", "password": "x", "dictionary_file": str(users)}}}}
    return TelemetrySettings(
        endpoint=free_endpoint(), commands=True, control_endpoint=free_endpoint(), control_zenoh=proof
    )


def tick(k: int) -> TickRecord:
    """Row k of a made-up run."""
    t = k * 0.02
    return TickRecord(t, k, "RUNNING", 0.1, t, 0.3, 0.2, math.nan, t, t, (t, 0.0, 0.0, 0.0), 0.0, 1, 0, 1e-4 * k, 0.0)


def wait_until(condition: Any, timeout_s: float = 10.0) -> bool:
    """True as soon as the condition holds."""
    end = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return bool(condition())


class Ticks:
    """A loop that takes commands every 10 ms and tells what became of them: refused with a reason, or done."""

    def __init__(self, gate: Gate, refused: dict[str, str] | None = None) -> None:
        self.gate, self.refused = gate, refused or {}
        self.taken: list[Command] = []
        self.asked: list[StatusTicket] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Ticks:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.hang()

    def hang(self) -> None:
        """No tick comes any more."""
        self._done.set()
        self._thread.join(5.0)

    def take(self) -> tuple[Command, ...]:
        """What was taken since the last call."""
        taken, self.taken = self.taken, []
        return tuple(taken)

    def _run(self) -> None:
        while not self._done.wait(0.01):
            while self.asked:
                self.asked.pop().fields = {"mode": "DISARMED"}
            for command in self.gate.take():
                self.taken.append(command)
                self.gate.settle(self._note(command), tick(1)._replace(mode=MODES.get(command.name, "RUNNING")))

    def _note(self, command: Command) -> Note:
        if command.name in self.refused:
            fields = {"command": command.name, "reason": self.refused[command.name]}
            return Note("command_refused", "warning", fields)
        name = {"reference": "reference", "tune": "tuned"}.get(command.name, "operator")
        return Note(name, "info", {"command": command.name} if name == "operator" else {})


@contextlib.contextmanager
def running(settings: TelemetrySettings, **options: Any) -> Iterator[Telemetry]:
    """Telemetry that is open, and closed in time."""
    telemetry = Telemetry(settings, Gate(RANGES), **options)
    telemetry.start()
    try:
        assert wait_until(lambda: telemetry.counts.open)
        yield telemetry
    finally:
        assert telemetry.close(10.0)


@contextlib.contextmanager
def client(endpoint: str, **extras: Any) -> Iterator[zenoh.Session]:
    """A client session that is closed."""
    with zenoh.open(connecting(endpoint, extras, 2.0)) as session:
        yield session


def receive(subscriber: Any, count: int, timeout_s: float = 10.0) -> list[bytes]:
    """The next messages, as many as come in time."""
    got: list[bytes] = []
    end = time.monotonic() + timeout_s
    while len(got) < count and time.monotonic() < end:
        sample = subscriber.try_recv()
        if sample is None:
            time.sleep(0.005)
        else:
            got.append(sample.payload.to_bytes())
    return got


def ask(session: zenoh.Session, key: str, payload: str | None = None) -> tuple[str | None, str | None]:
    """Reply and refusal of one query."""
    for reply in session.get(key, payload=payload, timeout=5.0):
        if reply.ok is not None:
            return reply.ok.payload.to_string(), None
        assert reply.err is not None
        return None, reply.err.payload.to_string()
    return None, None
