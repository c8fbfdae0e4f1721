"""From a recording to a controller in three commands, and what the fit is worth: the README's words, run.

The rig's truth is config/models/hoop.yaml; the rival is LQG designed on the thesis's entries, on the same rig.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from harness.rigrun import run_rig
from harness.rivals import SCENARIOS, Judged, judged, race
from inprocess import call

from hoopd import lab
from hoopd.commands import design, fit
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.options.fit import FitOptions
from hoopd.files.model import model_text
from hoopd.plants.model_file import load_model

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = (
    "hoopd experiment prbs --sim --speed max --camera direct --out rec.mcap",
    "hoopd fit rec.mcap --out mine.yaml",
    "hoopd design lqg --model mine.yaml --out lqg.yaml",
)
RUN = "hoopd --sim --speed max --camera direct --duration 10 --set control.file=lqg.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the three commands' files, and the rival's controller."""
    place = tmp_path_factory.mktemp("fit")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for command in COMMANDS:
            code, _, errors = call(tuple(command.split()[1:]))
            assert code == 0, (command, errors)
    design.run(DesignOptions(law="lqg", model=Path("models/thesis.yaml"), out=place / "thesis.yaml"))
    return place


def test_readme_shows_exactly_these_commands() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.search(r"## From a recording to a controller.*?```\n(.*?)```", readme, re.DOTALL)
    assert block is not None
    shown = [line.split("#")[0].strip() for line in block[1].splitlines() if line.strip()]
    assert shown[: len(COMMANDS)] == list(COMMANDS)
    assert shown[len(COMMANDS) :] == [RUN]


@pytest.mark.proof
def test_the_fit_has_something_to_find(folder: Path) -> None:
    """The README's two figures: what the fit starts from is another device than the rig."""
    recording = lab.load(folder / "rec.mcap")
    nominal, fitted = (lab.simulate(one, recording).fit["psi"] for one in ("thesis", folder / "mine.yaml"))
    assert nominal == pytest.approx(55.0, abs=0.5) and fitted == pytest.approx(99.5, abs=0.05)


@pytest.mark.proof
def test_the_daemon_holds_the_ball_with_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    code, _, errors = call(tuple(RUN.split()[1:]))
    assert code == 0, errors
    run = run_rig(folder / "hold", f"control.file={folder / 'lqg.yaml'}", duration_s=10.0)
    assert run.summary["exit"] == 0 and run.summary["faults"] == {}
    assert run.settled_s(run.psi, 0.05) < 1.0 and run.settled_s(run.dtheta, 1.0) < 1.5
    assert np.abs(run.psi[run.after(2.0)]).max() < 0.01


def both(folder: Path, scenario: str) -> list[list[Judged]]:
    """All seeds of the fitted one's controller, and of the rival's."""
    files = (folder / "lqg.yaml", folder / "thesis.yaml")
    return [[judged(run) for run in race(folder / scenario, file, SCENARIOS[scenario])] for file in files]


@pytest.mark.proof
def test_it_beats_the_thesis_s_entries_on_the_same_rig(folder: Path) -> None:
    """Told where to be, every seed of the fitted one is better than the best of the other, by both measures."""
    asked = SCENARIOS["references"]
    fitted, thesis = (
        [judged(run) for run in race(folder / "race", folder / name, asked)] for name in ("lqg.yaml", "thesis.yaml")
    )
    assert max(one.off_rms_rad for one in fitted) < 0.70 * min(one.off_rms_rad for one in thesis)
    assert max(one.cost for one in fitted) < 0.55 * min(one.cost for one in thesis)


@pytest.mark.proof
def test_brought_back_from_a_release_both_are_alike(folder: Path) -> None:
    """No reference, no model needed to hold it: the costs differ by less than 5 %."""
    asked = SCENARIOS["release"]
    fitted, thesis = (
        [judged(run) for run in race(folder / "release", folder / name, asked)] for name in ("lqg.yaml", "thesis.yaml")
    )
    assert np.mean([one.cost for one in fitted]) == pytest.approx(np.mean([one.cost for one in thesis]), rel=0.05)


@pytest.mark.proof
def test_a_fit_from_wrong_numbers_is_as_good(folder: Path) -> None:
    """It is the recording that tells: a start with inertias and frictions far off ends at the same loop."""
    base = load_model(ROOT / "config" / "models" / "hoop.yaml")
    wrong = {"Ib": 1.3, "Ih": 0.7, "bb": 2.0, "bh": 3.0}
    text = model_text(base)
    for name, factor in wrong.items():
        value = base.parameters[name].value
        text = text.replace(f"value: {value!r}", f"value: {value * factor!r}").replace(
            f"nominal: {value!r}", "nominal: null"
        )
    start = folder / "wrong.yaml"
    start.write_text(text, encoding="utf-8")
    fit.run(
        FitOptions(recordings=(str(folder / "rec.mcap"),), structure="rolling", model=start, out=folder / "again.yaml")
    )
    design.run(DesignOptions(law="lqg", model=folder / "again.yaml", out=folder / "again-lqg.yaml"))
    asked = SCENARIOS["references"]
    (again,), (first,) = (race(folder / "again", folder / name, asked, (0,)) for name in ("again-lqg.yaml", "lqg.yaml"))
    assert judged(again).off_rms_rad == pytest.approx(judged(first).off_rms_rad, rel=0.02)
