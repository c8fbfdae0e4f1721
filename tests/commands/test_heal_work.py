"""What a diagnosis beside a running loop is good for: a law that the daemon has no use for is left with its reason."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from harness.told_diagnosis import said

from hoopd.commands import heal_work
from hoopd.commands.heal_work import HealWorker
from hoopd.core.modes import Mode
from hoopd.files.heal_policy import HealPolicy
from hoopd.files.heal_versions import VersionFolder
from hoopd.files.memory import Memory, RememberedDiagnosis, add_to_memory, load_memory, save_memory
from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.files.shipped import defaults_folder
from hoopd.heal import cost_promise
from hoopd.heal.plan import HealWork
from hoopd.plants.model_file import load_model
from hoopd.recording.recording import Recording

MODEL = defaults_folder() / "models" / "hoop.yaml"
FRICTION = EffectEntry(name="hoop.coulomb_friction", parameters={"Fc": Parameter(value=0.01, unit="N m")})
CABLE = EffectEntry(
    name="hoop.dahl_of_theta",
    parameters={"A": Parameter(value=0.03, unit="N m"), "xs": Parameter(value=20.0, unit="rad")},
)


def begun(folder: Path) -> VersionFolder:
    """A loop as it was found: the shipped law on the shipped model."""
    versions = VersionFolder(folder)
    versions.begin("hoop")
    law = defaults_folder() / "controllers" / "lqg.yaml"
    versions.first("lqg.yaml@" + "0" * 64, law.read_text(), MODEL.read_text(), 0.0, "ann")
    return versions


def diagnosed(folder: Path, *found: EffectEntry, **numbers: float) -> dict[str, Any]:
    """What becomes of a diagnosis that has ended with these laws, and with these numbers of the model where they are
    told; the seconds of it are not looked at again."""
    versions = begun(folder)
    place = versions.of(versions.add(60.0, to_s=40.0).number)
    (place / "evidence.mcap").touch()
    (friction,) = said(0.9).effects
    told = [msgspec.structs.replace(friction, name=one.name) for one in found]
    (place / "diagnosis.json").write_bytes(msgspec.json.encode(said(0.9, effects=told)))
    model = load_model(MODEL)
    values = {name: msgspec.structs.replace(model.parameters[name], value=one) for name, one in numbers.items()}
    model = msgspec.structs.replace(model, effects=list(found), parameters={**model.parameters, **values})
    (place / "found.yaml").write_text(model_text(model))
    worker = HealWorker(folder=versions, recording=Path, lay_in=lambda *_: "", by="ball")
    return worker.work(HealWork("diagnose", 1, 0.0, 40.0))


def test_a_law_that_filter_and_feed_forward_have_no_use_for_is_left_with_its_reason(tmp_path: Path) -> None:
    left = diagnosed(tmp_path / "cable", CABLE)
    assert left["learn"] is False and left["kind"] == "physics"
    assert left["reason"].endswith("hoop.dahl_of_theta: the filter has no state for it")
    assert not (tmp_path / "cable" / "0001" / "controller.yaml").exists()


def test_where_one_law_is_of_use_a_controller_is_designed(tmp_path: Path) -> None:
    both = diagnosed(tmp_path / "both", CABLE, FRICTION)
    assert both["learn"] is True and (tmp_path / "both" / "0001" / "controller.yaml").exists()


def test_a_policy_sees_what_the_written_model_changes_and_the_data_do_not_exclude(tmp_path: Path) -> None:
    bb = load_model(MODEL).parameters["bb"].value
    result = diagnosed(tmp_path / "healed", FRICTION, bb=1.6 * bb)
    assert result["parameters"]["bb"] == pytest.approx(0.6) and result["values"]["bb"] == 1.6 * bb
    policy = HealPolicy(schema="hoopd.policy/1", effects=["hoop.*"])
    told = [result[name] for name in ("effects", "probabilities", "parameters", "values")]
    assert policy.objection(*told).startswith("bb changed by +60%")


@pytest.mark.parametrize(("share", "sees", "is_weighed"), [(1.0, True, True), (0.5, True, False), (1.0, False, False)])
def test_seconds_without_the_law_or_without_pictures_are_not_weighed(
    share: float, sees: bool, is_weighed: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    versions = begun(tmp_path / "healed")
    t = np.arange(0.0, 10.0, 0.02)
    running = np.where(t < 10.0 * share, str(Mode.RUNNING), str(Mode.FAULT))
    ball = np.full(len(t), 0.1 if sees else np.nan)
    seconds = Recording(
        t, u=0.0 * t, theta=t, dtheta=0.0 * t + 1.0, psi=ball, extra={"mode": running, "reference": 0.0 * t}
    )
    monkeypatch.setattr(heal_work, "read_recording", lambda text: seconds)
    monkeypatch.setattr(cost_promise, "_simulated", lambda *_: 0.1)
    worker = HealWorker(folder=versions, recording=Path, lay_in=lambda *_: "", by="ball")
    result = worker.work(HealWork("weigh", 0, 0.0, 10.0))
    assert ("error" not in result) is is_weighed
    if is_weighed:
        assert result["gain_of_before"] == {"nats": 0.0, "errors": 0.0, "seconds": 7.0, "share": 0.0}, (
            "two copies of one model"
        )
    else:
        assert result["error"].endswith(f"{10.0 * share if sees else 0.0:.1f} s of 10.0 s in which the law acts")


def test_a_diagnosis_is_told_what_is_known_and_adds_to_it_later(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    versions, known = begun(tmp_path / "healed"), tmp_path / "known.json"
    place = versions.of(versions.add(60.0, to_s=40.0).number)
    (place / "evidence.mcap").touch()
    worker = HealWorker(folder=versions, recording=Path, lay_in=lambda *_: "", by="ball", memory=known)
    save_memory(known, Memory(of="hoop rolling", diagnoses=[RememberedDiagnosis(recordings=["earlier"])]))

    def diagnoses(words: list[str | Path], *_: object, **__: object) -> int:
        path = Path(words[words.index("--memory") + 1])
        add_to_memory(path, "hoop rolling", RememberedDiagnosis(recordings=["this"]))
        Path(words[words.index("--json") + 1]).write_bytes(msgspec.json.encode(said()))
        return 0

    monkeypatch.setattr(heal_work, "run_step", diagnoses)
    assert worker.work(HealWork("diagnose", 1, 0.0, 40.0))["learn"] is False
    assert [one.recordings for one in load_memory(known, None)[0].diagnoses] == [["earlier"]]
    add_to_memory(known, "hoop rolling", RememberedDiagnosis(recordings=["meanwhile"]))
    without = dataclasses.replace(worker, memory=None)
    assert without.work(HealWork("remember", 1, 0.0, 40.0)) == {"remembered": False}
    assert worker.work(HealWork("remember", 1, 0.0, 40.0)) == {"remembered": True}
    assert [one.recordings for one in load_memory(known, None)[0].diagnoses] == [["earlier"], ["meanwhile"], ["this"]]


def test_a_mistake_in_a_computation_is_its_result(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fails(*_: object) -> None:
        raise KeyError("mode")

    monkeypatch.setattr(heal_work, "read_recording", fails)
    worker = HealWorker(folder=begun(tmp_path / "healed"), recording=Path, lay_in=lambda *_: "", by="ball")
    assert worker.work(HealWork("weigh", 0, 0.0, 10.0)) == {"error": "KeyError: 'mode'"}
