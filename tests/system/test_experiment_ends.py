"""Every way out of an experiment ends with zero torque; the judge is the board's own log of torque."""

from __future__ import annotations

import errno
import io
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from system.experiments import ends_at_rest, perform

from hoopd.daemon.conductor import Conductor
from hoopd.daemon.operator_abort import ABORTED
from hoopd.daemon.replay import replay
from hoopd.plants.hoop.loop.experiment_plan import Plan
from hoopd.shell import recorder
from hoopd.sim import torque_log


def test_a_breach_stops_it_and_says_why(tmp_path: Path) -> None:
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1, clock_ticks=4, angle_limit_rad=0.3))
    assert found.result["outcome"].startswith("ball angle 0.3") and found.result["exit"] == 1
    assert any("it would end early" in note for note in found.result["notes"])
    told = [e for e in found.run.events if e.event == "law_ended"]
    assert len(told) == 1 and told[0].t == found.result["ended_at_s"] and told[0].level == "warning"
    assert found.torque.max_abs(start=told[0].t + 0.002) <= 0.1 and ends_at_rest(found)
    assert {row.mode for row in found.run.ticks if row.t >= told[0].t} == {"STOPPING", "DISARMED"}
    assert replay(found.path)["equal"]


def at(patch: pytest.MonkeyPatch, t: float, act: Any) -> None:
    """Let something happen at a run time."""
    original = Conductor.put

    def put(self: Conductor, record: Any, inputs: Any) -> None:
        original(self, record, inputs)
        if abs(record.t - t) < 0.01:
            act(self)

    patch.setattr(Conductor, "put", put)


def test_abort_switches_off_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at(monkeypatch, 3.0, Conductor.abort)
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1))
    assert found.result["outcome"] == ABORTED and found.result["exit"] == 1
    assert found.torque.zero_for_good_from(3.0) <= 0.03
    assert found.run.ticks[-1].mode == "DISARMED" and found.run.ticks[-1].t < 3.2
    assert replay(found.path)["equal"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_in_order(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at(monkeypatch, 3.0, lambda _: os.kill(os.getpid(), number))
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1))
    assert found.result["outcome"] == (ABORTED if number == signal.SIGINT else "stopped: by the operator")
    asked = next(event.t for event in found.run.events if event.event == "operator" and event.t > 3.0)
    assert asked < 6.1  # virtual time looks at signals once a second, and takes three looks
    assert found.torque.zero_for_good_from(asked) <= (0.03 if number == signal.SIGINT else 1.1) and ends_at_rest(found)
    assert replay(found.path)["equal"]


FAULTS = {
    "link lost": ("board_silent", "link_lost", 0.2),
    "camera lost": ("camera_stall", "camera_lost", 1.4),
    "ball lost": ("ball_gone", "ball_lost", 0.4),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_end_it(name: str, tmp_path: Path) -> None:
    kind, fault, within_s = FAULTS[name]
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1), f"sim.faults=[{{kind: {kind}, at_s: 3.0, for_s: 2.0}}]")
    assert found.result["outcome"] == f"stopped: {fault}" and found.result["exit"] == 1
    assert found.torque.zero_for_good_from(3.0) <= within_s and ends_at_rest(found)
    assert found.run.ticks[-1].t < 3.0 + within_s + 1.0
    assert replay(found.path)["equal"]


def test_no_ball_where_one_is_expected_never_starts(tmp_path: Path) -> None:
    found = perform(tmp_path, Plan("prbs", 2.0), "sim.faults=[{kind: ball_gone, at_s: 0.0}]")
    assert found.result["outcome"] == "not started: ball_missing, ball_lost" and found.result["exit"] == 1
    assert found.torque.max_abs() == 0.0 and found.result["played_s"] == 0.0


def test_a_fault_before_the_signal_ends_it_soon(tmp_path: Path) -> None:
    faults = "sim.faults=[{kind: ball_gone, at_s: 0.0}, {kind: board_silent, at_s: 3.0, for_s: 1.0}]"
    found = perform(tmp_path, Plan("prbs", 2.0), faults)
    assert found.result["outcome"].startswith("not started: link_lost") and found.run.ticks[-1].t < 3.5
    assert found.torque.max_abs() == 0.0


@pytest.mark.parametrize("name", ["disarm", "stop"])
def test_switched_off_before_it_armed_it_ends_at_once(name: str, tmp_path: Path) -> None:
    found = perform(tmp_path, Plan("prbs", 2.0), f"sim.commands=[{{at_s: 0.5, name: {name}}}]")
    assert found.result["outcome"] == "not started: disarmed by the operator" and found.result["exit"] == 1
    assert found.torque.max_abs() == 0.0 and found.run.ticks[-1].t < 0.7


def test_a_watcher_that_fails_leaves_zero_torque(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Conductor) -> None:
        raise RuntimeError("no more")

    at(monkeypatch, 3.0, fail)
    with pytest.raises(RuntimeError, match="no more"):
        perform(tmp_path, Plan("prbs", 10.0, 0.1))
    assert torque_log.read(tmp_path / "torque.jsonl").zero_for_good_from(3.0) <= 0.03
    assert replay(tmp_path / "run.mcap")["equal"] and not list(tmp_path.glob(".run.mcap.*"))


@pytest.mark.parametrize("back", [True, False])
def test_a_disk_that_fails_keeps_what_it_took(back: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    put = recorder.Recorder.put

    def timed(self: recorder.Recorder, record: Any, inputs: Any) -> None:
        now[0] = record.t
        put(self, record, inputs)

    class Disk(io.FileIO):
        def write(self, data: Any) -> int:
            if now[0] >= 3.0 and not (back and now[0] > 4.0):
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data) or 0

    def create(where: Path) -> tuple[Path, Disk]:
        path = where / f"run-{len(list(where.glob('run-*'))) + 1:04d}.mcap"
        return path, Disk(path, "xb")

    monkeypatch.setattr(recorder.Recorder, "put", timed)
    monkeypatch.setattr(recorder, "create", create)
    found = perform(tmp_path, Plan("prbs", 4.0, 0.05))
    assert found.result["outcome"] == "done" and found.torque.rows[-1].torque_nm == 0.0
    assert 2.5 < found.run.ticks[-1].t <= 3.0 and any("was refused by the disk" in n for n in found.result["notes"])
    assert (tmp_path / "run-2.mcap").exists() == back == any("run-2.mcap" in n for n in found.result["notes"])
    assert replay(found.path)["equal"] and not list(tmp_path.glob(".run.mcap.*"))
