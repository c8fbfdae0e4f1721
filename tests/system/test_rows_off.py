"""Rows of the fault table that are off: arming asks for each, `hoopd check` names it, a replay knows the old files."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from harness.runs import run
from harness.smallrig import healthy

from hoopd.core.health import Thresholds
from hoopd.core.records import CameraSample
from hoopd.core.slow_ticks import rows_off
from hoopd.daemon.checks import Verdict, exit_code, fault_rows
from hoopd.daemon.replay import recorded_config, replay
from hoopd.daemon.report import operator_status
from hoopd.files.reading import InputError
from hoopd.shell.config import load

UNKNOWN = {"faults": {"torque_constant_nm_per_a": 0.0, "accepted_off": []}}


def test_a_rig_with_a_row_off_does_not_arm(tmp_path: Path) -> None:
    found = run(tmp_path, duration_s=3.0, config=UNKNOWN, commands=[{"at_s": 2.0, "name": "arm"}])
    assert found.torque.max_abs() == 0.0
    assert {tick.mode for tick in found.ticks} == {"DISARMED"}
    (refused,) = [e.fields["reason"] for e in found.events if e.event == "command_refused"]
    assert "current_implausible is off (faults.torque_constant_nm_per_a is 0)" in refused


def test_it_does_when_the_row_is_accepted(tmp_path: Path) -> None:
    accepted = {"faults": {**UNKNOWN["faults"], "accepted_off": ["current_implausible"]}}
    found = run(tmp_path, duration_s=3.0, config=accepted)
    assert found.mode_at(2.9) == "RUNNING"
    assert replay(found.recordings[0])["equal"]


def test_a_recording_of_before_ran_with_its_rows_off() -> None:
    text = "faults: {torque_constant_nm_per_a: 0.0}"
    assert not recorded_config(Path("old.mcap"), text).faults.not_accepted()
    assert recorded_config(Path("new.mcap"), text[:-1] + ", accepted_off: []}").faults.not_accepted()


def test_the_shipped_device_accepts_what_it_lacks() -> None:
    faults = load(None, sim=False, overrides=[]).faults
    assert list(faults.off_rows()) == ["current_implausible"] and not faults.not_accepted()
    assert not load(None, sim=True, overrides=[]).faults.off_rows()


def test_check_tells_what_is_off_and_why() -> None:
    missing, accepted, well = (
        fault_rows(thresholds)
        for thresholds in (
            Thresholds(),
            Thresholds(accepted_off=("current_implausible",)),
            Thresholds(torque_constant_nm_per_a=0.37),
        )
    )
    assert (missing.verdict, accepted.verdict, well.verdict) == (Verdict.FAIL, Verdict.WARN, Verdict.OK)
    assert exit_code([missing]) == 1 and "faults.accepted_off" in missing.advice
    assert all("current_implausible is off: faults.torque_constant" in row.granted for row in (missing, accepted))


def test_a_slow_tick_is_told_at_check_status_and_arming() -> None:
    assert rows_off(0.03) == {} and list(rows_off(0.05)) == ["ball_unresponsive"]
    slow = fault_rows(Thresholds(torque_constant_nm_per_a=0.37), 0.1)
    assert slow.verdict == Verdict.WARN and "hoop_innovation is off: loop.period_s is 0.1" in slow.granted
    rig = healthy()
    assert rig.tick.health.too_slow_for == {}
    rig.tick.health.period_s = 0.1
    (told,) = [note.fields["rows"] for note in rig.step("arm").notes if note.name == "rows_off"]
    loop = SimpleNamespace(tick=rig.tick, record=None, statistics=SimpleNamespace(summary=dict))
    status = operator_status(loop, SimpleNamespace(accepted=1, refused=0), None, None)  # type: ignore[arg-type]
    assert len(rows_off(0.1)) == 5 and all(row in told and row in status["rows_off"] for row in rows_off(0.1))


@pytest.mark.parametrize(
    ("pictures", "off"), [(25, ["ball_unresponsive"]), (30, ["ball_unresponsive"]), (45, []), (50, []), (52, []),
                          (60, ["angle_noiseless"]), (100, ["angle_noiseless"])],
)  # fmt: skip
def test_a_camera_that_leaves_rows_without_judgement_is_told(pictures: float, off: list[str]) -> None:
    assert list(rows_off(0.02, 1.0 / pictures)) == off
    found = fault_rows(Thresholds(torque_constant_nm_per_a=0.37), 0.02, 1.0 / pictures)
    assert found.verdict == (Verdict.WARN if off else Verdict.OK)


@pytest.mark.parametrize("pictures", [25, 50, 100])
def test_how_often_pictures_come_is_seen_and_told_at_arming(pictures: int) -> None:
    rig = healthy()

    def taken(t: float) -> CameraSample | None:
        newest = int((t - 0.005) * pictures)
        return CameraSample(newest, newest / pictures, t, 0.002 * (newest % 3), 1.0, 240.0, 422.0)

    rig._picture = taken  # type: ignore[method-assign, assignment]
    rig.run(200)
    told = [note.fields["rows"] for note in rig.step("arm").notes if note.name == "rows_off"]
    wanted = {25: "ball_unresponsive: the camera gives 25 pictures a second, it judges from 33 on",
              100: "angle_noiseless: the camera gives 100 pictures a second, more than there are ticks"}  # fmt: skip
    assert told == ([wanted[pictures]] if pictures in wanted else [])


def test_a_camera_that_was_away_is_no_slow_one() -> None:
    rig = healthy()
    rig.blind = 500
    rig.run(500)
    assert "ball_unresponsive" not in rig.tick.health.too_slow_for
    rig.run(1)
    assert "ball_unresponsive" not in rig.tick.health.too_slow_for


@pytest.mark.parametrize("value", ["[no_row]", "[1]", "current_implausible"])
def test_a_row_that_is_none_is_one_line(value: str) -> None:
    with pytest.raises(InputError, match=r"^[^\n]*accepted_off[^\n]*$"):
        load(None, sim=True, overrides=[f"faults.accepted_off={value}"])
