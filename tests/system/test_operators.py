"""Operators at the command socket of a running daemon: what they are told, and that nobody keeps them out."""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from system.realrun import ENVIRONMENT, START_S, Daemon, fifo_granted

from hoopd.shell.operator import CommandError
from hoopd.shell.socketfile import listening_socket

pytestmark = pytest.mark.realtime

IDLE = """
import resource, socket, sys, time
hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
held = []
for place in (("127.0.0.1", int(sys.argv[1])), sys.argv[2]):
    for _ in range(2000):
        one = socket.socket(socket.AF_UNIX if isinstance(place, str) else socket.AF_INET)
        one.setblocking(False)
        try:
            one.connect(place)
        except OSError:
            pass  # under way, or no room in the queue: it holds on all the same
        held.append(one)
print(len(held), flush=True)
time.sleep(60)
"""


def hoopd(*words: str, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
    """The command line, bounded in time."""
    command = [sys.executable, "-m", "hoopd", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False, env=ENVIRONMENT)


def listening(daemon: Daemon) -> None:
    """Until its command socket is there and its loop ticks."""
    end = time.monotonic() + START_S
    while time.monotonic() < end:
        with contextlib.suppress(CommandError):
            if daemon.command("status")["ok"]:
                return
        time.sleep(0.1)
    raise AssertionError("no command socket")


def test_an_operator_is_told_what_the_log_says(tmp_path: Path) -> None:
    with Daemon(tmp_path, fifo=fifo_granted()) as daemon:
        listening(daemon)
        here = f"commands.socket={daemon.socket}"
        tuned = hoopd("tune", "gain", "1.5", "--set", here)
        refused = daemon.wait_for(event="command_refused", command="tune")
        assert (tuned.returncode, tuned.stderr) == (2, f"hoopd: tune: refused: {refused['reason']}\n")
        moved = hoopd("ref", "0.05", "--set", here)
        assert moved.returncode == 0 and re.fullmatch(r"reference: [A-Z]+, reference 0.05 rad\n", moved.stdout)
        assert daemon.command("disarm")["mode"] in ("DISARMED", "FAULT")
        shown = hoopd("status", "--set", here, "--json", str(tmp_path / "status.json"))
        status = json.loads((tmp_path / "status.json").read_text())
        assert shown.returncode == 0 and status["mode"] in shown.stdout and status["session"]
        assert status["mode"] in ("DISARMED", "FAULT") and status["arming"] and status["commands"]["accepted"] == 3
        for name in ("arm", "clear", "stop"):
            with contextlib.suppress(CommandError):  # a busy machine's faults may forbid it: then the log says the same
                assert daemon.command(name)["mode"]
                daemon.wait_for(event="operator", command=name)
                continue
            daemon.wait_for(event="command_refused", command=name)
        with pytest.raises(CommandError, match="tune: refused: unknown key 'mass'"):
            daemon.command("tune", key="mass", value=1.0)
        assert daemon.stop() == 0
        assert not daemon.socket.exists()


def test_a_killed_daemons_socket_is_taken_over(tmp_path: Path) -> None:
    with Daemon(tmp_path) as daemon:
        listening(daemon)
        daemon.signal(signal.SIGKILL)
        daemon.process.wait(10)
        assert daemon.socket.exists()
        path = daemon.socket
        with Daemon(tmp_path / "next", config={"commands": {"socket": str(path)}}) as following:
            following.socket = path
            listening(following)
            assert following.command("disarm")["mode"] in ("DISARMED", "FAULT")
            beside = hoopd("--sim", "--camera", "direct", "--duration", "1", "--set", f"commands.socket={path}",
                           "--set", "telemetry.enabled=false")  # fmt: skip
            assert beside.returncode == 0 and "another daemon of this device runs" in beside.stderr
            assert following.command("status")["ok"]


def test_a_second_daemon_of_a_device_is_refused_in_one_line(tmp_path: Path) -> None:
    master, slave = os.openpty()
    first = listening_socket("hoop", str(tmp_path / "hoop.sock"))
    try:
        port = os.ttyname(slave)
        second = hoopd("--set", f"serial.port={port}", "--set", "camera.command=[cat]",
                       "--set", f"commands.socket={first.path}", "--duration", "1")  # fmt: skip
        says = f"hoopd: {first.path}: another daemon of this device runs on this machine"
        assert second.returncode == 2 and second.stderr.splitlines()[-1].startswith(says)
        assert "Traceback" not in second.stderr
    finally:
        first.close()
        os.close(master)
        os.close(slave)


def test_a_configuration_of_before_is_told_what_to_change(tmp_path: Path) -> None:
    old = tmp_path / "old.yaml"
    old.write_text("telemetry: {commands: true}\n")
    for words in (("--sim", "--duration", "1"), ("--sim", "--speed", "max", "--camera", "direct", "--duration", "1")):
        done = hoopd(*words, "--config", str(old))
        assert done.returncode == 2 and done.stdout == ""
        assert done.stderr.startswith(
            "hoopd: configuration: telemetry.commands: needs telemetry.control with an endpoint"
        )
        assert done.stderr.count("\n") == 1 and "take the key away" in done.stderr


def test_4000_idle_connections_keep_no_operator_out(tmp_path: Path) -> None:
    with Daemon(tmp_path, fifo=fifo_granted()) as daemon:
        listening(daemon)
        process = psutil.Process(daemon.process.pid)
        room = process.num_fds() + 100  # far less than who floods: the table is full in a moment
        process.rlimit(resource.RLIMIT_NOFILE, (room, room))
        port = daemon.endpoint.rpartition(":")[2]
        idle = subprocess.Popen([sys.executable, "-c", IDLE, port, str(daemon.socket)], stdout=subprocess.PIPE)
        try:
            assert idle.stdout is not None and int(idle.stdout.readline()) == 4000
            for value in (0.02, 0.04):
                assert daemon.command("reference", value=value)["ok"]
            before = daemon.command("status")["status"]
            time.sleep(1.0)
            after = daemon.command("status")["status"]
            assert after["t"] - before["t"] > 0.9 and after["ticks"] > before["ticks"]  # it goes on
            assert after["recorder"]["failures"] == 0
            assert hoopd("disarm", "--set", f"commands.socket={daemon.socket}").returncode == 0
        finally:
            idle.kill()
            idle.wait(10)
        assert daemon.stop() == 0
