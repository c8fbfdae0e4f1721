"""`hoopd plant`: templates that work, checks with their exit codes, what is shown and drawn, refusals in one line."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path

import pytest
from samples import sampled

from hoopd.commands import cli
from hoopd.files.plant_template import KINDS
from hoopd.plants.registry import FOLDER, REGISTERED


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def hoopd(*words: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error."""
    out, error = io.StringIO(), io.StringIO()
    argv, sys.argv = sys.argv, ["hoopd", *words]
    try:
        with contextlib.redirect_stderr(error), contextlib.redirect_stdout(out):
            cli.main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv = argv
    return code, out.getvalue(), error.getvalue()


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_template_is_a_sound_plant(kind: str, folder: Path) -> None:
    assert hoopd("plant", "new", "mine", "--kind", kind)[0] == 0
    assert hoopd("plant", "check", "mine.yaml", "--json", "check.json")[0] == 0
    result = json.loads((folder / "check.json").read_text())
    assert result["good"] is True and result["notes"] == []
    assert {one["answer"] for one in result["checks"].values()} <= {"yes", "does not apply"}


def test_a_file_that_is_there_is_never_overwritten(folder: Path) -> None:
    (folder / "mine.yaml").write_text("mine")
    code, _, error = hoopd("plant", "new", "mine")
    assert code == 2 and "is there already" in error
    assert (folder / "mine.yaml").read_text() == "mine"


def test_a_check_that_says_no_ends_with_1(folder: Path) -> None:
    text = (FOLDER / "pendulum.yaml").read_text()
    (folder / "wrong.yaml").write_text(text.replace("- c*alpha'", "+ c*alpha'"))
    code, shown, _ = hoopd("plant", "check", "wrong.yaml")
    assert code == 1 and "wrong sign" in shown


@pytest.mark.parametrize("name", sampled(list(REGISTERED), ["hoop", "drives"]))
def test_a_registered_plant_is_shown_and_drawn(name: str, folder: Path) -> None:
    assert hoopd("plant", "show", name, "--json", "show.json", "--figure", "run.png")[0] == 0
    result = json.loads((folder / "show.json").read_text())
    assert result["states"] and result["channels"] and all(one["unit"] for one in result["states"].values())
    assert (folder / "run.png").stat().st_size > 1000
    assert hoopd("plant", "check", name)[0] == 0


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("eat", "axis"), "known: new, check, show"),
        (("new", "a", "--kind", "soft"), "known: mechanical, first-order"),
        (("new", "a-b"), "a plant's name"),
        (("new", "a.py"), "is a .yaml"),
        (("new", "none/a.yaml"), "no such folder"),
        (("check", "axes"), "did you mean axis"),
        (("check", "none.yaml"), "no such file"),
        (("show", "axis", "--figure", "a.txt"), "a.txt"),
        (("check", "bad.yaml"), "bad.yaml: equations.x: column 5: unknown function '__import__'"),
        (("check", "bad.py"), "bad.py: line 2: ZeroDivisionError"),
        (("check", "bad.yaml", "--json", "bad.yaml"), "is an input"),
    ],
)
def test_what_cannot_be_used_is_one_line(words: tuple[str, ...], reason: str, folder: Path) -> None:
    bad = "schema: hoopd.plant/1\nname: bad\ncoordinates: {x: m}\nequations: {x: x = __import__(1)}\n"
    (folder / "bad.yaml").write_text(bad)
    (folder / "bad.py").write_text("\n1/0\n")
    code, _, error = hoopd("plant", *words)
    assert (code, error.count("\n")) == (2, 1)
    assert reason in error
    assert sorted(one.name for one in folder.iterdir()) == ["bad.py", "bad.yaml"]
