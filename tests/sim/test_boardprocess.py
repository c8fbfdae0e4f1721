"""The board on a real pseudo-terminal: timing, time-out, reopening, faults, endings; and its state ring."""

from __future__ import annotations

import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import psutil
import pytest

from hoopd.core.frames import DEFAULT_LAYOUT, STATUS_ENABLED, STATUS_TIMEOUT, Answer, Decoder, encode_request
from hoopd.sim import truth
from hoopd.sim.boardprocess import ProcessConfig, start
from hoopd.sim.rig import TruePsi
from hoopd.sim.statering import PlantState, StateRingReader, StateRingWriter
from hoopd.sim.torque_log import read

ROOT = Path(__file__).resolve().parents[2]
STUB = """
import math
class Wheel:
    def __init__(self, gain=500.0):
        self.t = self.theta = self.dtheta = 0.0
        self.gain = gain
    def advance(self, t, torque_nm):
        step = max(t - self.t, 0.0)
        self.theta += self.dtheta * step
        self.dtheta += self.gain * torque_nm * step
        self.t = max(self.t, t)
    def sample(self):
        return self.theta, self.dtheta, math.nan
    @property
    def state(self):
        return self.theta, self.dtheta, 2.0 * self.t, 2.0
class Shown(Wheel):
    @property
    def shown(self):
        return self.theta, self.dtheta, 2.0 * self.t + 0.1, 2.0
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "wheelstub.py").write_text(STUB)
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    return tmp_path


def config(folder: Path, **changes: object) -> ProcessConfig:
    values = {
        "plant": "wheelstub:Wheel",
        "torque_log": str(folder / "torque.jsonl"),
        "state_ring": str(folder / "ring"),
    }
    return ProcessConfig(**(values | changes))  # type: ignore[arg-type]


def end(process: subprocess.Popen[bytes]) -> None:
    process.stdin.close()
    process.wait(3.0)
    process.stderr.close()


@pytest.fixture
def board(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    process = start(folder / "port", config(folder))
    yield process
    end(process)


class Host:
    """The other side of the port."""

    def __init__(self, link: Path) -> None:
        self.fd = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.decoder = Decoder(DEFAULT_LAYOUT)
        self.seq = 0

    def ask(self, torque: float = 0.0, enable: bool = True, clear: bool = False, wait_s: float = 0.3) -> Answer | None:
        self.seq = (self.seq + 1) & 0xFF
        os.write(self.fd, encode_request(DEFAULT_LAYOUT, self.seq, enable, clear, torque))
        deadline = time.monotonic() + wait_s
        while time.monotonic() < deadline:
            if select.select([self.fd], [], [], 0.05)[0]:
                found = [e for e in self.decoder.feed(os.read(self.fd, 100)) if isinstance(e, Answer)]
                if found:
                    return found[0]
        return None

    def close(self) -> None:
        os.close(self.fd)


def test_round_trips_take_their_time_on_the_wire_and_the_timeout_latches(folder: Path, board: object) -> None:
    host = Host(folder / "port")
    times = []
    for _ in range(20):
        begin = time.monotonic()
        answer = host.ask(0.2)
        times.append(time.monotonic() - begin)
        assert answer is not None
        assert answer.seq == host.seq
        time.sleep(0.005)
    assert min(times) >= 28 * 10 / 115200  # 8 and 20 bytes
    assert float(np.median(times)) < 0.006
    time.sleep(0.15)
    answer = host.ask(0.2)
    assert answer is not None
    assert answer.status == STATUS_TIMEOUT
    host.ask(clear=True)
    answer = host.ask(0.0)
    assert answer is not None
    assert answer.status == STATUS_ENABLED
    log = read(folder / "torque.jsonl")
    fell = next(row for row in log.rows if row.reason == "timeout")
    last = max(row.t for row in log.rows if row.t < fell.t)
    assert fell.t - last == pytest.approx(0.1, abs=1e-5)
    assert log.longest_nonzero_after(last) == pytest.approx(0.1, abs=1e-5)
    assert log.max_abs() == pytest.approx(0.2)
    host.close()


def test_the_port_may_be_closed_and_opened_again(folder: Path, board: object) -> None:
    for _ in range(3):
        host = Host(folder / "port")
        assert host.ask() is not None
        host.close()
        time.sleep(0.02)


def test_the_true_state_is_written_on_the_clock_of_the_torque_log(folder: Path) -> None:
    process = start(folder / "port", config(folder, truth_log=str(folder / "truth.csv")))
    host = Host(folder / "port")
    for _ in range(10):
        host.ask(0.02)
    end(process)
    log, true = read(folder / "torque.jsonl"), truth.read(folder / "truth.csv")
    assert log.rows[0].t - 0.01 < true.t[0] and true.t[-1] < log.rows[-1].t
    assert np.diff(true.t) == pytest.approx(0.02)
    last = true.t[-1]
    pushed = sum(min(b.t, last) - a.t for a, b in pairwise(log.rows) if a.torque_nm and a.t < last)
    assert true.dtheta[-1] == pytest.approx(500.0 * 0.02 * pushed, rel=0.01)


def test_the_state_ring_follows_the_clock(folder: Path, board: object) -> None:
    reader = StateRingReader(folder / "ring")
    time.sleep(0.3)
    lags = []
    for _ in range(20):
        latest = reader.latest()
        assert latest is not None
        lags.append(time.monotonic() - latest.t)
        time.sleep(0.003)
    assert float(np.median(lags)) < 0.004
    now = time.monotonic()
    early, late = reader.at(now - 0.1), reader.at(now - 0.05)
    assert early is not None
    assert late is not None
    assert late.psi - early.psi == pytest.approx(2.0 * 0.05, abs=1e-6)
    assert reader.at(now + 1.0) is None
    assert reader.at(now - 10.0) is None


def test_the_truth_s_ring_has_the_state_and_not_what_the_camera_sees(folder: Path) -> None:
    process = start(
        folder / "port", config(folder, plant="wheelstub:Shown", truth_ring=str(folder / "truth"), t0=time.monotonic())
    )
    try:
        time.sleep(0.1)
        seen, now = StateRingReader(folder / "ring"), time.monotonic()
        true = TruePsi(folder / "truth", start=now - 5.0)
        psi, shown = true(4.95), seen.at(now - 0.05)
        assert psi is not None and shown is not None
        assert shown.psi - psi == pytest.approx(0.1, abs=1e-6)
        assert true(3.0) is None and true(6.0) is None
    finally:
        end(process)


def test_scripted_faults_act_in_run_time(folder: Path) -> None:
    t0 = time.monotonic() - 9.0
    faults = [{"kind": "board_silent", "at_s": 12.0, "for_s": 0.4}]
    process = start(folder / "port", config(folder, faults=faults, t0=t0))
    host = Host(folder / "port")
    assert host.ask(0.1) is not None
    time.sleep(t0 + 12.1 - time.monotonic())
    assert host.ask(0.1, wait_s=0.05) is None
    time.sleep(t0 + 12.41 - time.monotonic())
    answer = host.ask(0.1)
    assert answer is not None
    assert answer.status & STATUS_TIMEOUT
    host.close()
    end(process)


def test_it_is_cheap(folder: Path, board: subprocess.Popen[bytes]) -> None:
    host, process = Host(folder / "port"), psutil.Process(board.pid)
    before, begin = sum(process.cpu_times()[:2]), time.monotonic()
    for _ in range(25):
        host.ask()
        time.sleep(0.016)
    share = (sum(process.cpu_times()[:2]) - before) / (time.monotonic() - begin)
    host.close()
    assert share < 0.15  # measured 0.03 to 0.05; clock ticks are 10 ms


@pytest.mark.parametrize("how", ["sigterm", "stdin"])
def test_it_ends_and_takes_its_link_with_it(folder: Path, how: str) -> None:
    process = start(folder / "port", config(folder))
    if how == "sigterm":
        process.send_signal(signal.SIGINT)  # ignored: Ctrl-C belongs to the daemon
        time.sleep(0.05)
        assert process.poll() is None
        process.terminate()
        process.wait(2.0)
    end(process)
    assert process.returncode == 0
    assert not (folder / "port").is_symlink()
    assert read(folder / "torque.jsonl").rows[-1].reason == "end"


def test_it_dies_with_its_parent(folder: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path\n"
        "from hoopd.sim.boardprocess import ProcessConfig, start\n"
        "d = Path(sys.argv[1])\n"
        "p = start(d / 'port', ProcessConfig('wheelstub:Wheel', str(d / 'torque.jsonl')))\n"
        "print(p.pid, flush=True); time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE)
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait(2.0)
    parent.stdout.close()
    deadline = time.monotonic() + 2.0
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != "zombie" and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not (folder / "port").is_symlink()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"plant": "nowhere:Wheel"}, "nowhere"),
        ({"faults": [{"kind": "gremlin", "at_s": 0}]}, "gremlin"),
        ({"board": {"colour": 1}}, "colour"),
        ({"layout": {"request": {}}}, "request"),
    ],
)
def test_a_wrong_configuration_is_one_line(folder: Path, changes: dict[str, object], word: str) -> None:
    with pytest.raises(RuntimeError, match=word) as caught:
        start(folder / "port", config(folder, **changes))
    assert "\n" not in str(caught.value)


def test_the_ring_drops_the_oldest_and_interpolates(tmp_path: Path) -> None:
    writer = StateRingWriter(tmp_path / "ring", rows=4)
    reader = StateRingReader(tmp_path / "ring")
    assert reader.latest() is None
    assert reader.at(0.0) is None
    for k in range(6):
        writer.push(float(k), (k**2, 2.0 * k, k**3, 3.0 * k**2))
    assert reader.rows()[:, 0].tolist() == [2.0, 3.0, 4.0, 5.0]
    assert reader.at(3.5) == PlantState(3.5, 12.25, 7.0, 42.875, 37.5)
    assert reader.at(1.0) is None
    assert not math.isnan(reader.latest().t)
    (tmp_path / "other").write_bytes(b"x" * 100)
    with pytest.raises(ValueError, match="not a state ring"):
        StateRingReader(tmp_path / "other")
