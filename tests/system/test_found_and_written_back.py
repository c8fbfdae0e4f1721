"""From a mismatch to better control: the README's own commands, and the gain that it tells of.

Longer figures, four effects: tools/bench/writeback.py, docs/writeback.md.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from hoopd.cli import app
from hoopd.modelfiles import load_model
from tests.shellblocks import ROOT, below
from tests.system.test_writeback import HIDDEN, hide

pytestmark = pytest.mark.timeout(900)  # half a minute of a processor, which other work may share
HEADING = "## From a mismatch to better control"
NAME = "hoop.coulomb_friction"
Words = tuple[str, ...]


def command(*words: str) -> None:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.output


def judged(words: Words, *more: str) -> dict[str, Any]:
    """The summary of a run of the daemon."""
    command(*words, *more, "--json", "summary.json")
    summary: dict[str, Any] = json.loads(Path("summary.json").read_text())
    assert summary["faults"] == {} and summary["control"]["ended_by"] == []
    return summary["psi_error"]


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Words, Words]:
    """The folder in which all between the first command and the last was done, and these two."""
    before, *between, after = (shown.words[1:] for shown in below(HEADING))
    folder = tmp_path_factory.mktemp("loop")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for words in between:
            command(*words)
    return folder, before, after


def test_the_effect_is_named_with_its_number(loop: tuple[Path, Words, Words]) -> None:
    folder, before, _ = loop
    assert hide(NAME) in before and b"coulomb" not in (folder / "hidden.mcap").read_bytes()
    (effect,) = load_model(folder / "found.yaml").effects
    assert effect.name == NAME
    true, found = HIDDEN[NAME]["Fc"][0], effect.parameters["Fc"]
    assert found.value == pytest.approx(true, rel=0.02) and found.ci95 is not None


def test_the_gain_is_the_one_that_the_readme_tells(
    loop: tuple[Path, Words, Words], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(loop[0])
    text = (ROOT / "README.md").read_text(encoding="utf-8").partition(HEADING)[2]
    for name, words in zip(("before", "after"), loop[1:], strict=True):
        row = re.search(rf"^\| {name} \| ([\d.]+) mrad \| ([\d.]+) mrad \|$", text, re.MULTILINE)
        assert row is not None
        told, error = [1e-3 * float(cell) for cell in row.groups()], judged(words)
        assert [error[by]["rms_rad"] for by in ("measured", "true")] == pytest.approx(
            told, abs=8e-4
        )  # friction sticks now here, now there


@pytest.mark.parametrize(("seed", "value"), [(1, 0.04), (2, -0.04), (3, 0.02)])
def test_the_controller_written_back_is_better_than_the_one_it_replaces(
    loop: tuple[Path, Words, Words], monkeypatch: pytest.MonkeyPatch, seed: int, value: float
) -> None:
    """By the measured angle and by the true one; the rig's noise and its camera's phase are others each time."""
    monkeypatch.chdir(loop[0])
    step = f"sim.commands=[{{at_s: 8, name: reference, value: {value}}}]"
    base, better = (judged(words, "--set", step, "--seed", str(seed)) for words in loop[1:])
    assert better["measured"]["rms_rad"] < 0.4 * base["measured"]["rms_rad"]
    assert better["true"]["rms_rad"] < 0.3 * base["true"]["rms_rad"]
