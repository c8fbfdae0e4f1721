"""`hoopd diagnose`: the files it writes, the same bytes each time, and one line for whatever cannot be used.

Searches here are among eight effects of the library, in half of the time of all. Among all of them `make proof` names a
bias in `tests/tools/test_concealed_score.py` and the friction in `tests/system/test_found_and_written_back.py`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import typer
from commands.devicerun import written
from diagnose.examples import coulomb
from diagnose.madeup import NOISE, shipped_plant, stretch_with

from hoopd.commands import cli, diagnose
from hoopd.commands.diagnose_inputs import check_distinct, expanded
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.diagnose.proof.written_parameters import Written
from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.record_file import parse
from hoopd.diagnose.run import Outcome
from hoopd.files.reading import InputError
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording import load, save
from hoopd.recording.recording import from_columns

FRICTION_NM = 6e-3
NAME = "hoop.coulomb_friction"
KEPT = (
    NAME, "hoop.stribeck_friction", "hoop.friction_drift", "hoop.quadratic_drag", "hoop.imbalance",
    "actuator.torque_bias", "ball.coulomb_friction", "camera.latency",
)  # fmt: skip
LEFT_OUT = tuple(name for name in library(shipped_plant()) if name not in KEPT)
MODELS = Path(__file__).resolve().parents[2] / "config" / "models"


class Page(HTMLParser):
    """Anchors of sections, numbers of figures, and what it loads from elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sections, self.figures, self.loaded = [], 0, []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.sections += [found["id"]] if tag == "section" and "id" in found else []
        self.figures += tag == "figure"
        self.loaded += [v for k, v in attrs if k in ("src", "href") and v and not v.startswith(("#", "data:"))]


def run(recordings: Sequence[str], holdout: Sequence[str] = (), *, progress: Any = print, **asked: Any) -> Diagnosis:
    """What the command finds."""
    options = DiagnoseOptions(recordings=tuple(recordings), holdout=tuple(holdout), **asked)
    return diagnose.run(options, progress=progress)


def command(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Exit code of `hoopd diagnose ARGUMENTS`."""
    monkeypatch.setattr(sys, "argv", ["hoopd", "diagnose", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def program(folder: Path, hash_seed: int) -> subprocess.CompletedProcess[str]:
    """The program over the recordings of a folder; writes one.json, one.html and found.yaml into it."""
    outputs = ["--json", "one.json", "--report", "one.html", "--write", "found.yaml", "--without", ",".join(LEFT_OUT)]
    outputs += ["--yes"]  # six seconds leave a sign open
    arguments = [sys.executable, "-m", "hoopd", "diagnose", "train", "--holdout", "held.csv", *outputs]
    root = Path(diagnose.__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONHASHSEED": str(hash_seed)}
    return subprocess.run(arguments, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two recordings with dry friction, and what the program made of them in a process of its own."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "train").mkdir()
    written(folder / "train" / "run.csv", 1, 6.0, FRICTION_NM)
    written(folder / "held.csv", 2, 4.0, FRICTION_NM)
    done = program(folder, hash_seed=7)
    assert done.returncode == 0, done.stderr
    assert NAME in done.stdout
    assert not done.stderr  # progress is for a terminal
    return folder


@pytest.fixture(scope="module")
def diagnosis(made: Path) -> Diagnosis:
    return parse((made / "one.json").read_bytes(), "one.json")


def test_the_friction_is_named_with_its_value_and_proven(diagnosis: Diagnosis) -> None:
    first = diagnosis.effects[0]
    low, high = first.parameters["Fc"].ci95 or (None, None)
    assert diagnosis.verdict == "missing_physics"
    assert first.name == NAME
    assert low is not None
    assert high is not None
    assert low - 0.3e-3 < FRICTION_NM < high + 0.3e-3
    proof = diagnosis.fit.heldout["held.csv"]["theta_rate"]
    assert (proof.base_refit or 0.0) + 1.0 < (proof.with_effects or 0.0)
    assert list(diagnosis.fit.train) == ["train/run.csv"]


def test_the_page_stands_alone_and_shows_the_force_with_its_law(made: Path) -> None:
    text = (made / "one.html").read_text()
    page = Page(text)
    assert {"effects", "where", "force", "proof", "parameters", "quality"} <= set(page.sections)
    assert page.figures >= 5
    assert not page.loaded
    assert f"In orange: {NAME} with its fitted parameters" in text


def test_the_model_that_was_written_loads_with_intervals_and_region(made: Path) -> None:
    model = load_model(made / "found.yaml")
    (entry,) = model.effects
    amplitude = entry.parameters["Fc"]
    assert effects_of(model).names == (NAME,)
    assert amplitude.ci95 is not None
    assert amplitude.nominal == 0.0
    assert entry.valid["dtheta"][0] < -5.0 < 5.0 < entry.valid["dtheta"][1]
    assert all(one.ci95 is not None and one.nominal is not None for one in model.parameters.values())


@pytest.mark.proof
def test_a_run_from_python_says_what_it_does_and_writes_the_same_bytes(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process, whose strings have other hashes: the same input and seed give the same bytes."""
    monkeypatch.chdir(made)
    steps: list[str] = []
    outputs = {"json_path": tmp_path / "one.json", "report": tmp_path / "one.html", "write": tmp_path / "found.yaml"}
    found = run(["train"], ["held.csv"], progress=steps.append, without=LEFT_OUT, yes=True, **outputs)
    assert steps[0] == "reading the recordings" and "screening the library" in steps
    assert found.effects[0].name == NAME
    assert all((made / path.name).read_bytes() == path.read_bytes() for path in outputs.values())


# ---------------------------------------------------------------------------------------------- refused


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("short") / "run.csv", 3, 8.0)


