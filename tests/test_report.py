"""The summary at the end of a run: what it measures, over which seconds, and that its numbers add up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.rigrun import run_rig

from hoopd.daemon.report import _summary_rows
from hoopd.recording.mcap import read
from hoopd.shell.statistics import RunStatistics
from hoopd.sim import truth

FRICTION = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.008}}]"
STEP = "sim.commands=[{at_s: 5, name: reference, value: 0.05}]"


def rows(summary: dict[str, Any], virtual: bool = True) -> dict[str, str]:
    return dict(_summary_rows(summary, virtual))


def shown_noise(summary: dict[str, Any]) -> float:
    (text,) = (text for name, text in rows(summary).items() if name.startswith("psi error"))
    return float(text.removesuffix(")").split()[-1])


def test_what_is_printed(tmp_path: Path) -> None:
    long, short = (run_rig(tmp_path / str(end), duration_s=end).summary for end in (6.0, 3.0))
    shown = rows(long)
    assert "x real time" in shown["duration"] and "x real time" not in rows(long, virtual=False)["duration"]
    (name,) = (name for name in shown if name.startswith("psi error"))
    assert name == "psi error, 3.6 to 5.9 s" and float(shown[name].split()[0]) < 0.01
    assert float(shown["  by the rig's own state"].split()[0]) < 0.003
    long["psi_error"]["measured"]["noise_rad"] = 2.2e-5  # of pictures; four decimals called it none
    assert shown_noise(long) == pytest.approx(2.2e-5)
    assert rows(short)["psi error"].startswith("- (never controlled for more than 2.5 s")
    assert short["psi_error"] == {"measured": None, "true": None}
    without_ball = {**long, "psi_error": None}
    assert not any("psi" in name or "rig" in name for name in rows(without_ball))


def test_the_error_is_that_of_the_recorded_pictures_and_of_the_rig_s_truth(tmp_path: Path) -> None:
    """With friction that its model does not know, the filter's estimate stood nearer to the reference than the ball."""
    summary = run_rig(tmp_path, FRICTION, STEP, duration_s=20.0).summary
    told, recording = summary["psi_error"], read(tmp_path / summary["recording"]["file"])
    first, last = told["measured"]["over_s"]
    seen = np.isfinite(recording.psi) & (recording.psi_t >= first - 1e-9) & (recording.psi_t <= last + 1e-9)
    errors = recording.psi[seen] - 0.05
    assert told["measured"]["samples"] == len(errors) > 200
    assert told["measured"]["rms_rad"] == pytest.approx(np.sqrt(np.mean(errors**2)))
    state = truth.read(tmp_path / "truth.csv")
    first, last = told["true"]["over_s"]
    part = (state.t >= first - 1e-6) & (state.t <= last + 1e-6)
    assert told["true"]["rms_rad"] == pytest.approx(np.sqrt(np.mean((state.psi[part] - 0.05) ** 2)))
    assert told["true"]["rms_rad"] > 0.005


def test_start_up_ticks_and_missed_ones_are_the_run() -> None:
    statistics = RunStatistics(0.02)
    for tick_id in (44, 46, 47, 50, 1003):  # the first two come whenever start-up is done
        statistics.add(tick_id, 0.02 * tick_id + 0.0003, 0.0003, 0.001)
    told = statistics.summary()
    assert (told["ticks"], told["missed"]) == (5, 2 + 952)
    assert told["start_up_s"] + 0.02 * (told["ticks"] + told["missed"]) == pytest.approx(20.06)


def test_the_printed_duration_is_start_up_and_periods(tmp_path: Path) -> None:
    summary = run_rig(tmp_path, duration_s=2.0).summary
    assert summary["start_up_s"] == 0.0 and "start-up" not in rows(summary)["duration"]
    late = {**summary, "seconds": 20.06, "start_up_s": 0.88, "ticks": 958, "missed": 1}
    assert rows(late, virtual=False)["duration"] == "20.06 s, of it 0.88 s start-up"
    assert rows(late)["ticks"] == "958 and 1 missed, every 20 ms"


@pytest.mark.parametrize(
    ("sets", "ended_by", "shown"),
    [
        ((), [], "controlled for 2."),
        (("sim.faults=[{kind: board_fault, at_s: 2, for_s: 0.5}]",), None, "FAULT, controlled for "),
        (("sim.faults=[{kind: camera_stall, at_s: 2, for_s: 0.5}]",), ["camera_lost"], "DISARMED, controlled for "),
        (("sim.commands=[{at_s: 2, name: disarm}]",), [], "DISARMED, controlled for "),
        (("sim.faults=[{kind: ball_gone, at_s: 0}]",), [], "DISARMED, never controlled: ball_lost"),
        (("sim.faults=[{kind: board_silent, at_s: 0}]",), [], "DISARMED, never controlled: link_lost"),
    ],
    ids=["well", "cut", "stopped", "disarmed", "no ball", "no board"],
)
def test_what_ended_control_or_was_in_its_way_is_told(
    tmp_path: Path, sets: tuple[str, ...], ended_by: list[str] | None, shown: str
) -> None:
    summary = run_rig(tmp_path, *sets, duration_s=4.0).summary
    told, row = summary["control"], rows(summary)["mode at the end"]
    assert shown in row
    assert set(told["ended_by"]) <= set(summary["faults"])
    if ended_by is None:
        assert told["ended_by"] and summary["final_mode"] == "FAULT"
    else:
        assert told["ended_by"] == ended_by
    if told["ended_by"]:
        assert row.endswith(f"ended by {', '.join(told['ended_by'])} at {told['ended_at_s']:.2f} s")


def test_control_that_was_taken_up_again_was_not_ended(tmp_path: Path) -> None:
    stall, arm = "sim.faults=[{kind: camera_stall, at_s: 2, for_s: 0.3}]", "sim.commands=[{at_s: 4, name: arm}]"
    summary = run_rig(tmp_path, stall, arm, duration_s=5.0).summary
    assert summary["faults"]["camera_lost"] == 1 and summary["control"]["ended_by"] == []
