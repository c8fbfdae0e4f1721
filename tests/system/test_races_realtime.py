"""Races of operators on the machine's clock: a signal beside an arm, and a rig that is about to arm itself.

They mostly wait, and judge modes and torque with a tenth of a second and more to spare: side by side with others.
"""

from __future__ import annotations

import signal
import socket
import time
from pathlib import Path
from typing import Any

import pytest
from harness.realrun import Daemon, fifo_granted
from harness.runs import PERIOD_S, Run
from harness.timing import on_the_clock
from harness.witness import Witness, witnessed

from hoopd.core.modes import Mode

MARGIN_S = 0.1  # as in the campaign: the rig's board is a process beside others
FAULT_S, HEALTHY_S = 2.0, 1.2  # a fault of the board, and from its end until an arm has but to wait for the board


def never_energised(run: Run, since: float) -> None:
    """From run time `since`: no mode with the drive on, and by the board's own log neither drive nor torque."""
    zero = run.summary["start_monotonic_s"]
    assert run.modes(since, 99.0) <= {Mode.DISARMED, Mode.FAULT}
    assert run.torque.max_abs(start=zero + since + MARGIN_S) == 0.0
    assert not any(row.enabled for row in run.torque.rows if row.t > zero + since + MARGIN_S)


@pytest.mark.parametrize("after_s", [0.0, PERIOD_S])
def test_sigterm_after_an_arm_that_waits_for_the_board(after_s: float, tmp_path: Path) -> None:
    """The board forgets its fault only when it is asked to: an arm waits for that, and the signal comes meanwhile."""
    fault = {"kind": "board_fault", "at_s": FAULT_S, "for_s": 0.2}

    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, fifo=fifo_granted(), faults=[fault]) as daemon:
            daemon.wait_for(event="mode", mode="FAULT")
            time.sleep(0.2 + HEALTHY_S)
            with socket.socket(socket.AF_UNIX) as operator:
                operator.connect(str(daemon.socket))
                operator.sendall(b'{"command": "arm"}\n')  # and waits for no answer
                time.sleep(after_s)
                sent = daemon.signal(signal.SIGTERM)
            assert daemon.wait_exit() == 0
            run = daemon.result()
        shutdowns = [row.t for row in run.inputs if any(command.name == "shutdown" for command in row.commands)]
        assert len(shutdowns) == 1
        if run.mode_at(shutdowns[0] - PERIOD_S) == Mode.RUNNING:  # this machine slept for longer than was asked
            assert run.modes(shutdowns[0], 99.0) <= {Mode.STOPPING, Mode.DISARMED, Mode.FAULT}
            never_energised(run, shutdowns[0] + 1.0 + PERIOD_S)
            return
        never_energised(run, shutdowns[0])
        with on_the_clock():
            assert (
                run.summary["start_monotonic_s"] + run.ticks[-1].t - sent < 0.5
            )  # nothing was braked: it ends at once

    witnessed(tmp_path, check)


@pytest.mark.parametrize(("name", "at_s"), [("disarm", 0.5), ("stop", 1.0)])
def test_a_rig_that_is_switched_off_before_it_arms_does_not_arm_itself(name: str, at_s: float, tmp_path: Path) -> None:
    script: list[dict[str, Any]] = [{"at_s": at_s, "name": name}]

    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, fifo=fifo_granted(), commands=script) as daemon:
            daemon.wait_for(event="operator", command=name)
            time.sleep(2.0)
            assert daemon.stop() == 0
            run = daemon.result()
        assert run.ticks[-1].t > at_s + 1.5  # an undisturbed rig arms itself at 1.5 s
        never_energised(run, at_s)

    witnessed(tmp_path, check)
