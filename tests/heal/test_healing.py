"""A loop that is followed, against a daemon that is played: what it asks for, when, and where it goes on."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from hoopd.core.succession import REVERTED
from hoopd.design.comparison import WantedCommand
from hoopd.design.yardstick import TickSample
from hoopd.files.heal_policy import HealPolicy
from hoopd.files.heal_versions import HealDecision, VersionFolder
from hoopd.files.reading import InputError
from hoopd.heal.healing import Healing
from hoopd.heal.plan import HealPlan, HealWork
from hoopd.heal.weighing import verdict

PERIOD_S, COMPUTES_S = 0.02, 5.0
POLICY = HealPolicy(
    schema="hoopd.policy/1", effects=["hoop.*"], largest={"hoop.coulomb_friction.Fc": 0.02}, pause_s=0.0
)
FRICTION = {
    "kind": "physics", "reason": "new: hoop.coulomb_friction", "learn": True,
    "effects": {"hoop.coulomb_friction": {"Fc": 0.006}}, "probabilities": {"hoop.coulomb_friction": 0.9},
    "parameters": {},
}  # fmt: skip
PROVEN = {
    "proven": True, "why": "90 nats", "key": "heal-1.yaml@abc123abc123", "restores": None,
    "promise": {"measured": 1.0, "before": 1.0, "new": 0.8},
}  # fmt: skip
GOOD, BAD = {"measured": 0.8, "before": 1.0, "new": 0.8}, {"measured": 1.4, "before": 1.0, "new": 0.8}


@dataclass
class PlayedDaemon:
    """Answers what a healing asks for, and computes what it is told to."""

    folder: Path
    policy: HealPolicy | None = POLICY
    answers: dict[str, Any] = field(default_factory=dict)
    plan: HealPlan = field(default_factory=HealPlan)
    takes: bool = True
    tells: bool = True

    def __post_init__(self) -> None:
        self.t, self.running, self.faults, self.acting = 0.0, True, tuple[str, ...](), ""
        self.orders: list[tuple[float, WantedCommand]] = []
        self.works: list[HealWork] = []
        self._due: tuple[float, HealWork] | None = None
        self.versions = VersionFolder(self.folder)
        if not self.folder.exists():
            self.versions.begin("hoop")
            self.versions.first("lqg.yaml@000000000000", "law", "model", 0.0, "me")
        self.answers = {"diagnose": FRICTION, "prove": PROVEN, "weigh": GOOD, "remember": {}} | self.answers
        self.begin()

    def begin(self, run: str = "one") -> None:
        """A healing of this folder."""
        self.healing = Healing(self.versions, self.plan, self.policy, lambda: self.t, run)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Ticks, until something is so."""
        end = self.t + seconds
        while self.t < end and not until():
            self.t = round(self.t + PERIOD_S, 6)
            self.healing.see(self.faults, self.acting)
            nan = float("nan")
            for order in self.healing.put(TickSample(self.t, self.running, 0.0, 0.0, nan, nan, 0.0)):
                self._obey(order)
            if (work := self.healing.take_work()) is not None:
                self.works.append(work)
                self._due = (self.t + COMPUTES_S, work)
            if self._due is not None and self.t >= self._due[0]:
                done, self._due = self._due[1], None
                self.healing.done(done, self.answers[done.name])

    def _obey(self, order: WantedCommand) -> None:
        self.orders.append((self.t, order))
        if order.name in ("trial", "controller") and self.tells:
            if self.takes:
                told = {"command": order.name, "sha256": order.key.partition("@")[2] + "0" * 52}
                self.healing.note("controller", told)
            else:
                self.healing.note("command_refused", {"command": order.name, "reason": "the model does not fit"})
        if order.name == "accept":
            self.healing.note("operator", {"command": "accept"})
        if order.name == "revert":
            self.healing.note("trial_returned", {"reason": REVERTED})
        if order.name == "clear":
            self.faults = ()

    def drift(self) -> None:
        """The model no longer fits."""
        self.faults = ("model_drift",)
        self.healing.note("model_drift", {"channels": ["dtheta"]})

    @property
    def names(self) -> list[str]:
        """Of the orders but `alive`."""
        return [order.name for _, order in self.orders if order.name != "alive"]

    def state(self, number: int = 1) -> str:
        """Of a version."""
        return self.versions.read(number).state if number in self.versions.numbers() else ""


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
    assert daemon.names == ["trial", "accept", "clear"] and daemon.versions.loop().acting == 1
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
    assert daemon.names == ["trial", "accept", "clear", "controller", "clear"]
    assert daemon.orders[-2][1].key == "lqg.yaml@000000000000"
    assert daemon.state() == "rolled_back" and daemon.versions.loop().acting == 0


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
    again = PlayedDaemon(tmp_path / "healed")
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


def accepted(folder: Path) -> PlayedDaemon:
    """A daemon whose new version is accepted just now."""
    daemon = PlayedDaemon(folder)
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state() == "accepted")
    return daemon


def rounds(daemon: PlayedDaemon) -> list[HealWork]:
    """What was weighed after the trial."""
    return [one for one in daemon.works if one.name == "weigh"][1:]


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
