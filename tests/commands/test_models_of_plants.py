"""A model of another laboratory's plant, as `hoopd diagnose --write` writes it, is read by every command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoopd.plants.free_run import FreeRun
from hoopd.plants.plant_model import load_plant_model
from hoopd.plants.registry import plant_named
from tests.commands.test_plant import hoopd
from tests.docs.made_slide import DRY_N, made as carriage
from tests.docs.test_your_plant import the_file

# The slide of the guide: a carriage with dry friction that its plant file does not know of.
FRICTION = "body.coulomb_friction"
READ = ("--columns", "F=drive:N,x=position:mm")
QUICK = ("--no-free-run", "--library-only")  # what a search finds is told elsewhere; here, who reads it
PYTHON = """
import casadi as ca
from hoopd.plants.declaration import Channel, Input, Plant, Slot

PLANT = Plant(
    name="program", coordinates=("x",), accelerations=lambda s, force: (force - s.p["b"] * s.dx) / s.p["m"],
    values={"m": 2.0, "b": 3.0}, free=("m", "b"), units={"m": "kg", "b": "N s/m", "x": "m"},
    bounds={"m": (0.1, 20.0), "b": (0.0, 50.0)}, inputs=(Input("F", "N", 20.0, "x"),),
    channels={"x": Channel("x", "m", "ruler")},
    slots={"body": Slot("body", "x", speed=0.5), "ruler": Slot("sensor", "x", ("x",))},
)
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("slide")
    (folder / "sub").mkdir()
    (folder / "program.py").write_text(PYTHON)
    (folder / "slide.yaml").write_text(the_file("slide.yaml"))
    for name, seed in (("a.csv", 0), ("b.csv", 1)):
        np.savetxt(folder / name, carriage(seed), delimiter=",", header="t,position,drive", comments="")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        words = ("--plant", "slide.yaml", *READ, *QUICK, "--write")
        code, shown, error = hoopd("diagnose", "a.csv", *words, "found.yaml")
        assert code == 0, error
        assert FRICTION in shown
    text = (folder / "found.yaml").read_text()
    (folder / "sub" / "found.yaml").write_text(text.replace("plant: slide.yaml", "plant: ../slide.yaml"))
    return folder


