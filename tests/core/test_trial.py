"""A law on trial: back to the accepted one in the tick in which it is worse, alone, reverted, over or switched off."""

from __future__ import annotations

import itertools
from math import inf, nan

import pytest
from core.test_succession import LIMIT_NM, Cold, Turn, in_force, load, named, with_laws
from harness.smallrig import PERIOD_S, SmallRig, running

from hoopd.core.controllers import Log, Measurement
from hoopd.core.excitation import Excitation, ExcitationLimits
from hoopd.core.records import Command
from hoopd.core.trial import (
    BAND_S,
    FACTOR,
    FLOOR_RAD2,
    LEAST_BASELINE_S,
    MOST_RAD2,
    SILENCE_S,
    LawTrial,
    References,
    cost_of,
)

TICKS_OF_BASELINE = round(LEAST_BASELINE_S / PERIOD_S) + 2


class Failing(Turn):
    """A law that has a torque for some ticks only."""

    def __init__(self, ticks: int, after: float | Exception = nan) -> None:
        super().__init__(0.02)
        self.ticks, self.after = ticks, after

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        self.ticks -= 1
        if self.ticks >= 0:
            return super().update(measurement)
        if isinstance(self.after, Exception):
            raise self.after
        return self.after, {}


def on_trial(law: Turn, purpose: str = "trial") -> SmallRig:
    """A rig whose accepted law has acted for long enough, and now this one."""
    rig = with_laws(running(), other=named(law))
    rig.run(TICKS_OF_BASELINE)
    rig.step(load("other", purpose))
    assert in_force(rig) == "other.yaml" and not rig.refused()
    return rig


def returned(rig: SmallRig) -> list[str]:
    """Why trials and experiments were over."""
    return [note.fields["reason"] for note in rig.notes if note.name in ("trial_returned", "experiment_ended")]


def watched(rig: SmallRig, ticks: int) -> list[float]:
    """Torques of ticks with a supervisor who says so every second."""
    return [rig.step(*(["alive"] if k % 50 == 0 else [])).command.torque_nm for k in range(ticks)]


def test_a_good_law_stays_on_trial_while_somebody_watches_and_is_accepted() -> None:
    rig = on_trial(Turn(0.025))
    watched(rig, 500)
    assert rig.tick.succession.purpose == "trial" and returned(rig) == []
    rig.step("accept")
    rig.run(round(2 * SILENCE_S / PERIOD_S))
    assert in_force(rig) == "other.yaml" and rig.tick.succession.purpose == "controller" and returned(rig) == []
    rig.step("disarm")
    rig.run(5)
    assert in_force(rig) == "other.yaml"  # for good


def test_a_law_that_does_not_bring_the_ball_to_its_reference_is_taken_back() -> None:
    rig = on_trial(Turn(0.03))
    rig.step(Command("reference", 0.3))  # the ball of this rig stays where it is
    watched(rig, round(BAND_S / PERIOD_S) - 2)
    assert returned(rig) == []
    torques = watched(rig, 50)
    (reason,) = returned(rig)
    assert reason.startswith("cost ") and in_force(rig) == "" and rig.mode == "RUNNING"
    assert max(abs(b - a) for a, b in itertools.pairwise(torques)) < 0.01


def test_without_a_supervisor_it_is_taken_back_after_five_seconds() -> None:
    rig = on_trial(Turn(0.025))
    silent = round(SILENCE_S / PERIOD_S)
    rig.run(silent - 2)
    assert returned(rig) == []
    torques = [rig.step().command.torque_nm for _ in range(10)]
    assert returned(rig) == ["its supervisor was silent for 5 s"] and in_force(rig) == ""
    assert max(abs(b - a) for a, b in itertools.pairwise(torques)) < 0.01
    rig.step("alive")
    assert rig.refused() == [("alive", "there is no trial")]


@pytest.mark.parametrize("after", [nan, inf, ZeroDivisionError("speed")])
def test_a_law_that_fails_on_trial_is_taken_back_and_control_goes_on(after: float | Exception) -> None:
    rig = on_trial(Failing(20, after))
    torques = watched(rig, 100)
    (reason,) = returned(rig)
    assert ("ZeroDivisionError" in reason) == isinstance(after, Exception)
    assert rig.mode == "RUNNING" and in_force(rig) == ""
    assert max(abs(b - a) for a, b in itertools.pairwise(torques)) < 0.01


