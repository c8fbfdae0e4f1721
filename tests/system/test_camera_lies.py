"""A camera that lies smoothly: control ends before the true ball or hoop come to anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.runs import Run, run

from hoopd.core.faulttable import BY_NAME, Action
from hoopd.core.picturechecks import NAMES
from hoopd.daemon.replay import replay
from hoopd.sim.truth import read

AT_S = 4.0
STOPPING_S = 1.0
STEPS = [{"at_s": 3.0 + 2.0 * k, "name": "reference", "value": 0.15 * (-1) ** k} for k in range(9)]


def lie(folder: Path, kind: str, seconds: float, *, direct: bool = True, steps: bool = True, **params: Any) -> Run:
    faults = [{"kind": kind, "at_s": AT_S, "params": params}]
    commands = STEPS if steps else []
    return run(folder, duration_s=seconds, direct=direct, faults=faults, commands=commands, psi_rad=0.1)


def ended_by(found: Run, name: str, within_s: float) -> None:
    """The row came, control stopped, and what is true stayed small meanwhile."""
    told = found.fault_at(name)
    assert AT_S < told <= AT_S + within_s
    assert found.torque.max_abs(told + STOPPING_S + 0.1, 1e9) == 0.0
    assert found.mode_at(told + STOPPING_S + 0.1) == "DISARMED"
    assert np.abs(read(found.folder / "truth.csv").dtheta).max() < 60.0
    assert all(replay(path)["equal"] for path in found.recordings)


@pytest.mark.parametrize("direct", [True, False])
def test_frozen_pictures(tmp_path: Path, direct: bool) -> None:
    ended_by(lie(tmp_path, "pictures_frozen", 6.0, direct=direct), "pictures_identical", 0.4)


def test_frozen_pictures_of_a_ball_at_rest(tmp_path: Path) -> None:
    """Nothing moves and nothing need move: the pictures alone tell."""
    ended_by(lie(tmp_path, "pictures_frozen", 6.0, direct=False, steps=False), "pictures_identical", 0.4)


def test_a_painted_ball_at_rest(tmp_path: Path) -> None:
    ended_by(lie(tmp_path, "picture_ball_painted", 6.0, psi_rad=0.05), "angle_stuck", 0.8)


def test_a_painted_ball_that_swings_slowly(tmp_path: Path) -> None:
    found = lie(tmp_path, "picture_ball_painted", 9.0, steps=False, swing_rad=0.03, period_s=4.0)
    ended_by(found, "angle_noiseless", 2.0)


@pytest.mark.proof
def test_a_ball_painted_into_noisy_pictures(tmp_path: Path) -> None:
    """Noise at its rim is noise enough; but it does not roll when the hoop does."""
    found = lie(tmp_path, "picture_ball_painted", 16.0, direct=False, swing_rad=0.05, period_s=4.0)
    told = min(found.fault_at(name) for name in ("ball_unresponsive", "ball_implausible"))
    assert AT_S < told < 12.0
    assert found.mode_at(15.0) == "DISARMED"


def test_an_angle_shown_by_half(tmp_path: Path) -> None:
    ended_by(lie(tmp_path, "picture_scale", 20.0, factor=0.5), "ball_unresponsive", 14.0)


def test_pictures_of_a_tenth_of_a_second_ago(tmp_path: Path) -> None:
    """A knock at the hoop begins a swing that the late law keeps up: a ball, but not one of this moment."""
    knock = {"name": "external.disturbance", "parameters": {"t0": 5.0, "t1": 5.1, "A": 0.1}}
    faults = [{"kind": "pictures_aged", "at_s": AT_S, "params": {"delay_s": 0.1}}]
    found = run(tmp_path, duration_s=20.0, faults=faults, effects=[knock], psi_rad=0.1)
    ended_by(found, "ball_unresponsive", 14.0)


def test_pictures_of_a_tenth_of_a_second_ago_while_the_reference_steps(tmp_path: Path) -> None:
    """The hoop turns fast meanwhile: so late a ball is no small change of a ball that is not."""
    found = lie(tmp_path, "pictures_aged", 16.0, delay_s=0.1)
    assert AT_S < found.fault_at("ball_unresponsive") < 14.0
    assert found.mode_at(15.9) == "DISARMED"


def test_an_honest_camera_is_believed(tmp_path: Path) -> None:
    judge_honest(tmp_path, direct=True)


@pytest.mark.proof
def test_an_honest_camera_s_pictures_are_believed(tmp_path: Path) -> None:
    judge_honest(tmp_path, direct=False)


def judge_honest(tmp_path: Path, *, direct: bool) -> None:
    found = run(tmp_path, duration_s=16.0, direct=direct, commands=STEPS, angle_offset_rad=0.03)
    assert found.mode_at(15.9) == "RUNNING"
    assert not [name for name in NAMES if found.fault_at(name) < np.inf]


def test_a_lie_stops_and_does_not_cut() -> None:
    assert {BY_NAME[name].action for name in NAMES} == {Action.STOP}
