"""Board and wire in virtual time: pacing, order, faults at their edges, the same for any step of the caller."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hoopd.core.frames import DEFAULT_LAYOUT, Answer, Decoder, encode_request
from hoopd.sim.board import BYTE_S, DriverBoard
from hoopd.sim.faults import FaultScript, ScriptedFault
from hoopd.sim.torque_log import TorqueLog, TorqueRow
from hoopd.sim.wiredboard import WiredBoard


class Still:
    """Plant stub that never moves."""

    state = (0.0, 0.0, 0.0, 0.0)

    def advance(self, t: float, torque_nm: float) -> None: ...

    def sample(self) -> tuple[float, float, float]:
        return 0.0, 0.0, math.nan


def run(
    faults: list[ScriptedFault], step_s: float = 0.02, ticks: int = 100
) -> tuple[list[tuple[float, bytes]], TorqueLog]:
    """Ask at 50 Hz and advance in steps; what arrived, and the board's log."""
    rows: list[TorqueRow] = []
    board = DriverBoard(Still(), np.random.default_rng(0), sink=rows.append)
    wired, arrived = WiredBoard(board, FaultScript(faults, seed=5)), []
    for k in range(ticks):
        wired.write(0.02 * k, encode_request(DEFAULT_LAYOUT, k, True, False, 0.1))
        for i in range(1, round(0.02 / step_s) + 1):
            t = 0.02 * k + i * step_s - 1e-9
            wired.advance(t)
            arrived += wired.arrived(t)
    return arrived, TorqueLog(rows)


def test_an_answer_is_there_after_28_bytes() -> None:
    arrived, log = run([])
    assert [t for t, _ in arrived] == pytest.approx([0.02 * k + 28 * BYTE_S for k in range(100)])
    assert log.rows[1].t == pytest.approx(8 * BYTE_S)


def test_back_to_back_writes_queue_on_the_wire() -> None:
    board = DriverBoard(Still(), np.random.default_rng(0))
    wired = WiredBoard(board)
    for seq in (1, 2):
        wired.write(0.0, encode_request(DEFAULT_LAYOUT, seq, True, False, 0.1))
    assert wired.next_event() == pytest.approx(8 * BYTE_S)
    wired.advance(0.01)
    first, second = wired.arrived(0.01)
    assert first[0] == pytest.approx(28 * BYTE_S)
    assert second[0] == pytest.approx(48 * BYTE_S)


@pytest.mark.parametrize(
    "faults",
    [
        [ScriptedFault("board_reset", 0.5051)],
        [ScriptedFault("board_silent", 0.5051, 0.3)],
        [ScriptedFault("board_fault", 0.5051, 0.3)],
        [ScriptedFault("bit_flips", 0.2, 1.0, {"rate": 0.02}), ScriptedFault("late_frames", 0.5, 0.5, {"rate": 0.3})],
        [ScriptedFault("garbage", 0.2, 1.0, {"rate": 0.5}), ScriptedFault("duplicated_frames", 0.5, 0.5)],
    ],
)
def test_the_step_of_the_caller_changes_nothing(faults: list[ScriptedFault]) -> None:
    coarse, fine = run(faults, 0.02), run(faults, 0.001)
    assert coarse[0] == fine[0]
    assert coarse[1].rows == fine[1].rows


def test_silence_of_the_board_ends_in_its_own_timeout() -> None:
    _, log = run([ScriptedFault("board_silent", 0.5051, 0.3)])
    assert log.reasons()["timeout"] == 1
    assert log.zero_for_good_from(0.5051) <= 0.1


def test_a_reset_falls_at_its_instant() -> None:
    arrived, log = run([ScriptedFault("board_reset", 0.5051)])
    assert next(row.t for row in log.rows if row.reason == "reset") == pytest.approx(0.5051)
    answers = [e for _, data in arrived for e in Decoder(DEFAULT_LAYOUT).feed(data)]
    assert isinstance(answers[26], Answer)
    assert answers[26].board_ms == 15
