"""Every row of the fault table through the rig: right action, in time, never too much torque, cleared by its rule."""

from __future__ import annotations

import errno
import io
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest
from harness.runs import PERIOD_S, TORQUE_LIMIT_NM, Run, run, serve_late

from hoopd.core.encoderchecks import NAMES as ENCODER_FAULTS
from hoopd.core.faulttable import BY_NAME, FAULTS, Action
from hoopd.core.modes import Mode
from hoopd.daemon import app
from hoopd.shell import recorder

AT_S = 2.0  # the fault begins
EARLY_S = 2.3  # the operator arms while the fault lasts, a cut
EARLY_STOP_S = 2.8  # the same after a controlled stop
ARM_S = 4.4  # the operator arms when it is long over
END_S = 6.0
MARGIN_S = 0.1  # zero torque this long after the deadline of the rule
CAMERA_S = 0.06  # a picture is two to three periods old when it is judged
STOPPING_S = 1.0  # a controlled stop is over by then

Outcome = Literal["goes on", "pause", "stop", "cut", "never starts"]


@dataclass
class Case:
    """How one row is provoked, and what must follow."""

    outcome: Outcome
    deadline_s: float  # from the beginning of the fault to the rule's action
    kind: str = ""
    for_s: float = 0.5
    params: dict[str, Any] = field(default_factory=dict)
    clears: Literal["itself", "operator"] = "itself"
    at_s: float = AT_S
    early_arm: bool = False  # refused, because the fault still lasts
    seen: Callable[[Run], bool] | None = None  # for faults that are counted only: where the recording shows them
    config: dict[str, Any] = field(default_factory=dict)
    prepare: Callable[[pytest.MonkeyPatch, Path], None] | None = None


def bad_frames(found: Run) -> bool:
    return sum(row.link.bad_crc for row in found.inputs if AT_S < row.t < AT_S + 1) >= 3


def overran(found: Run) -> bool:
    gaps = [b.id - a.id - 1 for a, b in zip(found.inputs, found.inputs[1:], strict=False)]
    return sum(gaps) == 1 and found.fault_at("overrun_repeated") == math.inf


def late_from(count: int, late_s: float = 0.025) -> Callable[[pytest.MonkeyPatch, Path], None]:
    """The host wakes late `count` times in a row; each time it misses a deadline or more."""

    def prepare(patch: pytest.MonkeyPatch, folder: Path) -> None:
        left = [count]

        def late(k: int) -> float:
            if k * PERIOD_S < AT_S or left[0] == 0:
                return 0.0
            left[0] -= 1
            return late_s

        serve_late(patch, late=late)

    return prepare


LAW = """
class Law:
    def update(self, m):
        torque = -0.005 * m.x[1] - 0.05 * m.x[2] - 0.02 * m.x[3]
        return (float("nan") if {at} <= m.t < {at} + 0.5 else torque), {{}}
    def reset(self):
        pass
    def tune(self, key, value):
        return False
"""


LOOPING_LAW = """
class Law:
    def update(self, m):
        pumping = (0.7 if m.x[3] > 0 else -0.7) - 0.01 * m.x[1]
        torque = -0.005 * m.x[1] - 0.05 * m.x[2] - 0.02 * m.x[3]
        return (pumping if {at} <= m.t < {at} + 1.0 else torque), {{}}
    def reset(self):
        pass
    def tune(self, key, value):
        return False
"""


def law_that_loops(patch: pytest.MonkeyPatch, folder: Path) -> None:
    (folder / "law.py").write_text(LOOPING_LAW.format(at=AT_S))


def law_that_fails(patch: pytest.MonkeyPatch, folder: Path) -> None:
    (folder / "law.py").write_text(LAW.format(at=AT_S))


def full_disk(patch: pytest.MonkeyPatch, folder: Path) -> None:
    """The disk takes no byte from AT_S for a second (of rows: the recorder is told the time by them)."""
    last = [0.0]

    class Disk(io.FileIO):
        def write(self, data: Any) -> int:
            if AT_S <= last[0] < AT_S + 1.0:
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data) or 0

    def create(where: Path) -> tuple[Path, Disk]:
        path = where / f"run-{len(list(where.glob('run-*'))) + 1:04d}.mcap"
        return path, Disk(path, "xb")

    put = recorder.Recorder.put

    def timed(self: recorder.Recorder, record: Any, inputs: Any) -> None:
        last[0] = record.t
        put(self, record, inputs)

    patch.setattr(recorder, "create", create)
    patch.setattr(recorder.Recorder, "put", timed)
    patch.setattr(recorder, "RETRY_S", (1.0,))
    patch.setattr(
        recorder.Recorder.__init__, "__kwdefaults__", {**recorder.Recorder.__init__.__kwdefaults__, "retry_s": (1.0,)}
    )


