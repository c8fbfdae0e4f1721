"""`hoopd trajectory` and `hoopd maneuver` on the command line: files, one line for what cannot be, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.trajectory import TORQUES_NM, plan_on
from hoopd.files.controller import load_controller
from hoopd.files.model import EffectEntry, Parameter
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.files.trajectory import load_trajectory
from hoopd.plants.model_file import load_model
from tests.inprocess import call

MODEL = ("--model", "models/hoop.yaml")


def test_it_writes_a_trajectory_a_controller_a_figure_and_its_result(tmp_path: Path) -> None:
    names = {name: tmp_path / name for name in ("swing.yaml", "law.yaml", "plan.svg", "told.json")}
    words = ["--out", "swing.yaml", "--law", "law.yaml", "--figure", "plan.svg", "--json", "told.json"]
    code, out, errors = call(
        ["trajectory", "swing", *MODEL, "--angle", "0.6", *(str(names.get(word, word)) for word in words)]
    )
    assert code == 0 and not errors and "sensitivity" in out
    file = load_trajectory(names["swing.yaml"])
    assert file.name == "swing" and file.model == "models/hoop.yaml" and file.plan.suspends == []
    law = load_controller(names["law.yaml"])
    assert law.kind == "maneuver" and law.gains["torques_nm"] == file.plan.torques_nm
    told = json.loads(names["told.json"].read_text())
    assert told["sampled_models_arrived"] == told["sampled_models"] and told["largest_torque_nm"] < TORQUES_NM[0]
    assert names["plan.svg"].stat().st_size > 10_000


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ("{torque_nm: 0.05, slew_nm_per_tick: 1.4}", "gains: torques_nm asks for 0.1"),
        ("{torque_nm: 0.7, slew_nm_per_tick: 0.001}", "gains: torques_nm steps by 0.1"),
    ],
)
def test_a_law_of_a_controller_with_narrower_limits_is_refused(tmp_path: Path, limits: str, says: str) -> None:
    base = (defaults_folder() / "controllers" / "lqg.yaml").read_text()
    narrow, law, out = (tmp_path / name for name in ("narrow.yaml", "law.yaml", "swing.yaml"))
    narrow.write_text(base.replace("{torque_nm: 0.7, slew_nm_per_tick: 1.4}", limits))
    words = ["--law", str(law), "--controller", str(narrow), "--out", str(out)]
    code, _, errors = call(["trajectory", "swing", *MODEL, "--angle", "0.6", *words])
    assert code == 2 and says in errors and "are in force" in errors and errors.count("\n") == 1
    assert not law.exists() and not out.exists()


REFUSED = {
    "no such maneuver": (["jump", *MODEL], "trajectory: unknown maneuver 'jump'; known: loop, swing"),
    "a way that is none": (["loop", *MODEL, "--turn", "2"], "turn must be 1 or -1, not 2"),
    "no contact": (["loop", *MODEL, "--contact", "1.5"], "contact must be from 0 to below 1"),
    "too little torque": (["loop", *MODEL, "--max-torque", "0.05", "--seconds", "1.4"], "it would exceed torque by"),
    "a contact that up does not keep": (
        ["up", *MODEL, "--contact", "0.9"],
        "--contact: cannot be told of up",
    ),
    "a hold that is no success": (["up", *MODEL, "--hold", "0.9"], "hold must be 1 to 8 s, not 0.9"),
    "a speed at which control ends": (["loop", *MODEL, "--max-speed", "60"], "--max-speed: must be below 60 rad/s"),
    "no file of that kind": (["loop", *MODEL, "--out", "loop.txt"], "--out: must end in .yaml or .yml"),
    "a law of nothing": (["loop", *MODEL, "--controller", "controllers/lqg.yaml"], "goes with --law"),
    "no model": (["loop", "--model", "none.yaml"], "none.yaml: no such file"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words, says = REFUSED[name]
    code, _, errors = call(["trajectory", *words])
    assert code == 2 and says in errors and errors.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_damaged_trajectory_and_another_maneuver_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "swing.yaml"
    assert call(["trajectory", "swing", *MODEL, "--out", str(path)])[0] == 0
    code, _, errors = call(["maneuver", "loop", "--sim", "--trajectory", str(path), "--speed", "max"])
    assert code == 2 and "is a swing, no loop" in errors
    for old, new, says in (
        ("turn: 1", "turn: 3", "turn: must be 1 or -1, not 3"),
        ("plan:\n", "plan:\n  suspends: [link_lost]\n", "'link_lost' may not be suspended"),
        ("turn: 1", "colour: red", "colour"),
    ):
        assert old in path.read_text()
        (tmp_path / "bad.yaml").write_text(path.read_text().replace(old, new))
        with pytest.raises(InputError, match=says):
            load_trajectory(tmp_path / "bad.yaml")


@pytest.mark.proof
def test_more_torque_is_planned_with_where_the_usual_does_not_do() -> None:
    """A drag that asks for more than what feedback would like to keep for itself."""
    model = load_model(defaults_folder() / "models" / "hoop.yaml")
    drag = EffectEntry(name="ball.quadratic_drag", parameters={"c": Parameter(value=1.2e-4, unit="N m s2")})
    dragged = msgspec.structs.replace(model, effects=[drag])
    found = plan_on(dragged, TrajectoryOptions(kind="loop", model=Path("models/hoop.yaml")))
    assert TORQUES_NM[0] < abs(found.motion.inputs).max() <= TORQUES_NM[1]
    with pytest.raises(InputError, match="torque by"):
        plan_on(dragged, TrajectoryOptions(kind="loop", model=Path("models/hoop.yaml"), torque_nm=TORQUES_NM[0]))
