"""The laws in the full rig, in lock-step: bytes, board, camera two frames late, noise; judged by the true state.

The plant alone is in tests/design/test_closedloop.py; here the whole daemon runs, from `--sim --speed max`.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from harness.rigrun import RigRun, run_rig

from hoopd.daemon.replay import replay
from hoopd.files.controller import WIDEST_GATE_RAD
from hoopd.files.reading import InputError
from hoopd.recording.mcap import read_run

ROOT = Path(__file__).resolve().parents[2]
CONTROLLERS = ROOT / "config" / "controllers"
DEGREE = math.radians(1.0)
THESIS = ("device.model=models/thesis.yaml", "sim.model=models/thesis.yaml")
AT_REST = "sim.psi_rad=0"
WRONG_ZERO = f"sim.angle_offset_rad={DEGREE}"


def controller(name: str) -> str:
    return f"control.file=controllers/{name}.yaml"


def commands(*rows: str) -> str:
    return f"sim.commands=[{', '.join(rows)}]"


def settles(run: RigRun) -> bool:
    """psi inside 0.05 rad within 1.5 s for good, the hoop below 1 rad/s within 5 s for good."""
    return run.settled_s(run.psi, 0.05) <= 1.5 and run.settled_s(run.dtheta, 1.0) <= 5.0


def open_gate(folder: Path, name: str) -> str:
    """A shipped controller whose filter believes the false picture: the widest gate that a file may have."""
    file = yaml.safe_load((CONTROLLERS / f"{name}.yaml").read_text())
    file["estimator"]["gate_nis"] = (0.99 * WIDEST_GATE_RAD) ** 2 / file["estimator"]["r_psi"]
    path = folder / "open.yaml"
    path.write_text(yaml.safe_dump(file))
    return f"control.file={path}"


def own_law(folder: Path, text: str) -> str:
    path = folder / "law.py"
    path.write_text(text)
    return f"control.law={path}"


# ------------------------------------------------------------------------------------------------ regulation


def test_released_ball_comes_to_rest_with_rendered_pictures(tmp_path: Path) -> None:
    judge_with_pictures(tmp_path, "lqg")


@pytest.mark.proof
def test_released_ball_comes_to_rest_with_rendered_pictures_and_the_other_law(tmp_path: Path) -> None:
    judge_with_pictures(tmp_path, "arx")


def judge_with_pictures(tmp_path: Path, name: str) -> None:
    run = run_rig(tmp_path, controller(name), duration_s=8.0, pictures=True)
    assert run.t[-1] > 6.5 and run.psi[0] == pytest.approx(0.4, abs=1e-3)
    assert settles(run)
    assert run.torque.max_abs() <= 0.7 * (1 + 1e-6)  # a float of four bytes


@pytest.mark.parametrize("name", ["lqg", "arx"])
@pytest.mark.parametrize("phase", [0.0, 0.95])
def test_released_ball_comes_to_rest_whatever_the_cameras_phase(tmp_path: Path, name: str, phase: float) -> None:
    assert settles(run_rig(tmp_path, controller(name), f"sim.camera_phase={phase}", duration_s=8.0))


DISTURBED = (AT_REST, "sim.disturbance_rad=0.4", "sim.disturbance_at_s=3.0")


@pytest.mark.parametrize("name", ["lqg", "arx"])
def test_the_gate_refuses_one_sample_of_disturbance(tmp_path: Path, name: str) -> None:
    """The thesis's test cannot be seen in the shipped loop: one impossible sample moves nothing."""
    run = run_rig(tmp_path, controller(name), *DISTURBED, duration_s=8.0, pictures=name == "lqg")
    assert np.nanmax(run.psi_seen) > 0.35  # the disturbance was there
    assert run.summary["faults"]["ball_missing"] >= 1
    assert np.abs(run.psi).max() < 0.01 and np.abs(run.u).max() < 0.03


@pytest.mark.parametrize("name", ["lqg", "arx"])
def test_one_sample_of_disturbance_that_the_filter_believes(tmp_path: Path, name: str) -> None:
    run = run_rig(tmp_path, open_gate(tmp_path, name), *DISTURBED, duration_s=8.0, pictures=name == "lqg")
    seen = float(run.t[np.nanargmax(run.psi_seen)])
    assert np.abs(run.psi).max() > 0.02 and np.abs(run.u).max() > 0.03  # it did move
    assert run.settled_s(run.psi, 0.05, seen) <= 1.5 and run.settled_s(run.dtheta, 1.0, seen) <= 5.0


# ------------------------------------------------------------------------------------------------ the thesis's device


