"""Scripted faults: the table, the times, the wire and the board."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    ERROR_SUPPLY,
    STATUS_FAULT,
    THETA_WRAP_RAD,
    Answer,
    Decoder,
    LinkFault,
    encode_answer,
    encode_request,
)
from hoopd.sim.board import DriverBoard
from hoopd.sim.faults import KINDS, BoardFaults, FaultScript, FaultyWire, ScriptedFault, fault_from_table
from hoopd.sim.torque_log import TorqueRow

ANSWER = encode_answer(DEFAULT_LAYOUT, Answer(1, 1, 0, 0.5, 1.0, 0.1, 20))
REQUEST = encode_request(DEFAULT_LAYOUT, 1, True, False, 0.1)


class Still:
    """Plant stub that never moves."""

    state = (0.0, 0.0, 0.0, 0.0)

    def advance(self, t: float, torque_nm: float) -> None: ...

    def sample(self) -> tuple[float, float, float]:
        return 0.0, 0.0, math.nan


def wire(kind: str, **params: object) -> FaultyWire:
    return FaultyWire(FaultScript([ScriptedFault(kind, 1.0, 1.0, params)], seed=3), DEFAULT_LAYOUT)


def differing_bits(a: bytes, b: bytes) -> int:
    return sum((x ^ y).bit_count() for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("kind", [k for k, row in KINDS.items() if row.side == "link"])
def test_outside_its_time_a_fault_does_nothing(kind: str) -> None:
    line = wire(kind)
    for t in (0.0, 0.999, 2.0):
        assert line.answer(t, ANSWER) == [(t, ANSWER)]
        assert line.request(t, REQUEST) == [(t, REQUEST)]


def test_bit_flips_by_count_and_by_rate() -> None:
    line = wire("bit_flips", every=3, bits=2)
    counts = [differing_bits(ANSWER, line.answer(1.5, ANSWER)[0][1]) for _ in range(9)]
    assert counts == [0, 0, 2] * 3
    line = wire("bit_flips", rate=0.25)
    total = sum(differing_bits(ANSWER, line.answer(1.5, ANSWER)[0][1]) for _ in range(500))
    assert total / (500 * 20) == pytest.approx(0.25, abs=0.02)


def test_lost_late_duplicated_silent() -> None:
    assert wire("lost_frames").answer(1.5, ANSWER) == []
    assert wire("board_silent").request(1.5, REQUEST) == []
    assert wire("late_frames", delay_s=0.05).answer(1.5, ANSWER) == [(1.55, ANSWER)]
    assert wire("duplicated_frames").request(1.5, REQUEST) == [(pytest.approx(1.5 + 8 * 10 / 115200), REQUEST * 2)]


def test_direction_is_kept() -> None:
    line = wire("lost_frames", direction="answer")
    assert line.answer(1.5, ANSWER) == []
    assert line.request(1.5, REQUEST) == [(1.5, REQUEST)]


def test_garbage_stands_before_the_frame() -> None:
    ((_, data),) = wire("garbage", bytes=5).answer(1.5, ANSWER)
    assert len(data) == 25
    assert data.endswith(ANSWER)


@pytest.mark.parametrize(("kind", "field"), [("implausible_speed", "dtheta"), ("implausible_current", "current")])
def test_implausible_values_come_with_a_good_crc(kind: str, field: str) -> None:
    ((_, data),) = wire(kind).answer(1.5, ANSWER)
    assert Decoder(DEFAULT_LAYOUT).feed(data) == [LinkFault("implausible", 1, field)]


def mad_torques(line: FaultyWire, times: list[float]) -> list[float]:
    """What the board is asked for when the daemon asks to be off and to clear."""
    meek = encode_request(DEFAULT_LAYOUT, 7, False, True, 0.0)
    asked = [Decoder(DEFAULT_LAYOUT, "request").feed(line.request(t, meek)[0][1]) for t in times]
    assert all((one.seq, one.enable, one.clear_fault) == (7, True, False) for (one,) in asked)
    return [round(one.torque_nm, 6) for (one,) in asked]


def test_a_mad_host_asks_for_its_own_torque_in_good_frames() -> None:
    times = [1.0, 1.19, 1.21, 1.39, 1.41]
    assert mad_torques(wire("host_mad"), times) == [0.7] * 5
    assert mad_torques(wire("host_mad", torque_nm=-5.0), times) == [-5.0] * 5
    assert mad_torques(wire("host_mad", pattern="alternate"), times) == [0.7, 0.7, -0.7, -0.7, 0.7]
    assert mad_torques(wire("host_mad", pattern="alternate", period_s=0.2), times) == [0.7, -0.7, 0.7, -0.7, 0.7]


@pytest.mark.parametrize("params", [{"pattern": "random"}, {"period_s": 0.0}, {"torque_nm": math.nan}])
def test_a_madness_that_is_none_is_refused(params: dict) -> None:
    with pytest.raises(ValueError, match="host_mad"):
        ScriptedFault("host_mad", 1.0, 1.0, params)


def test_the_same_seed_does_the_same() -> None:
    lines = [wire("bit_flips", rate=0.1) for _ in range(2)]
    assert [lines[0].answer(1.5, ANSWER) for _ in range(50)] == [lines[1].answer(1.5, ANSWER) for _ in range(50)]


def test_board_faults_and_reset_reach_the_board() -> None:
    script = FaultScript(
        [ScriptedFault("board_fault", 1.0, 0.5, {"name": "supply"}), ScriptedFault("board_reset", 3.0)]
    )
    rows: list[TorqueRow] = []
    board = DriverBoard(Still(), np.random.default_rng(0), sink=rows.append)
    carrier = BoardFaults(script)
    seen = []
    for k in range(200):
        t = 0.02 * k
        carrier.update(t, board)
        board.receive(t, encode_request(DEFAULT_LAYOUT, k, True, k == 100, 0.1))
        (answer,) = Decoder(DEFAULT_LAYOUT).feed(board.outgoing(t)[0][1])
        assert isinstance(answer, Answer)
        seen.append(answer)
    assert (seen[60].status, seen[60].errors) == (STATUS_FAULT, ERROR_SUPPLY)
    assert seen[90].status == STATUS_FAULT  # latched after the condition
    assert seen[110].status == 1
    assert [row.reason for row in rows].count("reset") == 1


def test_camera_kinds_are_asked_by_name() -> None:
    script = FaultScript([fault_from_table({"kind": "late_pictures", "at_s": 2.0, "params": {"delay_s": 0.2}})])
    fault = script.active(5.0, "late_pictures")
    assert fault is not None
    assert fault["delay_s"] == 0.2
    assert script.active(5.0, "camera_stall") is None
    assert script.active(1.0, "late_pictures") is None


@pytest.mark.parametrize(
    ("row", "word"),
    [
        ({"kind": "gremlin", "at_s": 0}, "gremlin.*bit_flips"),
        ({"kind": "garbage", "at_s": 0, "params": {"colour": 1}}, "colour"),
        ({"kind": "garbage", "at_s": -1}, "at_s"),
        ({"kind": "garbage"}, "at_s"),
        ({"kind": "garbage", "at_s": 0, "when": 3}, "when"),
        ({"kind": "garbage", "at_s": 0, "params": {"direction": "up"}}, "direction"),
        ({"kind": "garbage", "at_s": 0, "params": {"bytes": "many"}}, "bytes"),
        ({"kind": "board_fault", "at_s": 0, "params": {"name": "fire"}}, "fire"),
    ],
)
def test_a_mistake_is_one_clear_line(row: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        fault_from_table(row)
    with pytest.raises(ValueError, match="gremlin"):
        FaultScript().active(0.0, "gremlin")


def told_by(line: FaultyWire, t: float, theta: float, dtheta: float) -> tuple[float, float]:
    """Angle and speed of the answer that the host gets."""
    ((_, data),) = line.answer(t, encode_answer(DEFAULT_LAYOUT, Answer(1, 1, 0, theta, dtheta, 0.1, 20)))
    (answer,) = Decoder(DEFAULT_LAYOUT).feed(data)
    assert isinstance(answer, Answer)
    return answer.theta, answer.dtheta


def turning(kind: str, **params: object) -> list[tuple[float, float, float]]:
    """(t, theta, dtheta) told every 20 ms: at rest until 1 s, then 5 rad/s^2; the lie begins at 1.5 s."""
    line = FaultyWire(FaultScript([ScriptedFault(kind, 1.5, 1.0, params)]), DEFAULT_LAYOUT)
    told = []
    for k in range(150):
        t, since = 0.02 * k, max(0.02 * k - 1.0, 0.0)
        told.append((t, *told_by(line, t, 2.5 * since**2, 5.0 * since)))
    return told


def test_a_frozen_encoder_holds_its_angle_and_says_that_nothing_turns() -> None:
    told = turning("encoder_frozen")
    before = told[74]
    assert {row[1:] for row in told[75:125]} == {(before[1], 0.0)}
    assert told[74][2] == pytest.approx(5.0 * 0.48)
    assert told[130][1] == pytest.approx(2.5 * 1.6**2)  # the truth went on, and comes back


def test_a_coasting_encoder_goes_on_with_the_speed_it_had() -> None:
    told = turning("encoder_coasts")
    t0, theta0, speed = told[74]
    for t, theta, dtheta in told[75:125]:
        assert theta == pytest.approx(theta0 + speed * (t - t0), abs=1e-6)
        assert dtheta == speed


@pytest.mark.parametrize("factor", [0.5, 2.0, -1.0])
def test_a_scaled_encoder_does_not_jump_and_turns_by_its_factor(factor: float) -> None:
    told = turning("encoder_scale", factor=factor)
    t0, theta0, _ = told[74]
    for t, theta, dtheta in told[75:125]:
        assert theta == pytest.approx(theta0 + factor * 2.5 * ((t - 1.0) ** 2 - (t0 - 1.0) ** 2), abs=1e-5)
        assert dtheta == pytest.approx(factor * 5.0 * (t - 1.0), abs=1e-5)


def test_a_scaled_encoder_wraps_where_the_board_wraps() -> None:
    line = FaultyWire(FaultScript([ScriptedFault("encoder_scale", 1.0, 9.0, {"factor": 2.0})]), DEFAULT_LAYOUT)
    told_by(line, 0.98, THETA_WRAP_RAD - 1.0, 50.0)
    theta, _ = told_by(line, 1.0, THETA_WRAP_RAD - 0.2, 50.0)
    assert theta == pytest.approx(-THETA_WRAP_RAD + 0.6, abs=1e-3)
    theta, _ = told_by(line, 1.02, -THETA_WRAP_RAD + 0.6, 50.0)  # the true count wraps
    assert theta == pytest.approx(-THETA_WRAP_RAD + 2.2, abs=1e-3)


@pytest.mark.parametrize("factor", ["half", math.nan])
def test_a_factor_is_a_number(factor: object) -> None:
    with pytest.raises(ValueError, match="factor must be a number"):
        fault_from_table({"kind": "encoder_scale", "at_s": 0, "params": {"factor": factor}})
