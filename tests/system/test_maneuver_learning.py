"""`hoopd maneuver --learn` on the rig: attempts that teach the next one, and what is refused or ends it."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoopd.commands import maneuver_learning
from hoopd.commands.maneuver import run
from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.smoothed_attempt import SmoothedAttempt
from hoopd.commands.trajectory import run as plan
from hoopd.daemon.replay import replay
from hoopd.files.correction import CorrectionFile, correction_beside, load_correction
from hoopd.files.reading import InputError
from hoopd.files.trajectory import load_trajectory
from hoopd.recording.mcap import read_run

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
    assert kept.best is not None and kept.best.tracking == second["tracking"]
    again = run(options(tmp_path, planned, FRICTION, correction=correction_beside(path), out=tmp_path / "again.mcap"))
    assert again["exit"] == 0 and correction_beside(path).read_text(encoding="utf-8").count("recording") == 2
    # the best that was played is played again, to the digit
    assert played_torques(tmp_path / "again.mcap") == played_torques(tmp_path / "run_2.mcap")
    assert played_torques(tmp_path / "again.mcap") != played_torques(tmp_path / "run_1.mcap")


@pytest.mark.proof
def test_the_loop_of_the_guide_is_nearer_to_its_plan_from_the_second_attempt_on(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    plan(TrajectoryOptions(kind="loop", model=Path("models/hoop.yaml"), out=path))
    rig = (FRICTION, f"sim.directory={tmp_path}", "log.level=error")
    given = ManeuverOptions(
        kind="loop", trajectory=path, learn=True, repeat=3, sim=True, speed="max", camera="direct", sets=rig,
        out=tmp_path / "learned.mcap",
    )  # fmt: skip
    first, second, third = run(given)["attempts"]
    assert first["tracking"] == pytest.approx(0.32, abs=0.03)
    assert max(second["tracking"], third["tracking"]) < first["tracking"] / 5.0


def played_torques(path: Path) -> list[float]:
    """Of the maneuver that a run was told."""
    texts = [command.text for inputs in read_run(path).inputs for command in inputs.commands if command.text]
    return json.loads(texts[0])["controller"]["gains"]["torques_nm"]  # type: ignore[no-any-return]


def load_file_hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_an_attempt_that_is_given_up_teaches_nothing_and_ends_it(tmp_path: Path, planned: str) -> None:
    weak = "sim.effects=[{name: actuator.torque_gain, parameters: {k: 0.2}}]"
    result = run(options(tmp_path, planned, weak, "sim.faults=[{kind: camera_stall, at_s: 1.8}]", learn=True, repeat=3))
    assert result["exit"] == 1 and result["played"] == 1 and "nothing was learned" in result["outcome"]
    path = tmp_path / "swing.yaml"
    assert load_correction(correction_beside(path), load_trajectory(path), load_file_hash(path)).attempts == []


def canned(monkeypatch: pytest.MonkeyPatch, tracking: list[float], ended: dict[int, dict[str, Any]]) -> list[int]:
    """Attempts that are told, not played: how far off the plan each is, and what it ended with; the seeds of their
    noise."""
    seen: list[int] = []

    def play(asked: Any, rig: Any, where: Any) -> dict[str, Any]:
        seen.append(rig.seed)
        k = len(seen) - 1
        row = {"began_s": 1.0, "turns": 0, "least_contact": 0.5, "settled_s": 0.0, "ended": "done", "shortfalls": []}
        told = {**row, "success": True, **ended.get(k, {}).get("row", {})}
        outcome = ended.get(k, {}).get("outcome", "done")
        return {"attempts": [told], "outcome": outcome, "file": f"{k}.mcap", "faults": {}, "notes": ["a note"]}

    def smooth(path: Path, trajectory: Any, model: Any) -> SmoothedAttempt:
        states = np.array(trajectory.plan.states)
        states[:, 1] += tracking[len(seen) - 1] * 6.0 * np.sqrt(3.0)
        played = np.array(trajectory.plan.torques_nm)
        return SmoothedAttempt(states, np.zeros(4), states[:-1], played)

    monkeypatch.setattr(maneuver_learning, "play", play)
    monkeypatch.setattr(maneuver_learning, "smoothed_attempt", smooth)
    return seen


def told_run(folder: Path, planned: str, repeat: int, **more: Any) -> tuple[dict[str, Any], CorrectionFile]:
    result, path = run(options(folder, planned, learn=True, repeat=repeat, **more)), folder / "swing.yaml"
    return result, load_correction(correction_beside(path), load_trajectory(path), load_file_hash(path))


def test_after_an_attempt_that_is_worse_the_best_is_played_next(
    tmp_path: Path, planned: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    canned(monkeypatch, [0.5, 0.2, 0.4, 0.2], {})
    result, kept = told_run(tmp_path, planned, 4)
    assert result["exit"] == 1 and result["played"] == 3 and "worse than the best" in result["outcome"]
    assert result["notes"] == ["a note"]
    assert kept.best is not None and kept.best.tracking == 0.2 and kept.torques_nm == kept.best.torques_nm
    assert len(kept.attempts) == 3 and np.abs(kept.unexplained).max() > 0.0
    # the next call begins with it, and knows what was best
    canned(monkeypatch, [0.4], {})
    again, kept = told_run(tmp_path, planned, 1)
    assert again["exit"] == 1 and "worse than the best" in again["outcome"] and kept.best is not None


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ({"row": {"least_contact": -0.1, "success": False}}, "the ball left the hoop"),
        ({"row": {"turns": 1, "success": False}}, r"went round \+1 times"),
        ({"row": {"turns": None, "least_contact": None, "success": False}}, "too little was recorded of it"),
        ({"outcome": "stopped: by the operator"}, "stopped: by the operator"),
    ],
)
def test_what_teaches_nothing_ends_it(
    tmp_path: Path, planned: str, monkeypatch: pytest.MonkeyPatch, what: dict[str, Any], said: str
) -> None:
    canned(monkeypatch, [0.5, 0.2, 0.2], {1: what})
    result, kept = told_run(tmp_path, planned, 3)
    assert result["exit"] == 1 and result["played"] == 2 and re.search(said, result["outcome"])
    if "row" in what:  # what led there is not what is played next
        assert kept.untaught == 1
        assert len(kept.attempts) == 1 and kept.best is not None and kept.torques_nm == kept.best.torques_nm


def test_no_attempt_has_the_noise_of_one_before(tmp_path: Path, planned: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = canned(monkeypatch, [0.5, 0.2], {1: {"row": {"turns": 1, "success": False}}})
    told_run(tmp_path, planned, 2)
    after = canned(monkeypatch, [0.2, 0.2], {})
    told_run(tmp_path, planned, 2)
    assert [*before, *after] == [before[0] + k for k in range(4)]


def test_with_less_torque_in_force_a_correction_stays_within_it(tmp_path: Path, planned: str) -> None:
    """The plan's own torque is all that is left at its largest: nothing is added there, and it goes on."""
    (tmp_path / "swing.yaml").write_text(planned, encoding="utf-8")
    largest = max(map(abs, load_trajectory(tmp_path / "swing.yaml").plan.torques_nm))
    limit = f"limits.torque_nm={largest + 0.001:.3f}"
    result = run(options(tmp_path, planned, FRICTION, limit, learn=True, repeat=2))
    assert result["played"] == 2 and result["exit"] == 0, result
    assert result["attempts"][1]["correction_nm"] > 0.0
    asked = played_torques(tmp_path / "run_2.mcap")
    assert max(map(abs, asked)) <= largest + 0.0015
    # what was learned with more in force is played with less
    beside = correction_beside(tmp_path / "swing.yaml")
    beside.write_text(re.sub(r"(?m)^torques_nm: \[[^]]*\]", f"torques_nm: {[0.02] * len(asked)}", beside.read_text()))
    again = run(options(tmp_path, planned, FRICTION, limit, learn=True, repeat=1, out=tmp_path / "again.mcap"))
    assert again["played"] == 1 and max(map(abs, played_torques(tmp_path / "again_1.mcap"))) <= largest + 0.0015


def test_an_attempt_that_cannot_be_played_leaves_what_was_told(
    tmp_path: Path, planned: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    canned(monkeypatch, [0.5], {})
    play = maneuver_learning.play

    def once(asked: Any, rig: Any, where: Any) -> dict[str, Any]:
        if where.file.name.endswith("_2.mcap"):
            raise InputError("the disk", "", "is full")
        return play(asked, rig, where)

    monkeypatch.setattr(maneuver_learning, "play", once)
    result, kept = told_run(tmp_path, planned, 3)
    assert result["exit"] == 1 and result["outcome"] == "attempt 2 was not played: the disk: is full"
    assert result["played"] == 1 and len(kept.attempts) == 1


def test_a_trajectory_of_another_model_is_refused(tmp_path: Path, planned: str) -> None:
    text = re.sub(r"model_sha256: \w+", "model_sha256: '00'", planned)
    with pytest.raises(InputError, match="no longer, the model"):
        run(options(tmp_path, text, learn=True))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"kind": "throw"}, "--learn: goes with loop and swing"),
        ({"trajectory": None}, "--learn: needs --trajectory"),
        ({"correction": Path("c.yaml")}, "--learn: goes on with the correction"),
        ({"practice": 1}, "--learn: goes without --practice"),
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
