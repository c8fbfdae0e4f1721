"""The installed unit: accepted by systemd, closed enough, and the daemon's libraries live inside its sandbox."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hoopd.shell.descriptors import WANTED

ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "systemd/hoopd.service"
SYSTEM_UNITS = Path("/usr/lib/systemd/system")
MAX_EXPOSURE = 2.0
UNAVAILABLE = 77

needs_analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def keys() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in UNIT.read_text(encoding="utf-8").splitlines():
        name, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(name, []).append(value)
    return found


@needs_analyze
def test_verify_of_the_installed_unit_is_clean(tmp_path):
    subprocess.run(
        [sys.executable, ROOT / "tools/install.py", "install", "--root", tmp_path, "--no-venv"],
        check=True, capture_output=True, timeout=60,
    )  # fmt: skip
    program = tmp_path / "opt/hoopd/bin/hoopd"  # the environment is not built here
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    shutil.copytree(SYSTEM_UNITS, tmp_path / "usr/lib/systemd/system", symlinks=True)
    result = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", f"--root={tmp_path}", "hoopd.service"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


@needs_analyze
def test_exposure_is_low():
    result = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--no-pager", UNIT],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    verdict = next(line for line in result.stdout.splitlines() if "Overall exposure" in line)
    assert float(verdict.rsplit(":", 1)[1].split()[0]) <= MAX_EXPOSURE


def test_service_says_what_the_safety_chain_needs():
    unit = keys()
    assert unit["Type"] == ["notify"]
    assert unit["NotifyAccess"] == ["main"]
    assert unit["Restart"] == ["on-failure"]
    assert unit["RestartPreventExitStatus"] == ["2"]
    assert unit["StartLimitIntervalSec"] == ["0"]  # a port that is missing for an hour still starts it
    assert unit["CPUSchedulingPolicy"] == ["fifo"]
    assert int(unit["LimitRTPRIO"][0]) >= int(unit["CPUSchedulingPriority"][0])
    assert unit["LimitMEMLOCK"] == ["infinity"]
    soft, hard = (float(part.removesuffix("s")) for part in unit["LimitRTTIME"][0].split(":"))
    assert 1 < soft < hard <= 10  # more than a start takes, less than for ever; SIGXCPU before SIGKILL
    assert unit["RestrictRealtime"] == ["no"]
    assert (unit["RuntimeDirectory"], unit["RuntimeDirectoryMode"]) == (["hoopd"], ["0750"])  # the command socket's
    assert unit["LimitNOFILE"] == [str(WANTED)]
    assert "--arm" not in unit["ExecStart"][0]


SANDBOXED = """
import mmap, os, pty, socket, subprocess, sys, threading, time
import casadi, cv2, mcap.writer, msgspec, numpy as np, serial, structlog, yaml, zenoh
from hoopd.shell.child import end_with_parent
from hoopd.shell.clock import TickTimer
from hoopd.shell.service import lock_memory, lower_thread_priority

x = casadi.SX.sym("x", 4)
casadi.Function("f", [x], [casadi.jacobian(casadi.sin(x), x)])([1, 2, 3, 4])
picture = np.zeros((480, 480, 3), np.uint8)
cv2.moments(cv2.threshold(cv2.split(picture)[0], 70, 255, 0)[1])
config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
with zenoh.open(config) as session:
    got = []
    subscriber = session.declare_subscriber("a/b", got.append)
    session.put("a/b", "x")
    deadline = time.monotonic() + 5
    while not got and time.monotonic() < deadline:
        time.sleep(0.01)
    assert got
master, slave = pty.openpty()
with serial.Serial(os.ttyname(slave), 115200, exclusive=True) as port:
    port.write(b"x")
    assert os.read(master, 1) == b"x"
TickTimer(0.01).close()
lock_memory()
thread = threading.Thread(target=lower_thread_priority)
thread.start()
thread.join()
subprocess.run([*end_with_parent(), "true"], check=True)  # as the camera's program is started
for forbidden in (
    lambda: mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC),
    lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW),
    lambda: os.chown(sys.executable, 0, 0),
):
    try:
        forbidden()
    except OSError:
        continue
    raise SystemExit("the sandbox is open")
print("lives")
"""


@needs_analyze
def test_libraries_live_inside_the_sandbox():
    result = subprocess.run(
        [sys.executable, ROOT / "tools/sandbox.py", UNIT, sys.executable, "-c", SANDBOXED],
        capture_output=True, text=True, timeout=60, check=False, cwd=ROOT,
    )  # fmt: skip
    if result.returncode == UNAVAILABLE:
        pytest.skip(result.stderr.strip())
    assert (result.returncode, result.stdout) == (0, "lives\n"), result.stderr


@needs_analyze
def test_the_whole_daemon_lives_inside_the_sandbox(tmp_path):
    command = [sys.executable, "-m", "hoopd", "--sim", "--camera", "direct", "--duration", "2", "--record", tmp_path]
    result = subprocess.run(
        [sys.executable, ROOT / "tools/sandbox.py", UNIT, *command, "--set", "telemetry.endpoint=tcp/127.0.0.1:17447"],
        capture_output=True, text=True, timeout=60, check=False, cwd=ROOT,
    )  # fmt: skip
    if result.returncode == UNAVAILABLE:
        pytest.skip(result.stderr.strip())
    assert result.returncode == 0, result.stdout + result.stderr
    assert list(tmp_path.glob("*.mcap"))
