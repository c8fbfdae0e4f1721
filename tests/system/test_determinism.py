"""Lock-step: the same seed gives the same bytes; every recording replays to the bit."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from harness.runs import Run, run
from samples import sampled

from hoopd.daemon.replay import replay
from hoopd.recording.mcap import read_run

ROOT = Path(__file__).resolve().parents[2]

NOISY: list[dict[str, Any]] = [
    {"kind": "bit_flips", "at_s": 1.5, "for_s": 2.0, "params": {"rate": 0.01}},
    {"kind": "garbage", "at_s": 1.5, "for_s": 2.0, "params": {"every": 9}},
    {"kind": "ball_gone", "at_s": 2.5, "for_s": 0.08},
]
BUSY: list[dict[str, Any]] = [
    {"at_s": 1.4, "name": "reference", "value": 0.15},
    {"at_s": 2.0, "name": "tune", "key": "k_psi", "value": 0.15},
    {"at_s": 2.2, "name": "tune", "key": "k_psi", "value": -1e9},
    {"at_s": 2.4, "name": "tune", "key": "no_such_gain", "value": 1.0},
    {"at_s": 2.6, "name": "reference", "value": -0.1},
    {"at_s": 3.0, "name": "disarm"},
    {"at_s": 3.2, "name": "arm"},
]
LATE = {"kind": "late_pictures", "at_s": 1.5, "for_s": 1.0, "params": {"delay_s": 0.05}}
RUNS: dict[str, dict[str, Any]] = {
    "undisturbed": {},
    "faults": {"faults": NOISY},
    "commands and tuning": {"commands": BUSY},
    "both, another seed": {"faults": NOISY, "commands": BUSY, "seed": 7},
    "link lost and armed again": {
        "faults": [{"kind": "board_silent", "at_s": 2.0, "for_s": 0.3}],
        "commands": [{"at_s": 3.8, "name": "arm"}],
    },
    "board restarts": {"faults": [{"kind": "board_reset", "at_s": 2.0}], "commands": [{"at_s": 2.5, "name": "clear"}]},
    "late pictures": {"faults": [LATE]},
    "pid": {"config": {"control": {"file": "controllers/pid.yaml"}}},
    "lead": {"config": {"control": {"file": "controllers/lead.yaml"}}},
    "arx": {"config": {"control": {"file": "controllers/arx.yaml"}}},
    "pictures": {"direct": False, "duration_s": 2.0},
}


@pytest.mark.parametrize("name", sampled(RUNS, ["arx", "pictures", "link lost and armed again"]))
def test_replay_is_equal_to_the_bit(name: str, tmp_path: Path) -> None:
    found = run(tmp_path, **{"duration_s": 4.5, **RUNS[name]})
    result = replay(found.recordings[0])
    assert result["equal"], result["first_difference"]
    assert result["ticks"] == len(found.ticks)
    assert result["lost"] == ""
    assert any(tick.u for tick in found.ticks)


def test_replay_notices_a_changed_command(tmp_path: Path) -> None:
    found = run(tmp_path, duration_s=2.0)
    path = found.recordings[0]
    other = run(tmp_path / "other", duration_s=2.0, config={"limits": {"torque_nm": 0.01}})
    assert replay(path)["equal"]
    assert max(abs(t.u) for t in other.ticks) <= 0.01
    assert replay(other.recordings[0])["equal"]


def recorded(found: Run) -> bytes:
    return found.recordings[0].read_bytes()


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    # The folder of the board's log is part of the configuration, so it is left out here.
    same: dict[str, Any] = {"duration_s": 4.0, "faults": NOISY, "commands": BUSY, "directory": ""}
    runs = [process(tmp_path / name, seed, hashes, same) for name, seed, hashes in SEEDS]
    assert runs[0] == runs[1]
    assert runs[2] != runs[0]
    assert read_run(tmp_path / "a/run-0001.mcap").zero_ns == 0  # no date in it


SEEDS = (("a", 3, "1"), ("elsewhere/b", 3, "2"), ("c", 4, "1"))


def process(folder: Path, seed: int, hash_seed: str, sim: dict[str, Any]) -> bytes:
    """Bytes of the recording of a run as a process of its own, with another order of hashes."""
    folder.mkdir(parents=True)
    duration_s = sim["duration_s"]
    sets = [f"--set=sim.{key}={sim[key]!r}" for key in ("faults", "commands")]
    done = subprocess.run(
        [sys.executable, "-m", "hoopd", "--sim", "--speed", "max", "--camera", "direct", "--seed", str(seed),
         "--duration", str(duration_s), "--record", str(folder), *sets],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": hash_seed},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return (folder / "run-0001.mcap").read_bytes()
