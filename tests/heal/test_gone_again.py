"""Rounds of real loops in lock-step: which of them say that what was learned has gone again, and which say nothing."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest
from harness.rigrun import run_rig
from harness.told_heal import moved

from hoopd.commands.heal_work import HealWorker
from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.files.shipped import defaults_folder
from hoopd.heal.filter_evidence import filter_evidence
from hoopd.heal.weighing import gone_again
from hoopd.plants.model_file import load_model
from hoopd.recording.slices import read_recording

SECONDS, FIRST_S, ROUND_S = 70.0, 10.0, 30.0
LATE = ("camera.latency", "d", 0.015, "s")
RUBS = ("hoop.coulomb_friction", "Fc", 0.012, "N m")
RESTING = "sim.commands=[]"


def version(folder: Path, *effects: tuple[str, str, float, str]) -> Path:
    """A model with these effects, and the law that is designed on it."""
    folder.mkdir()
    model = load_model(defaults_folder() / "models" / "hoop.yaml")
    entries = [EffectEntry(name=name, parameters={key: Parameter(value, unit)}) for name, key, value, unit in effects]
    model.effects.extend(entries)
    (folder / "model.yaml").write_text(model_text(model))
    HealWorker(folder=None, recording=Path, lay_in=None, by="ball")._design(folder)  # type: ignore[arg-type]
    return folder


def rounds(folder: Path, *sets: str, law: Path, before: Path) -> list[str]:
    """What each round of a run with this law says."""
    run_rig(folder / "run", f"control.file={law}/controller.yaml", "sim.psi_rad=0", *sets, duration_s=SECONDS)
    (path,) = (folder / "run").glob("run-*.mcap")
    edges = [FIRST_S + k * ROUND_S for k in range(2)]
    seconds = [read_recording(f"{path}@{edge:.3f}:{edge + ROUND_S:.3f}") for edge in edges]
    return [gone_again({"gain_of_before": asdict(filter_evidence(one, law, before))}, {}) for one in seconds]


@pytest.mark.parametrize("moves", [RESTING, moved(SECONDS)])
@pytest.mark.parametrize("what", [LATE, RUBS])
def test_what_is_still_there_has_not_gone_whether_the_reference_moves_or_rests(
    tmp_path: Path, what: tuple[str, str, float, str], moves: str
) -> None:
    name, key, value, _ = what
    hidden = f"sim.effects=[{{name: {name}, parameters: {{{key}: {value}}}}}]"
    law, before = version(tmp_path / "law", what), version(tmp_path / "before")
    assert rounds(tmp_path, hidden, moves, law=law, before=before) == ["", ""]


def test_what_has_gone_has_gone_in_both_rounds(tmp_path: Path) -> None:
    law, before = version(tmp_path / "law", RUBS), version(tmp_path / "before")
    assert all(rounds(tmp_path, moved(SECONDS), law=law, before=before))
