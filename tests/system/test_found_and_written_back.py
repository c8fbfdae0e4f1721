"""From a recording to better control with the commands that a user types: experiment, diagnose, design, the daemon.

Longer figures, four effects: tools/bench/writeback.py, docs/writeback.md.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from hoopd.cli import app
from hoopd.modelfiles import load_model
from tests.system.test_writeback import HIDDEN, hide, settled_error

NAME = "hoop.coulomb_friction"


def command(*words: str) -> None:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.output


def test_friction_is_found_in_a_recording_and_the_controller_made_from_it_is_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rig = ("--sim", "--speed", "max", "--camera", "direct", "--duration", "12", "--set", hide(NAME))
    command("experiment", "prbs", *rig, "--out", "rec.mcap")
    assert b"coulomb" not in Path("rec.mcap").read_bytes()
    command("diagnose", "rec.mcap", "--model", "models/hoop.yaml", "--write", "found.yaml")
    (effect,) = load_model(Path("found.yaml")).effects
    assert effect.name == NAME
    true, found = HIDDEN[NAME]["Fc"][0], effect.parameters["Fc"]
    assert found.value == pytest.approx(true, rel=0.02) and found.ci95 is not None
    command("design", "lqg", "--model", "found.yaml", "--out", "lqg.yaml")
    base, _ = settled_error(tmp_path / "base", hide(NAME))
    better, summary = settled_error(tmp_path / "better", hide(NAME), f"control.file={tmp_path / 'lqg.yaml'}")
    assert better < 0.3 * base
    assert summary["faults"] == {}
