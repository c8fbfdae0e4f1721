"""Once round the hoop in lock-step: on the rig that the plan knows, on rigs that are off, and what ends it early."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import tau
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from harness.runs import TORQUE_LIMIT_NM
from samples import sampled

from hoopd.core.records import Inputs, TickRecord
from hoopd.daemon.app import Options, run_daemon
from hoopd.daemon.maneuver import AskedManeuver, recorded_maneuvers, run
from hoopd.daemon.maneuver_conductor import ManeuverConductor
from hoopd.daemon.recording_target import Where
from hoopd.daemon.replay import replay
from hoopd.files.model import Parameter, model_text
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.files.trajectory import TrajectoryFile
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.trajectory import plan_trajectory, trajectory_file
from hoopd.plants.model_file import load_model
from hoopd.recording.mcap import RecordedRun, read_run
from hoopd.shell.loop import Loop
from hoopd.sim import torque_log, truth

HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")


@cache
def trajectory() -> TrajectoryFile:
    planned = plan_trajectory(HOOP, ManeuverQuestion("loop", MotionLimits(0.45, 40.0, 0.5, 0.6)))
    return trajectory_file(planned, "models/hoop.yaml", "ab", "loop")


def played(folder: Path, *sets: str, repeat: int = 1, file: TrajectoryFile | None = None) -> dict[str, Any]:
    """One run, held to what holds of every run: it replays, and no torque was beyond the limit or is left."""
    asked = AskedManeuver(file or trajectory(), "loop.yaml", repeat)
    sets = (f"sim.directory={folder}", "log.level=error", *sets)
    rig = Options(sim=True, speed="max", direct=True, sets=sets)
    result = run(asked, rig, Where(file=folder / "run.mcap"))
    assert replay(folder / "run.mcap")["equal"]
    board = torque_log.read(folder / "torque.jsonl")
    assert board.max_abs() <= TORQUE_LIMIT_NM and not board.rows[-1].enabled
    return result


def contact(folder: Path) -> float:
    """Least force between the rig's hoop and ball, in weights of the ball."""
    true, p = truth.read(folder / "truth.csv"), HOOP.values()
    return float((((p["Ro"] - p["Rb"]) * true.dpsi**2 + p["g"] * np.cos(true.psi)) / p["g"]).min())


def test_the_ball_goes_round_at_the_first_attempt_and_again(tmp_path: Path) -> None:
    result = played(tmp_path, repeat=2)
    assert result["exit"] == 0 and result["outcome"] == "done" and result["succeeded"] == result["played"] == 2
    assert not result["faults"] and all(one["settled_s"] < 0.5 for one in result["attempts"])
    true = truth.read(tmp_path / "truth.csv")
    assert true.psi[-1] == pytest.approx(2 * tau, abs=0.02) and contact(tmp_path) > 0.45
    plan = np.array(trajectory().plan.states)[:, 2]
    for attempt in result["attempts"]:  # by the pictures, whose noise is 0.002 rad, as by the rig's own state
        off = np.interp(attempt["began_s"] + 0.02 * np.arange(len(plan)), true.t, true.psi) - plan
        rms = np.sqrt(np.mean((off - tau * np.round(off / tau)) ** 2))
        assert attempt["off_plan_rad"] == pytest.approx(rms, abs=0.002)
        assert 0.001 < attempt["off_estimate_rad"] < 0.01


def test_it_goes_round_where_the_rig_is_another_one(tmp_path: Path) -> None:
    """Inertias and friction a tenth off, and a dry friction that nobody was told of."""
    change = {"Ih": 1.1, "Ib": 0.9, "bh": 1.1}
    parameters = {
        name: Parameter(value=entry.value * change.get(name, 1.0), unit=entry.unit)
        for name, entry in HOOP.parameters.items()
    }
    path = tmp_path / "other.yaml"
    path.write_text(model_text(msgspec.structs.replace(HOOP, parameters=parameters)))
    hidden = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.01}}]"
    result = played(tmp_path, f"sim.model={path}", hidden)
    assert result["succeeded"] == 1, result["attempts"]


def test_with_rendered_pictures(tmp_path: Path) -> None:
    asked = AskedManeuver(trajectory(), "loop.yaml")
    rig = Options(sim=True, speed="max", sets=(f"sim.directory={tmp_path}", "log.level=error"))
    result = run(asked, rig, Where(file=tmp_path / "run.mcap"))
    assert result["succeeded"] == 1 and contact(tmp_path) > 0.3


@pytest.mark.parametrize(
    ("fault", "mode"),
    [("{kind: camera_stall, at_s: 2.2}", "camera_lost"), ("{kind: ball_gone, at_s: 2.2}", "ball_lost")],
)
def test_what_goes_wrong_on_the_way_ends_it_with_the_torque_off(tmp_path: Path, fault: str, mode: str) -> None:
    result = played(tmp_path, f"sim.faults=[{fault}]")
    assert result["exit"] == 1 and result["succeeded"] == 0 and mode in result["faults"]


