"""Probes of the machine, and of the rig's board on a real pseudo-terminal."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.daemon import checks as check
from hoopd.daemon.checks import Verdict
from hoopd.shell import probe

ROOT = Path(__file__).resolve().parents[2]
TRIES = 3
STUB = """
import math
class Still:
    t = theta = dtheta = 0.0
    state = (0.0, 0.0, 0.0, 0.0)
    def advance(self, t, torque_nm): self.t = max(self.t, t)
    def sample(self): return 0.0, 0.0, math.nan
"""


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Port of a board process with a plant that does not move."""
    from hoopd.sim.boardprocess import ProcessConfig, start

    (tmp_path / "stillstub.py").write_text(STUB)
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    config = ProcessConfig(plant="stillstub:Still", torque_log=str(tmp_path / "torque.jsonl"))
    process = start(tmp_path / "port", config)
    yield tmp_path / "port"
    assert process.stdin is not None
    process.stdin.close()
    process.wait(5.0)
    assert process.stderr is not None
    process.stderr.close()


def test_the_rig_s_board_proves_its_time_out_with_zero_torque(rig: Path):
    from hoopd.sim.torque_log import read

    line = probe.BoardLine(str(rig), 115200, DEFAULT_LAYOUT)
    try:
        assert check.board_answers(line).verdict in (Verdict.OK, Verdict.WARN)
        # a board process that gets no processor for a while answers nothing: asked again, a board that runs proves it
        answers = [check.board_timeout(line)]
        while len(answers) < TRIES and answers[-1].granted.startswith("no answer"):
            answers.append(check.board_timeout(line))
        assert answers[-1].verdict is Verdict.OK
    finally:
        line.close()
    rows = read(rig.parent / "torque.jsonl").rows
    assert rows
    assert all(row.torque_nm == 0.0 for row in rows)
    assert not rows[-1].enabled
    assert 0.0024 < min(line.round_trip_s) < probe.ANSWER_S


def test_silent_port_gives_no_answer():
    master, slave = os.openpty()
    line = probe.BoardLine(os.ttyname(slave), 115200, DEFAULT_LAYOUT)
    assert line.exchange(False, False) is None
    line.close()
    os.close(master)
    os.close(slave)


def test_missing_port_is_an_os_error():
    with pytest.raises(OSError, match="No such file"):
        probe.BoardLine("/dev/hoop-driver-nowhere", 115200, DEFAULT_LAYOUT)


def test_clock_and_timer():
    assert probe.clock_resolution_s() <= 1e-6
    late = probe.timer_lateness_s(0.005, 10)
    assert late
    assert min(late) >= 0.0
    assert probe.clock_synchronised() in (True, False, None)


def test_throttled_word_from_the_firmware_s_file(tmp_path, monkeypatch):
    path = tmp_path / "get_throttled"
    path.write_text("50005\n")
    monkeypatch.setattr(probe, "THROTTLED_FILE", path)
    assert probe.throttled_word() == 0x50005


def test_throttled_word_from_vcgencmd(tmp_path, monkeypatch):
    tool = tmp_path / "vcgencmd"
    tool.write_text("#!/bin/sh\necho throttled=0x50000\n")
    tool.chmod(0o755)
    monkeypatch.setattr(probe, "THROTTLED_FILE", tmp_path / "none")
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    assert probe.throttled_word() == 0x50000


def test_no_firmware_no_word(tmp_path, monkeypatch):
    monkeypatch.setattr(probe, "THROTTLED_FILE", tmp_path / "none")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert probe.throttled_word() is None
    assert probe.service_pid() == 0


def test_endpoint_free_taken_or_unreadable():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(OSError, match="in use"):
            probe.claim_endpoint(endpoint)
    probe.claim_endpoint(endpoint)
    with pytest.raises(OSError, match="cannot be probed"):
        probe.claim_endpoint("serial//dev/ttyS0")


def test_realtime_is_asked_on_a_thread_of_its_own():
    before = os.sched_getscheduler(0)
    assert probe.try_realtime(1)["policy"] in ("fifo", "other")
    assert os.sched_getscheduler(0) == before


def test_memory_lock_probe():
    code = "from hoopd.shell.probe import try_memory_lock; r, n = try_memory_lock(); print((not r) == (n > 0))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, timeout=30)
    assert out.stdout == "True\n"


def test_lateness_is_measured_on_each_core_and_leaves_the_caller_where_it_was():
    allowed = os.sched_getaffinity(0)
    late = probe.core_lateness_s(allowed | {4096}, 1, 0.005, 3)
    assert late.keys() == allowed  # a core that is not there has no entry
    assert all(len(values) <= 3 and min(values) >= 0.0 for values in late.values())
    assert os.sched_getaffinity(0) == allowed