def dropped_telemetry(patch: pytest.MonkeyPatch, folder: Path) -> None:
    """There is no telemetry in lock-step: its flag is raised in its place."""
    original, clock = app.Loop, []

    class Loop(original):  # type: ignore[misc, valid-type]
        def __init__(self, tick: Any, timer: Any, *rest: Any, **options: Any) -> None:
            clock.append(timer.now)
            super().__init__(tick, timer, *rest, **options)

    patch.setattr(app, "Loop", Loop)
    kept = app._trouble
    patch.setattr(
        app, "_trouble", lambda sink: kept(sink) if sink else lambda: bool(clock) and AT_S <= clock[0]() < AT_S + 0.5
    )


CASES: dict[str, Case] = {
    "frame_bad": Case("goes on", 0.02, "bit_flips", 1.0, {"direction": "answer", "every": 7}, seen=bad_frames),
    "link_lost": Case("cut", 0.08, "board_silent", clears="operator", early_arm=True),
    "board_fault": Case("cut", 0.04, "board_fault", clears="operator", early_arm=True),
    "board_timeout": Case("cut", 0.16, clears="operator", prepare=late_from(1, 0.13)),
    "board_reset": Case("cut", 0.04, "board_reset", clears="operator"),
    "board_refuses": Case("never starts", 2.1, "drive_blocked", 2.5, clears="operator", at_s=0.0),
    "camera_late": Case("goes on", 0.12, "late_pictures", 1.0, {"delay_s": 0.06}),
    "camera_lost": Case("stop", 0.16 + 0.02, "camera_stall", 0.9, clears="operator", early_arm=True),
    "ball_missing": Case("goes on", CAMERA_S + 0.02, "ball_gone", 0.1),
    "ball_lost": Case("pause", CAMERA_S + 0.2, "ball_gone", 0.5),
    # Twenty refusals among the pictures of a second: the filter follows after five, and the held ball leaves it again.
    "ball_implausible": Case("stop", CAMERA_S + 1.0, "ball_held", 0.9, {"psi_rad": -0.4}, clears="operator"),
    "ball_runaway": Case("stop", 0.4, clears="operator", config={"control": {"law": "law.py"}}, prepare=law_that_loops),
    # Ten pictures after the first that is equal.
    "pictures_identical": Case("stop", CAMERA_S + 0.24, "pictures_frozen", 0.6, clears="operator"),
    # Ten equal angles; the law then moves the hoop, and the ball with it, by more than 12 mrad soon.
    "angle_stuck": Case("stop", CAMERA_S + 0.4, "picture_ball_painted", 0.6, {"psi_rad": 0.06}, clears="operator"),
    "overrun": Case("goes on", 0.02, prepare=late_from(1), seen=overran),
    "overrun_repeated": Case("goes on", 3 * 0.04 + 0.02, prepare=late_from(3)),
    "overrun_persistent": Case("stop", 10 * 0.04 + 0.02, clears="operator", prepare=late_from(12)),
    "current_implausible": Case(
        "cut", 0.24, "implausible_current", 0.8, {"value": 3.0}, clears="operator", early_arm=True
    ),
    "speed_implausible": Case(
        "cut", 0.24, "implausible_speed", 0.8, {"value": 30.0}, clears="operator", early_arm=True
    ),
    "hoop_overspeed": Case("cut", 0.08, "implausible_speed", 0.8, {"value": 80.0}, clears="operator", early_arm=True),
    "not_finite": Case("cut", 0.02, clears="operator", config={"control": {"law": "law.py"}}, prepare=law_that_fails),
    "recorder_trouble": Case("goes on", 0.3, prepare=full_disk),
    "telemetry_trouble": Case("goes on", 0.04, prepare=dropped_telemetry),
}


def provoke(name: str, case: Case, folder: Path, patch: pytest.MonkeyPatch) -> Run:
    """One run with one fault, a reference that keeps the motor busy, and an operator who arms again."""
    if case.prepare is not None:
        case.prepare(patch, folder)
    faults = [{"kind": case.kind, "at_s": case.at_s, "for_s": case.for_s, "params": case.params}] if case.kind else []
    commands: list[dict[str, Any]] = [{"at_s": 1.3, "name": "reference", "value": 0.1}]
    if case.early_arm:
        commands.append({"at_s": EARLY_STOP_S if case.outcome == "stop" else EARLY_S, "name": "arm"})
    if case.clears == "operator":
        commands.append({"at_s": ARM_S, "name": "arm"})
    return run(folder, duration_s=END_S, config=case.config, faults=faults, commands=commands)


