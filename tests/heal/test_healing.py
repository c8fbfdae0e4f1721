"""A loop that is followed, against a daemon that is played: what it asks for, when, and where it goes on."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest
from heal.played_daemon import BAD, COMPUTES_S, FRICTION, GOOD, PROVEN, PlayedDaemon

from hoopd.files.heal_policy import HealPolicy
from hoopd.files.heal_versions import HealDecision
from hoopd.files.reading import InputError
from hoopd.heal.weighing import WeighedRounds, gone_again, verdict

GONE = {"nats": 40.0, "errors": 4.0, "seconds": 25.0, "share": 0.3}


def test_a_change_is_diagnosed_from_where_it_is_certain_tried_and_accepted_by_the_policy(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.run(100.0)
    assert daemon.works == [] and daemon.orders == []
    daemon.drift()
    daemon.run(40.0, lambda: bool(daemon.works))
    assert daemon.works[0].from_s == pytest.approx(100.0 - 10.0, abs=0.05) and daemon.works[0].to_s == pytest.approx(
        130.0
    )
    daemon.run(100.0, lambda: daemon.state() == "accepted")
    assert daemon.names == ["trial", "accept"] and [one.name for one in daemon.works] == ["diagnose", "prove", "weigh"]
    # nothing that proves it was fitted
    assert daemon.works[1].from_s >= daemon.works[0].to_s
    alive = [t for t, order in daemon.orders if order.name == "alive"]
    assert max(b - a for a, b in itertools.pairwise(alive)) < 2.0
    daemon.run(200.0)
    assert daemon.names == ["trial", "accept"] and daemon.versions.loop().acting == 1
    assert daemon.versions.read(1).decided_by == "policy" and daemon.healing.phase == "watching"


def test_without_a_policy_a_person_accepts(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", policy=None)
    daemon.drift()
    daemon.run(200.0)
    assert daemon.state() == "proposed" and daemon.orders == []
    daemon.versions.decide(1, HealDecision(accept=True, who="ann"))
    decision = daemon.versions.decision(1)
    assert decision is not None
    daemon.healing.decide(decision.accept, decision.who)
    daemon.run(50.0)
    assert daemon.state() == "accepted" and daemon.versions.read(1).decided_by == "ann"
    with pytest.raises(InputError, match="1: is accepted, not proposed"):
        daemon.versions.decide(1, HealDecision(accept=False, who="ann"))


@pytest.mark.parametrize(
    ("policy", "why"),
    [
        ({"effects": ["camera.*"]}, "hoop.coulomb_friction is not among the policy's effects"),
        ({"largest": {"hoop.coulomb_friction.Fc": 0.003}}, "Fc is 0.006, the policy's largest is 0.003"),
        ({"least_probability": 0.95}, "hoop.coulomb_friction is 90% sure, the policy asks for 95%"),
        ({"most_per_day": 0}, "0 versions were accepted within a day, the policy's most is 0"),
    ],
)  # fmt: skip
def test_what_the_policy_does_not_let_pass_waits_for_a_person(policy: dict[str, Any], why: str, tmp_path: Path) -> None:
    told = {"schema": "hoopd.policy/1", "effects": ["hoop.*"], **policy}
    daemon = PlayedDaemon(tmp_path / "healed", policy=HealPolicy(**told))
    daemon.drift()
    daemon.run(200.0)
    assert daemon.state() == "proposed" and daemon.orders == []
    assert why in daemon.versions.read(1).history[-1][1]


def test_a_broken_sensor_is_left_and_looked_at_ever_more_seldom(tmp_path: Path) -> None:
    sensor = {"kind": "sensor", "reason": "camera.outliers", "learn": False}
    daemon = PlayedDaemon(tmp_path / "healed", answers={"diagnose": sensor})
    daemon.drift()
    daemon.run(2000.0)
    assert daemon.orders == [] and {one.name for one in daemon.works} == {"diagnose"}
    assert {one.state for one in daemon.versions.every()} == {"accepted", "left"}
    begun = [one.to_s for one in daemon.works]
    assert [round(b - a, -2) for a, b in itertools.pairwise(begun)] == [300.0, 600.0]


def test_what_no_fresh_seconds_prove_is_left(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", answers={"prove": {"proven": False, "why": "not proven: 1.0 nats"}})
    daemon.drift()
    daemon.run(100.0)
    assert daemon.state() == "left" and daemon.orders == []


def test_a_trial_that_costs_more_goes_back(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", answers={"weigh": BAD})
    daemon.drift()
    daemon.run(200.0)
    assert daemon.names == ["trial", "revert"] and daemon.state() == "went_back"
    assert daemon.versions.loop().acting == 0


def test_what_was_learned_and_has_gone_again_goes_back_though_it_costs_no_more_than_promised(tmp_path: Path) -> None:
    gone = GOOD | {"gain_of_before": GONE}
    trial = PlayedDaemon(tmp_path / "trial", answers={"weigh": gone})
    trial.drift()
    trial.run(200.0)
    assert trial.names == ["trial", "revert"] and trial.state() == "went_back"
    assert trial.versions.read(1).reason == "the model of before explains it better: 40 nats on 25 s"
    watched = PlayedDaemon(tmp_path / "watched")
    watched.drift()
    watched.run(300.0, lambda: watched.healing.phase == "settling")
    watched.answers["weigh"] = gone
    watched.run(60.0, lambda: watched.healing.phase == "weighing")
    watched.run(6.0)
    assert watched.state() == "accepted"  # one round is none
    watched.run(100.0)
    assert watched.state() == "rolled_back" and watched.versions.loop().acting == 0
    assert [one["bad"] != "" for one in watched.versions.read(1).evidence["rounds"]] == [False, True, True]


@pytest.mark.parametrize(
    "less",
    [
        {"nats": 2.9}, {"nats": -50.0, "errors": -5.0}, {"errors": 1.9},
        {"share": 0.05},  # two filters of one device, at rest
        {"seconds": 250.0},  # another regime: half as fast as it had been proven
    ],
)  # fmt: skip
def test_a_model_that_the_one_of_before_does_not_clearly_beat_has_not_gone(less: dict[str, float]) -> None:
    proof = {"gain": {"nats": 20.0, "errors": 6.0, "seconds": 25.0, "share": 0.2}}
    assert gone_again({"gain_of_before": GONE}, proof) and not gone_again({"gain_of_before": GONE | less}, proof)
    assert not gone_again({}, proof) and gone_again({"gain_of_before": GONE}, {})


def test_a_watch_whose_last_round_is_bad_goes_on_for_one_more() -> None:
    rounds = WeighedRounds()
    for bad in ("", "", "", "dear"):
        rounds.add(bad)
    assert not rounds.is_settled and not rounds.is_given_up
    rounds.add("")
    assert rounds.is_settled


def test_what_the_daemon_refuses_or_takes_back_is_written_down(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", takes=False)
    daemon.drift()
    daemon.run(200.0)
    assert daemon.state() == "refused" and "does not fit" in daemon.versions.read(1).reason
    other = PlayedDaemon(tmp_path / "other")
    other.drift()
    other.run(200.0, lambda: other.healing.phase == "trying")
    other.healing.note("trial_returned", {"reason": "cost 0.1 rad^2"})
    other.run(20.0, lambda: other.healing.phase == "trying")
    assert other.names == ["trial", "trial"]  # once more: the guard judges single seconds
    other.healing.note("trial_returned", {"reason": "cost 0.2 rad^2"})
    assert other.state() == "went_back" and other.versions.read(1).reason == "cost 0.2 rad^2"


def test_what_is_weighed_of_a_trial_that_went_back_meanwhile_accepts_nothing(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "weighing")
    daemon.healing.note("trial_returned", {"reason": "cost 0.1 rad^2"})
    daemon.run(COMPUTES_S + 1.0)  # the figures come now: they say that it may be tried again, and no more
    assert daemon.names == ["trial", "trial"] and daemon.state() == "trying"
    assert daemon.versions.loop().acting == 0


def test_what_one_second_of_a_trial_took_back_is_weighed_by_all_of_them(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "good")
    daemon.drift()
    for tried in (1, 2, 3):
        daemon.run(200.0, lambda: daemon.healing.phase == "trying")
        daemon.run(20.0)
        daemon.healing.note("trial_returned", {"reason": "cost 0.1 rad^2"})
        assert daemon.versions.read(1).evidence["tries"] == tried and daemon.healing.phase == "weighing"
    daemon.run(200.0, lambda: daemon.state() == "accepted")  # it kept its promise three times
    assert daemon.names == ["trial"] * 4 + ["accept"]
    bad = PlayedDaemon(tmp_path / "bad", answers={"weigh": BAD})
    bad.drift()
    bad.run(200.0, lambda: bad.healing.phase == "trying")
    bad.run(20.0)
    bad.healing.note("trial_returned", {"reason": "cost 0.1 rad^2"})
    bad.run(COMPUTES_S + 1.0)
    assert bad.names == ["trial"] and bad.state() == "went_back"
    assert "cost 0.1" in bad.versions.read(1).reason and "were promised" in bad.versions.read(1).reason


def test_another_s_trial_while_one_that_went_back_is_weighed_accepts_nothing(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "trying")
    daemon.run(20.0)
    daemon.healing.note("trial_returned", {"reason": "cost 0.1 rad^2"})
    daemon.healing.note("controller", {"command": "trial", "sha256": "f" * 64})
    assert daemon.state() == "went_back" and daemon.versions.loop().acting == 0
    daemon.run(COMPUTES_S + 1.0)
    assert daemon.state() == "went_back"


def test_it_rolls_back_by_itself_when_the_change_goes_away_again(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state() == "accepted")
    daemon.run(10.0)
    daemon.answers["weigh"] = BAD
    daemon.run(200.0)
    assert daemon.names == ["trial", "accept", "controller"]
    assert daemon.orders[-1][1].key == "lqg.yaml@000000000000"
    assert daemon.state() == "rolled_back" and daemon.versions.loop().acting == 0


def test_it_rolls_back_to_the_copy_that_nobody_else_writes_to(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    found = daemon.versions.read(0)
    found.copy = "heal-0-12345678.yaml@999999999999"
    daemon.versions.keep(found, 0.0)
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state() == "accepted")
    daemon.answers["weigh"] = BAD
    daemon.run(200.0, lambda: daemon.state() == "rolled_back")
    assert daemon.orders[-1][1].key == found.copy and daemon.state() == "rolled_back"


def test_killed_in_a_trial_it_goes_on_with_what_is_proposed_and_loses_nothing(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", policy=None)
    daemon.drift()
    daemon.run(200.0)
    daemon.healing.decide(True, "ann")
    daemon.run(10.0)
    assert daemon.state() == "trying"
    before = {path: path.read_bytes() for path in (tmp_path / "healed" / "0000").iterdir()}
    again = PlayedDaemon(tmp_path / "healed", policy=None)  # the daemon took the trial back meanwhile
    assert again.state() == "proposed" and again.versions.loop().acting == 0
    again.healing.decide(True, "ann")
    again.run(100.0, lambda: again.state() == "accepted")
    assert again.versions.loop().acting == 1
    assert all(path.read_bytes() == data for path, data in before.items())


@pytest.mark.parametrize("phase", ["diagnosing", "waiting", "proving"])
def test_killed_while_it_computes_it_goes_on_with_the_same_minutes(phase: str, tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == phase)
    again = PlayedDaemon(tmp_path / "healed")
    work = again.healing.take_work()
    assert work is not None and (work.name, work.number) == ("diagnose", 1)
    again.healing.done(work, FRICTION)
    again.run(300.0, lambda: again.state() == "accepted")
    assert again.versions.loop().acting == 1 and len(again.versions.numbers()) == 2


def test_minutes_that_another_run_lost_are_not_diagnosed(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "diagnosing")
    daemon.begin(run="two")
    assert daemon.state() == "left" and daemon.healing.take_work() is None


def test_somebody_else_s_controller_ends_it(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.run(5.0)
    daemon.healing.note("controller", {"command": "controller", "sha256": "f" * 64})
    daemon.run(1.0)
    assert daemon.healing.settled and "somebody else" in daemon.healing.why


def test_interrupted_in_a_trial_it_asks_for_the_accepted_one(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "trying")
    daemon.healing.stop("interrupted")
    daemon.run(1.0)
    assert daemon.names[-1] == "revert" and daemon.state() == "proposed"
    early = PlayedDaemon(tmp_path / "early")
    early.drift()
    early.run(200.0, lambda: early.healing.phase == "decided")
    early.tells = False
    early.run(10.0, lambda: early.names == ["trial"])
    early.healing.stop("interrupted before the daemon told that it acts")
    early.run(1.0)
    assert early.names == ["trial", "revert"] and early.state() == "proposed"


def test_an_earlier_version_that_explains_it_as_well_comes_back_in_place_of_a_new_one(tmp_path: Path) -> None:
    daemon = PlayedDaemon(
        tmp_path / "healed", answers={"prove": {**PROVEN, "restores": 0, "key": "lqg.yaml@000000000000"}}
    )
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state() == "accepted")
    assert daemon.versions.loop().acting == 0 and daemon.versions.read(1).acts_as == 0


def test_killed_in_a_trial_by_the_policy_it_is_tried_again(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "trying")
    again = PlayedDaemon(tmp_path / "healed", t=daemon.t)
    again.run(100.0, lambda: again.state() == "accepted")
    assert again.names == ["trial", "accept"] and again.versions.loop().acting == 1


def test_killed_before_the_daemon_said_that_it_accepted_nothing_acts_but_what_did(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "accepting")
    assert daemon.versions.loop().acting == 0 and daemon.state() == "trying"


def test_a_pause_of_the_law_begins_the_minutes_anew(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.run(30.0)
    daemon.drift()
    daemon.run(10.0)
    daemon.running = False
    daemon.run(60.0)
    assert daemon.works == []
    daemon.running = True
    daemon.run(60.0, lambda: bool(daemon.works))
    assert daemon.works[0].from_s >= 100.0 - 10.1


def test_a_file_that_was_changed_is_not_accepted(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", policy=None)
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "waiting")
    (tmp_path / "healed" / "0001" / "model.yaml").write_text("a: 1")
    daemon.run(100.0)
    assert daemon.state() == "proposed"
    (tmp_path / "healed" / "0001" / "model.yaml").write_text("a: 2")
    with pytest.raises(InputError, match=r"model\.yaml: was changed after it was proposed"):
        daemon.versions.decide(1, HealDecision(accept=True, who="ann"))


def test_a_promise_is_broken_by_more_than_a_fifth_and_more_than_before() -> None:
    promise = {"measured": 1.0, "before": 1.0, "new": 0.8}
    assert verdict({"measured": 0.95, "before": 1.0, "new": 0.8}, promise) == ""
    assert "were promised" in verdict({"measured": 1.1, "before": 1.0, "new": 0.8}, promise)
    # what the device costs more than its model in either is not the new law's fault
    assert verdict({"measured": 1.1, "before": 1.0, "new": 0.8}, promise | {"measured": 1.5}) == ""


def test_noise_in_quiet_minutes_lets_no_bad_law_pass() -> None:
    """Pictures of 4.8 mrad, minutes that hardly move, a model without any noise: added in squares, not as a ratio."""
    quiet = {"measured": 0.0052, "before": 0.0021, "new": 0.0018}
    assert "0.0363 were promised" in verdict({"measured": 0.095, "before": 0.042, "new": 0.036}, quiet)
    assert verdict({"measured": 0.006, "before": 0.0021, "new": 0.0018}, quiet) == ""
    cost = {"measured": 3.0, "before": 1.0, "new": 1.0}
    assert verdict({"measured": 3.5, "before": 2.0, "new": 1.0}, cost, "cost") == ""
    assert "3 were promised" in verdict({"measured": 4.3, "before": 2.0, "new": 1.0}, cost, "cost")
