"""A loop that is followed where the law stops, words are lost, the policy pauses, and minutes are none of the law's."""

from __future__ import annotations

from pathlib import Path

import pytest
from heal.played_daemon import BAD, FRICTION, PERIOD_S, POLICY, PROVEN, PlayedDaemon, accepted, rounds

from hoopd.files.heal_policy import HealPolicy
from hoopd.heal.loop_watch import LoopWatch
from hoopd.heal.plan import HealPlan


def test_minutes_in_which_the_law_does_not_act_are_no_round_of_the_watch(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.run(20.0)
    daemon.running = False
    daemon.run(300.0)
    assert rounds(daemon) == [] and daemon.healing.phase == "settling"
    daemon.running = True
    begins = daemon.t
    daemon.run(200.0)
    assert daemon.healing.phase == "watching" and daemon.versions.read(1).evidence["watched"]
    assert len(rounds(daemon)) == 4 and rounds(daemon)[0].from_s >= begins


def test_a_fault_under_what_was_accepted_is_a_bad_round_and_two_take_it_back(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    for names in (("ball_runaway", "ball_lost"), ("ball_runaway",)):
        daemon.run(10.0)
        assert daemon.state() == "accepted"
        daemon.running = False
        daemon.run(0.1)
        for name in names:
            daemon.healing.note("fault", {"fault": name})
        daemon.run(60.0)
        daemon.running = True
    assert daemon.state() == "rolled_back" and daemon.versions.loop().acting == 0
    assert daemon.versions.read(1).reason.startswith("ball_runaway: ")


@pytest.mark.parametrize("name", ["overrun_persistent", "camera_late", "ball_runaway"])
def test_a_fault_that_is_none_of_the_law_is_no_bad_round(name: str, tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    if name == "ball_runaway":  # while nobody controls
        daemon.running = False
        daemon.run(10.0)
    daemon.healing.note("fault", {"fault": name})
    assert len(daemon.versions.read(1).evidence["rounds"]) == 1  # the trial


def test_what_was_found_beside_another_version_than_the_one_that_acts_is_left(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", policy=None)
    daemon.drift()
    daemon.run(200.0, lambda: daemon.state() == "proposed")
    daemon.healing.note("controller", {"command": "controller", "sha256": "f" * 64})
    daemon.versions.first("other.yaml@ffffffffffff", "law", "model", daemon.t, "ann")
    daemon.begin()
    assert daemon.state() == "left" and daemon.healing.phase == "watching"
    assert daemon.versions.read(1).reason == "it was found beside version 0, and version 2 acts"


def test_a_diagnosis_is_remembered_when_the_watch_over_its_version_has_ended_well(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "good")
    assert "remember" not in [one.name for one in daemon.works]
    daemon.run(200.0)
    assert [(one.name, one.number) for one in daemon.works].count(("remember", 1)) == 1
    bad = accepted(tmp_path / "bad")
    bad.answers["weigh"] = BAD
    bad.run(200.0)
    assert bad.state() == "rolled_back" and "remember" not in [one.name for one in bad.works]


def test_a_fault_that_began_before_anybody_listened_is_of_the_minutes(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.faults = ("ball_missing", "frame_bad")
    daemon.run(100.0)
    daemon.healing.note("model_drift", {})
    daemon.run(60.0, lambda: bool(daemon.works))
    assert daemon.versions.read(1).faults_s == {"ball_missing": pytest.approx(40.0, abs=0.1)}


def test_a_fault_whose_end_nobody_heard_ends_with_the_status(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.run(10.0)
    daemon.healing.note("fault", {"fault": "ball_missing"})
    daemon.run(300.0)
    daemon.drift()
    daemon.run(60.0, lambda: bool(daemon.works))
    assert daemon.versions.read(1).faults_s == {}


def test_a_word_about_a_fault_is_believed_before_a_status_that_may_be_older(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.run(95.0)
    daemon.healing.note("fault", {"fault": "ball_missing"})  # the status has none of it yet
    daemon.run(1.0)
    daemon.faults = ("ball_missing",)
    daemon.healing.note("fault_cleared", {"fault": "ball_missing"})  # and has it still
    daemon.run(1.0)
    daemon.faults = ()
    daemon.run(3.0)
    daemon.drift()
    daemon.run(60.0, lambda: bool(daemon.works))
    assert daemon.versions.read(1).faults_s == {"ball_missing": pytest.approx(1.0, abs=0.05)}


def test_a_fault_that_a_status_told_before_its_event_is_over_when_it_is_over() -> None:
    watch = LoopWatch()
    watch.tick(10.0, running=True)
    watch.faults_are(["ball_missing"])
    watch.fault_begins("ball_missing")
    watch.tick(12.0, running=True)
    watch.fault_ends("ball_missing")
    assert watch.faults_s(0.0, 100.0) == {"ball_missing": 2.0} and watch.faults_s(60.0, 100.0) == {}


def test_a_trial_that_is_never_weighed_goes_back(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "weighing")
    daemon._due = None  # whoever computes it is gone
    daemon.run(290.0)
    assert daemon.state() == "trying"
    daemon.run(20.0)
    assert daemon.names == ["trial", "revert"] and daemon.state() == "went_back"
    assert daemon.versions.read(1).reason == "it was not weighed within 300 s"


@pytest.mark.parametrize(("acts", "state", "acting"), [(0, "rolled_back", 0), (1, "accepted", 1)])
def test_a_roll_back_of_which_nobody_heard_is_told_by_the_status(
    acts: int, state: str, acting: int, tmp_path: Path
) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.answers["weigh"] = BAD
    daemon.tells = False
    daemon.acting = daemon.versions.read(1).key
    daemon.run(200.0, lambda: daemon.healing.phase == "rolling")
    daemon.acting = daemon.versions.read(acts).key
    daemon.run(40.0)
    assert daemon.healing.phase == "watching" and daemon.state() == state
    assert daemon.versions.loop().acting == acting
    assert ("did not take over within 25 s" in daemon.versions.read(1).reason) is (acts == 1)


@pytest.mark.parametrize(
    "reason", ["the mode is FAULT (ball_runaway)", "the mode is DISARMED", "the estimate was lost"]
)
def test_a_trial_that_a_fault_or_a_person_ended_is_not_tried_again(reason: str, tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "trying")
    daemon.run(20.0)
    daemon.healing.note("trial_returned", {"reason": reason})
    daemon.running = False
    daemon.run(10.0)
    daemon.running = True
    daemon.run(60.0)
    assert daemon.names == ["trial"] and daemon.state() == "went_back"
    assert daemon.versions.read(1).reason == reason


def waiting_for_the_pause(folder: Path, pause_s: float) -> PlayedDaemon:
    """A second change, found while the policy's pause after the first one goes on."""
    told = {"schema": "hoopd.policy/1", "effects": ["hoop.*"], "pause_s": pause_s}
    daemon = PlayedDaemon(folder, policy=HealPolicy(**told))
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state() == "accepted")
    daemon.run(150.0)
    daemon.answers["prove"] = {**PROVEN, "key": "heal-2.yaml@def123def123"}
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state(2) == "proposed")
    assert "the policy's pause is" in daemon.versions.read(2).history[-1][1]
    return daemon


def test_the_policy_is_asked_again_when_its_pause_is_over(tmp_path: Path) -> None:
    daemon = waiting_for_the_pause(tmp_path / "soon", 400.0)
    daemon.run(400.0, lambda: daemon.state(2) == "accepted")
    assert daemon.versions.loop().acting == 2
    late = waiting_for_the_pause(tmp_path / "late", 1000.0)
    late.run(900.0)
    assert "s old, a policy tries nothing older than 600 s" in late.versions.read(2).reason
    late.run(250.0)
    assert late.versions.loop().acting == 3  # of the newest seconds


def test_a_proof_that_is_old_when_it_goes_on_is_not_tried_by_the_policy(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", policy=None)
    daemon.drift()
    daemon.run(200.0, lambda: daemon.state() == "proposed")
    daemon.policy, daemon.t = POLICY, daemon.t + 7200.0
    daemon.begin(run="two")
    assert daemon.state() == "left" and daemon.healing.phase == "watching"


def test_a_change_of_what_was_0_is_read_again_by_the_next(tmp_path: Path) -> None:
    grown = {**FRICTION, "parameters": {"hoop.dahl_of_theta.Fc": None}, "values": {"hoop.dahl_of_theta.Fc": 1e-4}}
    daemon = PlayedDaemon(tmp_path / "healed", answers={"diagnose": grown})
    daemon.drift()
    daemon.run(200.0, lambda: daemon.state() == "proposed")
    daemon.begin()
    assert daemon.state() == "proposed" and "was 0" in daemon.versions.read(1).history[-1][1]


@pytest.mark.parametrize(("who", "state"), [("ann", "proposed"), ("policy", "trying")])
def test_what_a_person_accepted_beyond_the_policy_does_not_come_back_by_it(
    who: str, state: str, tmp_path: Path
) -> None:
    daemon = accepted(tmp_path / "healed")
    version = daemon.versions.read(1)
    version.decided_by = who
    daemon.versions.keep(version, daemon.t)
    daemon.versions.acts(0)
    daemon.answers["prove"] = {**PROVEN, "restores": 1}
    daemon.policy = HealPolicy(schema="hoopd.policy/1", effects=["camera.*"], pause_s=0.0)
    daemon.begin()
    daemon.drift()
    daemon.run(200.0, lambda: daemon.state(2) == "proposed")
    daemon.run(10.0)
    assert daemon.state(2) == state


def test_minutes_before_the_law_acted_are_neither_diagnosed_nor_a_proof(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", plan=HealPlan(every_s=600.0))
    daemon.running = False
    daemon.run(700.0)
    daemon.running = True
    daemon.run(60.0, lambda: bool(daemon.works))
    assert daemon.works[0].from_s >= 700.0 and daemon.works[0].to_s == pytest.approx(740.0, abs=0.1)
    daemon.run(60.0, lambda: daemon.healing.phase == "waiting")
    daemon.running = False
    daemon.run(100.0)
    daemon.running, begins = True, daemon.t
    daemon.run(60.0, lambda: len(daemon.works) > 1)
    assert daemon.works[1].name == "prove" and daemon.works[1].from_s >= begins
    assert daemon.works[1].to_s - daemon.works[1].from_s >= 20.0 - PERIOD_S


def test_minutes_of_the_law_before_are_not_diagnosed_again_when_another_is_accepted(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", plan=HealPlan(every_s=60.0, window_s=100.0))
    daemon.run(600.0, lambda: daemon.state() == "accepted")
    since = daemon.t
    daemon.run(300.0, lambda: daemon.works[-1].name == "diagnose")
    assert daemon.works[-1].name == "diagnose" and daemon.works[-1].from_s >= since


def test_what_was_not_remembered_before_a_kill_is_remembered_by_the_next(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.run(400.0)
    assert daemon.works[-1].name == "remember" and daemon.versions.read(1).evidence["watched"]
    version = daemon.versions.read(1)
    del version.evidence["remembered"]  # killed between the two
    daemon.versions.keep(version, daemon.t)
    daemon.versions.add(daemon.t, state="left", reason="something newer")
    for asked in ([("remember", 1)], []):
        again = PlayedDaemon(tmp_path / "healed")
        again.run(10.0)
        assert [(work.name, work.number) for work in again.works] == asked
        assert again.healing.phase == "watching"


def test_what_waits_to_be_remembered_is_not_lost_to_what_is_computed(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.answers["remember"] = {}  # by one without a memory
    daemon.run(200.0)
    assert daemon.versions.read(1).evidence["watched"] and "remembered" not in daemon.versions.read(1).evidence
    daemon.versions.add(daemon.t, run="one", to_s=40.0, before=1)  # whose diagnosis was broken off
    daemon.works.clear()
    daemon.begin()
    daemon.run(1.0)
    assert {(one.name, one.number) for one in daemon.works} == {("remember", 1), ("diagnose", 2)}
