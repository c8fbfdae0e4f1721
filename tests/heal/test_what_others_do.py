"""What others do to a loop that is followed: their laws, gains and hands are none of the version's, and are noticed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from heal.played_daemon import BAD, PERIOD_S, PlayedDaemon, accepted, rounds

OTHER: dict[str, Any] = {"sha256": "f" * 64}
BEGINS: dict[str, tuple[str, dict[str, Any]]] = {
    "trial": ("controller", {"command": "trial", **OTHER}),
    "experiment": ("controller", {"command": "experiment", **OTHER}),
    "hand": ("speed", {"speed": 2.0}),
}
ENDS: dict[str, tuple[str, dict[str, Any]]] = {
    "trial": ("trial_returned", {"reason": "reverted"}),
    "experiment": ("experiment_ended", {"reason": "done"}),
    "hand": ("speed_ended", {"reason": "the hand was silent for 1 s"}),
}


@pytest.mark.parametrize("what", BEGINS)
def test_minutes_of_another_law_or_of_a_hand_are_not_diagnosed(what: str, tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.run(100.0)
    daemon.drift()
    daemon.run(5.0)
    daemon.healing.note(*BEGINS[what])
    daemon.run(60.0)
    assert daemon.works == [] and daemon.healing.phase == "watching"
    daemon.healing.note(*ENDS[what])
    own = daemon.t
    daemon.run(60.0, lambda: bool(daemon.works))
    assert daemon.works[0].from_s >= own


@pytest.mark.parametrize("what", BEGINS)
def test_the_watch_over_what_was_accepted_goes_on_after_them(what: str, tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.run(40.0)
    daemon.healing.note(*BEGINS[what])
    begins = daemon.t
    daemon.run(100.0)
    daemon.healing.note(*ENDS[what])
    ends = daemon.t
    daemon.run(200.0)
    assert len(rounds(daemon)) == 4 and daemon.versions.read(1).evidence["watched"]
    assert all(one.to_s <= begins or one.from_s >= ends for one in rounds(daemon))
    assert daemon.state() == "accepted" and daemon.works[-1].name == "remember"


def test_a_bad_round_that_is_told_while_somebody_tries_another_law_is_weighed_anew(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.answers["weigh"] = BAD
    daemon.run(200.0, lambda: len(rounds(daemon)) == 2)
    daemon.healing.note(*BEGINS["experiment"])
    daemon.run(30.0)
    assert daemon.names == ["trial", "accept"] and daemon.healing.phase == "settling"
    daemon.healing.note(*ENDS["experiment"])
    daemon.run(100.0)
    assert daemon.names[-1] == "controller" and daemon.state() == "rolled_back"


def test_what_is_refused_to_somebody_else_is_no_refusal_of_ours(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed", tells=False)
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "asked")
    refused = {"command": "trial", "reason": "heal-1.yaml is about to take over"}
    daemon.healing.note("command_refused", refused | {"sha256": "0" * 64})
    assert daemon.healing.phase == "asked"
    daemon.healing.note("command_refused", refused | {"sha256": "abc123abc123" + "0" * 52})
    assert daemon.state() == "refused"
    rolling = accepted(tmp_path / "rolling")
    rolling.answers["weigh"], rolling.tells = BAD, False
    rolling.run(200.0, lambda: rolling.healing.phase == "rolling")
    rolling.healing.note("command_refused", {"command": "controller", "reason": "no", "sha256": "f" * 64})
    assert rolling.healing.phase == "rolling"


def test_a_fault_under_somebody_s_experiment_is_no_bad_round(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.run(10.0)
    daemon.healing.note(*BEGINS["experiment"])
    daemon.run(0.5)
    daemon.healing.note("fault", {"fault": "ball_runaway"})
    assert len(daemon.versions.read(1).evidence["rounds"]) == 1  # the trial


def test_a_hand_that_drove_lets_go_where_the_loop_stops(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.healing.note(*BEGINS["hand"])
    daemon.running = False
    daemon.run(1.0)
    daemon.running = True
    daemon.run(300.0, lambda: daemon.healing.phase == "watching")
    assert len(rounds(daemon)) == 4


def test_gains_that_were_tuned_are_another_law_until_a_controller_is_loaded(tmp_path: Path) -> None:
    daemon, told = accepted(tmp_path / "healed"), list[str]()
    daemon.healing._in_hand.tell = told.append
    daemon.run(10.0)
    daemon.healing.note("tuned", {"key": "k_psi", "value": 3.0})
    daemon.healing.note("tuned", {"key": "k_psi", "value": 3.1})
    daemon.run(200.0)
    assert rounds(daemon) == [] and daemon.healing.phase == "settling"
    assert len(told) == 1 and told[0].startswith("k_psi was tuned by hand") and "hoopd heal restore 1" in told[0]
    daemon.healing.note("controller", {"command": "controller", "sha256": "abc123abc123"})
    assert daemon.healing.over  # and whoever follows next begins the watch anew
    daemon.begin()
    daemon.run(200.0)
    assert len(rounds(daemon)) == 4


def test_gains_that_are_tuned_in_a_trial_end_it_and_it_is_proposed_again(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.phase == "trying")
    daemon.run(5.0)
    daemon.healing.note("tuned", {"key": "k_psi", "value": 3.0})
    daemon.run(1.0, lambda: daemon.state() == "proposed")
    assert daemon.versions.read(1).history[-1][1] == "its trial was broken off: k_psi was tuned by hand"
    daemon.run(200.0, lambda: daemon.state() == "accepted")  # what was tuned went with the trial
    assert daemon.names == ["trial", "revert", "trial", "accept"]


def test_a_roll_back_is_over_when_the_controller_of_before_has_taken_over_and_no_other(tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.answers["weigh"], daemon.tells = BAD, False
    daemon.run(200.0, lambda: daemon.healing.phase == "rolling")
    daemon.healing.note(*BEGINS["trial"])
    assert daemon.healing.phase == "rolling"
    daemon.healing.note("controller", {"command": "controller", "sha256": "0" * 64})
    assert daemon.state() == "rolled_back" and daemon.versions.loop().acting == 0
    other = accepted(tmp_path / "other")
    other.answers["weigh"], other.tells = BAD, False
    other.run(200.0, lambda: other.healing.phase == "rolling")
    other.healing.note("controller", {"command": "controller", **OTHER})
    assert other.healing.over and "somebody else" in other.healing.why and other.state() == "accepted"


def test_a_controller_that_only_a_status_tells_of_ends_it(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.acting = "lqg.yaml@000000000000"
    daemon.run(20.0)
    daemon.acting = "mine.yaml@" + "f" * 64  # a status that is older than the last word would be corrected by the next
    daemon.run(2.0)
    assert not daemon.healing.over
    daemon.run(2.0)
    assert daemon.healing.settled
    assert daemon.healing.why == "mine.yaml acts, which is no version here: begin again with it"


@pytest.mark.parametrize("by", ["a status", "an event"])
def test_a_roll_back_that_comes_late_is_a_version_that_acts(by: str, tmp_path: Path) -> None:
    daemon = accepted(tmp_path / "healed")
    daemon.answers["weigh"], daemon.tells = BAD, False
    daemon.acting = daemon.versions.read(1).key
    daemon.run(300.0, lambda: daemon.healing.phase == "watching")
    assert daemon.state() == "accepted" and "did not take over within 25 s" in daemon.versions.read(1).reason
    if by == "a status":
        daemon.acting = daemon.versions.read(0).key
    else:
        daemon.healing.note("controller", {"command": "controller", "sha256": "0" * 64})
    daemon.run(4.0)
    assert daemon.healing.settled and daemon.healing.why == "version 0 acts: begin again with it"


def test_a_copy_of_the_version_and_what_was_accepted_just_now_are_no_others(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    found = daemon.versions.read(0)
    found.copy = "heal-0-12345678.yaml@999999999999"
    daemon.versions.keep(found, 0.0)
    daemon.acting = found.copy
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state() == "trying")
    daemon.acting = ""  # while the trial acts
    daemon.run(300.0, lambda: daemon.state() == "accepted")
    daemon.run(2.0)
    daemon.acting = daemon.versions.read(1).key
    daemon.run(200.0)
    assert daemon.healing.phase == "watching" and not daemon.healing.over and len(rounds(daemon)) == 4


def test_another_law_whose_begin_or_end_nobody_heard_is_told_by_the_status(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    own = "lqg.yaml@000000000000"
    daemon.acting = own
    daemon.run(100.0)
    daemon.acting = ""
    daemon.run(10.0)
    daemon.drift()
    daemon.run(60.0)
    assert daemon.works == []
    daemon.acting, since = own, daemon.t
    daemon.run(60.0, lambda: bool(daemon.works))
    assert daemon.works[0].from_s >= since
    late = PlayedDaemon(tmp_path / "late")
    late.acting = own
    late.run(10.0)
    late.healing.note(*BEGINS["experiment"])  # the status is older than this word
    late.run(1.0)
    assert late.healing._in_hand.watch.running is False
    late.run(3.0 + PERIOD_S)  # and never tells of it: it is over
    assert late.healing._in_hand.watch.running is True


def test_a_law_that_somebody_tried_and_accepted_ends_it(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.run(5.0)
    daemon.healing.note(*BEGINS["trial"])
    daemon.run(5.0)
    daemon.healing.note("operator", {"command": "accept"})
    assert daemon.healing.over and "somebody else changed the controller" in daemon.healing.why


@pytest.mark.parametrize("what", ["hand", "experiment"])
@pytest.mark.parametrize("answer", ["takes over", "refuses", "says nothing"])
def test_who_acts_while_a_trial_is_asked_for_does_not_end_it(what: str, answer: str, tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.tells = False
    daemon.run(200.0, lambda: daemon.healing.phase == "asked")
    daemon.healing.note(*BEGINS[what])
    daemon.run(1.0)
    assert daemon.healing.phase == "asked" and daemon.names == ["trial"]
    daemon.healing.note(*ENDS[what])
    if answer == "takes over":
        daemon.healing.note("controller", {"command": "trial", "sha256": "abc123abc123" + "0" * 52})
        daemon.run(2.0)
        assert daemon.state() == "trying" and [one.name for _, one in daemon.orders].count("alive") >= 1
    elif answer == "refuses":
        daemon.healing.note("command_refused", {"command": "trial", "reason": "mine.yaml is on experiment"})
        assert daemon.state() == "refused"
    else:
        daemon.run(25.0)
        assert daemon.state() == "refused" and "within 25 s" in daemon.versions.read(1).reason


def test_a_loop_that_stops_while_a_trial_is_asked_for_ends_it(tmp_path: Path) -> None:
    daemon = PlayedDaemon(tmp_path / "healed")
    daemon.drift()
    daemon.tells = False
    daemon.run(200.0, lambda: daemon.healing.phase == "asked")
    daemon.running = False
    daemon.run(0.1)
    assert daemon.state() == "went_back" and daemon.versions.read(1).reason == "the law no longer acts"
