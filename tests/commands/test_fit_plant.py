"""`hoopd fit --plant` and `hoopd simulate --plant`: any declared plant, from a CSV to a plant file and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import shared_path

from hoopd.plants.free_run import FreeRun
from hoopd.plants.plant_file import load_plant
from hoopd.plants.registry import FOLDER, plant_named
from tests.commands.test_plant import hoopd

TRUE = {"M": 80.0, "Fv": 300.0, "offset": 5.0}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A CSV of an axis: force in N, way in mm with noise."""
    monkeypatch.chdir(tmp_path)
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 2.0, 0.001)
        force = np.repeat(rng.choice((-60.0, 60.0), 20), 100)
        way = FreeRun(plant_named("axis"), values=TRUE).run([], [0.0, 0.0], t, force[:-1]).readings[:, 0]
        table = np.column_stack([t, force, 1e3 * way + 2e-3 * rng.normal(size=len(t))])
        np.savetxt(tmp_path / name, table, delimiter=",", header="t,Force,Position", comments="")
    return tmp_path


READ = ("--columns", "F=Force,x=Position:mm")


def test_a_fit_writes_a_plant_that_simulates(folder: Path) -> None:
    words = ("--holdout", "b.csv", *READ, "--out", "mine.yaml", "--figure", "fit.png", "--json", "fit.json")
    code, shown, error = hoopd("fit", "--plant", "axis", "a.csv", *words)
    assert code == 0, error
    result = json.loads((folder / "fit.json").read_text())
    for name, true in TRUE.items():
        low, high = result["parameters"][name]["ci95"]
        assert low - (high - low) < true < high + (high - low)
    assert result["fit"]["holdout"]["b.csv"]["x"]["fitted"] > 99.0 > result["fit"]["holdout"]["b.csv"]["x"]["nominal"]
    assert "Fv" in shown and (folder / "fit.png").stat().st_size > 10_000
    assert load_plant(folder / "mine.yaml").values["M"] == pytest.approx(result["parameters"]["M"]["value"])

    words = ("--input", "b.csv", *READ, "--out", "sim.csv", "--figure", "sim.png", "--json", "sim.json")
    code, _, error = hoopd("simulate", "--plant", "mine.yaml", *words)
    assert code == 0, error
    run = json.loads((folder / "sim.json").read_text())
    assert run["start_from"] == "estimated" and run["free_run"]["x"]["nrmse_percent"] > 99.0
    measured, simulated = (np.genfromtxt(name, delimiter=",", skip_header=1) for name in ("b.csv", "sim.csv"))
    assert np.abs(1e3 * simulated[:, 2] - measured[:, 2]).max() < 0.05


@pytest.mark.parametrize(
    ("spoiled", "says"),
    [
        (lambda table: np.delete(table, slice(900, 960), axis=0), "rows are missing at 1 place"),
        (lambda table: table * [1.0, 100.0, 1.0], "F reaches 6e+03 N, its limit is 1000: another unit?"),
        (lambda table: np.where(np.arange(6000).reshape(-1, 3) == 3002, 999.9, table), "x has 1 sample far from both"),
    ],
)
def test_what_is_worth_a_doubt_is_said_beside_a_fit_and_a_conversion(folder: Path, spoiled: Any, says: str) -> None:
    table = spoiled(np.genfromtxt("a.csv", delimiter=",", skip_header=1))
    np.savetxt(folder / "c.csv", table, delimiter=",", header="t,Force,Position", comments="")
    code, _, error = hoopd("fit", "--plant", "axis", "c.csv", *READ, "--json", "fit.json")
    assert code == 0, error
    assert any(note.startswith(f"c.csv: {says}") for note in json.loads((folder / "fit.json").read_text())["notes"])
    code, _, error = hoopd("convert", "c.csv", "c.mcap", "--plant", "axis", *READ, "--json", "said.json")
    assert code == 0 and any(says in note for note in json.loads((folder / "said.json").read_text())["notes"]), error


def test_a_good_recording_of_a_plant_has_no_doubts(folder: Path) -> None:
    assert hoopd("convert", "a.csv", "c.mcap", "--plant", "axis", *READ, "--json", "said.json")[0] == 0
    assert json.loads((folder / "said.json").read_text())["notes"] == []


def test_a_sensor_that_never_moves_is_nothing_to_judge_a_model_by(folder: Path) -> None:
    table = np.genfromtxt("a.csv", delimiter=",", skip_header=1)
    np.savetxt(folder / "c.csv", table * [1, 1, 0], delimiter=",", header="t,Force,Position", comments="")
    code, _, error = hoopd("diagnose", "--plant", "axis", "c.csv", *READ)
    assert code == 2 and "c.csv: x: never changes: nothing to judge a model by" in error


