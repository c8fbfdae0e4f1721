"""A host that has gone mad, through the whole rig: the board ends it, and the daemon says so and stays off."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.runs import TORQUE_LIMIT_NM, run

from hoopd.core.frames import ERROR_OVERCURRENT, ERROR_OVERSPEED, STATUS_ENABLED, STATUS_FAULT
from hoopd.core.health import HARD_ERRORS
from hoopd.core.modes import Mode
from hoopd.daemon.replay import replay
from hoopd.sim import truth

AT_S = 2.0
LIMIT_RAD_S = 100.0


def mad(for_s: float = 2.0, **params: Any) -> list[dict[str, Any]]:
    return [{"kind": "host_mad", "at_s": AT_S, "for_s": for_s, "params": params}]


@pytest.mark.parametrize("torque_nm", [0.7, -0.7, 50.0, 0.15])
def test_a_constant_torque_is_ended_by_the_board(torque_nm: float, tmp_path: Path) -> None:
    found = run(tmp_path, faults=mad(torque_nm=torque_nm))
    cut = next(row.t for row in found.torque.rows if row.reason == "fault")
    true = truth.read(tmp_path / "truth.csv")
    assert found.torque.max_abs() <= TORQUE_LIMIT_NM
    assert found.torque.zero_for_good_from(cut) == 0.0
    before = np.flatnonzero(true.t < cut)[-1]
    rate = (true.dtheta[before] - true.dtheta[before - 1]) / 0.02
    reached = abs(true.dtheta[before] + rate * (cut - true.t[before]))
    assert LIMIT_RAD_S - 0.5 <= reached <= LIMIT_RAD_S + 1.0  # a look every millisecond
    assert np.abs(true.dtheta).max() <= LIMIT_RAD_S + 1.0
    after = [tick for tick in found.ticks if tick.t > cut + 0.04]
    assert {tick.mode for tick in after} == {Mode.FAULT}
    assert after[0].status == STATUS_FAULT
    assert after[0].errors & ERROR_OVERSPEED
    assert found.fault_at("board_fault") <= cut + 0.04
    assert replay(found.recordings[0])["equal"]


def test_an_operator_cannot_arm_before_the_hoop_has_come_down(tmp_path: Path) -> None:
    again = [{"at_s": t, "name": "arm"} for t in (4.5, 20.0)]
    found = run(tmp_path, duration_s=22.0, faults=mad(for_s=1.0), commands=again)
    true = truth.read(tmp_path / "truth.csv")
    first = next(tick for tick in found.ticks if tick.t > 4.8)
    assert first.mode == Mode.FAULT
    assert first.errors & ERROR_OVERSPEED
    assert abs(np.interp(4.8, true.t, true.dtheta)) > 0.1 * LIMIT_RAD_S
    assert abs(np.interp(20.0, true.t, true.dtheta)) < 0.1 * LIMIT_RAD_S
    assert found.torque.max_abs(2.5, 19.9) == 0.0
    assert found.mode_at(21.5) in (Mode.READY, Mode.RUNNING)
    assert next(tick for tick in found.ticks if tick.t > 21.0).status & STATUS_ENABLED


def test_a_torque_that_turns_round_stays_below_the_limit_and_ends_with_the_madness(tmp_path: Path) -> None:
    found = run(tmp_path, faults=mad(pattern="alternate", period_s=0.4))
    true = truth.read(tmp_path / "truth.csv")
    assert 60.0 < np.abs(true.dtheta).max() < LIMIT_RAD_S
    assert found.torque.reasons().get("fault", 0) == 0
    assert found.torque.max_abs(AT_S + 1.9, AT_S + 2.0) == pytest.approx(TORQUE_LIMIT_NM)
    assert found.torque.zero_for_good_from(AT_S + 2.0) <= 0.02
    assert math.isfinite(found.fault_at("hoop_overspeed"))  # the daemon is sane and off; nobody listens to it


def test_the_overspeed_limit_is_configured(tmp_path: Path) -> None:
    found = run(tmp_path, faults=mad(torque_nm=0.2), board={"overspeed_rad_s": 30.0})
    true = truth.read(tmp_path / "truth.csv")
    assert 29.0 < np.abs(true.dtheta).max() < 31.0
    assert found.torque.zero_for_good_from(found.fault_at("board_fault")) == 0.0


def test_the_current_limit_is_configured(tmp_path: Path) -> None:
    """0.2 N m are 0.54 A: no fault of the shipped limit, one of 0.5 A."""
    found = run(tmp_path, faults=mad(torque_nm=0.2), board={"current_limit_a": 0.5})
    assert found.torque.max_abs(AT_S, AT_S + 2.0) <= 0.2 + 1e-6
    assert found.torque.zero_for_good_from(AT_S) <= 0.03
    told = next(tick for tick in found.ticks if tick.t > AT_S + 0.1)
    assert (told.status, told.errors & HARD_ERRORS) == (STATUS_FAULT, ERROR_OVERCURRENT)


def test_the_slew_limit_is_configured(tmp_path: Path) -> None:
    """0.05 N m/ms from whatever the law asked to 0.7 N m: 14 ms at most, in steps of 0.005 N m."""
    found = run(tmp_path, duration_s=3.0, faults=mad(for_s=1.0), board={"slew_nm_per_ms": 0.05})
    steps = [abs(b.torque_nm - a.torque_nm) for a, b in pairwise(found.torque.rows) if b.enabled]
    assert max(steps) == pytest.approx(0.005, abs=1e-9)
    assert found.torque.torque_at(AT_S + 0.005) < 0.4
    assert found.torque.torque_at(AT_S + 0.02) == pytest.approx(TORQUE_LIMIT_NM)
