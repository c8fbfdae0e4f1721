"""From a mismatch to better control: the README's own commands, and the gain that it tells of.

Longer figures, four effects: tools/bench/writeback.py, docs/explanations/writeback.md.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from typer.testing import CliRunner

from hoopd.commands.cli import app
from hoopd.plants.model_file import load_model
from tests.shellblocks import ROOT, below
from tests.system.test_writeback import HIDDEN, hide

pytestmark = pytest.mark.timeout(900)  # half a minute of a processor, which other work may share
HEADING = "## From a mismatch to better control"
NAME = "hoop.coulomb_friction"
TOLD = (ROOT / "README.md").read_text(encoding="utf-8").partition(HEADING)[2].partition("\n## ")[0]
ROUNDED_RAD = 6e-5  # half of the last digit told: lock-step repeats every digit of the errors
Words = tuple[str, ...]


def command(*words: str) -> str:
    """What a command prints, on one line."""
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


def judged(words: Words, *more: str) -> dict[str, Any]:
    """The summary of a run of the daemon."""
    command(*words, *more, "--json", "summary.json")
    summary: dict[str, Any] = json.loads(Path("summary.json").read_text())
    assert summary["faults"] == {} and summary["control"]["ended_by"] == []
    return summary["psi_error"]


class Loop(NamedTuple):
    """The folder in which all between the first command and the last was done, these two, and what the others said."""

    folder: Path
    before: Words
    after: Words
    said: str


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Loop:
    before, *between, after = (shown.words[1:] for shown in below(HEADING))
    folder = tmp_path_factory.mktemp("loop")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return Loop(folder, before, after, " ".join(command(*words) for words in between))


@pytest.mark.proof
def test_the_effect_is_named_with_its_number(loop: Loop) -> None:
    folder, before = loop.folder, loop.before
    assert hide(NAME) in before and b"coulomb" not in (folder / "hidden.mcap").read_bytes()
    (effect,) = load_model(folder / "found.yaml").effects
    assert effect.name == NAME
    true, found = HIDDEN[NAME]["Fc"][0], effect.parameters["Fc"]
    assert found.value == pytest.approx(true, rel=0.02) and found.ci95 is not None
    low, high = found.ci95
    assert f"`{NAME}`, {1e3 * found.value:.3f} mN m with an interval of +-{5e2 * (high - low):.3f}" in TOLD


@pytest.mark.proof
def test_the_fit_is_the_one_that_the_readme_tells(loop: Loop) -> None:
    share = re.search(r"falls from ([\d.]+) to\s+([\d.]+) %", TOLD)
    assert share is not None
    said = rf"Fit of held-out theta_rate: [^%]*{share[2]}, with effects {share[1]} %"
    assert re.search(said, " ".join(loop.said.split()))


@pytest.mark.proof
def test_the_gain_is_the_one_that_the_readme_tells(loop: Loop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(loop.folder)
    for name, words in (("before", loop.before), ("after", loop.after)):
        row = re.search(rf"^\| {name} \| ([\d.]+) mrad \| ([\d.]+) mrad \|$", TOLD, re.MULTILINE)
        assert row is not None
        told, error = [1e-3 * float(cell) for cell in row.groups()], judged(words)
        assert [error[by]["rms_rad"] for by in ("measured", "true")] == pytest.approx(told, abs=ROUNDED_RAD)


@pytest.mark.proof
@pytest.mark.parametrize(("seed", "value"), [(1, 0.04), (2, -0.04), (3, 0.02)])
def test_the_controller_written_back_is_better_than_the_one_it_replaces(
    loop: Loop, monkeypatch: pytest.MonkeyPatch, seed: int, value: float
) -> None:
    """By the measured angle and by the true one; the rig's noise and its camera's phase are others each time."""
    monkeypatch.chdir(loop.folder)
    step = f"sim.commands=[{{at_s: 8, name: reference, value: {value}}}]"
    base, better = (judged(words, "--set", step, "--seed", str(seed)) for words in (loop.before, loop.after))
    assert better["measured"]["rms_rad"] < 0.4 * base["measured"]["rms_rad"]
    assert better["true"]["rms_rad"] < 0.3 * base["true"]["rms_rad"]