def test_a_rig_that_cannot_follow_is_given_up_and_braked(tmp_path: Path) -> None:
    """A drive that gives a third of the torque: the plan is left, the hoop braked, and the law of before is back."""
    result = played(tmp_path, "sim.effects=[{name: actuator.torque_gain, parameters: {k: 0.35}}]")
    (attempt,) = result["attempts"]
    assert attempt["ended"].startswith("given up: ") and not attempt["success"] and result["exit"] == 1
    record = read_run(tmp_path / "run.mcap")
    (given_up,) = (event for event in record.events if event.event == "experiment_ended")
    assert given_up.fields["back_to"] == "lqg.yaml"


def test_torques_alone_lose_the_ball_of_a_weaker_drive_and_feedback_does_not(tmp_path: Path) -> None:
    """A drive that gives nine tenths: the ball leaves the hoop and falls, out of sight, and the torque ends."""
    plan = msgspec.structs.replace(trajectory().plan, feedback=[[0.0] * 4] * len(trajectory().plan.feedback))
    weaker = "sim.effects=[{name: actuator.torque_gain, parameters: {k: 0.9}}]"
    for name in ("alone", "fed_back"):
        (tmp_path / name).mkdir()
    alone = played(tmp_path / "alone", weaker, file=msgspec.structs.replace(trajectory(), plan=plan))
    assert alone["succeeded"] == 0 and contact(tmp_path / "alone") < 0.0 and alone["faults"]["ball_missing"]
    assert played(tmp_path / "fed_back", weaker)["succeeded"] == 1


def test_a_swing_that_hardly_moves_is_none(tmp_path: Path) -> None:
    planned = plan_trajectory(HOOP, ManeuverQuestion("swing", MotionLimits(0.45, 40.0, 0.5, 0.6), angle_rad=0.8))
    weak = "sim.effects=[{name: actuator.torque_gain, parameters: {k: 0.1}}]"
    result = played(tmp_path, weak, file=trajectory_file(planned, "models/hoop.yaml", "ab", "swing"))
    (attempt,) = result["attempts"]
    assert attempt["ended"] == "done" and attempt["shortfalls"] == ["swung by 0.16 rad, not by 0.8"]
    assert not attempt["success"] and result["exit"] == 1


def test_without_the_suspended_row_the_tick_stops_the_ball(tmp_path: Path) -> None:
    plan = msgspec.structs.replace(trajectory().plan, suspends=[])
    result = played(tmp_path, file=msgspec.structs.replace(trajectory(), plan=plan))
    assert result["outcome"] == "stopped: ball_runaway" and result["exit"] == 1
    (attempt,) = result["attempts"]
    assert "stopped, and not seen settling" in attempt["shortfalls"] and attempt["settled_s"] is None
    assert attempt["turns"] == 0 and attempt["largest_angle_rad"] > 1.0 and attempt["least_contact"] is not None


def test_a_maneuver_is_no_law_to_start_with(tmp_path: Path) -> None:
    from hoopd.commands.options.trajectory import TrajectoryOptions
    from hoopd.commands.trajectory import run as plan

    law = tmp_path / "law.yaml"
    plan(TrajectoryOptions(kind="swing", model=Path("models/hoop.yaml"), law=law))
    sets = (f"control.file={law}", f"device.model={defaults_folder()}/models/hoop.yaml")
    with pytest.raises(InputError, match="a maneuver holds no ball"):
        run_daemon(Options(sim=True, speed="max", direct=True, duration_s=1.0, sets=sets))
    with pytest.raises(InputError, match="no law that a maneuver could begin from"):
        played(tmp_path, *sets)


def test_what_does_not_fit_is_refused_before_anything_moves(tmp_path: Path) -> None:
    other = msgspec.structs.replace(trajectory(), sample_time_s=0.01)
    with pytest.raises(InputError, match=r"loop.yaml: sample_time_s: planned for 0.01 s"):
        played(tmp_path, file=other)
    with pytest.raises(InputError, match="ball_expected"):
        played(tmp_path, "faults.ball_expected=false")
    with pytest.raises(InputError, match=r"plan.torques_nm: asks for 0.3\d* N m, and 0.1 N m are in force"):
        played(tmp_path, "limits.torque_nm=0.1")
    with pytest.raises(InputError, match="the filter's model has none"):
        played(tmp_path, file=msgspec.structs.replace(trajectory(), maneuver="up"))


