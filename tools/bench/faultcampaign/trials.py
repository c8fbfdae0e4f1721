"""One run of the daemon with one fault, in real time or in lock-step, and what it left behind.

Rules of this file: the daemon is a process of its own in both ways; all times of a trial are on the clock of its torque
log (the monotonic one in real time, virtual seconds in lock-step); a trial's number is its seed and moves its fault.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import yaml
from harness.realrun import ENVIRONMENT, Daemon, zero_of
from harness.runs import Run, load

from hoopd.sim import truth
from hoopd.sim.truth import Truth

from .kind import AT_S, Kind

PATIENCE_S = 240.0  # for a run in lock-step with pictures on a busy machine
LATER_S = 0.0237  # each trial's fault: other phases of tick, picture and ball


class Way(NamedTuple):
    """How the daemon is run."""

    direct: bool
    fifo: bool = False
    lockstep: bool = False

    def __str__(self) -> str:
        camera = "angles without pictures" if self.direct else "rendered pictures"
        clock = "lock-step" if self.lockstep else f"real time, {'FIFO' if self.fifo else 'no priority'}"
        return f"{clock}, {camera}"


class Trial(NamedTuple):
    """What a run left behind; `at`: the fault, `zero`: run time zero."""

    run: Run
    truth: Truth
    at: float
    zero: float
    exit_code: int


def perform(folder: Path, kind: Kind, way: Way, number: int = 0) -> Trial:
    """Run the daemon with one fault."""
    at_s = AT_S + LATER_S * number
    play = _in_lockstep if way.lockstep else _in_real_time
    run, at, code = play(folder, kind, way, number, at_s)
    zero = 0.0 if way.lockstep else zero_of(run)
    return Trial(run, truth.read(folder / "truth.csv"), zero + at_s if math.isnan(at) else at, zero, code)


def _in_real_time(folder: Path, kind: Kind, way: Way, seed: int, at_s: float) -> tuple[Run, float, int]:
    with Daemon(folder, direct=way.direct, fifo=way.fifo, seed=seed, **kind.rig(at_s)) as daemon:
        daemon.wait_for(event="mode", mode="RUNNING")
        daemon.wait_for(event="reference")
        begun = time.monotonic() - kind.busy[0]["at_s"]  # of the run
        at = math.nan
        if kind.act:
            time.sleep(0.6)
            at = kind.act(daemon)
        end = max(time.monotonic(), begun + at_s) + kind.observe_s
        while time.monotonic() < end and daemon.process.poll() is None:
            time.sleep(0.05)
        code = daemon.stop() if daemon.process.poll() is None else daemon.wait_exit()
        return daemon.result(), at, code


def _in_lockstep(folder: Path, kind: Kind, way: Way, seed: int, at_s: float) -> tuple[Run, float, int]:
    record, summary = folder / "rec", folder / "summary.json"
    record.mkdir(parents=True)
    content = {"log": {"format": "json"}, "sim": {"directory": str(folder), **kind.rig(at_s)}}
    (folder / "run.yaml").write_text(yaml.safe_dump(content))
    command = [sys.executable, "-m", "hoopd", "--sim", "--speed", "max", "--config", str(folder / "run.yaml")]
    command += ["--duration", str(at_s + kind.observe_s), "--seed", str(seed)]
    command += ["--record", str(record), "--json", str(summary)]
    command += ["--camera", "direct"] if way.direct else []
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=PATIENCE_S, check=False)
    told = json.loads(summary.read_text()) if summary.exists() else {}
    return load(folder, record, done.stderr, told), math.nan, done.returncode
