"""An alternating run as its ticks see it: a made-up daemon obeys, refuses, goes wrong or is meddled with."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from math import nan
from typing import Any

import numpy as np
import pytest

from hoopd.core.succession import ALIVE, REVERT, REVERTED, TRIAL
from hoopd.design.alternation import Alternation, blocks_of
from hoopd.design.comparison import (
    BALL,
    BETTER,
    COST,
    OPEN,
    RETURNED,
    STOPPED,
    WORSE,
    ControllerComparison,
    WantedCommand,
)
from hoopd.design.side_effects import side_effects
from hoopd.design.yardstick import HeldSpeed, TickSample, Yardstick, held_speed

TICK_S = 0.02
KEY = "other.yaml@" + "ab" * 32
OURS = {"command": TRIAL, "sha256": "ab" * 32}


@dataclass
class Daemon:
    """Obeys a tick later; its ball is off by so much under each law, with some noise."""

    comparison: ControllerComparison
    off: dict[str, float] = field(default_factory=lambda: {"A": 0.02, "B": 0.02})
    torque: dict[str, float] = field(default_factory=lambda: {"A": 0.0, "B": 0.0})
    scatter: float = 0.0
    wait_s: float = 0.5  # until a candidate acts
    t: float = 0.0
    law: str = "A"
    reference: float = 0.0
    running: bool = True
    due: float = nan
    sent: list[tuple[float, WantedCommand]] = field(default_factory=list)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    def tick(self) -> None:
        self.t = round(self.t + TICK_S, 6)
        if self.t >= self.due:
            self.due, self.law = nan, "B"
            self.comparison.note("controller", OURS)
        off = self.off[self.law] * (1.0 + self.scatter * self.rng.standard_normal())
        u, angle = self.torque[self.law], self.reference + off
        sample = TickSample(self.t, self.running, u, 0.0, angle, self.t, self.reference)
        for order in self.comparison.put(sample):
            self.sent.append((self.t, order))
            if order.name == "reference":
                self.reference = order.value
            elif order.name == TRIAL:
                self.due = self.t + self.wait_s
            elif order.name == REVERT:
                self.law = "A"
                self.comparison.note("trial_returned", {"reason": REVERTED})

    def run(self, seconds: float = 1e4) -> None:
        end = self.t + seconds
        while self.t < end and not self.comparison.over:
            self.tick()
        self.tick()


def begun(blocks: int = 8, by: str = BALL, **settings: Any) -> Daemon:
    return Daemon(ControllerComparison(Alternation(blocks=blocks, seed=1), KEY, by=by), **settings)


def until_tried(rig: Daemon) -> Daemon:
    while rig.law != "B":
        rig.tick()
    return rig


@pytest.mark.parametrize(("b", "verdict"), [(0.01, BETTER), (0.03, WORSE)])
def test_a_clear_difference_ends_it_early_with_the_accepted_law_back(b: float, verdict: str) -> None:
    rig = begun(20, off={"A": 0.02, "B": b}, scatter=0.1)
    rig.run()
    told = rig.comparison.result()
    assert told["verdict"] == verdict and len(told["pairs"]) < 8
    assert (rig.law, rig.reference) == ("A", 0.0)
    low, high = told["ball_rms_rad"]["interval_percent"]
    assert low < 100 * (b / 0.02 - 1) < high
    assert told["ball_rms_rad"]["evidence"] >= told["ball_rms_rad"]["evidence_needed"] == 20.0


@pytest.mark.parametrize(("by", "verdict"), [(BALL, BETTER), (COST, WORSE)])
def test_what_better_means_is_chosen_before_the_run_and_told_with_it(by: str, verdict: str) -> None:
    """A law that holds the ball better for more torque."""
    rig = begun(20, by, off={"A": 0.02, "B": 0.015}, torque={"A": 0.0, "B": 0.02}, scatter=0.1)
    rig.run()
    told = rig.comparison.result()
    assert (told["verdict"], told["judged_by"]) == (verdict, by)
    assert told["ball_rms_rad"]["change_percent"] < 0.0 < told["cost"]["change_percent"]
    words = ["The cost of the design, which charges torque and speeds, rose: "] * (by == BALL)
    words += ["The torque at rest rose: 0.02 N m rms instead of 0 ("]
    assert [one.startswith(said) for one, said in zip(told["warnings"], words, strict=True)] == [True] * len(words)


def test_a_torque_at_rest_that_rose_is_told_beside_a_better_law() -> None:
    rig = begun(20, off={"A": 0.02, "B": 0.01}, torque={"A": 0.001, "B": 0.0012}, scatter=0.1)
    rig.run()
    told = rig.comparison.result()
    assert told["verdict"] == BETTER and told["torque_at_rest_nm"]["accepted"] == pytest.approx(0.001)
    (warning,) = told["warnings"]
    assert warning.startswith("The torque at rest rose: 0.0012 N m rms instead of 0.001 (+20 %, ")
    equal = begun(8, scatter=0.1, torque={"A": 0.001, "B": 0.001})
    equal.run()
    assert equal.comparison.result()["warnings"] == []


def test_a_comparison_by_something_else_is_refused() -> None:
    with pytest.raises(ValueError, match="ball or cost"):
        begun(by="beauty")


def test_equal_laws_take_all_blocks_and_are_not_told_apart() -> None:
    rig = begun(8, scatter=0.1)
    rig.run()
    assert rig.comparison.verdict == OPEN and len(rig.comparison.pairs) == 4


def test_both_blocks_of_a_pair_have_the_same_references_and_orders_are_balanced() -> None:
    for seed in range(20):
        blocks = blocks_of(Alternation(blocks=20, seed=seed))
        pairs = [blocks[k : k + 2] for k in range(0, 20, 2)]
        assert all(one.references == other.references and one.law != other.law for one, other in pairs)
        assert sum(one.law == "A" for one, _ in pairs) == 5
    assert len({tuple(block.law for block in blocks_of(Alternation(seed=seed))) for seed in range(20)}) > 10


def test_what_settles_does_not_count() -> None:
    rig = begun(6, off={"A": 0.02, "B": 0.02})
    while not rig.comparison.over:
        rig.tick()
        if rig.comparison.step.endswith(("settling", "at rest", "take over")):
            rig.off = {"A": 1.0, "B": 1.0}
        else:
            rig.off = {"A": 0.02, "B": 0.02}
    assert all(pair.b.ball_rms_rad == pytest.approx(0.02, abs=2e-3) for pair in rig.comparison.pairs)


def test_somebody_watches_every_trial_and_no_trial_begins_before_the_accepted_law_has_rested() -> None:
    rig = begun(8)
    rig.run()
    trials = [t for t, order in rig.sent if order.name == TRIAL]
    reverts = [t for t, order in rig.sent if order.name == REVERT]
    alive = [t for t, order in rig.sent if order.name == ALIVE]
    assert len(trials) == len(reverts) == 4 and trials[0] >= 3.0
    assert all(min(abs(one - other) for other in (*trials, *reverts)) > 0.0 for one in alive)
    for begin, end in zip(trials, reverts, strict=True):
        watched = [begin + 0.5, *(t for t in alive if begin < t < end), end]
        assert max(b - a for a, b in itertools.pairwise(watched)) <= 1.1
    assert all(trial - revert >= 3.0 for revert, trial in zip(reverts, trials[1:], strict=False))


def test_a_candidate_that_goes_back_by_itself_ends_it() -> None:
    rig = until_tried(begun())
    rig.law = "A"
    rig.comparison.note("trial_returned", {"reason": "cost 0.02 rad^2, the accepted law's bound is 0.01"})
    rig.tick()
    assert rig.comparison.verdict == RETURNED and "cost 0.02" in rig.comparison.reason
    assert not any(order.name == REVERT for _, order in rig.sent)


def off(rig: Daemon) -> None:
    rig.running = False


def moved(rig: Daemon) -> None:
    rig.reference = 0.3


MEDDLING = {
    "disarmed": (off, "no longer acts"),
    "another reference": (moved, "somebody else moves the reference"),
    "another controller": (lambda rig: rig.comparison.note("controller", {"command": "controller"}), "somebody else"),
    "tuned": (lambda rig: rig.comparison.note("tuned", {}), "somebody else changed"),
    "driven by hand": (lambda rig: rig.comparison.note("speed", {"speed": 3.0}), "drove the hoop"),
    "accepted": (lambda rig: rig.comparison.note("operator", {"command": "accept"}), "somebody else changed"),
    "ended from outside": (lambda rig: rig.comparison.stop("nobody watches"), "nobody watches"),
    "an order refused": (lambda rig: rig.comparison.refuse(WantedCommand(REVERT), "no answer"), "no answer"),
}


@pytest.mark.parametrize("what", MEDDLING)
def test_who_meddles_ends_it_with_the_accepted_law_asked_for(what: str) -> None:
    step, says = MEDDLING[what]
    rig = until_tried(begun())
    step(rig)
    for _ in range(100):
        rig.tick()
    assert rig.comparison.verdict == STOPPED and says in rig.comparison.reason
    assert sum(order.name == REVERT for _, order in rig.sent) == 1
    rig.comparison.note("controller", OURS)  # what comes later changes nothing
    assert rig.comparison.verdict == STOPPED


def test_a_law_that_no_longer_acts_is_told_with_the_mode_and_its_fault() -> None:
    rig = until_tried(begun())
    rig.running = False
    rig.tick()
    assert not rig.comparison.settled  # the event comes after its tick
    rig.comparison.note("mode", {"mode": "FAULT", "because": ["link_lost"]})
    rig.tick()
    assert rig.comparison.reason == "the law no longer acts: the mode is FAULT (link_lost)" and rig.comparison.settled
    silent = until_tried(begun())
    silent.running = False
    for _ in range(30):
        silent.tick()
    assert silent.comparison.settled and silent.comparison.reason == "the law no longer acts"


def test_a_candidate_that_acts_only_after_the_end_goes_back_too() -> None:
    rig = begun(wait_s=2.0)
    while not any(order.name == TRIAL for _, order in rig.sent):
        rig.tick()
    rig.comparison.stop("nobody watches")
    rig.tick()
    assert not rig.comparison.settled and not any(order.name == REVERT for _, order in rig.sent)
    for _ in range(150):
        rig.tick()
    assert rig.comparison.settled and rig.law == "A"
    assert sum(order.name == REVERT for _, order in rig.sent) == 1


def test_a_candidate_that_is_refused_or_never_acts_ends_it() -> None:
    rig = begun()
    rig.wait_s = nan
    while not any(order.name == TRIAL for _, order in rig.sent):
        rig.tick()
    rig.comparison.note("command_refused", {"command": TRIAL, "reason": "not yours", "sha256": "0" * 64})
    assert not rig.comparison.over  # what somebody else asked for
    rig.comparison.note("command_refused", {"command": TRIAL, "reason": "the model does not fit"})
    assert rig.comparison.verdict == STOPPED and "the model does not fit" in rig.comparison.reason
    late = begun(wait_s=60.0)
    late.run()
    assert late.comparison.verdict == STOPPED and "did not tell" in late.comparison.reason


def test_it_does_not_wait_for_ever_for_a_law_that_acts() -> None:
    rig = begun(running=False)
    rig.run(30.0)
    assert rig.comparison.verdict == STOPPED and "arm it first" in rig.comparison.reason and not rig.sent


def test_a_pair_with_too_few_ticks_does_not_count() -> None:
    rig = begun(6)
    while not rig.comparison.over:
        if rig.comparison.block.pair == 1 and rig.comparison.step.endswith("counting"):
            rig.t += 4 * TICK_S  # four of five are lost
        rig.tick()
    assert (rig.comparison.lost, len(rig.comparison.pairs)) == (1, 2)


@pytest.mark.parametrize(
    "numbers",
    [{"blocks": 7}, {"blocks": 4}, {"settle_s": 0.0}, {"amplitude_rad": 0.6}, {"alpha": 0.0}, {"hold_s": nan}],
)
def test_numbers_that_give_no_comparison_are_refused(numbers: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(numbers)).partition("_")[0]):
        Alternation(**numbers)


def test_the_yardstick_sums_measured_deviations_by_the_design_s_weights() -> None:
    yardstick = Yardstick(held=HeldSpeed(231.0, 0.8))
    for k in range(200):
        t = k * TICK_S
        speed = 0.0 if k < 100 else 231.0 * np.sin(0.1) * (1.0 - np.exp(-0.8 * (k - 99) * TICK_S))
        reference = 0.0 if k < 100 else 0.1
        yardstick.put(TickSample(t, True, 0.025, float(speed), reference + 0.04, t, reference), counts=k >= 110)
    # (0.04/0.2)^2 + (0.025/0.05)^2, and a hoop that turns as a reference asks costs nothing
    assert yardstick.figures.cost == pytest.approx(0.04 + 0.25, abs=1e-6)
    assert yardstick.figures.ball_rms_rad == pytest.approx(0.04)


def test_the_torque_at_rest_is_that_of_a_ball_that_has_been_at_the_bottom_for_a_while() -> None:
    yardstick = Yardstick(rest_after_s=0.5)
    for k in range(200):
        t, reference = k * TICK_S, 0.1 if k < 100 else 0.0
        u = 0.003 if t >= 2.5 - 1e-9 else 0.5
        yardstick.put(TickSample(t, True, u, 0.0, reference, t, reference), counts=True)
    assert yardstick.figures.rest_rms_nm == pytest.approx(0.003)
    assert Yardstick().figures.rest_rms_nm is None


def test_a_pair_whose_ball_never_rested_says_nothing_of_the_torque_at_rest() -> None:
    """The others do; and a change beyond every percentage is told without one."""
    rig = begun(8, scatter=0.1, torque={"A": 0.001, "B": 0.001})
    rig.run()
    last = rig.comparison.pairs[-1]
    rig.comparison.pairs.append(replace(last, a=last.a._replace(rest_rms_nm=None)))
    assert len(rig.comparison.ratios("rest")) == len(rig.comparison.pairs) - 1
    far = {"accepted": 1e-9, "candidate": 1.0, "change_percent": None, "interval_percent": [1e6, None]}
    assert side_effects({"judged_by": "cost", "ball_rms_rad": far}) == [
        "The ball's error rose: 1 rad rms instead of 1e-09 (at least +1000000 %)."
    ]


def test_a_picture_counts_against_the_reference_of_its_own_time() -> None:
    yardstick = Yardstick()
    for k in range(50):
        t, late = k * TICK_S, 0.06
        reference, before = (0.1 if t >= 0.5 else 0.0), (0.1 if t - late >= 0.5 - 1e-9 else 0.0)
        yardstick.put(TickSample(t, True, 0.0, 0.0, before, t - late, reference), counts=True)
    assert yardstick.figures.ball_rms_rad == pytest.approx(0.0, abs=1e-12)


def test_only_a_law_that_tells_how_a_reference_is_held_has_a_speed() -> None:
    assert held_speed({"speed_per_sin": 231.0, "hold_rate": 0.8}) == HeldSpeed(231.0, 0.8)
    assert held_speed({"b": [1.0], "a": [1.0]}) is None