def test_with_less_torque_in_force_a_plan_that_fits_is_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = played(tmp_path, "limits.torque_nm=0.5")
    assert result["succeeded"] == 1, result
    assert torque_log.read(tmp_path / "torque.jsonl").max_abs() <= 0.5
    assert result["notes"] == ["hoop.yaml has changed since the maneuver was planned on it"]
    assert result["notes"][0] in capsys.readouterr().err


def test_a_plan_of_another_model_is_told_of(tmp_path: Path) -> None:
    result = played(tmp_path, file=msgspec.structs.replace(trajectory(), model="heavy.yaml"))
    assert result["notes"] == ["planned on heavy.yaml, and the filter's model is hoop.yaml"]


def ended_after(modes: Sequence[tuple[float, str]], *, armed: bool) -> tuple[float, str]:
    """When and why a conductor ends a run whose ball never rests: a mode from each time on, s."""
    asked: list[float] = []
    conductor, t = ManeuverConductor("", 1, armed=armed), 0.0
    with conductor.attend(cast(Loop, SimpleNamespace(request_stop=lambda: asked.append(t)))):
        while not asked and t < 200.0:
            t += 0.5
            mode = [name for begins, name in modes if begins <= t][-1]
            moving = TickRecord(t, 0, mode, 0.0, 0.0, 0.0, 0.0, 0.0, t, t, (0.0, 9.0, 0.0, 0.0), 0.0, 0, 0, 0.0, 0.0)
            conductor.put(moving, cast(Inputs, None))
    return t, conductor.outcome


def test_the_ball_s_time_to_rest_counts_from_the_operator_s_arm() -> None:
    late = "the ball did not come to rest within 25 s"
    assert ended_after([(0.0, "DISARMED"), (100.0, "RUNNING")], armed=False) == (125.5, late)
    assert ended_after([(0.0, "DISARMED")], armed=False) == (200.0, "")
    assert ended_after([(0.0, "DISARMED")], armed=True) == (25.5, late)


def test_one_that_is_switched_off_before_its_first_torque_is_none() -> None:
    events = [
        SimpleNamespace(t=1.0, event="controller", fields={"command": "experiment"}),
        SimpleNamespace(t=1.02, event="experiment_ended", fields={"reason": "the mode is FAULT"}),
    ]
    ticks = [SimpleNamespace(t=1.0, mode="RUNNING"), SimpleNamespace(t=1.02, mode="FAULT")]
    header = SimpleNamespace(config="{}")
    assert (
        recorded_maneuvers(cast(RecordedRun, SimpleNamespace(events=events, ticks=ticks, inputs=[], header=header)))
        == []
    )


@cache
def throw() -> TrajectoryFile:
    planned = plan_trajectory(HOOP, ManeuverQuestion("throw", MotionLimits(0.45, 40.0, 0.5, 0.6)))
    return trajectory_file(planned, "models/hoop.yaml", "ab", "throw")


def bouncing(restitution: float, grip: float = 0.3) -> str:
    numbers = f"{{restitution: {restitution}, grip: {grip}}}"
    return f"sim.effects=[{{name: ball.lift_off, parameters: {numbers}}}]"


@pytest.mark.parametrize("restitution", sampled([0.0, 0.4], [0.4]))
def test_a_ball_is_thrown_and_caught(tmp_path: Path, restitution: float) -> None:
    result = played(tmp_path, bouncing(restitution), repeat=2, file=throw())
    assert result["succeeded"] == 2 and set(result["faults"]) <= {"ball_missing"}, result
    assert all(one["least_distance"] < 0.9 for one in result["attempts"])
    true, p = truth.read(tmp_path / "truth.csv"), HOOP.values()
    free = (p["Ro"] - p["Rb"]) * true.dpsi**2 + p["g"] * np.cos(true.psi) < 0.0
    assert true.psi[-1] == pytest.approx(2 * tau, abs=0.02) and free.sum() > 2 * 3


def test_a_ball_that_is_not_caught_ends_with_the_torque_off(tmp_path: Path) -> None:
    """It is gone from the middle of its flight on: nobody waits for it longer than planned."""
    flight = throw().plan.flight
    assert flight is not None
    gone_s = 1.66 + 0.02 * (flight.first_tick + 4)
    result = played(tmp_path, bouncing(0.0), f"sim.faults=[{{kind: ball_gone, at_s: {gone_s}}}]", file=throw())
    assert result["succeeded"] == 0 and result["faults"]["ball_lost"] and result["exit"] == 1


def test_a_ball_that_never_left_the_hoop_was_not_thrown(tmp_path: Path) -> None:
    """A loop that is called a throw goes round and settles, and is none."""
    result = played(tmp_path, file=msgspec.structs.replace(trajectory(), maneuver="throw"))
    (attempt,) = result["attempts"]
    assert not attempt["success"] and attempt["shortfalls"] == ["the ball did not leave the hoop"]
    assert attempt["least_distance"] > 0.99