@pytest.fixture(autouse=True)
def folder(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(made)
    return made


def result(folder: Path, *words: str) -> dict[str, Any]:
    code, _, error = hoopd(*words, "--json", str(folder / "result.json"))
    assert code == 0, error
    found: dict[str, Any] = json.loads((folder / "result.json").read_text())
    return found


def test_what_was_found_is_simulated_and_may_be_left_out(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ("simulate", "--input", "b.csv", *READ)
    found = result(folder, *asked, "--model", "found.yaml", "--figure", "run.png", "--out", "run.csv")
    assert (found["model"], found["plant"], found["effects"]) == ("found", "slide", [FRICTION])
    without = result(folder, *asked, "--model", "found.yaml", "--without-effects")
    assert without["effects"] == [] and without["notes"] == [f"{FRICTION}: left out of the model"]
    percent = [one["free_run"]["x"]["nrmse_percent"] for one in (found, without)]
    assert percent[0] > 99.0 > 80.0 > percent[1]
    assert (folder / "run.png").stat().st_size > 10_000
    # the plant's file is found from the model's folder, wherever the command is run
    monkeypatch.chdir(folder / "sub")
    words = ("--input", "../b.csv", *READ, "--model", "found.yaml")
    assert result(folder, "simulate", *words)["free_run"] == found["free_run"]


def test_a_fit_begins_with_what_was_found_and_writes_a_model(folder: Path) -> None:
    words = ("--model", "found.yaml", *READ, "--fix", "b=3.4", "--free", f"m,{FRICTION}.Fc")
    found = result(folder, "fit", "b.csv", *words, "--out", "sub/again.yaml")
    friction = found["parameters"][f"{FRICTION}.Fc"]
    assert friction["unit"] == "N" and friction["value"] == pytest.approx(DRY_N, rel=1e-3)
    assert found["effects"] == [FRICTION] and found["fit"]["train"]["b.csv"]["x"]["fitted"] > 99.5
    again = load_plant_model(folder / "sub" / "again.yaml")
    assert again.values[f"{FRICTION}.Fc"] == friction["value"] and again.values["b"] == 3.4
    entry = again.file.parameters["m"]
    assert entry.ci95 is not None and entry.nominal == load_plant_model(folder / "found.yaml").values["m"]
    # without a word on effects they stay as they are
    held = result(folder, "fit", "b.csv", "--model", "found.yaml", *READ)
    assert set(held["parameters"]) == {"m", "b"}


def test_linearize_design_and_diagnose_take_it(folder: Path) -> None:
    linear = result(folder, "linearize", "--model", "found.yaml")
    values = load_plant_model(folder / "found.yaml").values
    assert min(one["re"] for one in linear["poles"]) == pytest.approx(-values["b"] / values["m"])
    assert result(folder, "design", "lqg", "--model", "found.yaml")["plant"] == "slide"
    again = result(folder, "diagnose", "a.csv@0:9", "--model", "found.yaml", *READ, *QUICK)
    assert again["verdict"] == "consistent"


def test_a_plant_in_python_keeps_its_numbers_in_a_model_beside_it(folder: Path) -> None:
    words = ("--plant", "program.py", *READ)
    found = result(folder, "fit", "a.csv", *words, "--out", "sub/mine.yaml")
    assert "plant: ../program.py" in (folder / "sub" / "mine.yaml").read_text()
    run = result(folder, "simulate", "--model", "sub/mine.yaml", "--input", "a.csv", *words)
    assert run["free_run"]["x"]["nrmse_percent"] == pytest.approx(found["fit"]["train"]["a.csv"]["x"]["fitted"])
    code, _, error = hoopd("simulate", "--model", "sub/mine.yaml", "--input", "a.csv", *READ)
    assert (code, error.count("\n")) == (2, 1) and "is a program: name it with --plant" in error
    code, _, error = hoopd("diagnose", "a.csv@0:9", *words, *QUICK, "--write", "sub/seen.yaml")
    assert code == 0, error
    assert "plant: ../program.py" in (folder / "sub" / "seen.yaml").read_text()
    assert result(folder, "linearize", "--plant", "program.py", "--model", "sub/seen.yaml")["plant"] == "program"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("simulate", "--model", "found.yaml", "--plant", "tanks", "--input", "a.csv"),
            "parameters.m: tanks has no such parameter",
        ),
        (
            ("simulate", "--model", "found.yaml", "--plant", "hoop", "--input", "a.csv"),
            "plant: a model of slide.yaml, not of hoop",
        ),
        (("simulate", "--model", "none.yaml", "--plant", "axis", "--input", "a.csv"), "none.yaml"),
        (("fit", "a.csv", "--model", "found.yaml", *READ, "--free", "Fc"), f"known: m, b, {FRICTION}.Fc"),
        (("fit", "a.csv", "--plant", "slide.yaml", *READ, "--channels", "y"), "--channels: unknown 'y'; known: x"),
    ],
)
def test_what_cannot_be_used_is_one_line(words: tuple[str, ...], said: str) -> None:
    code, _, error = hoopd(*words)
    assert (code, error.count("\n")) == (2, 1)
    assert said in error


def test_only_the_channels_that_are_asked_for_are_compared(tmp_path: Path) -> None:
    t = np.arange(0.0, 600.0, 1.0)
    q = 5e-5 + 2e-5 * np.sign(np.sin(t / 40.0))
    levels = FreeRun(plant_named("tanks"), values={"a1": 2.7e-5}).run([], [0.2, 0.2], t, q[:-1]).readings
    levels[:, 1] += 0.05 * np.sin(t / 9.0)  # the lower tank's sensor is broken
    table = np.column_stack([t, q, levels + 1e-4 * np.random.default_rng(1).normal(size=levels.shape)])
    np.savetxt(tmp_path / "tanks.csv", table, delimiter=",", header="t,q,h1,h2", comments="")
    words = ("fit", str(tmp_path / "tanks.csv"), "--plant", "tanks", "--fix", "a2", "--channels", "h1")
    for method in ("output", "prediction"):
        found = result(tmp_path, *words, "--method", method)
        assert found["parameters"]["a1"]["value"] == pytest.approx(2.7e-5, rel=2e-3)
        scores = found["fit"]["train"][str(tmp_path / "tanks.csv")]
        assert scores["h1"]["fitted"] > 95.0 > scores["h2"]["fitted"]
