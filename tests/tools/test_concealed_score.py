"""The scorer of concealed cases: its rivals, its workers, its folder, and a whole run from the generator to figures."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.test_diagnose import LEFT_OUT
from rich.console import Console

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import baselines, cases, cli, recipes, runfolder, score, seeds, version, worker  # noqa: E402
from concealed.recipes import Wish  # noqa: E402

CONSISTENT: dict[str, Any] = {"verdict": "consistent", "effects": []}


def test_score_seeds_are_drawn_and_never_typed() -> None:
    drawn = {seeds.score_seed() for _ in range(50)}
    assert len(drawn) == 50
    assert not any(seeds.is_tuning(seed) for seed in drawn)
    assert all(seeds.is_tuning(seed) for seed in seeds.TUNING)
    with pytest.raises(SystemExit):
        cli.main(["generate", "nowhere", "--seed", str(min(drawn))])


FAKE = """
import json, os, sys
files = sorted(os.listdir())
json.dump({"verdict": "consistent", "effects": [], "files": files, "argv": sys.argv[1:]}, open("diagnosis.json", "w"))
"""


def test_a_worker_sees_the_recordings_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        worker, "command", lambda seed, without, names: [sys.executable, "-c", FAKE, str(seed), *without]
    )
    done = worker.diagnose({"train_1.csv": b"1", "train_2.csv": b"2", "holdout.csv": b"3"}, 7, ("ball.slip",))
    assert done["diagnosis"]["files"] == ["holdout.csv", "train_1.csv", "train_2.csv"]
    assert done["diagnosis"]["argv"] == ["7", "ball.slip"]
    assert (done["code"], done["error"]) == (0, "")


def test_a_worker_survives_a_failure_and_a_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        worker, "command", lambda *asked: [sys.executable, "-c", "import sys; sys.exit('no such column')"]
    )
    failed = worker.diagnose({}, 1)
    assert (failed["diagnosis"], failed["code"], failed["error"].strip()) == (None, 1, "no such column")
    monkeypatch.setattr(worker, "command", lambda *asked: [sys.executable, "-c", "import time; time.sleep(60)"])
    hung = worker.diagnose({}, 1, limit_s=0.5)
    assert (hung["diagnosis"], hung["code"]) == (None, None)
    assert "0.5 s" in hung["error"]


def test_command_line_of_a_case() -> None:
    words = worker.command(3)[1:]
    assert words[:3] == ["-m", "hoopd", "diagnose"]
    assert words[3:] == [
        "train_1.csv",
        "train_2.csv",
        "--holdout",
        "holdout.csv",
        "--json",
        "diagnosis.json",
        "--seed",
        "3",
        "--no-free-run",
    ]
    assert worker.command(3, ("ball.slip", "hoop.imbalance"))[1:] == [*words, "--without", "ball.slip,hoop.imbalance"]
    assert worker.command(3, (), True)[1:] == [*words, "--library-only"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[runfolder.RunFolder]:
    """A run with a strong bias of the torque and two nulls, short ones, that are made already."""
    asked = runfolder.Asked(1, 1, 2, 0, 0, 0, 0, ("single", "null"), only=("actuator.torque_bias",))
    made = runfolder.RunFolder(tmp_path_factory.mktemp("concealed") / "run")
    made.start(asked)
    ((first, wishes),) = made.chunks()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recipes, "NATS", (300.0, 300.0))
        for name in recipes.RECORDINGS:
            patch.setitem(recipes.LENGTH_S, name, 6.0)
        made.keep(first, cases.make(wishes, asked.seed))
    yield made


def of_family(folder: runfolder.RunFolder, family: str) -> list[str]:
    return [name for name in folder.identifiers() if folder.answer(name)["family"] == family]


def test_what_is_made_is_not_made_again(folder: runfolder.RunFolder) -> None:
    assert folder.chunks() == []
    assert len(folder.identifiers()) == 3
    assert [wish.family for wish in folder.asked().wishes()] == ["single", "null", "null"]
    assert {path.parent.name for path in folder.path.rglob("*.csv")} == set(folder.identifiers())


def test_a_family_alone_has_the_same_cases_as_among_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, name, 1.0)
    counts = (4, 1, 2, 0, 0, 1, 0)
    together = runfolder.Asked(*counts, ("null", "compound")).wishes()
    alone = runfolder.Asked(*counts, ("compound",), left_out=2).wishes()
    assert [wish.family for wish in together] == ["null", "null", "compound"]
    (one,), (*_, same) = cases.make(alone, 4), cases.make(together, 4)
    assert one.identifier == same.identifier
    assert one.files == same.files
    assert one.answer == same.answer


def test_a_folder_that_holds_a_run_is_not_begun_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runfolder.RunFolder(tmp_path).start(runfolder.Asked(7, 1, 0, 0, 0, 0, 0, ("single",)))
    before = (tmp_path / "run.json").read_bytes()
    for words in ((), ("calibrate",)):
        with pytest.raises(SystemExit) as ended:
            cli.main([*words, "--out", str(tmp_path)])
        told = capsys.readouterr().err
        assert ended.value.code == 2
        assert told.count("\n") == 1 and "--resume" in told
    assert (tmp_path / "run.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]


def test_answers_of_two_versions_of_the_code_are_told(tmp_path: Path) -> None:
    folder = runfolder.RunFolder(tmp_path)
    folder.start(runfolder.Asked(7, 1, 0, 0, 0, 0, 0, ("single",)))
    assert folder.versions() == [] and score._mixed(folder) == ""
    for one in ("a", "b", "a"):
        folder.speaks(one)
    assert folder.versions() == ["a", "b"]
    other = runfolder.RunFolder(tmp_path / "before")
    (other.path / "diagnoses").mkdir(parents=True)
    other.speaks("a")
    assert other.versions() == ["unknown", "a"]
    assert score._mixed(folder).endswith("a, b") and score.judged(folder)["versions"] == ["a", "b"]


def test_the_version_is_that_of_the_modules(tmp_path: Path) -> None:
    (tmp_path / "hoopd").mkdir()
    module = tmp_path / "hoopd" / "a.py"
    seen = []
    for text in ("x = 1\n", "x = 2\n", "x = 1\n"):
        module.write_text(text)
        seen.append(version.version(tmp_path))
    module.rename(module.with_name("b.py"))
    assert seen[0] == seen[2] != seen[1] and version.version(tmp_path) not in seen


def test_a_folder_without_a_run_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["report", str(tmp_path)], ["--resume", str(tmp_path / "nowhere")]):
        with pytest.raises(SystemExit) as ended:
            cli.main(words)
        assert ended.value.code == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_run_of_before_is_still_read(tmp_path: Path) -> None:
    counts = {"seed": 7, "singles": 1, "nulls": 2, "decoys": 0, "confounded": 0, "compounds": 0, "unknown": 0}
    (tmp_path / "run.json").write_text(json.dumps({**counts, "families": ["null"]}))
    asked = runfolder.RunFolder(tmp_path).asked()
    assert (asked.left_out, asked.only, len(asked.wishes())) == (0, (), 2)


@pytest.mark.parametrize("words", [(), ("calibrate",)])
def test_a_run_without_the_grammar_keeps_that_it_is_one(words: tuple[str, ...], tmp_path: Path) -> None:
    parser = cli._calibrating() if words else cli._scored()
    options = parser.parse_args(["--family", "outside", "--library-only"])
    folder = runfolder.RunFolder(tmp_path)
    folder.start(cli.asked(options, 7))
    assert folder.asked().library_only
    folder.say("answers", "a", {"family": "outside"})
    assert score._told(folder, score.DIAGNOSES, "a") == (score.SEED, (), True)
    assert score._told(folder, "sparse", "a") == ()


def test_only_who_has_the_library_is_asked_about_what_is_left_out(tmp_path: Path) -> None:
    folder = runfolder.RunFolder(tmp_path)
    folder.start(runfolder.Asked(7, 1, 0, 0, 0, 0, 0, ("single",)))
    for name, left_out in (("a", ["ball.slip"]), ("b", [])):
        folder.say("answers", name, {"left_out": left_out})
    assert score._told(folder, score.DIAGNOSES, "a") == (score.SEED, ("ball.slip",), False)
    assert score._told(folder, score.DIAGNOSES, "b") == (score.SEED, (), False)
    assert [score._concerned(folder, kind, "a") for kind in (score.DIAGNOSES, "sparse")] == [True, False]
    assert [score._concerned(folder, kind, "b") for kind in (score.DIAGNOSES, "sparse")] == [True, True]
    folder.say("answers", "c", {"left_out": [], "family": "outside"})
    assert [score._concerned(folder, kind, "c") for kind in (score.DIAGNOSES, "sparse")] == [True, False]


def test_rivals_say_what_they_are_known_for(folder: runfolder.RunFolder) -> None:
    (biased,) = of_family(folder, "single")
    files = folder.files(biased)
    assert baselines.nominal(files) == {"verdict": "consistent", "effects": []}
    assert baselines.refit(files) == {"verdict": "parameters", "effects": []}


@pytest.mark.parametrize(
    ("rival", "name", "size", "fixed"),
    [
        ("iid BIC", "camera.center_offset", 0.2, {"angle": np.pi / 2}),
        pytest.param("sparse", "hoop.imbalance", 0.03, {}, marks=pytest.mark.proof),
    ],
)
def test_a_rival_finds_what_is_plain_to_see(
    rival: str, name: str, size: float, fixed: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    for recording in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, recording, 5.0)
    recipe = recipes.draw(Wish("single", (name,), calm=True), (2, 0))
    recipe.fixed[name] |= fixed
    for recording in range(3):
        cases.scale_inputs([recipe], recording)
    plain = said_by(rival, recipe)
    recipe.sizes[name] = size
    found = said_by(rival, recipe)
    assert found["verdict"] == "missing_physics"
    assert name in [one["name"] for one in found["effects"]]
    assert name not in [one["name"] for one in plain["effects"]]


def said_by(rival: str, recipe: recipes.Recipe) -> dict[str, Any]:
    made = cases.traces([recipe])
    files = {f"{n}.csv": cases.csv_bytes(made[recipe.identifier, i]) for i, n in enumerate(recipes.RECORDINGS)}
    return baselines.RIVALS[rival](files)


def test_a_diagnosis_that_failed_is_an_answer(folder: runfolder.RunFolder) -> None:
    answers: dict[str, Any] = {"failed": {"diagnosis": None}, "done": {"diagnosis": CONSISTENT}}
    kind = score.DIAGNOSES
    for name, answer in answers.items():
        folder.say(kind, name, answer)
    told = {(name, retry): score._done(folder, kind, name, retry) for name in answers for retry in (False, True)}
    assert told == {("failed", False): True, ("failed", True): False, ("done", False): True, ("done", True): True}
    assert not score._done(folder, kind, "nobody", False)


def run_whole(folder: runfolder.RunFolder, *nulls: str, rivals: Iterable[str] = ()) -> None:
    """Generator, sealed folder, dask, `hoopd diagnose` as a process, score. The nulls that are named have an
    answer already, of those rivals too, which stays; that the biased one failed before is asked again."""
    console = Console(file=sys.stdout, width=100)
    (biased,) = of_family(folder, "single")
    for done in nulls:
        folder.say(score.DIAGNOSES, done, {"diagnosis": CONSISTENT, "seconds": 2.0, "code": 0, "error": ""})
        for rival in rivals:
            folder.say(rival, done, CONSISTENT)
    folder.say(score.DIAGNOSES, biased, {"diagnosis": None, "seconds": 0.1, "code": 1, "error": "broken off"})
    before = [(folder.path / score.DIAGNOSES / f"{done}.json").read_bytes() for done in nulls]
    with score.cluster(None, 1) as client:
        score.run(folder, client, console, retry=True)
    assert [(folder.path / score.DIAGNOSES / f"{done}.json").read_bytes() for done in nulls] == before
    named = told_by(folder, biased)
    assert (named["verdict"], [one["name"] for one in named["effects"]]) == (
        "missing_physics",
        ["actuator.torque_bias"],
    )
    result = score.publish(folder, console)
    rates = {name: (one["k"], one["n"]) for name, one in result["rates"].items()}
    assert (rates["first_name"], rates["false_alarms"], rates["spurious"]) == ((1, 1), (0, 2), (0, 1))
    assert (result["oracle_share"]["asked"], result["oracle_share"]["errors"]) == (1, 0)
    assert result["baselines"]["re-fit"]["first_name"]["k"] == 0
    assert result["baselines"]["nominal"]["false_alarms"]["n"] == 2
    assert json.loads((folder.path / "report.json").read_text())["cases"] == 3


def told_by(folder: runfolder.RunFolder, name: str) -> dict[str, Any]:
    """The diagnosis that the program wrote about a case."""
    answer = folder.said(score.DIAGNOSES, name) or {}
    assert answer["code"] == 0, answer
    diagnosis: dict[str, Any] = answer["diagnosis"]
    assert diagnosis["schema"] == "hoopd.diagnosis/1"
    return diagnosis


@pytest.mark.proof
@pytest.mark.timeout(900)  # 15 s of a processor, which other work may share
def test_a_run_names_what_is_hidden(
    folder: runfolder.RunFolder, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Among some of the library; among all of it by the proof below."""
    monkeypatch.setattr(score, "_told", lambda _, kind, name: (score.SEED, LEFT_OUT) if kind == score.DIAGNOSES else ())
    run_whole(folder, *of_family(folder, "null"), rivals=baselines.RIVALS)
    assert "false alarms" in capsys.readouterr().out


@pytest.mark.proof
@pytest.mark.timeout(900)
def test_a_run_names_what_is_hidden_and_nothing_where_nothing_is(
    folder: runfolder.RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    done, left = of_family(folder, "null")
    shutil.copytree(folder.path, tmp_path / "run")
    whole = runfolder.RunFolder(tmp_path / "run")
    run_whole(whole, done)
    plain = told_by(whole, left)
    assert (plain["verdict"], plain["effects"]) == ("parameters", [])
    assert "false alarms" in capsys.readouterr().out
