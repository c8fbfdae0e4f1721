"""Up in lock-step: thrown onto the inner hoop, held on its top, let down, and back to the law of the bottom."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from hoopd.daemon.app import Options
from hoopd.daemon.maneuver import AskedManeuver, run
from hoopd.daemon.recording_target import Where
from hoopd.daemon.replay import replay
from hoopd.files.model import InnerHoop, model_text
from hoopd.files.shipped import defaults_folder
from hoopd.files.trajectory import TrajectoryFile
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.trajectory import PlannedTrajectory, plan_trajectory, trajectory_file
from hoopd.plants.model_file import load_model
from hoopd.recording.mcap import read_run
from hoopd.sim import torque_log, truth

HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")
INNER = msgspec.structs.replace(HOOP, device=msgspec.structs.replace(HOOP.device, inner=InnerHoop(0.0445)))
SHARE = (0.0445 + 0.0104) / (0.0957 - 0.0104)


@cache
def planned(turn: int = 1) -> PlannedTrajectory:
    return plan_trajectory(INNER, ManeuverQuestion("up", MotionLimits(0.45, 40.0, 0.5, 0.6), turn=turn, hold_s=2.0))


def trajectory(turn: int = 1) -> TrajectoryFile:
    return trajectory_file(planned(turn), "inner.yaml", "ab", "up")


def played(folder: Path, restitution: float, *sets: str, turn: int = 1) -> dict[str, Any]:
    model = folder / "inner.yaml"
    model.write_text(model_text(INNER))
    numbers = f"{{restitution: {restitution}, grip: 0.4}}"
    hidden = f"sim.effects=[{{name: ball.lift_off, parameters: {numbers}}}]"
    sets = (f"sim.directory={folder}", "log.level=error", f"sim.model={model}", f"device.model={model}", hidden, *sets)
    rig = Options(sim=True, speed="max", direct=True, sets=sets)
    result = run(AskedManeuver(trajectory(turn), "up.yaml"), rig, Where(file=folder / "run.mcap"))
    assert replay(folder / "run.mcap")["equal"]
    board = torque_log.read(folder / "torque.jsonl")
    assert board.max_abs() <= 0.7001 and not board.rows[-1].enabled
    return result


def test_a_plan_lands_short_of_the_top_and_keeps_its_limits() -> None:
    plan = planned()
    assert plan.flight_ticks is not None and np.abs(plan.motion.inputs).max() <= 0.45 + 1e-9
    landed = plan.motion.states[plan.flight_ticks[1]]
    assert 2.5 < landed[2] < np.pi and 0.0 < landed[3] < 6.0
    assert plan.motion.states[-1, 2] == pytest.approx(np.pi) and plan.nominal.arrived
    assert np.nanmin(plan.contact[plan.flight_ticks[1] :]) >= 0.2 - 1e-6
    assert sum(one.arrived for one in plan.sampled) >= 38
    mirrored = planned(-1).motion
    assert mirrored.states == pytest.approx(-plan.motion.states, abs=1e-3)


@pytest.mark.parametrize(("restitution", "turn"), [(0.0, 1), (0.3, -1)])
def test_it_is_thrown_to_the_top_held_and_let_down(tmp_path: Path, restitution: float, turn: int) -> None:
    result = played(tmp_path, restitution, turn=turn)
    (attempt,) = result["attempts"]
    assert attempt["success"] and attempt["ended"] == "done", result
    assert attempt["top_s"] >= 2.0 and set(result["faults"]) <= {"ball_missing"}
    true = truth.read(tmp_path / "truth.csv")
    on_top = (np.abs(true.distance - SHARE) < 1e-6) & (np.abs(np.abs(true.psi) - np.pi) < 0.1)
    assert on_top.sum() * 0.02 > 2.0
    assert {tick.ball_mode for tick in read_run(tmp_path / "run.mcap").ticks} >= {"", "rolling", "air", "inner"}


def test_a_revert_on_the_top_lets_the_ball_down_before_the_law_of_the_bottom_has_it(tmp_path: Path) -> None:
    result = played(tmp_path, 0.0, "sim.commands=[{at_s: 3.5, name: revert}]")
    (attempt,) = result["attempts"]
    assert attempt["ended"] == "given up: reverted" and attempt["settled_s"] < 2.0, result
    assert set(result["faults"]) <= {"ball_missing"}
    run = read_run(tmp_path / "run.mcap")
    (over,) = [event.t for event in run.events if event.event == "experiment_ended"]
    assert max(abs(tick.u) for tick in run.ticks if 3.6 < tick.t < over) <= 0.1 + 1e-9


def test_a_ball_that_is_lost_on_the_way_ends_with_the_torque_off(tmp_path: Path) -> None:
    result = played(tmp_path, 0.0, "sim.faults=[{kind: ball_gone, at_s: 2.36}]")
    assert result["succeeded"] == 0 and result["exit"] == 1 and result["faults"]["ball_lost"]
