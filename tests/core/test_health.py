"""The fault table, row by row, on inputs made by hand."""

from __future__ import annotations

from math import inf, nan, tau

import numpy as np
import pytest

from hoopd.core.encoderchecks import NAMES as ENCODER_FAULTS
from hoopd.core.faulttable import BY_NAME, FAULTS, Action
from hoopd.core.frames import STATUS_ENABLED, STATUS_FAULT, STATUS_TIMEOUT
from hoopd.core.health import REFUSALS, Health, Sent, Thresholds
from hoopd.core.picturechecks import NAMES as PICTURE_FAULTS
from hoopd.core.records import CameraSample, DriverSample, Estimate, Inputs, LinkCounts

PERIOD = 0.02


class Bench:
    """Healthy inputs, tick after tick, with named fields replaced."""

    def __init__(self, **thresholds: float) -> None:
        self.health = Health(Thresholds(**thresholds), PERIOD)
        self.k = 0
        self.sent = Sent(0.0, 0.0, 0)
        self.board_ms = 0
        self.torque_nm = 0.05  # what every tick sends

    def run(
        self, ticks: int, *, estimate: dict | None = None, driver: dict | None = None, **inputs: object
    ) -> list[str]:
        for _ in range(ticks):
            self.k += 1
            self.board_ms = (self.board_ms + 20) % 65536
            t = self.k * PERIOD
            sample = DriverSample(t - 0.019, 0, STATUS_ENABLED, 0, 0.0, 0.0, 0.0, self.board_ms)._replace(
                **(driver or {})
            )
            camera = CameraSample(self.k, t - 0.05, t - 0.005, 0.1, 1.0, 0.0, 0.0)
            base = Inputs(self.k, t, camera, sample, LinkCounts(good=1), (), 1e-4, 5e-4, False, 0)
            guess = Estimate(np.zeros(4), True, 0.0, 0.0, True, 1.0)._replace(**(estimate or {}))
            self.sent = Sent(t, self.torque_nm, self.sent.enabled_for + 1)
            self.health.update(base._replace(**inputs), guess, self.sent)
        return [fault.name for fault in self.health.active()]

    @property
    def active(self) -> list[str]:
        return [fault.name for fault in self.health.active()]


def started(**thresholds: float) -> Bench:
    bench = Bench(**thresholds)
    assert bench.run(60) == []
    return bench


# name of the fault, what the inputs look like while it lasts
BAD = {
    "frame_bad": {"link": LinkCounts(bad_crc=1)},
    "link_lost": {"driver_none": True},
    "board_fault": {"driver": {"status": STATUS_ENABLED | STATUS_FAULT}},
    "board_timeout": {"driver": {"status": STATUS_TIMEOUT}},
    "board_reset": {"driver": {"board_ms": 30000}},
    "camera_late": {"camera": None},
    "camera_lost": {"camera_stalled": True},
    "ball_missing": {"no_ball": True},
    "ball_lost": {"no_ball": True},
    "ball_implausible": {"estimate": {"psi_accepted": False}},
    "ball_runaway": {"estimate": {"x": np.array([0.0, 0.0, -3.2, 0.0])}},
    "overrun": {"lateness_s": 0.015, "execution_s": 0.01},
    "overrun_repeated": {"lateness_s": 0.015, "execution_s": 0.01},
    "overrun_persistent": {"lateness_s": 0.015, "execution_s": 0.01},
    "current_implausible": {"driver": {"current": 9.0}},
    "speed_implausible": {"driver": {"dtheta": 30.0}},
    "hoop_overspeed": {"driver": {"dtheta": -61.0}},
    "not_finite": {"estimate": {"x": np.array([0.0, nan, 0.0, 0.0])}},
    "recorder_trouble": {"trouble": 1},
    "telemetry_trouble": {"trouble": 2},
}


def spoil(bench: Bench, ticks: int, name: str) -> None:
    for _ in range(ticks):
        bad = dict(BAD[name])
        if bad.pop("driver_none", False):
            bench.health.update(_without_driver(bench), Estimate(np.zeros(4), True, 0, 0, True, 1.0), bench.sent)
        elif bad.pop("no_ball", False):
            bench.k += 1
            t = bench.k * PERIOD
            camera = CameraSample(bench.k, t - 0.05, t, nan, 0.0, nan, nan)
            bench.k -= 1
            bench.run(1, camera=camera, **bad)
        else:
            bench.run(1, **bad)


def _without_driver(bench: Bench) -> Inputs:
    bench.k += 1
    bench.board_ms += 20
    t = bench.k * PERIOD
    camera = CameraSample(bench.k, t - 0.05, t - 0.005, 0.1, 1.0, 0.0, 0.0)
    return Inputs(bench.k, t, camera, None, LinkCounts(), (), 1e-4, 5e-4, False, 0)


@pytest.mark.parametrize("name", BAD)
def test_a_fault_comes_after_its_count_and_not_before(name: str) -> None:
    bench = started(torque_constant_nm_per_a=0.37)
    fault = BY_NAME[name]
    # A stale picture takes a while to be stale; speed and jumps judge pairs of answers.
    # An implausible ball is judged by a share of many pictures.
    slack = {"camera_late": 3, "speed_implausible": 3, "ball_implausible": REFUSALS - 1}.get(name, 0)
    if fault.on > 1:
        spoil(bench, fault.on - 1, name)
        assert name not in bench.active
    spoil(bench, 1 + slack, name)
    assert name in bench.active


