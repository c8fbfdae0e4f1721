"""What a recorded maneuver is judged to be, from arrays alone."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.plants.hoop.maneuver.judgement import ManeuverOutcome, RecordedManeuver, judge_maneuver

TRACK_M, GRAVITY_M_S2 = 0.0853, 9.81


def swing(to_rad: float) -> ManeuverOutcome:
    """Out and back within a second, then at rest."""
    t = np.arange(0.0, 4.0, 0.02)
    psi = np.where(t < 1.0, to_rad * np.sin(np.pi * np.minimum(t, 1.0)) ** 2, 0.0)
    states = np.column_stack([0 * t, 0 * t, psi, np.gradient(psi, t)])
    return judge_maneuver(RecordedManeuver(t, 0 * t, states, t, psi, 1.0), TRACK_M, GRAVITY_M_S2)


@pytest.mark.parametrize(
    ("to_rad", "turn", "says"),
    [
        (0.8, 1, ()),
        (-0.8, -1, ()),
        (0.7, 1, ()),
        (0.16, 1, ("swung by 0.16 rad, not by 0.8",)),
        (0.8, -1, ("swung by 0 rad, not by 0.8",)),
    ],
)
def test_a_swing_goes_as_far_as_planned_and_on_its_side(to_rad: float, turn: int, says: tuple[str, ...]) -> None:
    outcome = swing(to_rad)
    assert outcome.shortfalls("swing", turn, 0.8) == says
    assert outcome.largest_angle_rad == pytest.approx(abs(to_rad), rel=1e-3)


def test_the_outer_hoop_does_not_press_on_a_ball_that_rests_on_the_inner_one() -> None:
    """Ten ticks through the air, then at rest on the top: what flew is what was in the air."""
    t = np.arange(0.0, 4.0, 0.02)
    psi = np.where(t < 0.4, 0.0, np.pi)
    states = np.column_stack([0 * t, 0 * t, psi, 0 * t])
    inner = (t >= 0.6) & (t < 2.0)
    run = RecordedManeuver(t, 0 * t, states, t, psi, 1.9, None, inner)
    outcome = judge_maneuver(run, TRACK_M, GRAVITY_M_S2)
    assert outcome.loose_s == pytest.approx(0.2) and outcome.least_contact == pytest.approx(-1.0)
    never_flew = judge_maneuver(run._replace(inner=t >= 0.4), TRACK_M, GRAVITY_M_S2)
    assert never_flew.loose_s == 0.0 and never_flew.least_contact == pytest.approx(1.0) and not never_flew.flew


def test_what_presses_is_that_of_the_hoop_that_the_ball_is_on() -> None:
    """At the bottom, ten ticks through the air, on the top of the inner hoop: at rest, then at 5 rad/s for a while."""
    t, inner_m = np.arange(0.0, 4.0, 0.02), 0.0549
    psi, dpsi = np.where(t < 0.4, 0.0, np.pi), np.where((t >= 1.0) & (t < 1.2), 5.0, 0.0)
    states = np.column_stack([0 * t, 0 * t, psi, dpsi])
    inner, air = (t >= 0.6) & (t < 2.0), (t >= 0.4) & (t < 0.6)
    run = RecordedManeuver(t, 0 * t, states, t, psi, 1.9, None, inner, air)
    outcome = judge_maneuver(run, TRACK_M, GRAVITY_M_S2, inner_m)
    assert outcome.least_contact == pytest.approx(1.0 - inner_m * 25.0 / GRAVITY_M_S2)
    # by which it is known to have flown stays
    assert outcome.loose_s == pytest.approx(0.2) and outcome.flew
    assert judge_maneuver(run, TRACK_M, GRAVITY_M_S2).least_contact == pytest.approx(1.0)
    pulled = judge_maneuver(run._replace(states=states * [1, 1, 1, 3]), TRACK_M, GRAVITY_M_S2, inner_m)
    assert pulled.least_contact == pytest.approx(1.0 - inner_m * 225.0 / GRAVITY_M_S2)


def stopped(at_s: float, *, seen: bool = True) -> ManeuverOutcome:
    """Once round the hoop within a second; nothing is recorded from `at_s` on."""
    t = np.arange(0.0, at_s, 0.02)
    psi = 2.0 * np.pi * np.minimum(t, 1.0)
    states = np.column_stack([0 * t, 0 * t, psi, np.where(t < 1.0, 2.0 * np.pi, 0.0)])
    pictures = psi if seen else np.full(len(t), np.nan)
    return judge_maneuver(RecordedManeuver(t, 0 * t, states, t, pictures, at_s), TRACK_M, GRAVITY_M_S2)


def test_of_a_maneuver_that_was_stopped_what_was_played_is_judged() -> None:
    half, whole = stopped(0.4), stopped(0.9)
    assert half.turns == 0 and half.least_contact == pytest.approx(-0.386, abs=0.01)
    assert half.largest_angle_rad == pytest.approx(2.39, abs=0.01) and np.isnan(half.settled_s)
    assert whole.turns == 1 and whole.shortfalls("throw", 1, 6.3) == ("stopped, and not seen settling",)
    assert "went round +0 times, not +1" in half.shortfalls("loop", 1, 6.3)


def test_what_no_picture_shows_is_not_judged() -> None:
    outcome = stopped(0.9, seen=False)
    assert outcome.turns is None and outcome.shortfalls("loop", 1, 6.3) == ("too little was recorded of it",)


def test_a_maneuver_of_which_no_picture_was_taken_until_it_had_ended_was_on_no_top() -> None:
    t = np.arange(0.0, 2.0, 0.02)
    pictures = np.where(t < 1.0, np.nan, 0.0)
    run = RecordedManeuver(t, 0 * t, np.zeros((len(t), 4)), t, pictures, 0.9)
    assert judge_maneuver(run, TRACK_M, GRAVITY_M_S2).top_s == 0.0
