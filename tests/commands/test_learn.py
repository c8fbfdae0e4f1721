"""`hoopd learn`: it goes on until it knows, resumes where it was broken off, and keeps to its budget."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from commands.played_campaign import options, played
from harness.learn_kills import run_killed, running
from harness.told_diagnosis import said
from inprocess import call

from hoopd import lab
from hoopd.commands import learn as command
from hoopd.commands.options.learn import seconds_of
from hoopd.files.campaign_progress import read_progress
from hoopd.files.reading import InputError

FRICTION = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.006}}]"


def test_it_records_until_the_law_is_sure_then_designs_and_keeps_what_is_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = played(monkeypatch, said(0.6), said(0.92))
    result = command.run(options(tmp_path))
    assert steps.commands == ["experiment", "diagnose", "experiment", "diagnose", "design", "compare"]
    assert result["settled"] and result["kept"] and result["laws"] == ["hoop.coulomb_friction"]
    assert result["recorded_s"] == 42.0 and len(steps.words[3]) == len(steps.words[1]) + 1
    page = (tmp_path / "campaign" / "story.html").read_text()
    assert "hoop.coulomb_friction is 65% sure" in page and "clear after 4 pairs" in page
    assert str(tmp_path) not in page


def test_it_tells_what_it_does_and_believes_to_whoever_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, seen = tmp_path / "campaign", list[tuple[str, int, bool]]()
    played(monkeypatch, said(0.6), said(0.92))

    def look(doing: str) -> None:
        told = read_progress(folder)
        seen.append((doing.partition(":")[0], len(told.runs), (folder / "story.html").exists()))
        with pytest.raises(InputError, match="another hoopd learn is at work here"):
            command.run(options(tmp_path))

    command.run(options(tmp_path), look)
    assert [one[1:] for one in seen] == [(0, False), (0, False), (1, True), (1, True), (2, True), (2, True)]
    told = read_progress(folder)
    assert (
        told.doing == ""
        and "95% sure" in told.ended
        and told.runs[0].open == ["hoop.coulomb_friction is 65% sure, 95% are asked for"]
    )


def test_what_a_person_has_to_do_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played(monkeypatch, said(0.92), said(0.92))
    asked: list[str] = []

    def may(text: str) -> bool:
        asked.append(read_progress(tmp_path / "campaign").asks)
        return False

    (tmp_path / "device.yaml").write_text("device: {name: own}\n")
    command.run(options(tmp_path, sim=False, config=tmp_path / "device.yaml"), may_play=may)
    assert len(asked) == 1 and asked[0].startswith("whoever began it: may it play prbs, 22 s")


def test_it_says_that_nothing_is_missing_and_designs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch, said(), said(), said(), said())
    steps.writes_models = True
    result = command.run(options(tmp_path))
    assert steps.commands == ["experiment", "diagnose"] * 4
    first, again, *_ = (one for one in steps.words if one[0] == "experiment")
    assert first[1] == again[1]  # the careful signal once more,
    assert "--use" in first and "--model" in again  # as strong as what was learned allows
    assert result["settled"] and result["laws"] == [] and not result["kept"]


def test_the_budget_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch, said(0.5), said(0.5), verdict="worse")
    result = command.run(options(tmp_path, budget="45s"))
    assert steps.commands.count("experiment") == 2
    assert not result["settled"] and not result["kept"] and "budget of 45 s" in result["ended_because"]


def test_with_more_budget_it_designs_and_compares_anew_and_keeps_what_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, folder = played(monkeypatch, said(0.5), said(0.5), said(0.92), verdict="worse"), tmp_path / "campaign"
    assert not command.run(options(tmp_path, budget="45s"))["kept"]
    steps.words, steps.verdict = [], "better"
    result = command.run(options(tmp_path))
    assert steps.commands == ["experiment", "diagnose", "design", "compare"] and result["kept"]
    assert json.loads((folder / "earlier_comparison_1.json").read_bytes())["verdict"] == "worse"
    assert (folder / "earlier_design_1.json").exists()
    steps.words = []
    assert command.run(options(tmp_path))["kept"] and steps.commands == []


def test_what_was_broken_off_goes_on_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch, said(0.6), said(0.92))
    steps.fails = "design"
    with pytest.raises(command.StepError):
        command.run(options(tmp_path))
    before = {path: path.read_bytes() for path in (tmp_path / "campaign").rglob("*") if path.is_file()}
    (tmp_path / "campaign" / "run_03").mkdir()
    steps.fails, steps.words = "", []
    assert command.run(options(tmp_path))["kept"]
    assert steps.commands == ["design", "compare"]
    told_anew = ("progress.json", "story.html")
    assert all(path.read_bytes() == data for path, data in before.items() if path.name not in told_anew)


def test_who_interrupts_is_told_where_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any, **__: Any) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(command.Steps, "command", interrupted)
    with pytest.raises(KeyboardInterrupt):
        command.learn(options(tmp_path))
    told = " ".join(capsys.readouterr().err.split())
    assert told.endswith("campaign keeps what is done, and the same command goes on")


def test_a_recording_that_nobody_finished_is_kept_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "campaign" / "run_01"
    steps = played(monkeypatch, said(), said(), said(), said())
    steps.fails = "experiment"
    with pytest.raises(command.StepError):
        command.run(options(tmp_path))
    (folder / "recording.mcap").write_bytes(b"half")
    steps.fails = ""
    command.run(options(tmp_path))
    assert (folder / "broken_1.mcap").read_bytes() == b"half"


def test_the_last_diagnosis_foresees_the_next_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch, said(0.6), said(0.92))
    steps.writes_models = True
    command.run(options(tmp_path))
    first, second = (one for one in steps.words if one[0] == "experiment")
    assert "--model" not in first and float(first[first.index("--use") + 1]) < 0.8
    assert second[second.index("--model") + 1] == str(tmp_path / "campaign" / "run_01" / "model.yaml")


def test_a_run_that_a_limit_ended_too_early_is_made_again_with_half_the_torque(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, folder = played(monkeypatch, said(0.6), said(0.92)), tmp_path / "campaign" / "run_01"
    early = {"ended_at_s": 1.5, "outcome": "ball angle 1.3 rad beyond 1.25", "limit_passed": True}
    steps.early = [{**early, "amplitude_nm": 0.08}, {**early, "amplitude_nm": 0.04}]
    asked: list[str] = []
    result = command.run(options(tmp_path), may_play=lambda text: not asked.append(text))
    assert [one[one.index("--amplitude") + 1] for one in steps.words if "--amplitude" in one] == ["0.04", "0.02"]
    assert result["recorded_s"] == 42.0 + 3.0 and result["runs"] == 2
    assert len(asked) == 4 and "beyond 1.25): with half the torque" in asked[1]
    assert {one.name for one in folder.glob("early_*")} == {
        f"early_{k}.{end}" for k in (1, 2) for end in ("mcap", "json")
    }
    # it is the same kind of signal all the same
    assert read_progress(tmp_path / "campaign").runs[0].signal == "prbs --amplitude 0.02"


@pytest.mark.parametrize(("limit", "tries"), [(True, 4), (False, 1)])
def test_what_ends_again_and_again_or_by_a_fault_ends_the_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: bool, tries: int
) -> None:
    steps = played(monkeypatch, said(0.6))
    steps.early = [{"ended_at_s": 1.5, "outcome": "why it ended", "limit_passed": limit, "amplitude_nm": 0.08}] * 9
    with pytest.raises(command.StepError, match=r"run 1 lasted 1\.5 s: why it ended"):
        command.run(options(tmp_path))
    assert steps.commands == ["experiment"] * tries


def test_what_a_fault_ended_at_once_is_played_again_by_the_same_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps, folder = played(monkeypatch, said(0.6), said(0.92)), tmp_path / "campaign" / "run_01"
    nobody, lost = (
        {"ended_at_s": at, "outcome": "stopped", "limit_passed": False, "amplitude_nm": 0.08} for at in (None, 2.2)
    )
    steps.early = [nobody, lost]
    for _ in range(2):
        with pytest.raises(command.StepError, match="the same command plays it again"):
            command.run(options(tmp_path))
    result = command.run(options(tmp_path))
    assert result["settled"] and result["recorded_s"] == pytest.approx(42.0 + 2.2)
    assert [path.name for path in sorted(folder.glob("early_*"))] == [
        f"early_{k}.{end}" for k in (1, 2) for end in ("json", "mcap")
    ]
    assert "--amplitude" not in steps.words[2]  # no fault is a reason for less torque


def test_a_signal_that_a_limit_ends_however_small_it_is_gives_way_to_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = played(monkeypatch, said(0.6), said(0.92))
    early = {"ended_at_s": 1.5, "outcome": "beyond", "limit_passed": True, "amplitude_nm": 0.08}
    steps.early = [early] * 4
    with pytest.raises(command.StepError, match="the same command goes on with another signal"):
        command.run(options(tmp_path))
    assert json.loads((tmp_path / "campaign" / "run_01" / "given_up_1.json").read_bytes())["words"] == ["prbs"]
    result = command.run(options(tmp_path))
    assert result["settled"] and result["recorded_s"] == 42.0 + 6.0
    played_kinds = [one[1] for one in steps.words if one[0] == "experiment"]
    assert played_kinds[:5] == ["prbs"] * 4 + ["multisine"]


def test_a_device_on_which_every_signal_meets_a_limit_ends_the_campaign_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = played(monkeypatch)
    steps.early = [{"ended_at_s": 0.5, "outcome": "beyond", "limit_passed": True, "amplitude_nm": 0.08}] * 99
    for _ in range(6):
        with pytest.raises(command.StepError):
            command.run(options(tmp_path, budget="10min"))
    result = command.run(options(tmp_path, budget="10min"))
    assert not result["settled"] and "a limit has ended every one" in result["ended_because"]


@pytest.mark.parametrize("text", ["{}", "[]", '{"ended_at_s": "soon"}'])
def test_a_spoiled_file_of_a_run_is_one_line(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played(monkeypatch, said(0.6), said(0.92))
    command.run(options(tmp_path))
    path = tmp_path / "campaign" / "run_01" / "experiment.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"run_01/experiment\.json"):
        command.run(options(tmp_path))


def test_another_question_is_no_campaign_to_go_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played(monkeypatch, said(), said(), said(), said())
    command.run(options(tmp_path))
    with pytest.raises(InputError, match=r"learn.json: confidence: was begun with 0.95, not with 0.8"):
        command.run(options(tmp_path, confidence=0.8))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("x")
    with pytest.raises(InputError, match="holds other files"):
        command.run(options(tmp_path, out=tmp_path / "other"))


def test_a_device_is_not_driven_unasked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch)
    (tmp_path / "device.yaml").write_text("device: {name: own}\n")
    here = options(tmp_path, sim=False, config=tmp_path / "device.yaml")
    asked: list[str] = []
    result = command.run(here, may_play=lambda text: bool(asked.append(text)))
    assert steps.words == [] and len(asked) == 1 and result["ended_because"] == "The operator wanted no further run."
    code, _, errors = call(["learn", "--config", str(tmp_path / "device.yaml"), "--out", str(tmp_path / "c")])
    assert code == 2 and "nobody is there to be asked" in errors


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "hoopd: --sim: or --config FILE: where shall be recorded?"),
        (["--sim", "--budget", "4x"], "hoopd: --budget: must be a time up to a day, as 10min or 90s, not '4x'"),
        (["--plant", "pendulum"], "hoopd: --plant: another plant is not driven from here: --recording FILE for each"),
        (["--sim", "--recording", "a.csv"], "hoopd: --recording: what was recorded by hand drives nothing"),
    ],
)
def test_what_cannot_be_begun_is_one_line(words: list[str], line: str, tmp_path: Path) -> None:
    code, _, errors = call(["learn", "--out", str(tmp_path / "campaign"), *words])
    assert code == 2 and errors.startswith(line) and errors.count("\n") == 1
    assert not (tmp_path / "campaign").exists()


def test_what_is_known_of_the_device_goes_into_every_diagnosis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch, said(0.6), said(0.92))
    command.run(options(tmp_path, memory=tmp_path / "known.json"))
    diagnoses = [words for words in steps.words if words[0] == "diagnose"]
    assert [words[words.index("--memory") + 1] for words in diagnoses] == [str(tmp_path / "known.json")] * 2


def test_times_have_units() -> None:
    assert [seconds_of(text) for text in ("10min", "90s", "1.5h", "600")] == [600.0, 90.0, 5400.0, 600.0]


@pytest.mark.proof
@pytest.mark.timeout(1200)
def test_killed_at_random_moments_it_leaves_the_drive_off_loses_nothing_and_goes_on(tmp_path: Path) -> None:
    killed = run_killed(tmp_path, kills=3, seed=3, compared=False)
    assert len(killed.met) == 3 and killed.wrong == (), killed


@pytest.mark.proof
@pytest.mark.timeout(900)
def test_a_concealed_friction_is_learned_on_the_rig_however_often_it_is_killed(tmp_path: Path) -> None:
    """Nothing of it is left running when it is killed, and what it had is not done again."""
    folder = tmp_path / "campaign"
    line = [
        sys.executable,
        "-m",
        "hoopd",
        "learn",
        "--sim",
        "--budget",
        "3min",
        "--set",
        FRICTION,
        "--out",
        str(folder),
    ]
    for wait_s in (0.7, 1.9, 4.0, 8.0):
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(wait_s)
        os.kill(process.pid, signal.SIGKILL)
        process.wait(10.0)
        deadline = time.monotonic() + 10.0
        while (left := running(folder)) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert not left
    told = folder / "told.json"
    subprocess.run([*line, "--json", str(told)], check=False, capture_output=True, timeout=600.0)
    result = json.loads(told.read_text())
    assert result["settled"] and result["laws"][0] == "hoop.coulomb_friction" and result["runs"] <= 4


def test_the_lab_learns_by_the_same_command(tmp_path: Path) -> None:
    """With a budget that leaves no room for a run nothing is played."""
    learned = lab.learn(budget="5s", folder=tmp_path / "campaign", sets={"sim.delay_frames": 2})
    assert not learned.settled and learned.laws == [] and "5 s" in learned.result["ended_because"]
    asked = json.loads((tmp_path / "campaign" / "learn.json").read_text())
    assert asked["sets"] == ["sim.delay_frames=2"] and asked["sim"]
    with pytest.raises(ValueError, match=r"sets: was begun with sim.delay_frames=2, not with none"):
        lab.learn(budget="5s", folder=tmp_path / "campaign")
    lab.learn(budget="9s", folder=tmp_path / "campaign", sets={"sim.delay_frames": 2})
    assert json.loads((tmp_path / "campaign" / "learn.json").read_text())["budget_s"] == 9.0


def test_what_is_not_what_it_should_be_is_told_before_a_folder_is_made(tmp_path: Path) -> None:
    memory = tmp_path / "memory.json"
    memory.write_text("{")
    for words in (
        ["--config", str(tmp_path / "none.yaml")],
        ["--sim", "--memory", str(memory)],
        ["--sim", "--set", "nokey=3"],
    ):
        code, _, errors = call(["learn", *words, "--out", str(tmp_path / "c")])
        assert code == 2 and errors.count("\n") == 1 and not (tmp_path / "c").exists()
    code, _, errors = call(["learn", "--sim", "--out", str(memory)])
    assert code == 2 and "is no folder" in errors
