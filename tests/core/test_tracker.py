"""The law of a maneuver: begins at rest, plays its plan once, is given up into a brake; alone and in the tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan, pi, tau
from typing import Any

import numpy as np
import pytest
from harness.smallrig import PERIOD_S, SmallRig, healthy

from hoopd.core.controllers import DONE, Log, Measurement
from hoopd.core.faulttable import FAULTS, SUSPENDABLE, SUSPENDABLE_IN_FLIGHT
from hoopd.core.installed import ControllerLabel, Filter, Installed
from hoopd.core.records import CameraSample, Command
from hoopd.core.tracker import (
    CAUGHT_TICKS,
    LONGEST_PLAN_TICKS,
    Brake,
    FlightTicks,
    MotionTracker,
    PlannedMotion,
    Tolerances,
)

START, ENVELOPE = Tolerances(1.0, 0.05, 0.5), Tolerances(20.0, 0.5, 8.0)
TORQUES = [0.0, 0.2, -0.1]
STATES = [[0.0, 0.0, 0.0, 0.0], [0.1, 2.0, 0.05, 1.0], [0.2, 4.0, 0.1, 1.0], [0.3, 2.0, 0.1, 0.0]]
FEEDBACK = [[0.0, 0.01, 0.5, 0.1]] * 3


def planned(**changes: Any) -> PlannedMotion:
    told: dict[str, Any] = {"torques_nm": TORQUES, "states": STATES, "feedback": FEEDBACK, "start": START}
    told |= {"envelope": ENVELOPE, **changes}
    return PlannedMotion(**told)


def measured(x: Sequence[float], t: float = 0.0, *, ready: bool = True) -> Measurement:
    return Measurement(t, np.array(x), ready, nan, False, nan, 0.0, 0.0, PERIOD_S)


def asked(law: MotionTracker, *states: Sequence[float]) -> list[float]:
    return [law.update(measured(x, PERIOD_S * k))[0] for k, x in enumerate(states)]


def test_on_its_plan_it_asks_for_the_planned_torques_and_ends() -> None:
    law = MotionTracker(planned())
    assert asked(law, *STATES) == [*TORQUES, 0.0] and law.ended == DONE
    assert asked(law, STATES[0]) == [0.0] and law.ended == DONE
    law.reset()
    assert law.ended == "" and asked(law, *STATES[:2]) == TORQUES[:2]


def test_the_hoop_s_angle_and_the_bottom_at_which_it_begins_are_its_zero() -> None:
    law, zero = MotionTracker(planned()), np.array([17.0, 0.0, -2.0 * tau, 0.0])
    assert asked(law, *(np.array(STATES) + zero)) == pytest.approx([*TORQUES, 0.0], abs=1e-12)


def test_off_its_plan_feedback_is_added() -> None:
    law = MotionTracker(planned())
    law.update(measured(STATES[0]))
    torque, log = law.update(measured([0.1, 3.0, 0.15, 0.0]))
    # 0.2 - (0.01 * 1 + 0.5 * 0.1 - 0.1 * 1)
    assert torque == pytest.approx(0.24) and log["feedback_nm"] == pytest.approx(0.04)


@pytest.mark.parametrize("x", [(0, 1.5, 0, 0), (0, 0, 0.1, 0), (0, 0, 0, -0.6), (0, nan, 0, 0)])
def test_it_does_not_begin_but_at_rest_at_the_bottom(x: Sequence[float]) -> None:
    law = MotionTracker(planned())
    assert asked(law, x) == [0.0] and law.ended
    assert law.suspended == ()


def test_it_does_not_begin_without_an_estimate() -> None:
    law = MotionTracker(planned())
    assert law.update(measured(STATES[0], ready=False))[0] == 0.0 and law.ended == "the estimate is not ready"


@pytest.mark.parametrize("x", [(0, 23.0, 0, 0), (0, 2.0, 0.6, 0), (0, 2.0, 0.05, 10.0)])
def test_outside_of_its_envelope_the_hoop_is_braked_and_never_driven_again(x: Sequence[float]) -> None:
    law = MotionTracker(planned())
    law.update(measured(STATES[0]))
    assert law.update(measured(x, 0.02))[0] <= 0.0 and law.ended == ""
    # back on the plan it is not taken up again
    torque = law.update(measured([0.2, 4.0, 0.1, 1.0], 0.04))[0]
    assert torque == pytest.approx(-0.02) and law.suspended == ()
    assert law.update(measured([0.2, 1.0, 0.1, 1.0], 0.06))[0] == 0.0 and law.ended.startswith("given up: ")


def test_a_plan_that_ends_on_top_lets_the_ball_down_and_is_done_when_all_is_calm() -> None:
    law = MotionTracker(planned(let_down=True, suspends=("ball_runaway",)))
    asked(law, *STATES[:3])
    assert law.update(measured([0.3, 4.0, 0.1, 0.0], 0.06))[0] == pytest.approx(-0.02) and law.ended == ""
    # whatever the ball does meanwhile, and the plan's rows stay suspended
    assert law.update(measured([0.3, 4.0, 1.5, 20.0], 0.08))[0] < 0.0 and law.suspended == ("ball_runaway",)
    assert law.update(measured([0.3, 1.0, 0.1, 1.0], 0.10))[0] == 0.0 and law.ended == DONE
    assert law.suspended == ()


@pytest.mark.parametrize(
    ("x", "ticks", "ended"),
    [
        ([0.3, 0.0, pi, 0.0], Brake().longest_s / PERIOD_S, "let down: the ball is still above the axis"),
        ([0.3, 0.0, 1.2, 5.0], Brake().longest_s / PERIOD_S, DONE),
        ([nan] * 4, 1, "let down: the estimate was lost"),
    ],
)
def test_only_a_ball_that_came_down_is_done(x: list[float], ticks: float, ended: str) -> None:
    law = MotionTracker(planned(let_down=True))
    asked(law, *STATES[:3])
    law.update(measured([0.3, 4.0, 0.1, 0.0], 0.06))
    torques = [law.update(measured(x, 0.06 + 0.02 * k))[0] for k in range(1, 300) if not law.ended]
    assert law.ended == ended and len(torques) == pytest.approx(ticks, abs=2) and torques[-1] == 0.0


def test_without_an_estimate_there_is_no_torque_at_all() -> None:
    law = MotionTracker(planned())
    law.update(measured(STATES[0]))
    assert law.update(measured([nan] * 4, 0.02))[0] == 0.0 and law.ended == "given up: the estimate was lost"


def test_the_brake_ends_whatever_the_ball_does() -> None:
    law, brake = MotionTracker(planned()), Brake()
    law.update(measured(STATES[0]))
    falls = [0.0, 30.0, 2.0, 12.0]
    torques = [law.update(measured(falls, 0.02 * k))[0] for k in range(1, 300) if not law.ended]
    assert len(torques) == pytest.approx(brake.longest_s / PERIOD_S, abs=2) and min(torques) == -brake.limit_nm
    assert law.ended.startswith("given up: dtheta") and torques[-1] == 0.0


def test_the_filter_is_told_to_expect_more_until_it_is_over() -> None:
    law = MotionTracker(planned(unmodelled=7.0))
    assert law.unmodelled == 7.0
    asked(law, *STATES)
    assert law.ended == DONE and law.unmodelled == 0.0


WRONG = {
    "no torque": ({"torques_nm": [], "states": STATES[:1], "feedback": []}, "1 to 500 ticks, not 0"),
    "too long": ({"torques_nm": [0.0] * 501, "states": [STATES[0]] * 502, "feedback": FEEDBACK[:1] * 501}, "not 501"),
    "a row too few": ({"states": STATES[:3]}, "3 torques need 4 rows"),
    "three gains": ({"feedback": [[0.0, 1.0, 1.0]] * 3}, "four gains"),
    "no number": ({"torques_nm": [0.0, nan, 0.0]}, "must be finite"),
    "begins elsewhere": ({"states": [[0.0, 0.0, 1.0, 0.0], *STATES[1:]]}, "begins at rest"),
    "a filter of nothing": ({"unmodelled": 2e3}, "unmodelled must be from 0 to 1000"),
    "suspends a link": ({"suspends": ("link_lost",)}, "'link_lost' may not be suspended: only ball_runaway"),
}


@pytest.mark.parametrize("name", WRONG)
def test_tables_that_do_not_fit_are_refused(name: str) -> None:
    changes, says = WRONG[name]
    with pytest.raises(ValueError, match=says):
        planned(**changes)
    with pytest.raises(ValueError, match="above zero"):
        Tolerances(1.0, 0.0, 1.0)


def test_only_the_ball_s_way_over_the_top_may_be_suspended_and_of_a_flight_that_it_is_not_seen() -> None:
    assert {"ball_runaway"} == SUSPENDABLE and LONGEST_PLAN_TICKS * PERIOD_S == 10.0
    assert {"ball_lost", "ball_implausible"} == SUSPENDABLE_IN_FLIGHT
    assert {fault.name for fault in FAULTS} > SUSPENDABLE | SUSPENDABLE_IN_FLIGHT


def thrown(**changes: Any) -> MotionTracker:
    """A plan of thirty ticks whose ball is in the air from the tenth on."""
    n = 30
    told = {"torques_nm": [0.1] * n, "states": [[0.0] * 4] * (n + 1), "feedback": [[0.0] * 4] * n, "unmodelled": 3.0}
    flight = FlightTicks(10, 5, 400.0, ("ball_lost", "ball_implausible"))
    return MotionTracker(planned(**{**told, "flight": flight, "suspends": ("ball_runaway",), **changes}))


def test_in_the_air_and_until_it_is_caught_more_is_suspended_and_expected_and_the_ball_is_not_judged() -> None:
    law, told = thrown(), []
    for k in range(30):
        off = 2.0 if 10 <= k < 15 + CAUGHT_TICKS else 0.0
        law.update(measured([0.0, 0.0, off, 0.0], PERIOD_S * k))
        told.append((law.suspended, law.unmodelled))
        assert not law.ended
    given_up = thrown()
    asked(given_up, *[[0.0] * 4] * (15 + CAUGHT_TICKS), [0.0, 0.0, 2.0, 0.0])
    assert given_up.suspended == ()
    rows = ("ball_runaway", "ball_lost", "ball_implausible")
    assert told[8] == (rows[:1], 3.0) and told[9] == told[21] == (rows, 400.0) and told[22] == (rows[:1], 3.0)


def test_a_throw_that_is_reverted_in_the_air_is_caught_when_it_was_planned_to_be() -> None:
    law, told = thrown(), []
    for k in range(60):
        if k == 12:
            assert law.give_up("reverted")
        law.update(measured([0.0, 15.0 if k else 0.0, 0.0, 0.0], PERIOD_S * k))
        told.append((law.suspended, law.unmodelled))
    rows = ("ball_runaway", "ball_lost", "ball_implausible")
    assert told[12] == told[21] == (rows, 400.0) and told[22] == told[-1] == (rows[:1], 3.0) and not law.ended


def test_a_throw_that_is_given_up_before_it_flies_has_no_flight() -> None:
    for off, by_word in ((0.0, True), (2.0, False)):
        law, told = thrown(), []
        for k in range(40):
            if by_word and k == 4:
                assert law.give_up("reverted")
            law.update(measured([0.0, 15.0 if k else 0.0, off if k == 4 else 0.0, 0.0], PERIOD_S * k))
            told.append((law.suspended, law.unmodelled))
        assert not law.ended and set(told[4:]) == {(("ball_runaway",) if by_word else (), 3.0)}


def test_a_revert_lets_a_brake_go_on_that_the_plan_itself_began() -> None:
    law = MotionTracker(planned())
    asked(law, STATES[0], [0.1, 9.0, 2.0, 1.0])
    assert law.give_up("reverted") and law.suspended == () and not law.give_up("reverted")
    asked(law, [0.1, 0.0, 0.0, 0.0])
    assert "reverted" not in law.ended and law.ended.startswith("given up: psi")


def test_in_the_air_the_hoop_is_judged_all_the_same() -> None:
    law = thrown()
    for k in range(12):
        law.update(measured([0.0, 0.0, 0.0, 0.0], PERIOD_S * k))
    assert law.update(measured([0.0, 50.0, 0.0, 0.0], 1.0))[0] == -0.1 and law.suspended == ()


@pytest.mark.parametrize(
    ("flight", "says"),
    [
        (FlightTicks(10, 20, 400.0), "within the plan's 30 ticks"),
        (FlightTicks(10, 5, 4e3), "unmodelled must be"),
        (
            FlightTicks(10, 5, 1.0, ("ball_runaway",)),
            "'ball_runaway' may not be suspended: only ball_implausible",
        ),
        (FlightTicks(10, 5, 1.0, ("link_lost",)), "'link_lost' may not be suspended"),
    ],
)
def test_a_flight_that_cannot_be_is_refused(flight: FlightTicks, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        thrown(flight=flight)


# ------------------------------------------------------------------------------------------ in the tick


class Idle:
    """A law that leaves the hoop alone, and has a torque, so that it is one under torque."""

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        return 1e-3, {}

    def reset(self) -> None: ...

    def tune(self, key: str, value: float) -> bool:
        return False


class RoundRig(SmallRig):
    """A rig whose ball goes where it is told, whatever the torque."""

    psi: Callable[[int], float] = staticmethod(lambda k: 0.0)

    def _picture(self, t: float) -> CameraSample:
        seen = super()._picture(t)
        return seen._replace(psi=seen.psi + self.psi(self.k))


TICKS = 60
ROUND = [[0.0, 0.0, tau * k / TICKS, 0.0] for k in range(TICKS + 1)]


def rounding(rig: SmallRig, **changes: Any) -> None:
    """A plan that takes the ball once round within sixty ticks, to be loaded as `round`."""
    told = {"torques_nm": [1.5e-3] * TICKS, "states": ROUND, "feedback": [[0.0] * 4] * TICKS}
    wide = Tolerances(90.0, 1.0, 90.0)
    plan = planned(**{**told, "envelope": wide, "suspends": ("ball_runaway",), **changes})

    def make(running: Filter) -> Installed:
        return Installed(MotionTracker(plan), running, 0.7, 0.7, fed=False, label=ControllerLabel("round.yaml"))

    rig.loadable["round"] = make


def ready(**changes: Any) -> RoundRig:
    """A rig that controls a ball at rest, and its hoop, too."""
    rig = healthy()
    rig.__class__ = RoundRig
    assert isinstance(rig, RoundRig)
    rig.tick.succession.acting.__dict__["law"] = Idle()
    rounding(rig, **changes)
    rig.step("arm")
    assert rig.run(30)[-1] == "RUNNING"
    return rig


def carried(rig: RoundRig, until: float = tau) -> None:
    """From the next tick on the ball goes round with the plan, up to an angle."""
    first = rig.k + 2
    rig.psi = lambda k: min(until, max(0.0, tau * (k - first) / TICKS))


def fault_notes(rig: SmallRig) -> list[str]:
    return [note.fields["fault"] for note in rig.notes if note.name == "fault"]


def test_a_ball_that_goes_round_by_plan_is_no_runaway_and_the_bottom_is_the_next_one() -> None:
    rig = ready()
    carried(rig)
    rig.step(Command("experiment", text="round"))
    assert set(rig.run(TICKS + 40)) == {"RUNNING"} and not fault_notes(rig)
    assert [note.fields["reason"] for note in rig.notes if note.name == "experiment_ended"] == [DONE]
    # from now on the row is judged again, from the bottom at which the ball is
    rig.psi = lambda k: tau + 1.02 * pi
    assert rig.run(3)[-1] == "STOPPING" and fault_notes(rig) == ["ball_runaway"]


def test_without_a_plan_the_same_ball_is_a_runaway() -> None:
    rig = ready()
    carried(rig)
    assert "STOPPING" in rig.run(TICKS) and fault_notes(rig) == ["ball_runaway"]


def test_a_plan_that_does_not_name_the_row_is_stopped_by_it() -> None:
    rig = ready(suspends=())
    carried(rig)
    rig.step(Command("experiment", text="round"))
    assert "STOPPING" in rig.run(TICKS) and fault_notes(rig) == ["ball_runaway"]


def test_a_maneuver_that_is_given_up_suspends_nothing_any_more() -> None:
    rig = ready(envelope=Tolerances(90.0, 0.2, 90.0))
    carried(rig, 2.0)  # it stays behind at 2 rad
    rig.step(Command("experiment", text="round"))
    assert set(rig.run(40)) == {"RUNNING"}
    assert rig.tick.succession.suspended(rig.tick.mode) == ()
    rig.psi = lambda k: 4.0
    assert "STOPPING" in rig.run(5) and fault_notes(rig) == ["ball_runaway"]


@pytest.mark.parametrize("command", ["stop", "disarm"])
def test_what_switches_off_wins_over_a_maneuver(command: str) -> None:
    rig = ready()
    carried(rig)
    rig.step(Command("experiment", text="round"))
    rig.run(20)
    first = rig.step(command)
    assert first.record.mode in ("STOPPING", "DISARMED")
    outputs = [rig.step() for _ in range(80)]
    assert outputs[-1].record.mode == "DISARMED" and outputs[-1].command.torque_nm == 0.0
    assert rig.tick.succession.acting is rig.tick.succession.accepted


@pytest.mark.parametrize(("gone", "mode"), [("silent", "FAULT"), ("blind", "DISARMED"), ("late", "DISARMED")])
def test_a_fault_during_a_maneuver_ends_it_without_torque(gone: str, mode: str) -> None:
    rig = ready()
    carried(rig)
    rig.step(Command("experiment", text="round"))
    rig.run(20)
    setattr(rig, gone, 60)
    outputs = [rig.step() for _ in range(90)]
    assert outputs[-1].record.mode == mode and outputs[-1].command.torque_nm == 0.0


def test_a_revert_gives_it_up_into_the_brake_and_the_second_one_gives_the_drive_back_at_once() -> None:
    rig = ready()
    carried(rig, 2.0)
    rig.step(Command("experiment", text="round"))
    rig.run(20)
    law = rig.tick.succession.acting.law
    rig.step("revert")
    assert rig.tick.succession.acting.law is law
    assert rig.tick.succession.suspended(rig.tick.mode) == ("ball_runaway",)  # a ball on its plan is none
    braked = rig.step()
    assert braked.command.torque_nm == pytest.approx(Brake().torque(braked.record.x_hat[1]), abs=5e-4)
    rig.step("revert")
    assert rig.tick.succession.acting is rig.tick.succession.accepted and rig.mode == "RUNNING"
    assert [note.fields["reason"] for note in rig.notes if note.name == "experiment_ended"] == ["reverted"]
    given_up = ready()
    carried(given_up, 2.0)
    given_up.step(Command("experiment", text="round"))
    given_up.run(20)
    given_up.step("revert")
    given_up.run(200)
    told = [note.fields["reason"] for note in given_up.notes if note.name == "experiment_ended"]
    assert told == ["given up: reverted"] and not given_up.refused()


def test_who_lets_the_ball_down_brakes_on_when_it_is_reverted_and_is_not_done() -> None:
    law = MotionTracker(planned(let_down=True))
    asked(law, *STATES[:3], [0.3, 6.0, 0.1, 0.0])
    assert law.give_up("reverted") and not law.give_up("reverted") and not law.ended
    asked(law, *[STATES[0]] * 2)
    assert law.ended == "given up: reverted" and not law.give_up("reverted")
    assert not MotionTracker(planned()).give_up("reverted")  # not begun


def test_a_ball_out_of_sight_pauses_it_and_it_does_not_go_on() -> None:
    rig = ready()
    carried(rig)
    rig.step(Command("experiment", text="round"))
    rig.run(20)
    rig.psi = lambda k: nan
    assert "READY" in rig.run(20) and rig.tick.succession.acting is rig.tick.succession.accepted