def test_pid_with_a_zero_angle_error_lets_the_hoop_run(tmp_path: Path) -> None:
    run = run_rig(tmp_path, *THESIS, controller("pid"), AT_REST, "sim.delay_frames=1", WRONG_ZERO, duration_s=25.0)
    end = run.after(18.0)
    assert abs(run.dtheta[end].mean()) == pytest.approx(7.4, abs=0.5) and np.ptp(run.dtheta[end]) < 0.5
    assert abs(np.nanmean(run.psi_seen[end])) < 1e-3
    assert run.psi[end].mean() == pytest.approx(-DEGREE, abs=1e-3)


def test_pid_without_the_error_lets_the_hoop_come_to_rest(tmp_path: Path) -> None:
    run = run_rig(tmp_path, *THESIS, controller("pid"), "sim.delay_frames=1", duration_s=25.0)
    assert np.abs(run.dtheta).max() > 5.0
    assert np.abs(run.dtheta[run.after(15.0)]).max() < 0.5
    assert run.settled_s(run.psi, 0.05) < 1.5


@pytest.mark.parametrize("release", [AT_REST, "sim.psi_rad=0.4"])
def test_lqg_keeps_the_hoop_slow_with_the_same_error(tmp_path: Path, release: str) -> None:
    run = run_rig(tmp_path, *THESIS, release, "sim.delay_frames=1", WRONG_ZERO, duration_s=15.0)
    assert np.abs(run.dtheta[run.after(0.0 if release == AT_REST else 1.5)]).max() < 2.0


@pytest.mark.parametrize("release", [AT_REST, "sim.psi_rad=0.4"])
def test_pid_is_a_limit_cycle_with_two_frames_and_the_tick_phase(tmp_path: Path, release: str) -> None:
    run = run_rig(tmp_path, *THESIS, controller("pid"), release, duration_s=25.0)
    cycles = [run.after(a) & (run.t < a + 4.0) for a in (14.0, 18.0)]
    for part in cycles:
        assert run.u[part].max() == pytest.approx(0.7) and run.u[part].min() == pytest.approx(-0.7)
    swings = [np.ptp(run.psi[part]) for part in cycles]
    assert swings[0] == pytest.approx(swings[1], rel=0.05) and 1.0 < swings[0] < 4.0  # neither dies nor grows
    assert np.ptp(run.dtheta[cycles[1]]) > 30.0


@pytest.mark.parametrize("frames", [1, 2])
def test_lead_fails_with_a_camera(tmp_path: Path, frames: int) -> None:
    """From rest, by noise alone, its swing grows to full torque and takes the ball over the top of the hoop."""
    lead = (*THESIS, controller("lead"), AT_REST)
    run = run_rig(tmp_path, *lead, f"sim.delay_frames={frames}", duration_s=15.0)
    early = run.t < 6.0
    assert np.abs(run.psi[early]).max() > math.pi
    assert run.u[early].max() == pytest.approx(0.7) and run.u[early].min() == pytest.approx(-0.7)
    assert run.torque.max_abs() <= 0.7 * (1 + 1e-6)
    assert set(run.summary["faults"]) & {"ball_runaway", "hoop_overspeed"} and run.summary["final_mode"] != "RUNNING"


def test_the_lead_on_the_default_rig_ends_by_itself(tmp_path: Path) -> None:
    """The circling ball once ran on without a fault, its angle hundreds of radians away."""
    run = run_rig(tmp_path, controller("lead"), duration_s=20.0)
    # which of the two comes first is decided within a few ticks
    assert set(run.summary["faults"]) & {"ball_runaway", "hoop_overspeed"} and run.summary["running_s"] < 2.0
    assert run.torque.longest_nonzero_after(3.0) == 0.0


def test_lead_works_without_delay(tmp_path: Path) -> None:
    """So it is the delay that it fails of."""
    run = run_rig(tmp_path, *THESIS, controller("lead"), "sim.delay_frames=0", "sim.camera_phase=0", duration_s=8.0)
    assert run.settled_s(run.psi, 0.05) < 1.6


# ------------------------------------------------------------------------------------------------ references


def test_a_small_reference_is_held(tmp_path: Path) -> None:
    """With the hoop speed that friction demands for it, 23 rad/s for 0.1 rad."""
    steps = commands("{at_s: 3, name: reference, value: 0.1}", "{at_s: 11, name: reference, value: 0}")
    run = run_rig(tmp_path, AT_REST, steps, duration_s=17.0)
    begin = 3.0 - (17.0 - run.t[-1])  # of the run's own time
    held = run.after(begin + 1.0) & (run.t < begin + 7.9)
    np.testing.assert_allclose(run.psi[held], 0.1, atol=0.015)
    assert run.dtheta[held][-1] == pytest.approx(23.0, abs=1.5)
    back = run.after(begin + 8.0)
    assert np.abs(run.psi[back]).max() < 0.15 and run.psi[back].min() > -0.06  # stopped at once: -0.25
    after = run.after(begin + 11.0)
    assert np.abs(run.psi[after]).max() < 0.02 and np.abs(run.dtheta[after]).max() < 2.5  # 23 exp(-0.79 3)


