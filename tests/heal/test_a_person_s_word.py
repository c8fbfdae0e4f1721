"""A person's word about a version acts whatever has become of it meanwhile, and ends with what it was said of."""

from __future__ import annotations

from pathlib import Path

import pytest
from heal.played_daemon import POLICY, PlayedDaemon

from hoopd.files.heal_policy import HealPolicy
from hoopd.files.heal_versions import HealDecision
from hoopd.files.reading import InputError

YES, NO = HealDecision(accept=True, who="ann"), HealDecision(accept=False, who="bob")


def proposed(folder: Path, policy: HealPolicy | None = None) -> PlayedDaemon:
    """A version that waits for a word."""
    daemon = PlayedDaemon(folder, policy=policy)
    daemon.drift()
    daemon.run(200.0, lambda: daemon.healing.version is not None and bool(daemon.state() in ("proposed", "trying")))
    return daemon


def says(daemon: PlayedDaemon, decision: HealDecision) -> None:
    """By the command, of which the process learns with its next look."""
    daemon.versions.decide(1, decision)
    daemon.run(0.1)


def test_a_no_after_a_yes_ends_it_before_the_trial_begins(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed")
    daemon.running = False
    says(daemon, YES)
    assert daemon.healing.phase == "decided"
    says(daemon, NO)
    daemon.running = True
    daemon.run(30.0)
    assert daemon.state() == "left" and daemon.orders == [] and daemon.versions.read(1).decided_by == "bob"


def test_a_no_that_comes_with_the_trial_takes_it_back(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed", POLICY)
    daemon.run(200.0, lambda: daemon.healing.phase == "trying")
    with pytest.raises(InputError, match="1: is trying, not proposed"):
        daemon.versions.decide(1, YES)
    says(daemon, NO)
    daemon.run(100.0)
    assert daemon.names == ["trial", "revert"] and daemon.state() == "went_back"
    assert daemon.versions.read(1).reason == "left by bob" and daemon.versions.loop().acting == 0


def test_a_no_while_the_daemon_makes_the_trial_ready_takes_it_back_when_it_acts(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed", POLICY)
    daemon.tells = False
    daemon.run(20.0, lambda: daemon.healing.phase == "asked")
    says(daemon, NO)
    assert daemon.healing.phase == "asked"
    daemon.healing.note("controller", {"command": "trial", "sha256": "abc123abc123"})
    daemon.run(1.0)
    assert daemon.names == ["trial", "revert"] and daemon.state() == "went_back"


def test_a_no_that_the_daemon_s_acceptance_overtakes_brings_the_version_of_before_back(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed", POLICY)
    daemon.run(200.0, lambda: daemon.healing.phase == "weighing")
    daemon.versions.decide(1, NO)
    daemon.healing.done(daemon.works[-1], daemon.answers["weigh"])  # in the same look, before the word is read
    daemon.run(10.0)
    assert daemon.names == ["trial", "accept", "controller"] and daemon.state() == "rolled_back"
    assert daemon.versions.read(1).reason == "left by bob"


def test_a_no_while_one_that_the_daemon_took_back_is_weighed_ends_it(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed", POLICY)
    daemon.run(200.0, lambda: daemon.healing.phase == "trying")
    daemon.run(20.0)
    daemon.healing.note("trial_returned", {"reason": "cost 0.1 rad^2"})
    says(daemon, NO)
    daemon.run(30.0)
    assert daemon.names == ["trial"] and daemon.state() == "went_back"
    assert daemon.versions.read(1).reason == "cost 0.1 rad^2; left by bob"


def test_a_yes_is_of_one_trial_broken_off_a_person_is_asked_again(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed")
    says(daemon, YES)
    daemon.run(20.0, lambda: daemon.healing.phase == "trying")
    daemon.healing.stop("interrupted")
    daemon.run(0.1)
    assert daemon.state() == "proposed" and daemon.versions.waiting() == [1]
    assert daemon.versions.decision(1) is None and (daemon.versions.of(1) / "decision_1.json").exists()
    daemon.t += 3 * 86400.0
    daemon.orders.clear()
    daemon.begin("two")
    daemon.run(20.0)
    assert daemon.orders == [] and daemon.state() == "proposed"
    says(daemon, YES)
    daemon.run(100.0, lambda: daemon.state() == "accepted")
    assert daemon.state() == "accepted"


def test_a_proof_of_a_time_to_come_is_none_for_a_policy(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed")
    version = daemon.versions.read(1)
    version.evidence["proven_at"] = daemon.t + 5000.0
    daemon.versions.keep(version, daemon.t)
    daemon.policy = POLICY
    daemon.begin()
    assert daemon.state() == "left"
    assert daemon.versions.read(1).reason.startswith("its proof is of a time to come: the clock was set back by 5000 s")


def with_a_model(folder: Path) -> tuple[PlayedDaemon, Path]:
    """A version that waits for a word, with a file whose hash is known."""
    daemon = PlayedDaemon(folder, policy=None)
    daemon.drift()
    daemon.run(200.0, lambda: daemon.state() == "diagnosing")
    model = daemon.versions.of(1) / "model.yaml"
    model.write_text("a: 1\n")
    daemon.run(200.0, lambda: daemon.state() == "proposed")
    return daemon, model


def test_a_trial_whose_files_were_touched_is_taken_back_by_a_no(tmp_path: Path) -> None:
    daemon, model = with_a_model(tmp_path / "healed")
    says(daemon, YES)
    daemon.run(30.0, lambda: daemon.healing.phase == "trying")
    model.write_text("a: 2\n")
    says(daemon, NO)
    assert daemon.names == ["trial", "revert"] and daemon.state() == "went_back"


def test_a_version_whose_files_were_touched_takes_no_yes(tmp_path: Path) -> None:
    daemon, model = with_a_model(tmp_path / "healed")
    model.write_text("a: 2\n")
    with pytest.raises(InputError, match="was changed after it was proposed"):
        says(daemon, YES)


TRIAL_OF_OURS = {"command": "trial", "file": "heal-1.yaml", "sha256": "abc123abc123" + "0" * 52}


def asked_for(folder: Path) -> PlayedDaemon:
    """A trial that was asked for, and waits for its filter."""
    daemon = PlayedDaemon(folder)
    daemon.drift()
    daemon.tells = False
    daemon.run(200.0, lambda: daemon.healing.phase == "asked")
    return daemon


def refuses_to_revert(daemon: PlayedDaemon) -> None:
    """As the daemon does while the trial waits."""
    daemon._obey = lambda order: daemon.orders.append((daemon.t, order))


@pytest.mark.parametrize("is_over", [True, False])
def test_a_trial_that_was_broken_off_before_it_took_over_is_taken_back_when_it_does(
    is_over: bool, tmp_path: Path
) -> None:
    daemon, told = asked_for(tmp_path / "healed"), list[str]()
    daemon.healing._in_hand.tell = told.append
    refuses_to_revert(daemon)
    if is_over:
        daemon.healing.stop("interrupted")
    else:
        daemon.healing.note("tuned", {"key": "k_psi", "value": 3.0})
    daemon.run(0.1)
    daemon.healing.note("command_refused", {"command": "revert", "reason": "there is no trial"})
    assert daemon.names == ["trial", "revert"] and not daemon.healing.settled
    daemon.healing.note("controller", TRIAL_OF_OURS)
    daemon.run(0.1)
    assert daemon.names == ["trial", "revert", "revert"] and daemon.state() == "proposed"
    assert told[-1] == "the trial that was broken off took over: it is taken back"
    assert daemon.healing.settled is is_over


@pytest.mark.parametrize("answer", ["refused", "none", "returned"])
def test_what_was_broken_off_is_waited_for_until_the_daemon_has_answered(answer: str, tmp_path: Path) -> None:
    daemon = asked_for(tmp_path / "healed")
    refuses_to_revert(daemon)
    daemon.healing.stop("interrupted")
    daemon.run(0.1)
    if answer == "refused":
        daemon.healing.note("command_refused", {"command": "trial", "reason": "the model does not fit"})
    elif answer == "returned":
        daemon.healing.note("trial_returned", {"reason": "reverted"})
    else:
        daemon.run(25.0)
    daemon.run(0.1)
    assert daemon.healing.settled and daemon.names == ["trial", "revert"]


def test_a_trial_of_a_person_s_own_is_not_taken_back(tmp_path: Path) -> None:
    daemon = proposed(tmp_path / "healed")
    daemon.healing.note("controller", TRIAL_OF_OURS)
    daemon.run(10.0)
    assert daemon.orders == [] and daemon.state() == "proposed"
