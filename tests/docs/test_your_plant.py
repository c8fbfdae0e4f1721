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
TOLD = PAGE.read_text(encoding="utf-8").partition("## Fit it to a recording")[2].partition("\n## Plants")[0]
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
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Any, str]:
    """What the page's commands print, the model that the last one writes, and the page's recording."""
    folder = tmp_path_factory.mktemp("slide")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("sys.argv", [str(MAKER), "day1.csv"])
        runpy.run_path(str(MAKER), run_name="__main__")
        Path("slide.yaml").write_text(the_file("slide.yaml"))
        said = []
        for block in (block for block in blocks(PAGE) if "test_your_plant" in block.mark):
            for row in commands(PAGE.name, block.text):
                done = CliRunner().invoke(app, list(row.words[1:]))
                assert done.exit_code == 0, done.output
                said.append(done.output)
        (program,) = (block for block in blocks(PAGE) if block.save == "steer.py")
        exec(compile(program.text, "steer.py", "exec"), {})  # the page's own program
        assert Path("found.html").is_file() and Path("fitted.png").is_file()
        parse_plant(Path("fitted.yaml").read_text(), "fitted.yaml")
        model = yaml.safe_load(Path("found.yaml").read_text())
        return " ".join(" ".join(said).split()), model, Path("day1.csv").read_text()


@pytest.mark.proof
def test_the_recording_is_the_one_that_is_shown(diagnosed: tuple[str, Any, str]) -> None:
    shown = TOLD.partition("```text\n")[2].partition("```")[0].splitlines()[1:]
    assert shown and shown == diagnosed[2].splitlines()[1 : 1 + len(shown)]


@pytest.mark.proof
def test_the_fit_is_the_one_that_the_page_tells(diagnosed: tuple[str, Any, str]) -> None:
    said, told = diagnosed[0], " ".join(TOLD.split())
    (nominal, fitted) = re.findall(r"fits x to ([\d.]+) %, that of the fitted ones to ([\d.]+) %", told)[0]
    assert f"x │ {nominal} % │ {fitted} %" in said
    assert re.search(r"m │ 2\.7[23]\d* │ kg", said) and "2.73 kg" in told
    assert "residuals are coloured (the model misses something)" in said


@pytest.mark.proof
def test_the_effect_and_the_gain_are_those_that_the_page_tells(diagnosed: tuple[str, Any, str]) -> None:
    said, model, _ = diagnosed
    (effect,) = model["effects"]
    percent = re.search(r"now fits x to ([\d.]+) %", TOLD)
    assert percent is not None and percent[1] in [f"{float(one):.2f}" for one in re.findall(r"x │ ([\d.]+) │", said)]
    dry, (low, high) = effect["parameters"]["Fc"], effect["parameters"]["Fc"]["ci95"]
    assert effect["name"] == "body.coulomb_friction" and dry["value"] == pytest.approx(DRY_N, rel=1e-3)
    assert f"{dry['value']:.4f} N with an interval of {low:.4f} to {high:.4f}" in TOLD
    gain = re.search(r"goes from ([\d.]+) to ([\d.]+) %", TOLD)
    assert gain is not None and re.search(rf"Fit of held-out x: .*{gain[1]}.* with effects {gain[2]} %", said)


@pytest.mark.proof
def test_the_parameters_are_the_carriage_s(diagnosed: tuple[str, Any, str]) -> None:
    parameters = diagnosed[1]["parameters"]
    for name, value in TRUE.items():
        assert parameters[name]["value"] == pytest.approx(value, rel=1e-3)
    assert f"m is {parameters['m']['value']:.4f} kg" in TOLD