def _empty_folder(run: Path, tmp: Path) -> list[Any]:
    (tmp / "empty").mkdir()
    return [tmp / "empty"]


def _too_short(run: Path, tmp: Path) -> list[Any]:
    return [f"{run}@0:4"]


def _nothing_held(run: Path, tmp: Path) -> list[Any]:
    return [f"{run}@0:6", "--holdout", f"{run}@6.5:7.6"]


def _held_out_and_fitted(run: Path, tmp: Path) -> list[Any]:
    return [run, "--holdout", f"{run}@4:8"]


def _twice(run: Path, tmp: Path) -> list[Any]:
    return [run, run]


def _another_name(run: Path, tmp: Path) -> list[Any]:
    return [run, run.parent / ".." / run.parent.name / run.name]


def _a_copy(run: Path, tmp: Path) -> list[Any]:
    return [run, "--holdout", shutil.copy(run, tmp / "copy.csv")]


def _no_recording(run: Path, tmp: Path) -> list[Any]:
    return [tmp / "none.csv"]


def _another_file(run: Path, tmp: Path) -> list[Any]:
    (tmp / "notes.csv").write_text("nothing to see\n")
    return [tmp / "notes.csv"]


def _own_input(run: Path, tmp: Path) -> list[Any]:
    return [run.parent, "--write", run]


def _one_target(run: Path, tmp: Path) -> list[Any]:
    return [run, "--json", tmp / "x", "--report", tmp / "x"]


def _no_effects(run: Path, tmp: Path) -> list[Any]:
    (tmp / "mine.py").write_text("EFFECTS = (1,)\n")
    return [run, "--effects", tmp / "mine.py"]


def _taken_name(run: Path, tmp: Path) -> list[Any]:
    text = 'from hoopd.plants.effects.base import Effect\nEFFECTS = (Effect("hoop.imbalance", ()),)\n'
    (tmp / "mine.py").write_text(text)
    return [run, "--effects", tmp / "mine.py"]


def _still_ball(run: Path, tmp: Path) -> list[Any]:
    """Fitted to the hoop alone, proven with the ball."""
    both = load(run)
    save(replace(both, psi=np.full(len(both.t), np.nan)), tmp / "hoop.csv")
    return [tmp / "hoop.csv", "--holdout", run]


def _still_ball_of_entries(run: Path, tmp: Path) -> list[Any]:
    """Half of the recordings are of a bare hoop, whose entries are other ones."""
    return [run, _still_ball(run, tmp)[0]]


def _still_ball_of_masses(run: Path, tmp: Path) -> list[Any]:
    """Nothing that is fitted moves the ball; masses and radii would be the same."""
    return [*_still_ball(run, tmp), "--model", MODELS / "hoop.yaml"]


REFUSED: dict[Callable[[Path, Path], list[Any]], str] = {
    _empty_folder: "no recording in this folder",
    _too_short: "too short to hold a third out",
    _nothing_held: "too short",
    _held_out_and_fitted: "it proves nothing",
    _twice: "given twice",
    _another_name: "same data",
    _a_copy: "rows in common",
    _no_recording: "no such file",
    _another_file: "notes.csv",
    _own_input: "is an input",
    _one_target: "is already where --json goes",
    _no_effects: "an Effect is expected",
    _taken_name: "there is an effect of this name already",
    _still_ball: "entries differ",
    _still_ball_of_entries: "entries differ",
    _still_ball_of_masses: "here the ball moved, and in nothing that is fitted",
}