@pytest.mark.parametrize("name", BAD)
def test_a_fault_clears_as_its_row_says(name: str) -> None:
    bench = started(torque_constant_nm_per_a=0.37)
    fault = BY_NAME[name]
    spoil(bench, fault.on + 4 + REFUSALS, name)
    bench.run(fault.off + 60)
    assert (name in bench.active) is fault.latched
    bench.health.acknowledge()
    assert name not in bench.active


def test_a_hand_may_carry_the_ball_round_and_the_next_top_counts_from_there() -> None:
    bench = started()
    for turns in (1.0, 0.9, 1.1):  # a full turn by hand, then torque with the ball about the new bottom
        bench.torque_nm = 0.0 if turns == 1.0 else 0.05
        assert "ball_runaway" not in bench.run(1, estimate={"x": np.array([0.0, 0.0, turns * tau, 0.0])})
    assert "ball_runaway" in bench.run(1, estimate={"x": np.array([0.0, 0.0, 0.4 * tau, 0.0])})


def test_an_operator_cannot_acknowledge_what_still_is_wrong() -> None:
    bench = started()
    spoil(bench, 5, "link_lost")
    bench.health.acknowledge()
    assert "link_lost" in bench.active
    assert "link_lost" in bench.health.hindrances()


def test_the_board_that_never_enables_is_reported() -> None:
    bench = Bench()
    assert "board_refuses" not in bench.run(BY_NAME["board_refuses"].on - 1, driver={"status": 0})
    assert "board_refuses" in bench.run(1, driver={"status": 0})


def test_missed_timer_expirations_count_as_overruns() -> None:
    bench = started()
    bench.k += 3
    bench.board_ms += 60
    assert {"overrun", "overrun_repeated"} <= set(bench.run(1))


def test_counts_are_consecutive_never_per_lifetime() -> None:
    bench = started()
    for _ in range(40):
        spoil(bench, 2, "link_lost")
        bench.run(1)
    assert "link_lost" not in bench.active


def test_the_strongest_action_wins() -> None:
    bench = started()
    spoil(bench, 11, "ball_lost")
    assert bench.health.action() is Action.PAUSE
    spoil(bench, 1, "camera_lost")
    assert bench.health.action() is Action.STOP
    spoil(bench, 3, "link_lost")
    assert bench.health.action() is Action.CUT


def test_nothing_seen_yet_forbids_arming() -> None:
    health = Health(Thresholds(), PERIOD)
    empty = Inputs(1, 0.02, None, None, LinkCounts(), (), 0.0, 0.0, False, 0)
    health.update(empty, Estimate(np.zeros(4), False, nan, nan, False, nan), Sent(0.0, 0.0, 0))
    assert {"link_lost", "camera_lost"} <= set(health.hindrances())


def test_every_row_of_the_table_is_tested() -> None:
    # the board's refusal is above, drift is half a minute's work: test_drift; of pictures that lie: test_picturechecks
    elsewhere = {"board_refuses", "model_drift", *PICTURE_FAULTS, *ENCODER_FAULTS}
    assert {fault.name for fault in FAULTS} == set(BAD) | elsewhere


def test_infinite_state_is_not_finite() -> None:
    assert "not_finite" in started().run(1, estimate={"x": np.array([inf, 0.0, 0.0, 0.0])})


def test_a_row_that_is_off_forbids_arming_until_it_is_accepted() -> None:
    bench = started()
    assert bench.health.hindrances() == ()
    (told,) = bench.health.arming_hindrances()
    assert told.startswith("current_implausible is off (faults.torque_constant_nm_per_a is 0)")
    assert started(torque_constant_nm_per_a=0.37).health.arming_hindrances() == ()
    assert started(accepted_off=("current_implausible",)).health.arming_hindrances() == ()


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("current_implausible", {"torque_constant_nm_per_a": 0.37, "current_mismatch_nm": 1.4}),
        ("hoop_overspeed", {"torque_constant_nm_per_a": 0.37, "hoop_speed_rad_s": 200.0}),
    ],
)
def test_a_number_that_switches_a_row_off_is_told(name: str, numbers: dict) -> None:
    assert set(Thresholds(**numbers).not_accepted()) == {name}
    assert not Thresholds(**numbers, accepted_off=(name,)).not_accepted()


def test_a_hoop_without_a_ball_implies_its_rows() -> None:
    thresholds = Thresholds(ball_expected=False, torque_constant_nm_per_a=0.37)
    assert {"camera_lost", "ball_unresponsive"} <= set(thresholds.off_rows())
    assert not thresholds.not_accepted()


def test_a_row_that_does_not_exist_cannot_be_accepted() -> None:
    with pytest.raises(ValueError, match="no row 'curent_implausible'"):
        Thresholds(accepted_off=("curent_implausible",))


def test_another_model_is_free_of_what_was_held_against_the_one_before() -> None:
    health = Health(Thresholds(), 0.02)
    health.raise_now("model_drift")
    health.raise_now("link_lost")
    health.follow("a", "b", None, None, None)
    assert [fault.name for fault in health.active()] == ["link_lost"] == [*health.halting()]
    health.raise_now("model_drift")  # the new one may drift as well
    assert "model_drift" in [fault.name for fault in health.active()]


def test_a_model_that_comes_back_from_a_trial_brings_its_drift_along() -> None:
    """It would learn the device that has drifted as normal."""
    health = Health(Thresholds(), 0.02)
    drift = health.drift
    health.raise_now("model_drift")
    health.follow("a", "b", None, None, None)
    assert not health.active() and health.drift is not drift
    health.follow("b", "a", None, None, None)
    assert [fault.name for fault in health.active()] == ["model_drift"] and health.drift is drift
    health.follow("a", "c", None, None, None)
    assert not health.active()