def test_reverted_it_is_back_in_that_tick_without_a_step() -> None:
    rig = on_trial(Turn(0.03, 22.0))
    before = watched(rig, 50)[-1]
    after = rig.step("revert").command.torque_nm
    assert returned(rig) == ["reverted"] and in_force(rig) == "" and abs(after - before) < 0.01
    rig.step("revert")
    assert rig.refused() == [("revert", "there is no trial")]


def test_a_trial_that_waits_is_forgotten_when_it_is_reverted_and_a_controller_is_not() -> None:
    rig = with_laws(running(), other=named(Cold(0.02)))
    rig.run(TICKS_OF_BASELINE)
    rig.step(load("other", "trial"))
    assert rig.tick.succession.waiting == "other.yaml"
    rig.step("revert")
    assert rig.refused() == [("trial", "reverted")] and rig.tick.succession.waiting == ""
    rig.run(200)
    assert in_force(rig) == "" and returned(rig) == []
    rig.step(load("other"))
    rig.step("revert")  # of somebody whose trial has gone back by itself
    assert rig.refused()[-1] == ("revert", "there is no trial") and rig.tick.succession.waiting == "other.yaml"


@pytest.mark.parametrize("name", ["disarm", "stop", "shutdown"])
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_what_switches_off_ends_a_trial_whoever_accepts_it(name: str, order: tuple[int, ...]) -> None:
    rig = on_trial(Turn(0.025))
    three = ("accept", name, "alive")
    rig.step(*(three[i] for i in order))
    assert {rig.mode, *rig.run(80)} <= {"DISARMED", "STOPPING"}
    assert in_force(rig) == "" and ("accept", f"revoked by {name}") in rig.refused()


def test_a_cut_ends_a_trial() -> None:
    rig = on_trial(Turn(0.025))
    rig.board.condition = True
    rig.run(3)
    assert rig.mode == "FAULT" and in_force(rig) == "" and returned(rig) == ["the mode is FAULT (board_fault)"]


@pytest.mark.parametrize(
    ("ticks", "commands", "says"),
    [
        (0, [load("other", "trial")], "has to act for 3 s first"),
        (TICKS_OF_BASELINE, [load("other", "trial"), load("other", "trial")], "other.yaml is on trial"),
        (TICKS_OF_BASELINE, [load("other", "trial"), load("other")], "other.yaml is on trial: accept or revert"),
    ],
)
def test_trials_that_are_refused(ticks: int, commands: list[Command], says: str) -> None:
    rig = with_laws(running(), other=named(Turn(0.02)))
    rig.tick.succession._baseline.clear()
    rig.run(ticks)
    for command in commands:
        rig.step(command)
    assert says in rig.refused()[-1][1]


def test_the_limits_of_a_trial_are_its_own_and_then_the_accepted_ones_again() -> None:
    rig = with_laws(running(), other=named(Turn(0.02), 0.1, 0.05))
    rig.run(TICKS_OF_BASELINE)
    rig.step(load("other", "trial"))
    assert (rig.tick.limiter.torque_nm, rig.tick.limiter.slew_nm_per_tick) == (0.1, 0.05)
    rig.step("revert")
    assert (rig.tick.limiter.torque_nm, rig.tick.limiter.slew_nm_per_tick) == (LIMIT_NM, LIMIT_NM)


def test_a_signal_plays_once_and_the_accepted_law_is_back() -> None:
    table = Excitation([0.05] * 25, ExcitationLimits(0.1, 100.0, 1.0), around=Turn(0.02))
    rig = on_trial(table, "experiment")  # type: ignore[arg-type]
    torques = [rig.step().command.torque_nm for _ in range(60)]
    assert returned(rig) == ["done"] and rig.mode == "RUNNING" and in_force(rig) == ""
    assert max(torques) > 0.03
    assert abs(torques[26] - torques[24]) < 0.02  # what is over asks for nothing, and that is no step
    assert rig.tick.succession.purpose == "controller"


def test_a_signal_is_taken_back_as_a_trial_is() -> None:
    table = Excitation([0.05] * 500, ExcitationLimits(0.1, 100.0, 1.0), around=Turn(0.02))
    rig = on_trial(table, "experiment")  # type: ignore[arg-type]
    before = rig.run(20) and rig.step().command.torque_nm
    after = rig.step("accept", "revert").command.torque_nm
    assert rig.refused() == [("accept", "there is no trial")]
    assert returned(rig) == ["reverted"] and in_force(rig) == "" and abs(after - before) < 0.02


