"""`hoopd heal` beside the daemon in lock-step: friction grows in a running loop, and the loop is mended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from harness.healed_rig import HealedRun, heal_run

from hoopd.commands.heal_work import HealWorker
from hoopd.daemon.replay import replay
from hoopd.files.heal_policy import HealPolicy
from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.heal.plan import HealPlan, HealWork
from hoopd.plants.model_file import load_model
from hoopd.recording.mcap import read_run

POLICY = HealPolicy(schema="hoopd.policy/1", effects=["hoop.*"], pause_s=0.0)
FC = 0.012
MOVES = (0.1, -0.1, 0.05, -0.05, 0.15, -0.1)
QUICK = HealPlan(window_s=20.0, fresh_s=12.0, trial_s=12.0, round_s=12.0, pause_s=60.0)


class ToldWorker(HealWorker):
    """Is told what a diagnosis would find: designs on it, proves and weighs as ever."""

    def _diagnose(self, work: HealWork) -> dict[str, Any]:
        version, place = self.folder.read(work.number), self.folder.of(work.number)
        self._cut(work, place / "evidence.mcap")
        model = load_model(self.folder.of(version.before) / "model.yaml")
        known = [one for one in model.effects if one.name != "hoop.coulomb_friction"]
        friction = EffectEntry(name="hoop.coulomb_friction", parameters={"Fc": Parameter(value=FC, unit="N m")})
        effects = known if len(known) < len(model.effects) else [*known, friction]
        (place / "model.yaml").write_text(model_text(model.__class__(**fields(model) | {"effects": effects})))
        self._design(place)
        told = {"hoop.coulomb_friction": {"Fc": FC}}
        sure = {"hoop.coulomb_friction": 0.9}
        return {"kind": "physics", "reason": "told", "learn": True, "effects": told, "probabilities": sure}


def fields(model: Any) -> dict[str, Any]:
    """Of a model's record."""
    return {name: getattr(model, name) for name in model.__struct_fields__}


def moved(duration_s: float) -> str:
    """References as an operator would ask for, every three seconds."""
    every = range(int(duration_s / 3.0) - 1)
    rows = (f"{{at_s: {2 + 3 * k}, name: reference, value: {MOVES[k % len(MOVES)]}}}" for k in every)
    return f"sim.commands=[{', '.join(rows)}]"


def grown(folder: Path, duration_s: float, for_s: float = 0.0, **how: Any) -> HealedRun:
    """A run in which dry friction grows after 30 s."""
    friction = f"{{name: hoop.coulomb_friction, parameters: {{Fc: {FC}}}, at_s: 30, for_s: {for_s}}}"
    return heal_run(folder, f"sim.effects=[{friction}]", moved(duration_s), duration_s=duration_s, **how)


@pytest.mark.timeout(300)
def test_friction_that_grows_is_learned_accepted_by_the_policy_and_given_up_when_it_goes(tmp_path: Path) -> None:
    run = grown(tmp_path, 190.0, for_s=80.0, plan=QUICK, policy=POLICY, worker=ToldWorker)
    first, second, *_ = run.versions
    assert second.accepted is not None, run.told
    assert (
        second.evidence["gain"]["nats"] > 50.0
        and second.evidence["promise"]["new"] < second.evidence["promise"]["before"]
    )
    # by the way of any operator: the recording holds all of it
    events = [(one.event, one.fields.get("command")) for one in read_run(run.recording).events]
    assert ("controller", "trial") in events and ("operator", "accept") in events
    assert replay(run.recording)["equal"]
    # the friction is gone again: what acts in the end knows none
    model = load_model(tmp_path / "healed" / f"{run.acting:04}" / "model.yaml")
    assert model.effects == [], run.told
    assert first.number == 0 and run.summary["faults"] == {}


@pytest.mark.timeout(200)
def test_nothing_is_learned_where_nothing_changes(tmp_path: Path) -> None:
    run = heal_run(tmp_path, moved(120.0), duration_s=120.0, plan=QUICK, policy=POLICY, worker=ToldWorker)
    assert run.acting == 0 and len(run.versions) == 1 and run.costs == ()


@pytest.mark.proof
@pytest.mark.timeout(1800)
def test_friction_that_grows_is_found_by_the_real_diagnosis(tmp_path: Path) -> None:
    run = grown(tmp_path, 330.0, plan=HealPlan(), policy=POLICY)
    assert run.acting == 1, run.told
    model = load_model(tmp_path / "healed" / "0001" / "model.yaml")
    (friction,) = [one for one in model.effects if one.name == "hoop.coulomb_friction"]
    assert friction.parameters["Fc"].value == pytest.approx(FC, rel=0.05)
