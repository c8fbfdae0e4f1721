"""`hoopd design --plant`: the controller's file, its run on the plant, its figure, and the daemon's refusal."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoopd import lab
from hoopd.design.plant_loop import StateFeedback
from hoopd.files.plant_controller import load_plant_controller
from hoopd.plants.numeric_plant import NumericPlant
from hoopd.plants.registry import plant_named
from tests.commands.test_plant import hoopd

# Two pumps, one into each of two tanks of which the upper one runs into the lower one.
PUMPS = """
schema: hoopd.plant/1
name: pumps
states: {h1: {unit: m, usual: 0.2}, h2: {unit: m, usual: 0.2}}
inputs: {q1: {unit: m3/s, limit: 2.0e-4, usual: 5.0e-5}, q2: {unit: m3/s, limit: 2.0e-4, usual: 5.0e-5}}
parameters: {A: 0.015 m2, a1: 2.0e-4 m2/s, a2: 3.0e-4 m2/s}
equations:
  h1: A*h1' = q1 - a1*h1
  h2: A*h2' = a1*h1 - a2*h2 + q2
sample_time_s: 1
"""
DRY = """
schema: hoopd.model/1
name: dry
plant: axis
effects:
  - {name: body.coulomb_friction, parameters: {Fc: {value: 60.0, unit: N}}}
  - {name: actuator.delay, parameters: {d: {value: 0.002, unit: s}}}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pumps.yaml").write_text(PUMPS)
    (tmp_path / "dry.yaml").write_text(DRY)
    return tmp_path


def result(*words: str) -> dict[str, Any]:
    code, _, error = hoopd("design", *words, "--json", "result.json")
    assert code == 0, error
    found: dict[str, Any] = json.loads(Path("result.json").read_text())
    return found


def test_the_file_s_law_brings_the_plant_home_as_the_command_says(folder: Path) -> None:
    words = ("--plant", "axis", "--poles=-20+10j,-20-10j", "--out", "law.yaml", "--figure", "law.png")
    told = result("placement", *words)
    file = load_plant_controller(folder / "law.yaml")
    assert (file.plant, file.kind, file.sample_time_s) == ("axis", "state_feedback", 0.001)
    assert (file.inputs, file.channels, file.limits) == ({"F": "N"}, {"x": "m"}, {"F": 1000.0})
    assert (folder / "law.png").stat().st_size > 10_000
    # a program of one's own: the law of the file on the plant, sample by sample
    law, plant = StateFeedback(file), NumericPlant(plant_named("axis"))
    x = np.array([told["closed_loop"]["x"]["begins_at"], 0.0])
    ways, forces = [], []
    for _ in range(2000):
        ways.append(x[0])
        forces.append(law.update({"x": x[0]})["F"])
        x = plant.advance(x, forces[-1], file.sample_time_s)
    assert max(map(abs, forces)) == pytest.approx(told["closed_loop"]["F"]["largest_deviation"], rel=1e-6)
    settled = told["closed_loop"]["x"]["settles_s"]
    assert max(map(abs, ways[round(settled / 0.001) :])) <= 0.05 * ways[0] < abs(ways[round(settled / 0.001) - 1])


def test_several_inputs_are_steered_about_the_point_that_they_hold(folder: Path) -> None:
    (folder / "laws").mkdir()
    at = "q1=2e-5,q2=1e-5,h1=0.1,h2=0.1"
    told = result("lqg", "--plant", "pumps.yaml", "--at", at, "--out", "laws/law.yaml", "--figure", "law.svg")
    file = load_plant_controller(folder / "laws" / "law.yaml")
    assert file.plant == "../pumps.yaml" and np.shape(file.gains.feedback) == (2, 2)
    assert file.operating_point == pytest.approx({"q1": 2e-5, "q2": 1e-5, "h1": 0.1, "h2": 0.1})
    for name, one in told["closed_loop"].items():
        assert one["settles_s"] is not None, name
    assert {one["unit"] for one in told["closed_loop"].values()} == {"m", "m3/s"}
    assert all(name in (folder / "law.svg").read_text() for name in ("h1", "h2", "q1", "q2"))


def test_an_input_that_is_not_steered_is_held(folder: Path) -> None:
    at = ("--at", "q1=2e-5,q2=1e-5,h1=0.1,h2=0.1")
    words = ("--plant", "pumps.yaml", *at, "--poles=-0.05,-0.06", "--out", "law.yaml", "--figure", "law.svg")
    told = result("placement", *words, "--steer", "q1")
    file = load_plant_controller(folder / "law.yaml")
    assert file.inputs == {"q1": "m3/s"} and file.limits == {"q1": 2e-4} and np.shape(file.gains.feedback) == (1, 2)
    assert file.operating_point == pytest.approx({"q1": 2e-5, "h1": 0.1, "h2": 0.1})
    assert all(told["closed_loop"][name]["settles_s"] is not None for name in ("h1", "h2"))
    assert "q2: held, the law does not move it" in told["notes"]
    code, _, error = hoopd("design", "lqg", "--plant", "pumps.yaml", *at, "--steer", "q3")
    assert code == 2 and "--steer: q3: is no input of the plant; known: q1, q2" in error


