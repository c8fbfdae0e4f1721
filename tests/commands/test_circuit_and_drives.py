"""Every command takes the registered circuit and the coupled drives: made data, through the files that users have."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoopd.files.identified import load_identified
from hoopd.plants.effects.library import library
from hoopd.plants.free_run import FreeRun
from hoopd.plants.registry import plant_named
from hoopd.plants.scales import motion_scale
from tests.commands.test_plant import hoopd

# What the plant is in truth, and the effect that its recording may have.
TRUE = {"circuit": {"R": 23.0, "L": 0.09}, "drives": {"J": 2.3e-3, "k": 450.0}}
HIDDEN = {"circuit": ("i_store.inductor_saturation", {"b": 60.0}), "drives": ("a_body.coulomb_friction", {"Fc": 0.01})}
PLANTS = pytest.mark.parametrize("name", [*TRUE])


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def recorded(name: str, path: str, seed: int = 1, *, hidden: bool = False) -> None:
    """Random levels of every input, and readings with noise of a thousandth of their range."""
    plant, random, count = plant_named(name), np.random.default_rng(seed), 600
    t = np.arange(count) * plant.time_scale_s
    sizes = [2.0 * plant.scales[one.name] for one in plant.inputs]
    u = np.repeat(random.uniform(-1.0, 1.0, (count // 20, len(sizes))), 20, axis=0) * sizes
    effect, values = HIDDEN[name]
    keys = {**TRUE[name], **({f"{effect}.{key}": value for key, value in values.items()} if hidden else {})}
    run = FreeRun(plant, (library(plant)[effect],) if hidden else (), values=keys)
    y = run.run([], [0.0] * len(plant.states), t, u[:-1, 0] if len(sizes) == 1 else u[:-1]).readings
    table = np.column_stack([t, u, y + 1e-3 * np.ptp(y, axis=0) * random.normal(size=y.shape)])
    names = ("t", *(one.name for one in plant.inputs), *plant.channels)
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")


def result(*words: str) -> dict[str, Any]:
    code, _, error = hoopd(*words, "--json", "result.json")
    assert code == 0, error
    found: dict[str, Any] = json.loads(Path("result.json").read_text())
    return found


@PLANTS
def test_it_is_fitted_and_simulated(name: str) -> None:
    recorded(name, "run.csv")
    found = result("fit", "--plant", name, "run.csv", "--out", "mine.yaml")
    for key, true in TRUE[name].items():
        assert found["parameters"][key]["value"] == pytest.approx(true, rel=0.01)
    run = result("simulate", "--plant", "mine.yaml", "--input", "run.csv")
    assert min(one["nrmse_percent"] for one in run["free_run"].values()) > 99.0


def test_what_is_hidden_in_the_circuit_is_named_and_the_simulation_gains() -> None:
    judge_hidden("circuit")


def test_nothing_is_named_in_a_circuit_that_hides_nothing() -> None:
    judge_nothing("circuit")


@pytest.mark.proof
def test_the_drives_friction_is_named_and_nothing_where_there_is_none() -> None:
    judge_hidden("drives")
    judge_nothing("drives")


def judge_hidden(name: str) -> None:
    for path, seed in (("train.csv", 1), ("held.csv", 2)):
        recorded(name, path, seed, hidden=True)
    found = result("diagnose", "--plant", name, "train.csv", "--holdout", "held.csv", "--write", "found.yaml")
    effect, values = HIDDEN[name]
    assert (found["verdict"], [one["name"] for one in found["effects"]]) == ("missing_physics", [effect])
    for key, true in values.items():
        assert found["effects"][0]["parameters"][key]["value"] == pytest.approx(true, rel=0.1)
    assert found["fit"]["window_s"] == pytest.approx(2.0 * motion_scale(plant_named(name)))
    for channel in found["fit"]["heldout"]["held.csv"].values():
        assert channel["with_effects"] > channel["base_refit"]
    run = result("simulate", "--model", "found.yaml", "--input", "held.csv")
    assert min(one["nrmse_percent"] for one in run["free_run"].values()) > 97.0


def judge_nothing(name: str) -> None:
    recorded(name, "run.csv")
    found = result("diagnose", "--plant", name, "run.csv", "--no-free-run")
    assert (found["verdict"], found["effects"]) == ("parameters", [])


@PLANTS
def test_it_is_linear_about_rest_and_has_a_law(name: str) -> None:
    # 1/sqrt(L C) of the circuit; k r^2 turns the two drives of half an inertia against each other
    resonance = {"circuit": 1.0 / np.sqrt(0.1 * 1e-5), "drives": np.sqrt(2.0 * 500.0 * 0.035**2 / 2e-3)}
    poles = result("linearize", "--plant", name)["poles"]
    sizes = [float(np.hypot(one["re"], one["im"])) for one in poles]
    assert min(abs(one / resonance[name] - 1.0) for one in sizes) < 1e-3
    law = result("design", "lqg", "--plant", name)
    assert all(abs(complex(one["re"], one["im"])) < 1.0 for one in law["closed_loop_poles"])


@PLANTS
def test_a_signal_is_played_converted_and_identified(name: str) -> None:
    words = ("--amplitude", "0.1", "--clock", "10", "--duration", "1", "--out", "play.csv")
    assert result("experiment", "prbs", "--plant", name, *words)["rows"] > 99
    recorded(name, "run.csv")
    assert hoopd("convert", "--plant", name, "run.csv", "run.mat")[0] == 0
    found = result("identify", "--plant", name, "run.mat", "--orders", "2,2")
    assert found["outputs"] == [*plant_named(name).channels]


def test_the_response_to_one_of_two_drives_is_identified() -> None:
    """The second one stands still in what an experiment plays: it is left out, or the command says so."""
    assert hoopd("experiment", "prbs", "--plant", "drives", "--out", "play.csv")[0] == 0
    words = ("identify", "--plant", "drives", "play.csv", "--orders", "4,4")
    code, _, error = hoopd(*words)
    assert code == 2 and "input M2 is constant: it tells nothing, leave it out" in error
    assert hoopd(*words, "--inputs", "M1", "--out", "model.yaml")[0] == 0
    assert load_identified(Path("model.yaml")).inputs == ["M1"]
    for inputs, known in (("M3", "M1, M2"), ("M1,M1", "M1, M2")):
        code, _, error = hoopd(*words, "--inputs", inputs)
        assert code == 2 and f"--inputs: different ones of {known}" in error
