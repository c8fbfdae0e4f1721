"""`hoopd maneuver --learn` on the rig: attempts that teach the next one, and what is refused or ends it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hoopd.commands.maneuver import run
from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.trajectory import run as plan
from hoopd.daemon.replay import replay
from hoopd.files.correction import correction_beside, load_correction
from hoopd.files.reading import InputError
from hoopd.files.trajectory import load_trajectory

FRICTION = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.02}}]"


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("plan") / "swing.yaml"
    plan(TrajectoryOptions(kind="swing", model=Path("models/hoop.yaml"), angle_rad=0.9, out=path))
    return path.read_text(encoding="utf-8")


def options(folder: Path, planned: str, *sets: str, **more: Any) -> ManeuverOptions:
    path = folder / "swing.yaml"
    if not path.exists():
        path.write_text(planned, encoding="utf-8")
    given = {"kind": "swing", "trajectory": path, "sim": True, "speed": "max", "camera": "direct"}
    rig = (f"sim.directory={folder}", "log.level=error", *sets)
    return ManeuverOptions(**{**given, "sets": rig, "out": folder / "run.mcap", **more})


def test_a_friction_that_nobody_knows_is_answered_at_the_second_attempt(tmp_path: Path, planned: str) -> None:
    figure = tmp_path / "attempts.png"
    result = run(options(tmp_path, planned, FRICTION, learn=True, repeat=2, figure=figure))
    first, second = result["attempts"]
    assert result["exit"] == 0 and result["succeeded"] == 2 and figure.exists()
    assert second["tracking"] < first["tracking"] / 2.0, result["attempts"]
    assert 0.0 < second["correction_nm"] <= result["correction_limit_nm"]
    for name in ("run_1.mcap", "run_2.mcap"):
        assert replay(tmp_path / name)["equal"]
    # what was learned is beside the trajectory, and goes on there
    path = tmp_path / "swing.yaml"
    kept = load_correction(correction_beside(path), load_trajectory(path), load_file_hash(path))
    assert [one.recording for one in kept.attempts] == ["run_1.mcap", "run_2.mcap"]
    again = run(options(tmp_path, planned, FRICTION, correction=correction_beside(path), out=tmp_path / "again.mcap"))
    assert again["exit"] == 0 and correction_beside(path).read_text(encoding="utf-8").count("recording") == 2


def load_file_hash(path: Path) -> str:
    import hashlib

    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_an_attempt_that_is_given_up_teaches_nothing_and_ends_it(tmp_path: Path, planned: str) -> None:
    weak = "sim.effects=[{name: actuator.torque_gain, parameters: {k: 0.2}}]"
    result = run(options(tmp_path, planned, weak, "sim.faults=[{kind: camera_stall, at_s: 1.8}]", learn=True, repeat=3))
    assert result["exit"] == 1 and result["played"] == 1 and "nothing was learned" in result["outcome"]
    assert not correction_beside(tmp_path / "swing.yaml").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"kind": "throw"}, "--learn: goes with loop and swing"),
        ({"trajectory": None}, "--learn: needs --trajectory"),
        ({"kind": "loop"}, "is a swing, no loop"),
        ({"learn": False, "trajectory": None, "correction": Path("c.yaml")}, "--correction: goes with --trajectory"),
    ],
)
def test_what_cannot_be_learned_is_refused(tmp_path: Path, planned: str, more: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(options(tmp_path, planned, **{"learn": True, **more}))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("limit_nm: 0.1125", "limit_nm: 0.0", "limit_nm: must be above 0"),
        ("torques_nm: [0.0, ", "torques_nm: [", "torques_nm: has"),
        ("torques_nm: [0.0, ", "torques_nm: [0.2, ", r"torques_nm\[0\]: 0.2 N m is beyond limit_nm"),
        ("trajectory_sha256: ", "trajectory_sha256: f", "was learned on another trajectory"),
    ],
)
def test_a_correction_that_does_not_fit_is_refused(tmp_path: Path, planned: str, old: str, new: str, said: str) -> None:
    path = tmp_path / "swing.yaml"
    path.write_text(planned, encoding="utf-8")
    n = len(load_trajectory(path).plan.torques_nm)
    text = (
        f"schema: hoopd.correction/1\ntrajectory: swing.yaml\ntrajectory_sha256: {load_file_hash(path)}\n"
        f"limit_nm: 0.1125\ntorques_nm: {[0.0] * n}\nunexplained: {[[0.0] * 4] * n}\nattempts: []\n"
    )
    assert old in text
    correction_beside(path).write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=said):
        run(options(tmp_path, planned, learn=True))
