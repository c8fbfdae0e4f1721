"""`hoopd heal` beside the daemon in lock-step: friction grows in a running loop, and the loop is mended."""

from __future__ import annotations

from pathlib import Path

import pytest
from harness.heal_kills import run_killed
from harness.healed_rig import heal_run
from harness.told_heal import FC, POLICY, QUICK, ToldWorker, grown, moved

from hoopd.daemon.replay import replay
from hoopd.heal.plan import HealPlan
from hoopd.plants.model_file import load_model
from hoopd.recording.mcap import read_run


@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("seconds", "grown_s"), [(120.0, 0.0), pytest.param(190.0, 80.0, marks=pytest.mark.proof)])
def test_friction_that_grows_is_learned_accepted_by_the_policy_and_given_up_when_it_goes(
    tmp_path: Path, seconds: float, grown_s: float
) -> None:
    run = grown(tmp_path, seconds, for_s=grown_s, plan=QUICK, policy=POLICY, worker=ToldWorker)
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
    # what acts in the end knows the friction as long as it is there
    model = load_model(tmp_path / "healed" / f"{run.acting:04}" / "model.yaml")
    assert [one.name for one in model.effects] == ([] if grown_s else ["hoop.coulomb_friction"]), run.told
    assert first.number == 0 and run.summary["faults"] == {}


@pytest.mark.timeout(600)
def test_nothing_is_learned_where_nothing_changes(tmp_path: Path) -> None:
    run = heal_run(tmp_path, moved(120.0), duration_s=120.0, plan=QUICK, policy=POLICY, worker=ToldWorker)
    assert run.acting == 0 and len(run.versions) == 1 and run.costs == ()


@pytest.mark.proof
@pytest.mark.timeout(1200)
def test_killed_at_random_moments_it_leaves_what_was_accepted_loses_nothing_and_goes_on(tmp_path: Path) -> None:
    killed = run_killed(tmp_path, kills=3, seed=1)
    assert len(killed.at_s) == 3 and killed.wrong == (), killed.wrong


@pytest.mark.proof
@pytest.mark.timeout(1800)
def test_friction_that_grows_is_found_by_the_real_diagnosis(tmp_path: Path) -> None:
    run = grown(tmp_path, 330.0, plan=HealPlan(), policy=POLICY)
    assert run.acting == 1, run.told
    model = load_model(tmp_path / "healed" / "0001" / "model.yaml")
    (friction,) = [one for one in model.effects if one.name == "hoop.coulomb_friction"]
    assert friction.parameters["Fc"].value == pytest.approx(FC, rel=0.05)
