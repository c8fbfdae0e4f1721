"""DriverBoard by its contract: limits, time-out, latches, echo, wrap; judged from its own torque log."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given, settings, strategies as st
from sim.boardbench import Bench, Wheel

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    ERROR_CRC,
    ERROR_ENCODER,
    ERROR_SEQ_GAP,
    STATUS_ENABLED,
    STATUS_FAULT,
    STATUS_LIMITED,
    STATUS_TIMEOUT,
    THETA_WRAP_RAD,
    encode_request,
)
from hoopd.sim.board import BYTE_S, TIMEOUT_S, BoardConfig, wrap_theta
from hoopd.sim.torque_log import TorqueLogFile, TorqueRow, read


def test_torque_acts_from_the_last_byte_and_the_sample_is_of_that_instant() -> None:
    bench = Bench()
    bench.ask(0.020, 0.06)
    bench.board.advance(0.040)
    assert bench.plant.dtheta == pytest.approx(500 * 0.06 * 0.020)
    answer = bench.ask(0.040, -0.01)
    assert answer.dtheta == pytest.approx(0.6)
    assert answer.current == pytest.approx(-0.01 / 0.37)
    assert answer.status == STATUS_ENABLED
    assert answer.board_ms == 40


def test_torque_saturates_with_its_status_bit() -> None:
    bench = Bench()
    assert bench.ask(0.02, -3.0).status == STATUS_ENABLED | STATUS_LIMITED
    bench.board.advance(0.03)
    assert bench.board.torque_nm == -0.7
    assert bench.ask(0.04, 0.7).status == STATUS_ENABLED
    assert bench.log.max_abs() == 0.7


def test_without_enable_there_is_no_torque() -> None:
    bench = Bench()
    assert bench.ask(0.02, 0.5, enable=False).status == 0
    assert bench.log.max_abs() == 0.0


def test_the_timeout_falls_at_100_ms_and_stays_latched_until_cleared() -> None:
    bench = Bench()
    bench.ask(0.02, 0.3)
    bench.board.advance(0.5)
    assert bench.log.longest_nonzero_after(0.0) == pytest.approx(TIMEOUT_S)
    assert bench.log.rows[-1] == TorqueRow(pytest.approx(0.12), 0.0, False, "timeout")
    assert bench.ask(0.52, 0.3).status == STATUS_TIMEOUT
    assert bench.ask(0.54, 0.3, enable=False).status == STATUS_TIMEOUT
    assert bench.ask(0.56, 0.3, clear=True).status == 0  # clearing never enables by itself
    assert bench.ask(0.58, 0.3).status == STATUS_ENABLED
    assert bench.log.max_abs(0.13, 0.575) == 0.0


def test_a_gap_just_below_the_timeout_is_harmless() -> None:
    bench = Bench()
    bench.ask(0.02, 0.3)
    assert bench.ask(0.1199, 0.3).status == STATUS_ENABLED


def test_the_timeout_latches_while_disabled_too() -> None:
    bench = Bench()
    bench.ask(0.02, enable=False)
    assert bench.ask(0.30, enable=False).status == STATUS_TIMEOUT


def test_no_timeout_before_the_first_request() -> None:
    bench = Bench()
    bench.board.advance(5.0)
    assert bench.ask(5.0, 0.1).status == STATUS_ENABLED


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_torque_that_is_no_number_is_a_latched_fault(bad: float) -> None:
    bench = Bench()
    bench.ask(0.02, 0.3)
    assert bench.ask(0.04, bad).status == STATUS_FAULT
    assert bench.ask(0.06, 0.3).status == STATUS_FAULT
    assert bench.log.longest_nonzero_after(0.04) == 0.0
    bench.ask(0.08, clear=True)
    assert bench.ask(0.10, 0.3).status == STATUS_ENABLED


def test_an_injected_fault_clears_only_after_its_condition() -> None:
    bench = Bench()
    bench.ask(0.02, 0.3)
    bench.board.inject("encoder", 0.03)
    assert bench.board.torque_nm == 0.0
    answer = bench.ask(0.04, 0.3)
    assert (answer.status, answer.errors) == (STATUS_FAULT, ERROR_ENCODER)
    assert bench.ask(0.06, clear=True).status == STATUS_FAULT
    bench.board.heal("encoder")
    assert bench.ask(0.08).errors == ERROR_ENCODER
    cleared = bench.ask(0.10, clear=True)
    assert (cleared.status, cleared.errors) == (0, 0)


def test_a_bad_crc_and_a_gap_are_told_once() -> None:
    bench = Bench()
    bench.ask(0.02)
    damaged = bytearray(encode_request(DEFAULT_LAYOUT, 2, True, False, 0.5))
    damaged[5] ^= 1
    bench.board.receive(0.04, bytes(damaged))
    assert bench.board.outgoing(0.05) == []
    assert bench.board.torque_nm == 0.0
    bench.seq = 2
    assert bench.ask(0.06).errors == ERROR_CRC | ERROR_SEQ_GAP
    assert bench.ask(0.08).errors == 0


def test_a_repeated_request_is_a_gap() -> None:
    bench = Bench()
    bench.ask(0.02)
    bench.seq -= 1
    assert bench.ask(0.04).errors == ERROR_SEQ_GAP


def test_a_partial_frame_is_dropped_after_2_ms() -> None:
    frame = encode_request(DEFAULT_LAYOUT, 1, True, False, 0.5)
    split = Bench().board
    split.receive(0.02, frame[:4])
    split.receive(0.0215 + 3 * BYTE_S, frame[4:])
    assert len(split.outgoing(1.0)) == 1
    late = Bench().board
    late.receive(0.02, frame[:4])
    late.receive(0.0225 + 3 * BYTE_S, frame[4:])
    assert late.outgoing(1.0) == []
    late.receive(0.04, frame)
    assert len(late.outgoing(1.0)) == 1


def test_two_requests_in_one_chunk_have_their_own_instants() -> None:
    bench = Bench()
    frames = [encode_request(DEFAULT_LAYOUT, s, True, False, 0.1 * s) for s in (1, 2)]
    bench.board.receive(0.02, b"".join(frames))
    first, second = bench.board.outgoing(0.02)
    assert second[0] - first[0] == pytest.approx(8 * BYTE_S)


def test_reset_disables_and_restarts_the_clock() -> None:
    bench = Bench()
    bench.ask(0.02, 0.3)
    bench.board.reset(0.05)
    assert bench.log.longest_nonzero_after(0.05) == 0.0
    answer = bench.ask(0.0605, 0.0, enable=False)
    assert (answer.status, answer.errors, answer.board_ms) == (0, 0, 10)


def test_the_board_clock_wraps() -> None:
    assert Bench().ask(65.536 + 0.0105).board_ms == 10


def test_the_encoder_quantises_and_wraps() -> None:
    answer = Bench(plant=Wheel(1.0)).ask(0.02)
    assert answer.theta == pytest.approx(math.floor(1.0 / (2 * math.pi / 4096)) * 2 * math.pi / 4096)
    assert wrap_theta(THETA_WRAP_RAD) == -THETA_WRAP_RAD
    assert Bench(plant=Wheel(THETA_WRAP_RAD + 1.0)).ask(0.02).theta == pytest.approx(1.0 - THETA_WRAP_RAD, abs=2e-3)


def test_noise_is_seeded() -> None:
    runs = [Bench(BoardConfig()).ask(0.02) for _ in range(2)]
    assert runs[0] == runs[1]
    assert runs[0].dtheta != 0.0


requests = st.tuples(
    st.floats(width=32, allow_nan=True, allow_infinity=True), st.booleans(), st.booleans(), st.floats(0.001, 0.3)
)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.one_of(requests, st.binary(max_size=20)), max_size=30))
@example([(0.0, False, False, 0.25), (0.0, False, False, 0.06), b"\x00", (-0.01, True, False, 0.06)])
def test_whatever_comes_the_torque_is_bounded_and_dies_100_ms_after_the_last_request(steps: list) -> None:
    bench, t = Bench(), 0.0
    for seq, step in enumerate(steps):
        if isinstance(step, bytes):
            t += 0.005
            bench.board.receive(t, step)
        else:
            torque, enable, clear, pause = step
            t += pause
            bench.board.receive(t, encode_request(DEFAULT_LAYOUT, seq, enable, clear, torque))
    bench.board.advance(t + 1.0)
    assert bench.log.max_abs() <= 0.7
    assert bench.log.zero_for_good_from(t) <= TIMEOUT_S + 1e-9
    for row in bench.log.rows:
        assert row.enabled or row.torque_nm == 0.0


def test_the_log_file_reads_back_and_answers_questions(tmp_path) -> None:
    path = tmp_path / "torque.jsonl"
    rows = [
        TorqueRow(0.0, 0.0, False, "start"),
        TorqueRow(1.0, 0.5, True, "request"),
        TorqueRow(1.02, -0.7, True, "request"),
        TorqueRow(1.1, 0.0, False, "timeout"),
        TorqueRow(2.0, 0.1, True, "request"),
    ]
    with TorqueLogFile(path) as sink:
        for row in rows:
            sink(row)
        with path.open("a") as torn:
            torn.write('{"t":3.0,"torq')
        log = read(path)
    assert log.rows == rows
    assert [log.torque_at(t) for t in (-1.0, 0.5, 1.0, 1.05, 1.5, 9.0)] == [0.0, 0.0, 0.5, -0.7, 0.0, 0.1]
    assert log.max_abs(1.2, 1.9) == 0.0
    assert log.max_abs() == 0.7
    assert log.longest_nonzero_after(0.0) == pytest.approx(0.1)
    assert log.longest_nonzero_after(1.05) == pytest.approx(0.05)
    assert log.longest_nonzero_after(0.0, stop=2.5) == pytest.approx(0.5)
    assert log.zero_from(1.05) == pytest.approx(0.05)
    assert log.zero_for_good_from(1.0) == math.inf
    assert log.reasons()["request"] == 3
    assert log.enabled_at(1.01)