def test_values_are_fixed_believed_and_chosen(folder: Path) -> None:
    words = ("--fix", "offset=5", "--free", "M,Fv", "--prior", "Fv=300:0.01", "--window", "0.5", "--json", "fit.json")
    code, _, error = hoopd("fit", "--plant", "axis", "a.csv", *READ, *words)
    assert code == 0, error
    result = json.loads((folder / "fit.json").read_text())
    assert result["starts"] == 4
    assert result["parameters"]["offset"] == {"value": 5.0, "unit": "N", "ci95": None, "nominal": 0.0}
    assert result["parameters"]["M"]["value"] == pytest.approx(80.0, rel=0.05)


def test_a_given_start_is_simulated(folder: Path) -> None:
    code, _, error = hoopd(
        "simulate", "--plant", "axis", "--input", "a.csv", *READ, "--x0", "x=0.1", "--json", "sim.json"
    )
    assert code == 0, error
    run = json.loads((folder / "sim.json").read_text())
    assert run["start"] == {"x": 0.1, "dx": 0.0} and run["start_from"] == "given"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fit", "--plant", "axis", "a.csv", *READ, "--structure", "rolling"), "--structure: belongs to the hoop"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--kinematics"), "--kinematics: belongs to the hoop"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--free", "mass"), "not a parameter of axis; known: M, Fv, offset"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--fix", "mass=3"), "known: M, Fv, offset"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--fix", "M=-1"), "--fix: M: -1 is outside of 1 to 1000"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--prior", "M=1e6:0.1"), "--prior: M: 1e+06 is outside of 1"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--fix", "M=90,M=80"), "--fix: M: stands twice"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--free", "M", "--prior", "Fv=300:0.1"), "Fv: is not fitted; M is"),
        *(
            (
                ("fit", "--plant", "axis", "a.csv", *READ, "--method", "prediction", *more),
                f"{more[0]}: of another plant",
            )
            for more in (("--prior", "M=90:0.1"), ("--loss", "huber"), ("--window", "0.5"))
        ),
        (("fit", "--plant", "axis", "a.csv", *READ, "--method", "guess"), "known: output, prediction"),
        (("fit", "--plant", "axis", "a.csv", *READ, "--loss", "guess"), "known: linear, huber, soft_l1, cauchy"),
        (("fit", "--plant", "axis", "a.csv", "a.csv", *READ), "rows in common with a.csv"),
        (("fit", "--plant", "axles", "a.csv"), "did you mean axis"),
        (("simulate", "--plant", "axis", "--model", "m.yaml", "--input", "a.csv", *READ), "m.yaml"),
        (("simulate", "--plant", "axis", "--input", "a.csv", *READ, "--x0", "y=1"), "known: x, dx"),
        (("simulate", "--input", "a.csv"), "--plant"),
        *(
            ((*command, "--model", "plant.yaml"), "plant.yaml: schema: hoopd.plant/1 is a plant, no model of one")
            for command in (
                ("simulate", "--input", "a.csv"),
                ("fit", "a.csv"),
                ("fit", "a.csv", "--plant", "axis"),
                ("linearize",),
            )
        ),
    ],
)
def test_what_cannot_be_used_is_one_line(words: tuple[str, ...], said: str) -> None:
    Path("plant.yaml").write_text((FOLDER / "axis.yaml").read_text())
    code, _, error = hoopd(*words)
    assert code == 2
    assert said in " ".join(error.split())


@pytest.mark.parametrize(
    ("name", "file", "least"), [("axis", "axis_1kHz", 94.0), ("pendulum", "pendulum_decay_7", 96.0),
                                ("falling", "drop_bowling_ball_1", 97.0)],
)  # fmt: skip
def test_a_real_recording_takes_a_short_plant_and_one_command_each(name: str, file: str, least: float) -> None:
    """A plant file of at most 25 lines; a fit, and a free run of what was fitted."""
    recording, plant = str(shared_path(f"plants/{file}.csv")), FOLDER / f"{name}.yaml"
    assert len(plant.read_text().splitlines()) <= 25
    free = ("--free", "g") if name == "falling" else ()
    assert hoopd("fit", "--plant", str(plant), recording, *free, "--out", "mine.yaml")[0] == 0
    assert hoopd("simulate", "--plant", "mine.yaml", "--input", recording, "--json", "run.json")[0] == 0
    (channel,) = json.loads(Path("run.json").read_text())["free_run"].values()
    assert channel["nrmse_percent"] > least
