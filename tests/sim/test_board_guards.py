"""What the board cuts and limits by itself: overspeed, overcurrent, steps of the torque; judged from its own log."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings, strategies as st
from sim.boardbench import Bench, Pushed

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    ERROR_OVERCURRENT,
    ERROR_OVERSPEED,
    STATUS_ENABLED,
    STATUS_FAULT,
    encode_request,
)
from hoopd.sim.board import BoardConfig

# The wheel of the bench takes up 500 rad/s^2 for each N m.
ACCELERATION = 500.0


def run_up(bench: Bench, torque_nm: float, seconds: float) -> list[int]:
    """Ask for the same torque at 50 Hz; the error bits of the answers."""
    return [bench.ask(0.02 * k, torque_nm).errors for k in range(1, round(seconds / 0.02) + 1)]


@pytest.mark.parametrize("torque_nm", [0.7, -0.7, 0.2])
def test_a_host_that_wants_the_largest_torque_for_ever_is_ended_by_overspeed(torque_nm: float) -> None:
    bench = Bench()
    errors = run_up(bench, torque_nm, 2.0)
    cut = next(row for row in bench.log.rows if row.reason == "fault")
    reached = 100.0 / (ACCELERATION * abs(torque_nm))
    assert cut.t - 0.02 == pytest.approx(reached, abs=0.002)
    assert bench.log.zero_for_good_from(cut.t) == 0.0
    assert abs(bench.plant.dtheta) == pytest.approx(100.0, abs=0.5)
    assert errors[-1] == ERROR_OVERSPEED
    assert bench.board.status == STATUS_FAULT


def test_overspeed_is_not_cleared_before_the_hoop_has_come_down() -> None:
    bench = Bench(plant=Pushed())
    bench.ask(0.02, 0.3)
    bench.plant.dtheta = 101.0
    assert bench.ask(0.04, 0.3).errors == ERROR_OVERSPEED
    for t, speed, left in ((0.06, 60.0, ERROR_OVERSPEED), (0.08, -10.5, ERROR_OVERSPEED), (0.10, 9.5, 0)):
        bench.plant.dtheta = speed
        assert bench.ask(t, clear=True).errors == left
    assert bench.log.zero_for_good_from(0.04) == 0.0
    assert bench.ask(0.12, 0.3).status == STATUS_ENABLED


def test_a_hoop_that_is_turned_by_hand_trips_a_board_that_is_off() -> None:
    bench = Bench(plant=Pushed())
    bench.plant.dtheta = -120.0
    bench.board.advance(0.1)
    assert bench.ask(0.12, 0.3).status == STATUS_FAULT
    assert bench.log.max_abs() == 0.0


def test_a_restart_forgets_the_latch_and_finds_the_condition_again() -> None:
    bench = Bench(plant=Pushed())
    bench.plant.dtheta = 120.0
    bench.board.reset(0.1)
    assert bench.ask(0.12, 0.3).errors == ERROR_OVERSPEED
    bench.plant.dtheta = 50.0
    bench.board.reset(0.2)
    assert bench.ask(0.22, 0.3).errors == 0


@pytest.mark.parametrize("current", [2.6, -2.6])
def test_a_current_that_no_torque_needs_is_an_overcurrent(current: float) -> None:
    bench = Bench(plant=Pushed())
    bench.ask(0.02, 0.3)
    bench.plant.current = current
    answer = bench.ask(0.04, 0.3)
    assert (answer.status, answer.errors) == (STATUS_FAULT, ERROR_OVERCURRENT)
    assert bench.ask(0.06, clear=True).errors == ERROR_OVERCURRENT  # it lasts
    bench.plant.current = 0.0
    assert bench.ask(0.08, clear=True).errors == 0
    assert bench.log.zero_for_good_from(0.04) == 0.0


def test_the_largest_torque_is_no_overcurrent_and_a_wrong_constant_is() -> None:
    fine, wrong = Bench(), Bench(BoardConfig(dtheta_noise=0.0, current_noise=0.0, kt=0.2))
    assert run_up(fine, 0.7, 0.1)[-1] == 0
    assert run_up(wrong, 0.7, 0.1)[-1] == ERROR_OVERCURRENT
    assert wrong.log.max_abs() <= 2.5 * 0.2 + 0.07  # the first step beyond the limit is the last


def test_every_limit_is_configured() -> None:
    config = BoardConfig(dtheta_noise=0.0, current_noise=0.0, overspeed_rad_s=5.0, slew_nm_per_ms=0.1)
    bench = Bench(config)
    bench.ask(0.02, 0.5)
    bench.board.advance(0.02095)
    assert bench.board.torque_nm == pytest.approx(0.1)
    assert run_up(bench, 0.5, 0.2)[-1] == ERROR_OVERSPEED
    assert abs(bench.plant.dtheta) < 6.0


def test_off_waits_for_no_slope() -> None:
    bench = Bench()
    bench.ask(0.02, 0.7)
    bench.ask(0.04, 0.7, enable=False)
    assert bench.log.zero_for_good_from(0.04) == 0.0
    bench.ask(0.06, 0.7)
    bench.board.advance(0.5)
    assert bench.log.zero_for_good_from(0.06) == pytest.approx(0.1)


def test_the_log_holds_every_step_of_the_torque() -> None:
    """The plant got exactly what the log says: the speed is the log's integral."""
    bench = Bench()
    for k, torque in enumerate((0.7, -0.7, 0.3, 0.35, -0.1), start=1):
        bench.ask(0.02 * k, torque)
    bench.board.advance(0.12)
    integral = sum(row.torque_nm * (then.t - row.t) for row, then in pairwise(bench.log.rows))
    integral += bench.log.rows[-1].torque_nm * (0.12 - bench.log.rows[-1].t)
    assert bench.plant.dtheta == pytest.approx(ACCELERATION * integral, rel=1e-9)


wishes = st.tuples(st.floats(-3.0, 3.0, width=32), st.booleans(), st.booleans(), st.floats(1e-5, 0.05))


@settings(max_examples=100, deadline=None)
@given(st.lists(wishes, max_size=40))
def test_no_host_moves_the_torque_faster_or_the_hoop_beyond_the_limit(steps: list) -> None:
    bench, t = Bench(), 0.0
    for seq, (torque, enable, clear, pause) in enumerate(steps):
        t += pause
        bench.board.receive(t, encode_request(DEFAULT_LAYOUT, seq, enable, clear, torque))
    bench.board.advance(t + 0.2)
    rows = bench.log.rows
    for before, after in pairwise(rows):
        assert abs(after.torque_nm) <= 0.7
        if after.enabled:
            assert abs(after.torque_nm - before.torque_nm) <= 0.07 + 1e-12
    changes = [after for before, after in pairwise(rows) if after.enabled and after.torque_nm != before.torque_nm]
    # ten steps of 0.07 N m in a millisecond and no more
    assert all(b.t - a.t >= 1e-4 - 1e-9 for a, b in pairwise(changes) if a.enabled)
    assert abs(bench.plant.dtheta) <= 100.0 + ACCELERATION * 0.7 * 0.001 + 1e-6
