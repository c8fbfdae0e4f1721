"""Plants with several inputs: coupled drives and two tanks with two pumps, by the same commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoopd.plants.effects.library import library
from hoopd.plants.free_run import FreeRun
from hoopd.plants.likelihood.stretches import Held, stretch_of
from hoopd.plants.plant_file import load_plant
from tests.commands.test_plant import hoopd
from tests.commands.test_plant_design import PUMPS

# Two wheels on one spring, each with a drive of its own.
DRIVES = """
schema: hoopd.plant/1
name: drives
coordinates: {a: {unit: rad, usual: 1, usual_rate: 5}, b: {unit: rad, usual: 1, usual_rate: 5}}
inputs: {Ta: {unit: N m, limit: 1}, Tb: {unit: N m, limit: 1}}
parameters:
  J: {value: 0.01, unit: kg m2, bounds: [0.001, 0.1]}
  k: {value: 0.5, unit: N m/rad, bounds: [0.01, 10]}
  c: {value: 0.02, unit: N m s/rad, bounds: [0, 1]}
equations:
  a: J*a'' = Ta - c*a' - k*(a-b)
  b: J*b'' = Tb - c*b' - k*(b-a)
sample_time_s: 0.01
"""
FRICTION, DELAY = "b_body.coulomb_friction", "actuator.delay"


def written(path: Path, plant: Path, values: dict[str, float], sizes: tuple[float, float, float], seed: int) -> None:
    """Random levels of both inputs; sizes: mean and swing of the inputs, noise."""
    declared, (mean, swing, noise) = load_plant(plant), sizes
    rng, t = np.random.default_rng(seed), np.arange(1000) * declared.time_scale_s
    u = np.stack([mean + np.repeat(rng.choice([-swing, swing], 1000 // n + 1), n)[:1000] for n in (17, 23)], axis=1)
    effects = [effect for effect in library(declared).values() if any(key.startswith(effect.name) for key in values)]
    start = [0.2 * bool(mean)] * len(declared.states)
    y = FreeRun(declared, effects, values=values).run([], start, t, u[:-1]).readings
    table = np.column_stack([t, u, y + noise * rng.normal(size=y.shape)])
    names = ("t", *(one.name for one in declared.inputs), *declared.channels)
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pumps.yaml").write_text(PUMPS)
    (tmp_path / "drives.yaml").write_text(DRIVES)
    return tmp_path


def result(folder: Path, *words: str) -> dict[str, Any]:
    code, _, error = hoopd(*words, "--json", "result.json")
    assert code == 0, error
    found: dict[str, Any] = json.loads((folder / "result.json").read_text())
    return found


@pytest.mark.proof
def test_friction_of_the_second_drive_is_found_written_and_simulated(folder: Path) -> None:
    true = {"J": 0.012, "k": 0.6, f"{FRICTION}.Fc": 0.05}
    written(folder / "drives.csv", folder / "drives.yaml", true, (0.0, 0.3, 5e-4), 3)
    words = ("drives.csv", "--plant", "drives.yaml", "--no-free-run", "--write", "found.yaml")
    found = result(folder, "diagnose", *words)
    (effect,) = found["effects"]
    assert (found["verdict"], effect["name"]) == ("missing_physics", FRICTION)
    assert effect["parameters"]["Fc"]["value"] == pytest.approx(0.05, rel=0.01)
    assert found["base"]["parameters"]["k"]["value"] == pytest.approx(0.6, rel=0.01)
    run = result(folder, "simulate", "--model", "found.yaml", "--input", "drives.csv")
    assert min(one["nrmse_percent"] for one in run["free_run"].values()) > 99.0
    assert np.shape(result(folder, "design", "lqg", "--model", "found.yaml")["feedback"]) == (2, 4)


@pytest.mark.proof
def test_a_late_first_drive_is_told_from_the_second_one(folder: Path) -> None:
    written(folder / "drives.csv", folder / "drives.yaml", {f"{DELAY}.d": 0.012}, (0.0, 0.3, 5e-4), 5)
    words = ("drives.csv", "--plant", "drives.yaml", "--no-free-run", "--without", "actuator.lag")
    (effect,) = result(folder, "diagnose", *words)["effects"]
    assert effect["name"] == DELAY and effect["parameters"]["d"]["value"] == pytest.approx(0.012, rel=0.05)


def test_tanks_with_two_pumps_are_judged_and_fitted_by_the_likelihood(folder: Path) -> None:
    held = PUMPS.replace("A: 0.015 m2", "A: {value: 0.015, unit: m2, held: true}")
    (folder / "pumps.yaml").write_text(held)
    written(folder / "pumps.csv", folder / "pumps.yaml", {"a1": 2.2e-4, "a2": 2.8e-4}, (4e-5, 2e-5, 2e-4), 1)
    words = ("pumps.csv", "--plant", "pumps.yaml")
    found = result(folder, "diagnose", *words, "--no-free-run")
    assert found["verdict"] == "parameters"
    fitted = result(folder, "fit", *words, "--method", "prediction")
    for values in (found["base"]["parameters"], fitted["parameters"]):
        assert values["a1"]["value"] == pytest.approx(2.2e-4, rel=0.01)
        assert values["a2"]["value"] == pytest.approx(2.8e-4, rel=0.01)


def test_only_the_first_input_is_late_and_every_one_is_held() -> None:
    t, u = np.array([0.0, 0.01, 0.02]), np.array([[1.0, 10.0], [3.0, 30.0]])
    held = Held.of(stretch_of("r", load_plant(Path("drives.yaml")), t, u, {}))
    assert held.inputs(2, 0.005)[:, 1].tolist() == [[1.0, 30.0], [3.0, 30.0]]
    back = held.inputs_back([0.006], 0.0)
    assert back.shape == (6, 1, 3) and back[:2, 0, 2].tolist() == [3.0, 30.0]


def test_several_inputs_are_held_and_late_in_a_sampled_model(folder: Path) -> None:
    words = ("linearize", "--plant", "pumps.yaml", "--at", "q1=2e-5,q2=1e-5", "--sample-time", "1")
    system = result(folder, *words, "--delay", "2")["state_space"]
    now = result(folder, *words)["state_space"]
    assert system["states"] == ["h1", "h2", "q1_2", "q2_2", "q1_1", "q2_1"] and system["inputs"] == ["q1", "q2"]
    a, b, c = (np.array(system[name]) for name in "ABC")
    # what an input does two samples later is what it does at once without a delay
    assert c @ a @ a @ b == pytest.approx(np.array(now["C"]) @ np.array(now["B"]))
    assert not (c @ b).any() and not (c @ a @ b).any()
