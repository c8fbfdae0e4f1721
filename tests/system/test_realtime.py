"""The daemon on the real clock against signals, a dead board, a full disk and bad neighbours; the board's log judges.

The machine may stand still by itself: a check is repeated only when an independent witness saw that.
"""

from __future__ import annotations

import os
import resource
import signal
import time
from pathlib import Path

import pytest
from harness.neighbours import FLOOD, SUBSCRIBER, neighbour
from harness.realrun import Daemon, fifo_granted, undelayed, zero_of
from harness.runs import TORQUE_LIMIT_NM, Run
from harness.timing import on_the_clock
from harness.witness import Witness, witnessed

from hoopd.core.modes import Mode
from hoopd.daemon.replay import replay
from hoopd.recording.mcap import read_run

pytestmark = pytest.mark.realtime

BOARD_TIMEOUT_S = 0.1
MARGIN_S = 0.1
STOPPING_S = 1.0
TICK_S = 0.02
REFERENCE = [{"at_s": 1.8, "name": "reference", "value": 0.1}]  # keeps the motor busy


def judge(run: Run) -> None:
    """What holds for every run: never too much torque, and a recording that opens and replays to the bit."""
    assert run.torque.max_abs() <= TORQUE_LIMIT_NM
    assert run.recordings
    for path in run.recordings[:1]:
        result = replay(path)
        assert result["equal"], result["first_difference"]
        assert result["ticks"] > 50


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_is_a_controlled_stop(name: str, tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        before_ns = time.time_ns()
        with Daemon(folder, commands=REFERENCE) as daemon:
            daemon.wait_running()
            sent = daemon.signal(signal.Signals[name])
            assert daemon.wait_exit() == 0
            run = daemon.result()
        judge(run)
        assert before_ns < read_run(run.recordings[0]).zero_ns < time.time_ns()
        assert run.torque.max_abs(sent - 0.1, sent) > 0.0
        with on_the_clock():
            assert run.torque.zero_for_good_from(sent) <= STOPPING_S + MARGIN_S
        assert [row.enabled for row in run.torque.rows[-4:]] == [False] * 4
        assert [tick.mode for tick in run.ticks][-1] == Mode.DISARMED
        assert any(e.event == "operator" and e.fields["command"] == "stop" for e in run.events)

    witnessed(tmp_path, check)


def test_a_terminal_that_hangs_up_is_a_controlled_stop(tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        ours, terminal = os.openpty()
        with Daemon(folder, commands=REFERENCE, terminal=terminal) as daemon:
            os.close(terminal)
            daemon.wait_running()
            sent = time.monotonic()
            os.close(ours)
            assert daemon.wait_exit() == 0
            run = daemon.result()
        judge(run)
        assert run.torque.max_abs(sent - 0.1, sent) > 0.0
        with on_the_clock():
            assert run.torque.zero_for_good_from(sent) <= STOPPING_S + MARGIN_S
        assert "timeout" not in run.torque.reasons()
        assert [tick.mode for tick in run.ticks][-1] == Mode.DISARMED

    witnessed(tmp_path, check)


def test_killed_the_boards_own_time_out_zeroes_and_the_recording_lives(tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, commands=REFERENCE) as daemon:
            daemon.wait_running()
            killed = daemon.signal(signal.SIGKILL)
            assert daemon.wait_exit() == -signal.SIGKILL
            time.sleep(0.3)
            run = daemon.result()
        judge(run)
        assert run.torque.max_abs(killed - 0.1, killed) > 0.0
        with on_the_clock():
            assert run.torque.zero_for_good_from(killed) <= BOARD_TIMEOUT_S + 0.01
        assert "timeout" in run.torque.reasons()
        with on_the_clock():
            assert killed - (zero_of(run) + run.ticks[-1].t) <= 1.0  # lost at most a second

    witnessed(tmp_path, check)


def test_stopped_and_continued_it_stays_without_torque(tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, commands=REFERENCE) as daemon:
            daemon.wait_running()
            stopped = daemon.signal(signal.SIGSTOP)
            time.sleep(0.5)
            daemon.signal(signal.SIGCONT)
            daemon.wait_for(event="mode", mode="FAULT")
            time.sleep(0.5)
            assert daemon.stop() == 0
            run = daemon.result()
        judge(run)
        assert run.torque.max_abs(stopped - 0.1, stopped) > 0.0
        with on_the_clock():
            assert run.torque.zero_for_good_from(stopped) <= BOARD_TIMEOUT_S + 0.01
        assert {tick.mode for tick in run.ticks[-20:]} == {Mode.FAULT}
        assert run.causes(Mode.FAULT) & {"board_timeout", "overrun_persistent"}

    witnessed(tmp_path, check)


def test_without_its_board_it_goes_on_in_fault_and_still_ends(tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder) as daemon:
            daemon.wait_running()
            [board] = daemon.family("boardprocess")
            killed = time.monotonic()
            board.kill()
            daemon.wait_for(event="fault", fault="link_lost")
            with on_the_clock():
                assert time.monotonic() - killed < 0.06 + 0.2 + MARGIN_S  # 0.2 s: facts are written that often
            time.sleep(0.7)
            assert daemon.stop() == 0
            run = daemon.result()
        judge(run)
        assert run.ticks[-1].t - run.fault_at("link_lost") > 0.6
        assert run.ticks[-1].mode == Mode.FAULT
        assert run.inputs[-1].link.lost

    witnessed(tmp_path, check)


def test_a_full_disk_does_not_touch_control(tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, commands=REFERENCE) as daemon:
            daemon.wait_running()
            size = max(path.stat().st_size for path in daemon.record.iterdir())
            # No file of this process may grow beyond what the recording has already: writes fail as on a full disk.
            resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
            full = time.monotonic()
            daemon.wait_for(3.0, event="recorder_trouble")
            time.sleep(1.0)
            end = time.monotonic()
            assert daemon.stop() == 0
            run = daemon.result()
        judge(run)
        with on_the_clock():
            assert run.torque.longest_nonzero_after(full, end) >= end - full - TICK_S
        [line] = [line for line in run.log if line["event"] == "recorder_trouble"]
        assert line["reason"] == "file too large"
        assert any(line.get("fault") == "recorder_trouble" and line["event"] == "fault" for line in run.log)

    witnessed(tmp_path, check)


def test_a_flood_of_commands_delays_nothing_and_disarm_is_obeyed(tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, fifo=fifo_granted(), commands=REFERENCE) as daemon:
            daemon.wait_running()
            start = time.monotonic()
            with neighbour(FLOOD, daemon.endpoint, str(daemon.socket), "3"):
                time.sleep(1.5)
                asked = time.monotonic()
                assert daemon.command("disarm")["mode"] == "DISARMED"
                answered = time.monotonic()
                time.sleep(0.3)
                assert daemon.stop() == 0
            run = daemon.result()
        judge(run)
        undelayed(run, witness, start, answered)
        assert sum(len(row.commands) for row in run.inputs) > 20  # the flood came through
        assert run.torque.max_abs(asked - 0.1, asked) > 0.0
        with on_the_clock():
            assert run.torque.zero_for_good_from(answered) <= MARGIN_S
        with on_the_clock():
            assert answered - asked < 2.0

    witnessed(tmp_path, check)


def test_a_frozen_subscriber_delays_nothing_and_does_not_hold_the_exit(tmp_path: Path) -> None:
    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, fifo=fifo_granted(), commands=REFERENCE) as daemon:
            daemon.wait_running()
            with neighbour(SUBSCRIBER, daemon.endpoint) as subscriber:
                assert subscriber.stdout is not None and subscriber.stdout.readline()
                start = time.monotonic()
                subscriber.send_signal(signal.SIGSTOP)
                time.sleep(2.0)
                stop = time.monotonic()
                assert daemon.stop() == 0
            run = daemon.result()
        judge(run)
        undelayed(run, witness, start, stop)
        with on_the_clock():
            assert run.torque.longest_nonzero_after(start, stop) >= stop - start - TICK_S

    witnessed(tmp_path, check)