def test_a_large_reference_is_limited_by_the_hoop_speed_it_would_need(tmp_path: Path) -> None:
    """0.3 rad needs 69 rad/s of the hoop: reached for half a second, then 30 rad/s and the angle they carry."""
    run = run_rig(tmp_path, AT_REST, commands("{at_s: 3, name: reference, value: 0.3}"), duration_s=14.0)
    assert run.psi.max() > 0.25
    assert np.abs(run.dtheta).max() < 33.0
    assert run.psi[run.after(run.t[-1] - 1.0)].mean() == pytest.approx(30 / 231, abs=0.015)
    assert run.summary["final_mode"] == "DISARMED" and "hoop_overspeed" not in run.summary["faults"]


def test_a_hoop_driven_by_hand_turns_as_wanted_stops_by_itself_and_replays(tmp_path: Path) -> None:
    """10 rad/s for six seconds, then silence: the same without the operator's last word."""
    hand = ", ".join(f"{{at_s: {3 + 0.1 * k:g}, name: speed, value: 10}}" for k in range(60))
    run = run_rig(tmp_path, AT_REST, commands(hand), duration_s=12.0)
    ends = 9.0 - (12.0 - run.t[-1])  # of the run's own time
    held = run.after(ends - 3.0) & (run.t < ends)
    np.testing.assert_allclose(run.dtheta[held], 10.0, atol=0.3)
    assert np.abs(run.psi[run.after(1.0)]).max() < 0.15
    assert np.abs(run.dtheta[run.after(ends + 1.0)]).max() < 1.0  # 0.3 s of patience, then it is braked
    assert replay(tmp_path / "run-0001.mcap")["equal"] is True


def test_a_disarm_forgets_the_reference(tmp_path: Path) -> None:
    rows = "{at_s: 1.5, name: reference, value: 0.2}, {at_s: 2, name: disarm}, {at_s: 2.2, name: arm}"
    run_rig(tmp_path, AT_REST, commands(rows), duration_s=4.0)
    ticks = read_run(tmp_path / "run-0001.mcap").ticks
    assert {tick.reference for tick in ticks if tick.t < 2.0 and tick.mode == "RUNNING"} == {0.0, 0.2}
    assert {tick.reference for tick in ticks if tick.t > 2.1 and tick.mode == "RUNNING"} == {0.0}


def test_a_reference_beyond_the_range_is_cut_to_it(tmp_path: Path) -> None:
    run_rig(tmp_path, AT_REST, commands("{at_s: 2, name: reference, value: 3.0}"), duration_s=3.0)
    assert max(tick.reference for tick in read_run(tmp_path / "run-0001.mcap").ticks) == 0.5


# ------------------------------------------------------------------------------------------------ limits


def test_torque_limit_holds_on_the_board(tmp_path: Path) -> None:
    run = run_rig(tmp_path, "limits.torque_nm=0.03", "sim.psi_rad=0.8", duration_s=8.0)
    assert run.torque.max_abs() <= 0.03 * (1 + 1e-6)  # a float of four bytes
    assert (np.abs(run.u) > 0.0299).sum() > 5  # it did bite
    assert settles(run)


@pytest.mark.parametrize("slew", [0.01, 0.05])
def test_slew_limit_holds_on_the_board(tmp_path: Path, slew: float) -> None:
    run = run_rig(tmp_path, controller("arx"), f"limits.slew_nm_per_tick={slew}", duration_s=8.0)
    changes = np.abs(np.diff([0.0, *run.u]))
    assert changes.max() <= slew + 1e-7
    assert (changes > 0.99 * slew).sum() > 3  # it did bite
    assert run.settled_s(run.psi, 0.05) < 3.0


UNAWARE = """
from hoopd.core.controllers import TransferFunctionController


class Law(TransferFunctionController):
    def __init__(self):
        super().__init__({b}, {a})
        self.wanted = 0.0

    def update(self, m):
        self.wanted, log = super().update(m._replace(torque_previous=self.wanted))
        return self.wanted, log
"""


