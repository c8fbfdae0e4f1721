"""A mechanism without a name in the library: found by the command, written down, and simulated again by its name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.commands.test_plant import hoopd
from tests.docs.test_your_plant import the_file

READ = ("--columns", "F=drive:N,x=position:mm")
NAME = "body.above_of_x"
STEP_S, PARTS = 0.02, 20


def carriage(seed: int, seconds: float = 20.0) -> np.ndarray:
    """Rows of t (s), position (mm), drive (N): 2.1 kg on 3.3 N s/m, a disturbance of 70 mN, and from 0.3 m on a bumper
    of 9 N/m."""
    random, n = np.random.default_rng(seed), round(seconds / STEP_S)
    levels = np.repeat(random.choice([-5.0, -2.0, 2.0, 5.0], n // 15 + 1), 15)[: n + 1]
    rows, x, v, push = [], 0.0, 0.0, 0.0
    for k in range(n + 1):
        push = 0.9 * push + 0.03 * random.normal()
        force = float(np.clip(levels[k] - 4.0 * x, -9.0, 9.0))
        rows.append((k * STEP_S, 1e3 * (x + 1e-4 * random.normal()), force))
        for _ in range(PARTS):
            a = (force + push - 3.3 * v - 9.0 * max(x - 0.3, 0.0)) / 2.1
            x += STEP_S / PARTS * (v + STEP_S / PARTS * a / 2.0)
            v += STEP_S / PARTS * a
    return np.array(rows)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("bumper")
    (made / "slide.yaml").write_text(the_file("slide.yaml"))
    for name, seed in (("a.csv", 3), ("b.csv", 4)):
        np.savetxt(made / name, carriage(seed), delimiter=",", header="t,position,drive", comments="")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        words = ("--plant", "slide.yaml", *READ, "--no-free-run", "--write", "found.yaml", "--json", "found.json")
        code, _, error = hoopd("diagnose", "a.csv", *words)
        assert code == 0, error
    return made


def test_it_is_named_with_its_formula(folder: Path) -> None:
    found = json.loads((folder / "found.json").read_text())
    (effect,) = found["effects"]
    assert (found["verdict"], effect["name"]) == ("missing_physics", NAME)
    assert "max(x - v0, 0)" in str(effect.get("formula", "max(x - v0, 0)"))
    sizes = effect["parameters"]
    assert sizes["A"]["value"] == pytest.approx(-9.0, rel=0.1) and sizes["A"]["unit"] == "N/m"
    assert sizes["v0"]["value"] == pytest.approx(0.3, abs=0.02) and sizes["v0"]["unit"] == "m"


def test_every_command_reads_the_model_that_has_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    percent = []
    for more in ((), ("--without-effects",)):
        words = ("--model", "found.yaml", "--input", "b.csv", *READ, *more, "--json", "run.json")
        code, _, error = hoopd("simulate", *words)
        assert code == 0, error
        percent.append(json.loads((folder / "run.json").read_text())["free_run"]["x"]["nrmse_percent"])
    assert percent[0] > percent[1] + 10.0
    code, shown, error = hoopd("fit", "b.csv", "--model", "found.yaml", *READ, "--fix", "m,b", "--free", f"{NAME}.A")
    assert code == 0, error
    assert NAME in shown
    code, _, error = hoopd("linearize", "--model", "found.yaml")
    assert code == 0, error
    # a law of this model is part of what a further diagnosis judges: nothing is missing any more
    code, shown, error = hoopd("diagnose", "b.csv", "--model", "found.yaml", *READ, "--no-free-run", "--json", "b.json")
    assert code == 0, error
    assert json.loads((folder / "b.json").read_text())["effects"] == []


@pytest.mark.proof
def test_only_the_library_may_be_asked(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    words = ("diagnose", "a.csv", "--plant", "slide.yaml", *READ, "--no-free-run", "--json", "other.json")
    code, _, error = hoopd(*words, "--library-only")
    assert code == 0, error
    names = [one["name"] for one in json.loads((folder / "other.json").read_text())["effects"]]
    assert not [one for one in names if "_of_" in one]
    code, _, error = hoopd(*words, "--without", "body.nothing_of_x")
    assert code == 2 and "body.nothing_of_x" in error


def test_a_name_that_is_none_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    text = (folder / "found.yaml").read_text().replace(NAME, "body.abve_of_x")
    (folder / "wrong.yaml").write_text(text)
    code, _, error = hoopd("simulate", "--model", "wrong.yaml", "--input", "b.csv", *READ)
    assert code == 2
    assert len(error.strip().splitlines()) == 1
    assert "body.abve_of_x" in error
