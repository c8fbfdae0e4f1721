"""Whole daemon runs in virtual time, judged from the board's own log of torque and from the recording.

Rules of this file: a run is the daemon as the command line would start it; what it wrote on standard error is kept;
the judge reads the board's log, never the daemon's word.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from hoopd.core.modes import Mode
from hoopd.core.records import Inputs, TickRecord, TorqueCommand
from hoopd.daemon import app
from hoopd.daemon.world import World
from hoopd.recording.mcap import read_run
from hoopd.recording.schemas import LogEvent
from hoopd.sim import torque_log
from hoopd.sim.torque_log import TorqueLog

PERIOD_S = 0.02
TORQUE_LIMIT_NM = 0.7


@dataclass
class Run:
    """What a run left behind."""

    folder: Path
    recordings: list[Path]
    ticks: list[TickRecord]
    inputs: list[Inputs]
    events: list[LogEvent]
    torque: TorqueLog
    log: list[dict[str, Any]]  # lines of standard error
    summary: dict[str, Any] = field(default_factory=dict)

    def mode_at(self, t: float) -> str:
        """Mode of the last tick at or before `t`."""
        return [tick.mode for tick in self.ticks if tick.t <= t + 1e-9][-1]

    def modes(self, start: float, stop: float) -> set[str]:
        """Modes between two instants."""
        return {tick.mode for tick in self.ticks if start <= tick.t < stop}

    def fault_at(self, name: str) -> float:
        """When the recording first tells of a fault; inf when it never does."""
        times = [e.t for e in self.events if e.event == "fault" and e.fields.get("fault") == name]
        return min(times, default=math.inf)

    def causes(self, mode: Mode) -> set[str]:
        """What the recording gives as the causes of entering a mode."""
        found = [e.fields for e in self.events if e.event == "mode" and e.fields["mode"] == mode]
        return {cause for fields in found for cause in fields["because"]}


def run(
    folder: Path,
    *,
    duration_s: float = 6.0,
    seed: int = 0,
    record: Path | None = None,
    direct: bool = True,
    config: dict[str, Any] | None = None,
    **sim: Any,
) -> Run:
    """Run the daemon in lock-step; `sim` are keys of the rig's section."""
    folder.mkdir(parents=True, exist_ok=True)
    record = record or folder / "rec"
    record.mkdir(exist_ok=True)
    content = {"log": {"format": "json"}, **(config or {}), "sim": {"directory": str(folder), **sim}}
    path = folder / "run.yaml"
    path.write_text(yaml.safe_dump(content))
    options = app.Options(True, path, (), duration_s, record, seed, "max", direct)
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
        summary = app.run_daemon(options)
    return load(folder, record, errors.getvalue(), summary)


def load(folder: Path, record: Path, log: str, summary: dict[str, Any] | None = None) -> Run:
    """What a finished or killed run left behind."""
    recordings = sorted(record.glob("run-*.mcap"))
    runs = [read_run(path) for path in recordings]
    return Run(
        folder,
        recordings,
        [tick for part in runs for tick in part.ticks],
        [row for part in runs for row in part.inputs],
        [event for part in runs for event in part.events],
        torque_log.read(folder / "torque.jsonl"),
        [json.loads(line) for line in log.splitlines() if line.startswith("{")],
        summary or {},
    )


class SlowHost:
    """Timer and drive of a lock-step rig, `late(k)` s after deadline k and with `slow(k)` s of work in that tick."""

    def __init__(
        self, rig: Any, late: Callable[[int], float] = lambda k: 0.0, slow: Callable[[int], float] = lambda k: 0.0
    ) -> None:
        self._rig, self._late, self._slow, self._k = rig, late, slow, 0
        self.open, self.take, self.now = rig.open, rig.take, rig.now

    async def wait(self) -> int:
        """Go on to the next deadline and past it by the lateness; how many have passed."""
        due = (self._k + 1) * PERIOD_S
        await self._rig.wait() if self._k == 0 else None  # lets signals in once
        self._advance(due + self._late(self._k + 1))
        passed = max(1, int((self.now() + 1e-9) / PERIOD_S) - self._k)
        self._k += passed
        return passed

    def write(self, command: TorqueCommand) -> None:
        """Compute for a while, then write."""
        self._advance(self.now() + self._slow(self._k))
        self._rig.write(command)

    def _advance(self, t: float) -> None:
        if t > self.now():
            self._rig.finish(t - self.now())


def serve_late(patch: pytest.MonkeyPatch, **lateness: Callable[[int], float]) -> None:
    """Every lock-step run from now on has a slow host."""
    original = app._world

    @contextlib.contextmanager
    def slow(*arguments: Any) -> Iterator[World]:
        with original(*arguments) as world:
            host = SlowHost(world.drive, **lateness)
            yield World(host, host, world.eye)

    patch.setattr(app, "_world", slow)
