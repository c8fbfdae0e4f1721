"""The lesson runs as a plain script, without a screen, and draws every figure that its questions name (`make proof`).

`make test` holds its form, and that every call of it is one that `hoopd.lab` takes; `test_lab.py` holds what they do.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import subprocess
import sys
import types

import pytest
from shared import ROOT

import hoopd.lab as lab

pytestmark = pytest.mark.timeout(300)  # half a minute on a machine of its own
LESSON = ROOT / "docs" / "lesson.py"


@pytest.fixture(scope="module")
def lesson(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lesson")
    made = subprocess.run(
        [sys.executable, str(LESSON), str(folder / "figures")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    return folder, made.stdout


@pytest.mark.proof
def test_every_figure_of_a_question_is_there(lesson):
    folder, _ = lesson
    named = set(re.findall(r"\b[1-8]_[a-z_]+", LESSON.read_text()))
    drawn = {one.stem for one in (folder / "figures").glob("*.png")}
    assert named == drawn
    assert {name[0] for name in drawn} == set("12345678")


@pytest.mark.proof
def test_nothing_is_written_elsewhere(lesson):
    folder, _ = lesson
    assert [one.name for one in folder.iterdir()] == ["figures"]


def lab_calls():
    """Every call of a function of the lab."""
    for node in ast.walk(ast.parse(LESSON.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and re.fullmatch(r"lab\.\w+", ast.unparse(node.func)):
            yield node


def test_every_call_is_one_that_the_lab_takes():
    names = set()
    for node in lab_calls():
        keywords = {one.arg: one.value for one in node.keywords if one.arg is not None}
        inspect.signature(getattr(lab, node.func.attr)).bind(*node.args, **keywords)
        names.add(node.func.attr)
    assert {"model", "simulate", "experiment", "fit", "linearize", "design", "feedback"} <= names


def test_every_step_ends_with_a_question():
    steps = LESSON.read_text().split("\n# ## ")[1:]
    assert len(steps) == 8
    for step in steps:
        cells = [cell for cell in step.split("# %%") if cell.strip(" []markdown\n")]
        assert "**Question.**" in cells[-1]
        assert "Figure" in cells[-1]


@pytest.mark.proof
def test_the_numbers_say_what_the_text_says(lesson):
    _, said = lesson
    psi = re.search(r"psi: thesis +([\d.]+), fitted +([\d.]+)", said)
    assert float(psi[1]) < 60.0 < 99.0 < float(psi[2])
    assert "not determined one by one" in said
    assert "lost: theta; weak: dtheta" in said
    away, stays = (abs(float(re.search(rf"{law}: the hoop ends at (\S+) rad/s", said)[1])) for law in ("PID", "LQG"))
    assert away == pytest.approx(7.4, abs=0.3)
    assert stays < 0.6


@pytest.mark.proof
def test_the_files_are_those_that_the_daemon_takes(lesson):
    folder, _ = lesson
    law = lab.controller(folder / "figures" / "lqg.yaml")
    assert law.model.parameters == lab.model(folder / "figures" / "model.yaml").parameters


def test_a_notebook_shows_every_figure_not_only_the_last_of_a_cell(tmp_path, monkeypatch):
    shown, saved = [], []
    display = types.ModuleType("IPython.display")
    display.display = shown.append
    for name in ("ipykernel", "IPython"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.chdir(tmp_path)
    first = LESSON.read_text(encoding="utf-8").split("# %%")[2]
    space = {}
    exec(compile(first, "lesson", "exec"), space)

    class Picture:
        def save(self, path):
            saved.append(path.name)

    pictures = [Picture(), Picture()]
    for place, picture in enumerate(pictures):
        assert space["show"](str(place), picture) is None  # or the cell would show its last one twice
    assert shown == pictures and saved == ["0.png", "1.png"]
