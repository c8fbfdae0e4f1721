"""The rig keeps up with the loop: its board and its camera have the loop's priority when the loop has one."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest
from harness.realrun import ENVIRONMENT, FIFO_PRIORITY, Daemon, fifo_granted

from hoopd.shell.service import granted_realtime

pytestmark = pytest.mark.realtime

NEED_FIFO = pytest.mark.skipif(not fifo_granted(), reason="no right to real-time priority here")
PARTS = ("boardprocess", "hoopd.sim.camera")
PATIENCE_S = 40.0


def priorities(daemon: Daemon) -> dict[str, tuple[str, int]]:
    """Policy and priority of the rig's parts that run."""
    facts = {part: granted_realtime(child.pid) for part in PARTS for child in daemon.family(part)}
    return {part: (row["policy"], row["priority"]) for part, row in facts.items()}


@pytest.mark.parametrize(
    ("fifo", "wanted"),
    [pytest.param(True, ("fifo", FIFO_PRIORITY), marks=NEED_FIFO), (False, ("other", 0))],
)
def test_board_and_camera_run_as_the_loop_does(fifo: bool, wanted: tuple[str, int], tmp_path: Path) -> None:
    with Daemon(tmp_path, direct=False, fifo=fifo) as daemon:
        deadline = time.monotonic() + PATIENCE_S
        while priorities(daemon) != dict.fromkeys(PARTS, wanted) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert granted_realtime(daemon.process.pid)["policy"] == wanted[0]
        assert priorities(daemon) == dict.fromkeys(PARTS, wanted)


@NEED_FIFO
def test_a_loop_that_resets_on_fork_tells_its_priority_too() -> None:
    """As under the unit, whose CPUSchedulingResetOnFork is a flag beside the policy."""
    code = (
        "from hoopd.shell.service import fifo_priority, raise_thread_priority\n"
        "print(fifo_priority(), raise_thread_priority(7), fifo_priority())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True, check=True, timeout=30
    )
    assert done.stdout.split() == ["0", "True", "7"]