def test_the_run_has_the_friction_and_the_limit_that_the_linear_model_has_not(folder: Path) -> None:
    words = ("placement", "--poles=-20+10j,-20-10j")
    free, dry = (result(*words, *more) for more in (("--plant", "axis"), ("--model", "dry.yaml", "--out", "law.yaml")))
    assert free["feedback"] == dry["feedback"]
    assert abs(free["closed_loop"]["x"]["ends_at"]) < 1e-5 < 5e-4 < abs(dry["closed_loop"]["x"]["ends_at"])
    assert any("x: not settled" in note for note in dry["notes"]) and "settled" not in "".join(free["notes"])
    assert "actuator.delay is not part of the closed loop, either" in dry["notes"]
    assert load_plant_controller(folder / "law.yaml").model == "dry.yaml"
    hard = result("lqg", "--plant", "axis", "--weights", "F=1e5,x=1e-3")
    assert hard["closed_loop"]["F"]["largest_deviation"] == 1000.0


def test_the_daemon_refuses_it_in_one_line(folder: Path) -> None:
    result("lqg", "--plant", "axis", "--out", "law.yaml")
    code, _, error = hoopd("--sim", "--duration", "0.1", "--set", "control.file=law.yaml")
    assert (code, error.count("\n")) == (2, 1)
    assert "law.yaml: plant: a controller of 'axis': the daemon runs the hoop alone" in error


def test_the_python_interface_designs_linearizes_and_saves_the_same(folder: Path) -> None:
    result("placement", "--model", "dry.yaml", "--poles=-20+10j,-20-10j", "--out", "law.yaml")
    made = lab.design("placement", "dry.yaml", poles=(-20 + 10j, -20 - 10j))
    assert (
        isinstance(made, lab.DesignedPlant)
        and repr(made) == "DesignedPlant(placement for dry: F from x, every 0.001 s)"
    )
    made.save(folder / "again.yaml")
    texts = [(folder / name).read_text().replace(name.split(".")[0], "") for name in ("law.yaml", "again.yaml")]
    assert texts[0] == texts[1]
    assert len(made.plot().figure.axes) == 2 and made.margins is not None
    assert made.law().update({"x": 0.001})["F"] < 0.0
    linear = lab.linearize(plant="pumps.yaml", at={"q1": 2e-5, "q2": 1e-5}, outputs="h2")
    assert linear.system.input_labels == ["q1", "q2"]
    assert sorted(linear.poles.real) == pytest.approx([-3e-4 / 0.015, -2e-4 / 0.015])
    assert linear.plot("step").figure is not None and linear.point.x == pytest.approx([0.1, 0.1])
    assert "actuator.delay" in lab.linearize("dry.yaml").notes
    own = replace(lab.plant("axis"), values={"M": 50.0, "Fv": 200.0, "offset": 0.0})
    assert lab.linearize(plant=own, sample_time=0.001).poles.real.min() == pytest.approx(np.exp(-0.004))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("placement", "--plant", "axis"), "--poles: 2 are needed, in rad/s (x, dx), not 3"),
        (("pid", "--plant", "axis"), "LAW: pid is a law of the hoop"),
        (("foo", "--plant", "axis"), "LAW: foo is no law; of other plants: lqg, placement"),
        (("lqg", "--plant", "axis", "--recording", "a.mcap"), "--recording: is of the hoop's laws"),
        (("lqg", "--plant", "axis", "--omega", "3"), "--omega: is of the hoop's laws"),
        (("lqg", "--plant", "axis", "--delay", "0.1"), "--delay: is of the hoop's laws"),
        (("lqg", "--plant", "axis", "--weights", "y=1"), "--weights: y: unknown; known: x, dx, F"),
        (("lqg", "--plant", "axis", "--sample-time", "0"), "--sample-time"),
        (("lqg", "--plant", "tanks", "--at", "q=1,h1=1,h2=1"), "--at: q: 1 is beyond its limit"),
        (("lqg", "--plant", "axis", "--figure", "a.txt"), "a.txt"),
        (("lqg", "--plant", "axis", "--out", "no/law.yaml"), "no such folder"),
        (("placement", "--plant", "pumps.yaml", "--poles=-1,-2"), "poles are placed with one input; lqg takes several"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_writes_nothing(words: tuple[str, ...], said: str, folder: Path) -> None:
    before = sorted(folder.iterdir())
    code, _, error = hoopd("design", *words)
    assert (code, error.count("\n")) == (2, 1)
    assert said in error
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("limits: {F:", "limits: {G:", "limits.G: no input; known: F"),
        ("- [0.99", "- [1.0, 0.99", "gains.filter: must have 2 rows of 1 numbers"),
        ("x: 0.0}", "y: 0.0}", "operating_point.x: a finite number is needed"),
        ("kind: state_feedback", "kind: pid", "kind"),
        ("sample_time_s: 0.001", "sample_time_s: 0", "sample_time_s: must be above 0"),
    ],
)
def test_a_file_that_is_wrong_is_one_line(old: str, new: str, said: str, folder: Path) -> None:
    result("lqg", "--plant", "axis", "--out", "law.yaml")
    text = (folder / "law.yaml").read_text()
    assert old in text
    (folder / "law.yaml").write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=r"law\.yaml: ") as caught:
        load_plant_controller(folder / "law.yaml")
    assert said in str(caught.value)
