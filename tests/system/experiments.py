"""Experiments on the rig in virtual time; the judge is the board's own log of torque."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoopd.daemon import experiment
from hoopd.daemon.app import Options
from hoopd.daemon.recording_target import Where
from hoopd.plants.hoop.loop.experiment_plan import Plan
from hoopd.recording.mcap import RecordedRun, read_run
from hoopd.sim import torque_log
from hoopd.sim.torque_log import TorqueLog

ROOT = Path(__file__).resolve().parents[2]
# Options of a short run in lock-step.
LOCKSTEP = ("--sim", "--speed", "max", "--camera", "direct", "--duration", "2")


@dataclass
class Experiment:
    """What one experiment left behind."""

    result: dict[str, Any]
    run: RecordedRun
    torque: TorqueLog
    path: Path

    @property
    def played(self) -> list[Any]:
        """Rows of the signal."""
        return [row for row in self.run.ticks if row.mode == "RUNNING"]


def perform(folder: Path, plan: Plan, *sets: str, seed: int = 0, figure: Path | None = None) -> Experiment:
    """Play a plan on the rig in virtual time."""
    sets = (f"sim.directory={folder}", "log.level=error", *sets)
    options = Options(sim=True, sets=sets, seed=seed, speed="max", direct=True)
    path = folder / "run.mcap"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        result = experiment.run(plan, options, Where(file=path), figure)
    return Experiment(result, read_run(path), torque_log.read(folder / "torque.jsonl"), path)


def ends_at_rest(found: Experiment) -> bool:
    """The board's last word is zero torque, and so is the recording's."""
    return found.torque.rows[-1].torque_nm == 0.0 and found.run.ticks[-1].u == 0.0
