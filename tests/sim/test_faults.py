"""Scripted faults: the table, the times, the wire and the board."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    ERROR_SUPPLY,
    STATUS_FAULT,
    Answer,
    Decoder,
    LinkFault,
    encode_answer,
    encode_request,
)
from hoopd.sim.board import DriverBoard
from hoopd.sim.faults import KINDS, BoardFaults, Fault, FaultScript, FaultyWire, fault_from_table
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
    return FaultyWire(FaultScript([Fault(kind, 1.0, 1.0, params)], seed=3), DEFAULT_LAYOUT)


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


def test_the_same_seed_does_the_same() -> None:
    lines = [wire("bit_flips", rate=0.1) for _ in range(2)]
    assert [lines[0].answer(1.5, ANSWER) for _ in range(50)] == [lines[1].answer(1.5, ANSWER) for _ in range(50)]


def test_board_faults_and_reset_reach_the_board() -> None:
    script = FaultScript([Fault("board_fault", 1.0, 0.5, {"name": "supply"}), Fault("board_reset", 3.0)])
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