@pytest.mark.parametrize("make", REFUSED, ids=lambda make: make.__name__.strip("_"))
def test_what_cannot_be_used_is_one_line_and_exit_code_2(
    make: Callable[[Path, Path], list[Any]],
    short: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = short.read_bytes()
    arguments = make(short, tmp_path)
    there = sorted(tmp_path.iterdir())
    assert command(monkeypatch, *arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert REFUSED[make] in error
    assert short.read_bytes() == before
    assert sorted(tmp_path.iterdir()) == there


DOUBT = "J12 has the other sign: -2.5 1/s, 1.5 before"


@pytest.fixture
def doubtful(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A diagnosis whose model no one would expect; the path that it is to be written to."""
    found: Any = Outcome(coulomb()[0], *[cast(Any, None)] * 3)
    monkeypatch.setattr(Outcome, "written", Written(cast(Any, None)))
    monkeypatch.setattr(diagnose, "outcome_of", lambda *given, **more: found)
    monkeypatch.setattr(diagnose, "doubts", lambda outcome: [DOUBT])
    monkeypatch.setattr(diagnose, "left_out", lambda outcome: [])
    monkeypatch.setattr(diagnose, "_model_text", lambda *given: "model\n")
    return tmp_path / "found.yaml"


def test_a_model_of_which_there_are_doubts_is_refused_where_no_one_can_be_asked(
    doubtful: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Everything else is written, and told."""
    monkeypatch.setattr(sys.stdin, "isatty", lambda: False)
    assert command(monkeypatch, "run.csv", "--write", doubtful, "--json", tmp_path / "found.json") == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1 and f"is not written without --yes: {DOUBT}" in printed.err
    assert "hoop.coulomb_friction" in printed.out
    assert not doubtful.exists() and (tmp_path / "found.json").exists()
    assert DOUBT not in (tmp_path / "found.json").read_text()
    assert command(monkeypatch, "run.csv", "--json", tmp_path / "found.json") == 0  # no model, no question


def test_a_model_of_which_there_are_doubts_is_written_when_it_is_agreed_to(
    doubtful: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, "run.csv", "--write", doubtful, "--yes") == 0
    assert doubtful.read_text() == "model\n" and DOUBT in " ".join(capsys.readouterr().out.split())
    doubtful.unlink()
    asked: list[str] = []
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    for agreed in (False, True):
        monkeypatch.setattr(typer, "confirm", lambda text, agreed=agreed, **more: asked.append(text) or agreed)
        assert command(monkeypatch, "run.csv", "--write", doubtful) == 0
        assert doubtful.exists() == agreed
    assert len(asked) == 2 and all(DOUBT in one and str(doubtful) in one for one in asked)


def test_python_writes_such_a_model_when_it_is_told_to(doubtful: Path) -> None:
    found, base = diagnose.outcome_of([], [], cast(Any, None)), cast(Any, None)
    with pytest.raises(InputError, match="is not written without yes=True: J12 "):
        diagnose.write_model(found, base, doubtful)
    assert not doubtful.exists()
    assert diagnose.write_model(found, base, doubtful, yes=True).read_text() == "model\n"


def test_an_interrupted_run_leaves_no_file(short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(case: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnose, "diagnose", interrupted)
    outputs = ["--json", tmp_path / "o.json", "--report", tmp_path / "o.html", "--write", tmp_path / "o.yaml"]
    assert command(monkeypatch, short, *outputs) == 130
    assert list(tmp_path.iterdir()) == []


def test_a_folder_stands_for_its_recordings_by_name(tmp_path: Path, short: Path) -> None:
    for name in ("b.csv", "a.csv", "notes.txt"):
        (tmp_path / name).write_bytes(short.read_bytes())
    save(load(short), tmp_path / "c.h5")
    assert expanded([str(tmp_path)]) == [str(tmp_path / name) for name in ("a.csv", "b.csv", "c.h5:Exp1")]


def test_recordings_of_one_name_in_two_folders_stay_apart(short: Path, tmp_path: Path) -> None:
    other = written(tmp_path / short.name, 4, 8.0)
    seen: list[list[str]] = []

    def stopped(case: Any) -> None:
        seen.append([one.name for one in (*case.train, *case.heldout)])
        raise InputError("here", "", "stop")

    with pytest.MonkeyPatch.context() as patch, pytest.raises(InputError):
        patch.setattr(diagnose, "diagnose", stopped)
        run([str(short), str(other)])
    assert seen == [[str(short), str(other), str(short), str(other)]]


def test_a_models_own_effects_are_part_of_what_is_judged(made: Path) -> None:
    cases: list[Any] = []

    def stopped(case: Any) -> None:
        cases.append(case)
        raise InputError("here", "", "stop")

    with pytest.MonkeyPatch.context() as patch, pytest.raises(InputError):
        patch.setattr(diagnose, "diagnose", stopped)
        run([str(made / "train")], [str(made / "held.csv")], model=made / "found.yaml")
    assert [effect.name for effect in cases[0].effects] == [NAME]
    assert cases[0].values[f"{NAME}.Fc"] == load_model(made / "found.yaml").effects[0].parameters["Fc"].value


@pytest.fixture(scope="module")
def of_two_kinds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bare hoop and a hoop with its ball, both with the same dry friction, under a physical structure."""
    folder, values = tmp_path_factory.mktemp("kinds"), load_model(MODELS / "hoop.yaml").values()
    friction = {f"{NAME}.Fc": FRICTION_NM}
    parts = {"hoop": slice(0, 1), "both": slice(0, 2)}
    for name, kind, seed in (("bare", "hoop", 1), ("run", "both", 2), ("held", "both", 3)):
        plant, part = hoop_plant("rolling", values, kind), parts[kind]
        noise = Noise(NOISE.force[part], NOISE.time_s[part], NOISE.reading[: len(plant.channels)])
        made = stretch_with(plant, name, seed, 6.0, [library(plant)[NAME]], friction, noise=noise)
        columns = {"psi": np.full(len(made.t), np.nan), **dict(zip(plant.channels, made.y.T, strict=True))}
        save(from_columns({"t": made.t, "u": np.append(made.u, made.u[-1]), **columns}), folder / f"{name}.csv")
    return folder


@pytest.mark.proof
def test_a_bare_hoop_and_hoop_with_ball_are_diagnosed_together(of_two_kinds: Path) -> None:
    train, held = [str(of_two_kinds / name) for name in ("bare.csv", "run.csv")], [str(of_two_kinds / "held.csv")]
    found = run(train, held, model=MODELS / "hoop.yaml", free_run=False, without=LEFT_OUT, grammar=False)
    low, high = found.effects[0].parameters["Fc"].ci95 or (0.0, 0.0)
    assert [one.name for one in found.effects] == [NAME]
    assert low - 0.3e-3 < FRICTION_NM < high + 0.3e-3
    assert {"theta_rate", "psi"} <= set(found.fit.train[train[1]])
    assert found.fit.train[train[0]].get("psi") is None
    assert any("solver's step" in note for note in found.data_quality.notes)


def test_what_is_not_to_be_looked_for_is_called_unknown(of_two_kinds: Path) -> None:
    train, held = [str(of_two_kinds / name) for name in ("bare.csv", "run.csv")], [str(of_two_kinds / "held.csv")]
    rubs = (*KEPT[:4], *LEFT_OUT)
    found = run(train, held, model=MODELS / "hoop.yaml", free_run=False, without=rubs, grammar=False)
    assert found.verdict == "unknown_physics"
    assert found.effects[0].name == "unknown.hoop"
    assert (found.location.slot, found.location.depends_on) == ("hoop", ["dtheta"])
    assert found.unexplained is not None and found.unexplained.probability == found.effects[0].probability
    assert found.effects[0].probability is not None and found.effects[0].probability > 0.5


@pytest.mark.proof
def test_what_the_library_lacks_has_a_formula_at_its_place(of_two_kinds: Path) -> None:
    train, held = [str(of_two_kinds / name) for name in ("bare.csv", "run.csv")], [str(of_two_kinds / "held.csv")]
    found = run(train, held, model=MODELS / "hoop.yaml", free_run=False, without=(*KEPT[:4], *LEFT_OUT))
    first = found.effects[0]
    assert (first.slot, found.location.slot) == ("hoop", "hoop")
    assert "dtheta" in first.name and first.formula


def test_an_effect_that_is_not_in_the_library_cannot_be_left_out(
    short: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, short, "--without", f"{NAME},hoop.nonsense") == 2
    assert "--without: hoop.nonsense: is none of" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["a name too long", "links in a circle"])
def test_a_path_that_cannot_be_looked_at_is_one_line(kind: str, tmp_path: Path) -> None:
    circle = tmp_path / "circle.csv"
    circle.symlink_to(circle)
    with pytest.raises(InputError):
        check_distinct(expanded(["a" * 5000 if kind == "a name too long" else str(circle)]), [])