@pytest.mark.parametrize("name", CASES)
def test_row(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = CASES[name]
    found = provoke(name, case, tmp_path, monkeypatch)
    assert found.torque.max_abs() <= TORQUE_LIMIT_NM
    JUDGE[case.outcome](name, case, found)
    assert found.torque.rows[-1].torque_nm == 0.0


def judge_goes_on(name: str, case: Case, found: Run) -> None:
    assert found.modes(1.2, END_S) == {Mode.RUNNING}
    assert found.torque.longest_nonzero_after(1.2) > END_S - 1.2 - PERIOD_S
    if case.seen is not None:
        assert case.seen(found)
        return
    raised, cleared = told(name, found)
    assert AT_S <= raised <= AT_S + case.deadline_s
    assert cleared < END_S


def judge_pause(name: str, case: Case, found: Run) -> None:
    zero_in_time(case, found, until=case.at_s + case.for_s)
    assert found.modes(AT_S + case.deadline_s, AT_S + case.for_s) == {Mode.READY}
    assert found.mode_at(3.5) == Mode.RUNNING  # nobody armed
    raised, cleared = told(name, found)
    assert raised <= AT_S + case.deadline_s < cleared < 3.5


def judge_cut(name: str, case: Case, found: Run) -> None:
    zero_in_time(case, found, until=ARM_S)
    assert found.mode_at(ARM_S - PERIOD_S) == Mode.FAULT
    assert found.causes(Mode.FAULT) >= {name}
    armed_again(name, case, found)


def judge_stop(name: str, case: Case, found: Run) -> None:
    braking = found.modes(AT_S + case.deadline_s, AT_S + case.deadline_s + 0.04)
    assert braking <= {Mode.STOPPING, Mode.DISARMED}
    zero_in_time(case, found, until=ARM_S, within_s=STOPPING_S)
    assert found.mode_at(ARM_S - PERIOD_S) == Mode.DISARMED
    assert found.causes(Mode.STOPPING) >= {name}
    armed_again(name, case, found)


def judge_never_starts(name: str, case: Case, found: Run) -> None:
    assert found.torque.max_abs(0.0, ARM_S) == 0.0
    assert found.mode_at(ARM_S - PERIOD_S) == Mode.FAULT
    assert found.fault_at(name) <= case.deadline_s
    armed_again(name, case, found)


JUDGE: dict[Outcome, Callable[[str, Case, Run], None]] = {
    "goes on": judge_goes_on,
    "pause": judge_pause,
    "stop": judge_stop,
    "cut": judge_cut,
    "never starts": judge_never_starts,
}


def told(name: str, found: Run) -> tuple[float, float]:
    """When the recording tells of the fault and of its end, once control runs."""
    mine = [event for event in found.events if event.fields.get("fault") == name and event.t > 1.2]
    by_event = {event.event: event.t for event in reversed(mine)}
    return by_event.get("fault", math.inf), by_event.get("fault_cleared", math.inf)


def zero_in_time(case: Case, found: Run, until: float, within_s: float = 0.0) -> None:
    """Torque before, none from the deadline on."""
    latest = AT_S + case.deadline_s + within_s + MARGIN_S
    assert found.torque.max_abs(1.9, AT_S) > 0.0
    assert found.torque.max_abs(latest, until) == 0.0


def armed_again(name: str, case: Case, found: Run) -> None:
    """The fault was told in time and stayed until the operator came; an arm that came too early was refused by name."""
    if case.outcome != "never starts":
        assert AT_S <= told(name, found)[0] <= AT_S + case.deadline_s
    refused = [e for e in found.events if e.event == "command_refused"]
    assert len(refused) == case.early_arm
    assert all(name in e.fields["reason"] for e in refused)
    assert found.mode_at(END_S - PERIOD_S) == Mode.RUNNING


def test_every_row_has_a_test() -> None:
    # drift takes half a minute: test_writeback; what takes seconds to tell of a camera that lies: test_camera_lies;
    # what the torque and the reference must be for an encoder that lies: test_encoder_lies
    longer = {"model_drift", "angle_noiseless", "ball_unresponsive", *ENCODER_FAULTS}
    assert set(CASES) == {fault.name for fault in FAULTS} - longer


EXPECTED_OUTCOME: dict[Action, set[Outcome]] = {
    Action.NOTE: {"goes on"},
    Action.FLAG: {"goes on"},
    Action.PREDICT: {"goes on"},
    Action.PAUSE: {"pause"},
    Action.STOP: {"stop"},
    Action.CUT: {"cut", "never starts"},
}


@pytest.mark.parametrize("name", CASES)
def test_the_cases_expect_what_the_table_says(name: str) -> None:
    assert CASES[name].outcome in EXPECTED_OUTCOME[BY_NAME[name].action]
    assert (CASES[name].clears == "operator") == BY_NAME[name].latched
