"""Operators who race in whole runs: what switches off wins; the judge is the board's own log of torque."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from harness.runs import PERIOD_S, Run, run
from samples import sampled

from hoopd.core.modes import Mode
from hoopd.daemon import app
from hoopd.daemon.replay import replay
from hoopd.shell.loop import Loop

WISH_S = 0.2  # so long may an arm wait for the board


def command(at_s: float, name: str) -> dict[str, Any]:
    return {"at_s": at_s, "name": name}


def refused(found: Run) -> list[tuple[str, str]]:
    rows = [event.fields for event in found.events if event.event == "command_refused"]
    return [(fields["command"], fields["reason"]) for fields in rows]


def stays_off(found: Run, since: float) -> None:
    """From the tick at `since` on nothing is energised, by the board's log and by the recording."""
    assert found.torque.max_abs(start=since + 0.01) == 0.0
    assert not any(row.enabled for row in found.torque.rows if row.t > since + 0.01)
    assert found.modes(since, 99.0) <= {Mode.DISARMED, Mode.FAULT}
    assert replay(found.recordings[0])["equal"]


@pytest.mark.parametrize("names", [("arm", "disarm"), ("disarm", "arm"), ("arm", "stop"), ("stop", "arm")])
def test_an_arm_beside_it_does_not_win(names: tuple[str, str], tmp_path: Path) -> None:
    script = [command(2.0, "disarm"), *(command(3.0, name) for name in names)]
    found = run(tmp_path, duration_s=4.5, commands=script)
    assert found.mode_at(1.9) == Mode.RUNNING
    stays_off(found, 2.0)
    other = next(name for name in names if name != "arm")
    assert refused(found) == [("arm", f"revoked by {other}")]


def test_an_arm_and_a_disarm_at_six_seconds_of_a_run_disarmed_at_four(tmp_path: Path) -> None:
    found = run(
        tmp_path, duration_s=9.0, commands=[command(4.0, "disarm"), command(6.0, "arm"), command(6.0, "disarm")]
    )
    stays_off(found, 4.0)
    assert found.ticks[-1].mode == Mode.DISARMED and found.ticks[-1].t > 8.9


@pytest.mark.parametrize("name", ["disarm", "stop", "shutdown"])
def test_an_arm_that_waits_for_the_board_is_taken_back(name: str, tmp_path: Path) -> None:
    fault = {"kind": "board_fault", "at_s": 2.0, "for_s": 0.5}
    armed = run(tmp_path / "armed", duration_s=4.5, faults=[fault], commands=[command(3.0, "arm")])
    assert armed.mode_at(3.0) == Mode.FAULT and armed.mode_at(4.0) == Mode.RUNNING  # it has to wait
    script = [command(3.0, "arm"), command(3.0 + PERIOD_S, name)]
    found = run(tmp_path / "raced", duration_s=4.5, faults=[fault], commands=script)
    stays_off(found, 2.1)
    assert refused(found) == [("arm", f"revoked by {name}")]


@pytest.mark.parametrize("name", ["disarm", "stop"])
@pytest.mark.parametrize("at_s", sampled([0.5, 1.0, 1.06], [1.06]))
def test_a_rig_switched_off_before_it_arms_does_not_arm_itself(name: str, at_s: float, tmp_path: Path) -> None:
    found = run(tmp_path, duration_s=3.0, commands=[command(at_s, name)])
    stays_off(found, at_s)
    later = run(tmp_path / "later", duration_s=3.0, commands=[command(at_s, name), command(1.5, "arm")])
    assert later.mode_at(2.5) == Mode.RUNNING  # the operator still may


def test_an_operator_who_arms_first_and_disarms_is_not_armed_again(tmp_path: Path) -> None:
    first = run(tmp_path / "first", duration_s=2.0)
    armed = next(tick.t for tick in first.ticks if tick.mode == Mode.READY)
    for early in (armed - 2 * PERIOD_S, armed - PERIOD_S, armed):
        script = [command(early, "arm"), command(early + PERIOD_S, "disarm")]
        found = run(tmp_path / f"{early:.2f}", duration_s=3.0, commands=script)
        stays_off(found, early + PERIOD_S)


def asked_to_end(patch: pytest.MonkeyPatch, *times: float) -> None:
    """The loop gets SIGTERM at these run times, before the commands of their tick."""
    left, original = list(times), Loop._commands

    def commands(self: Loop, t: float) -> Any:
        while left and t >= left[0] - 1e-9:
            left.pop(0)
            self.request_stop()
        return original(self, t)

    patch.setattr(app.Loop, "_commands", commands)


@pytest.mark.parametrize("after", [0, 1, 2])
def test_a_signal_after_an_arm_ends_it_without_torque(
    after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_s = 3.0 + after * PERIOD_S
    asked_to_end(monkeypatch, at_s)
    fault = {"kind": "board_fault", "at_s": 2.0, "for_s": 0.5}
    found = run(tmp_path, duration_s=9.0, faults=[fault], commands=[command(3.0, "arm"), command(at_s, "arm")])
    stays_off(found, at_s)
    assert found.ticks[-1].t < at_s + 0.1  # nothing was braked, so nothing was waited for


def test_arms_during_the_end_are_refused_and_a_second_signal_switches_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked_to_end(monkeypatch, 3.0, 3.1)
    arms = [command(3.0 + k * PERIOD_S, "arm") for k in range(20)]
    found = run(tmp_path, duration_s=9.0, commands=[command(1.5, "reference"), *arms], psi_rad=0.4)
    assert found.mode_at(2.9) == Mode.RUNNING
    stays_off(found, 3.1)
    assert found.ticks[-1].t < 3.3


def test_the_end_of_the_run_takes_no_arm(tmp_path: Path) -> None:
    arms = [command(2.5 + k * PERIOD_S, "arm") for k in range(80)]
    found = run(tmp_path, duration_s=3.0, commands=arms)
    assert found.mode_at(2.98) == Mode.RUNNING
    assert found.modes(3.0, 99.0) <= {Mode.STOPPING, Mode.DISARMED} and found.ticks[-1].mode == Mode.DISARMED
    assert found.torque.rows[-1].torque_nm == 0.0