def test_anti_windup(tmp_path: Path) -> None:
    """PID at its limit for most of a big swing; the same PID, if it believes its own wishes, loses the ball."""
    gains = yaml.safe_load((CONTROLLERS / "pid.yaml").read_text())["gains"]
    law = own_law(tmp_path, UNAWARE.format(**gains))
    sets = (*THESIS, controller("pid"), "sim.delay_frames=1", "limits.torque_nm=0.1", "sim.psi_rad=1.5")
    aware = run_rig(tmp_path / "aware", *sets, duration_s=12.0)
    unaware = run_rig(tmp_path / "unaware", *sets, law, duration_s=12.0)
    assert (np.abs(aware.u) > 0.0999).sum() > 12
    assert aware.settled_s(aware.psi, 0.05) < 2.0 and np.abs(aware.psi).max() < 1.51
    assert np.abs(unaware.psi).max() > math.tau


@pytest.mark.parametrize("name", ["lqg", "arx"])
def test_lqg_recovers_from_a_big_swing_at_its_torque_limit(tmp_path: Path, name: str) -> None:
    run = run_rig(tmp_path, controller(name), "limits.torque_nm=0.05", "sim.psi_rad=1.2", duration_s=10.0)
    assert (np.abs(run.u) > 0.0499).sum() > 5
    assert np.abs(run.psi).max() < 1.25
    assert run.settled_s(run.psi, 0.05) < 3.0 and run.settled_s(run.dtheta, 1.0) < 5.0


# ------------------------------------------------------------------------------------------------ own laws, tuning


def documented_law() -> str:
    """The code block of docs/guides/laws.md."""
    found = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "guides" / "laws.md").read_text(), re.DOTALL)
    assert found is not None
    return found.group(1)


def test_the_documented_law_runs_within_the_same_limits(tmp_path: Path) -> None:
    law = documented_law()
    assert len([line for line in law.splitlines() if line.strip()]) <= 20
    run = run_rig(tmp_path, own_law(tmp_path, law), duration_s=8.0)
    assert settles(run)
    limited = run_rig(tmp_path / "limited", own_law(tmp_path, law), "limits.torque_nm=0.02", duration_s=4.0)
    assert limited.torque.max_abs() == pytest.approx(0.02)
    assert replay(tmp_path / "run-0001.mcap", run_law=True)["equal"]


WILD = """
class Law:
    def reset(self):
        pass

    def update(self, m):
        {body}
"""


def test_a_wild_law_gets_no_more_than_the_limit(tmp_path: Path) -> None:
    law = own_law(tmp_path, WILD.format(body="return 1e9, {}"))
    assert run_rig(tmp_path, law, "limits.torque_nm=0.1", duration_s=2.0).torque.max_abs() == pytest.approx(0.1)


@pytest.mark.parametrize("body", ["return float('nan'), {}", "return 1 / 0, {}", "return None"])
def test_a_law_that_fails_switches_the_drive_off(tmp_path: Path, body: str) -> None:
    run = run_rig(tmp_path, own_law(tmp_path, WILD.format(body=body)), duration_s=2.0)
    assert run.summary["faults"]["not_finite"] == 1 and run.summary["final_mode"] == "FAULT"
    assert run.torque.max_abs() == 0.0


def test_gains_change_while_running(tmp_path: Path) -> None:
    """One run of two with its gain on psi taken away 0.1 s after the release: the same until then, and replayable."""
    plain = run_rig(tmp_path / "plain", duration_s=4.0)
    tuned = run_rig(tmp_path / "tuned", commands("{at_s: 1.2, name: tune, key: k_psi, value: 0.0}"), duration_s=4.0)
    same = plain.t < 0.08
    np.testing.assert_array_equal(plain.u[same], tuned.u[same])
    assert np.abs(plain.psi - tuned.psi).max() > 0.02
    events = {event.event for event in read_run(tmp_path / "tuned" / "run-0001.mcap").events}
    assert "tuned" in events
    assert replay(tmp_path / "tuned" / "run-0001.mcap")["equal"]


@pytest.mark.parametrize("row", ["key: k_nothing, value: 1", "key: hoop_speed_limit, value: -1"])
def test_tuning_of_nonsense_is_refused(tmp_path: Path, row: str) -> None:
    run = run_rig(tmp_path, commands(f"{{at_s: 1.5, name: tune, {row}}}"), duration_s=4.0)
    assert "command_refused" in {event.event for event in read_run(tmp_path / "run-0001.mcap").events}
    assert run.settled_s(run.psi, 0.05) < 1.5


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("def", "SyntaxError"),
        ("import no_such_module", "ModuleNotFoundError"),
        ("class Law:\n    def update(self, m):\n        return 0.0, {}", "needs a class Law"),
        ("Law = 3", "needs a class Law"),
        ("class Law:\n    def __init__(self):\n        raise OSError('no')", "OSError: no"),
    ],
)
def test_a_file_that_is_no_law_is_one_line(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(InputError) as refused:
        run_rig(tmp_path, own_law(tmp_path, text), duration_s=1.0)
    assert reason in str(refused.value) and "law.py" in str(refused.value) and "\n" not in str(refused.value)
