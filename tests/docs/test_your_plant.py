"""The file that the guide on plants shows is a sound plant, and its diagnosis says what the guide tells."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from hoopd.commands.cli import app
from hoopd.plants.plant_check import checks
from hoopd.plants.plant_file import parse_plant
from tests.docs.marks import ROOT, blocks
from tests.shellblocks import commands

PAGE = ROOT / "docs" / "guides" / "your_plant.md"
TOLD = PAGE.read_text(encoding="utf-8").partition("## What your device does")[2].partition("\n## ")[0]
MAKER = Path(__file__).with_name("made_slide.py")
TRUE = {"m": 2.2, "b": 3.4}
DRY_N = 1.5


def the_file(name: str) -> str:
    (file,) = (block for block in blocks(PAGE) if block.save == name)
    return file.text


def test_the_page_s_file_is_a_sound_plant() -> None:
    plant = parse_plant(the_file("slide.yaml"), "slide.yaml")
    assert plant.free == ("m", "b") and list(plant.channels) == ["x"]
    assert [check for check in checks(plant) if check.good is False] == []


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Any]:
    """What the page's command prints and writes, on the recording that the page speaks of."""
    folder = tmp_path_factory.mktemp("slide")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("sys.argv", [str(MAKER), "day1.csv"])
        runpy.run_path(str(MAKER), run_name="__main__")
        Path("slide.yaml").write_text(the_file("slide.yaml"))
        (block,) = (block for block in blocks(PAGE) if "test_your_plant" in block.mark)
        (row,) = commands(PAGE.name, block.text)
        done = CliRunner().invoke(app, list(row.words[1:]))
        assert done.exit_code == 0 and Path("found.html").is_file(), done.output
        return " ".join(done.output.split()), yaml.safe_load(Path("found.yaml").read_text())


def test_the_recording_is_the_one_that_is_shown(diagnosed: object) -> None:
    made = runpy.run_path(str(MAKER))["made"]()
    shown = TOLD.partition("```text\n")[2].partition("```")[0].splitlines()[1:]
    assert shown == [f"{t:.3f},{x:.4f},{f:.4f}" for t, x, f in made[: len(shown)]]


def test_the_effect_and_the_gain_are_those_that_the_page_tells(diagnosed: tuple[str, Any]) -> None:
    said, model = diagnosed
    (effect,) = model["effects"]
    dry, (low, high) = effect["parameters"]["Fc"], effect["parameters"]["Fc"]["ci95"]
    assert effect["name"] == "body.coulomb_friction" and dry["value"] == pytest.approx(DRY_N, rel=1e-3)
    assert f"{dry['value']:.4f} N with an interval of {low:.4f} to {high:.4f}" in TOLD
    gain = re.search(r"goes from ([\d.]+) to ([\d.]+) %", TOLD)
    assert gain is not None and f"held-out x goes from {gain[1]} to {gain[2]} %" in said


def test_the_parameters_are_the_carriage_s(diagnosed: tuple[str, Any]) -> None:
    parameters = diagnosed[1]["parameters"]
    for name, value in TRUE.items():
        assert parameters[name]["value"] == pytest.approx(value, rel=1e-3)
    assert f"m is {parameters['m']['value']:.4f} kg" in TOLD