def test_of_revert_and_accept_in_one_tick_the_first_counts() -> None:
    rig = on_trial(Turn(0.025))
    rig.step("revert", "accept")
    assert returned(rig) == ["reverted"] and rig.refused() == [("accept", "there is no trial")]
    rig = on_trial(Turn(0.025))
    rig.step("accept", "revert")
    assert rig.refused() == [("revert", "there is no trial")] and in_force(rig) == "other.yaml"
    rig.run(TICKS_OF_BASELINE)
    with_laws(rig, next=named(Turn(0.03)))
    rig.step(load("next", "trial"))
    rig.run(10)
    assert rig.tick.succession.purpose == "trial" and returned(rig) == []


def test_a_signal_that_breaks_its_limits_ends_at_once() -> None:
    table = Excitation([0.05] * 500, ExcitationLimits(0.1, 21.0, 1.0), around=Turn(0.02))
    rig = on_trial(table, "experiment")  # type: ignore[arg-type]
    rig.run(100)
    (reason,) = returned(rig)
    assert reason.startswith("hoop speed 2") and rig.mode == "RUNNING" and in_force(rig) == ""


def test_a_disarmed_daemon_plays_nothing() -> None:
    rig = with_laws(running(), other=named(Turn(0.02)))
    rig.step("disarm")
    rig.run(2)
    rig.step(load("other", "experiment"))
    assert rig.refused()[-1] == ("experiment", "the mode is DISARMED")


def test_who_is_refused_in_a_fault_is_told_which_one() -> None:
    rig = with_laws(running(), other=named(Turn(0.02)))
    rig.silent = 20
    rig.run(5)
    rig.step(load("other", "experiment"), Command("speed", 1.0))
    assert set(rig.refused()) == {(name, "the mode is FAULT (link_lost)") for name in ("experiment", "speed")}


def test_a_step_of_the_reference_costs_nothing_on_its_way() -> None:
    references = References()
    assert references.distance(0.0, 0.0, 0.1) == pytest.approx(0.1)
    for psi in (-0.1, 0.0, 0.1, 0.2):  # it starts the other way, and goes beyond
        assert references.distance(1.0, 0.1, psi) == pytest.approx(0.0)
    assert references.distance(1.0, 0.1, 0.3) == pytest.approx(0.1)
    assert references.distance(1.1 + BAND_S, 0.1, 0.0) == pytest.approx(0.1)


@pytest.mark.parametrize(("baseline", "bound"), [(0.0, FACTOR * FLOOR_RAD2), (2e-3, FACTOR * 2e-3), (9.0, MOST_RAD2)])
def test_the_bound_of_a_trial(baseline: float, bound: float) -> None:
    assert LawTrial(0.0, baseline).bound == pytest.approx(bound)


def test_a_lost_estimate_ends_a_trial() -> None:
    assert LawTrial(0.0, 0.0).verdict(0.02, cost_of(nan, 0.0)) == "the estimate was lost"


def test_a_signal_that_would_be_cut_short_is_refused() -> None:
    rig = with_laws(running(), other=named(Turn(0.02), 0.8))
    rig.run(TICKS_OF_BASELINE)
    rig.step(load("other", "experiment"))
    assert rig.refused()[-1] == ("experiment", "limits.torque_nm of 0.8 is more than the 0.7 that the run began with")


@pytest.mark.parametrize("ticks", [1, 2, 3])
@pytest.mark.parametrize("purpose", ["trial", "experiment"])
def test_a_pause_ends_it_however_soon_after_it_began(purpose: str, ticks: int) -> None:
    signal = Excitation([0.05] * 500, ExcitationLimits(0.1, 100.0, 1.0), around=Turn(0.02))
    law = signal if purpose == "experiment" else Turn(0.03)
    rig = with_laws(running(), other=named(law))  # type: ignore[arg-type]
    rig.run(TICKS_OF_BASELINE)
    rig.dark = 10  # pictures, after which the ball is lost
    rig.run(9 - ticks)
    rig.step(load("other", purpose))
    assert in_force(rig) == "other.yaml"
    assert rig.run(ticks)[-1] == "READY" and in_force(rig) == ""
    assert rig.run(60)[-1] == "RUNNING" and in_force(rig) == ""
