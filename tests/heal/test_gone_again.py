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

SECONDS, FIRST_S, ROUND_S = 42.0, 10.0, 30.0
LATE = ("camera.latency", "d", 0.015, "s")
RUBS = ("hoop.coulomb_friction", "Fc", 0.012, "N m")
RESTING = "sim.commands=[]"


@pytest.fixture(scope="module")
def versions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A version of each effect by its name, and the one of before: model and law."""
    made = {}
    for name, key, value, unit in (LATE, RUBS):
        made[name] = folder = tmp_path_factory.mktemp("law")
        model = load_model(defaults_folder() / "models" / "hoop.yaml")
        model.effects.append(EffectEntry(name=name, parameters={key: Parameter(value, unit)}))
        (folder / "model.yaml").write_text(model_text(model))
        HealWorker(folder=None, recording=Path, lay_in=None, by="ball")._design(folder)  # type: ignore[arg-type]
    made["before"] = folder = tmp_path_factory.mktemp("before")
    law = (defaults_folder() / "controllers" / "lqg.yaml").read_text()
    (folder / "controller.yaml").write_text(law.replace("../models/hoop.yaml", "model.yaml"))
    (folder / "model.yaml").write_text((defaults_folder() / "models" / "hoop.yaml").read_text())
    return made


def what_a_round_says(folder: Path, *sets: str, law: Path, before: Path) -> str:
    """Of a run with this law."""
    run_rig(folder / "run", f"control.file={law}/controller.yaml", "sim.psi_rad=0", *sets, duration_s=SECONDS)
    (path,) = (folder / "run").glob("run-*.mcap")
    seconds = read_recording(f"{path}@{FIRST_S:.3f}:{FIRST_S + ROUND_S:.3f}")
    return gone_again({"gain_of_before": asdict(filter_evidence(seconds, law, before))}, {})


@pytest.mark.parametrize("moves", [RESTING, moved(SECONDS)], ids=["resting", "moved"])
@pytest.mark.parametrize("what", [LATE, RUBS], ids=["late", "rubs"])
def test_what_is_still_there_has_not_gone_whether_the_reference_moves_or_rests(
    tmp_path: Path, versions: dict[str, Path], what: tuple[str, str, float, str], moves: str
) -> None:
    name, key, value, _ = what
    hidden = f"sim.effects=[{{name: {name}, parameters: {{{key}: {value}}}}}]"
    assert what_a_round_says(tmp_path, hidden, moves, law=versions[name], before=versions["before"]) == ""


def test_what_has_gone_is_told_to_have_gone(tmp_path: Path, versions: dict[str, Path]) -> None:
    assert what_a_round_says(tmp_path, moved(SECONDS), law=versions[RUBS[0]], before=versions["before"])
