"""Operators at the command socket of a running daemon: what they are told, and that nobody keeps them out.

And at a terminal that takes nothing any more: whoever left it there holds up nothing.
"""

from __future__ import annotations

import contextlib
import fcntl
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
from harness.realrun import ENVIRONMENT, START_S, Daemon, fifo_granted, free_port, undelayed
from harness.timing import on_the_clock
from harness.witness import Witness, witnessed
from inprocess import call

from hoopd.daemon.replay import replay
from hoopd.files.controller_folder import key_of
from hoopd.files.shipped import defaults_folder
from hoopd.shell.operator import CommandError
from hoopd.shell.socketfile import listening_socket

REFERENCE = [{"at_s": 1.8, "name": "reference", "value": 0.1}]  # keeps the motor busy
DICTIONARY = "transport/auth/usrpwd/dictionary_file"

# Queries far beyond what a message may have, to a session that asks nobody and to one with a password.
HUGE = """
import json, sys, zenoh
from hoopd.shell.session import connecting
payload = bytes(40 * 10**6)
for endpoint, extras in json.loads(sys.argv[1]):
    with zenoh.open(connecting(endpoint, extras, 2.0)) as session:
        assert session.info.transports()
        for name in ("arm", "disarm", "reference"):
            for reply in session.get(f"hoopd/hoop/cmd/{name}", payload=payload, timeout=0.5):
                print(name, "taken" if reply.ok else reply.err.payload.to_string())
"""

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


def hoopd(*words: str) -> subprocess.CompletedProcess[str]:
    """What the command line says."""
    code, out, errors = call(words)
    return subprocess.CompletedProcess(words, code, out, errors)


def started(*words: str) -> subprocess.CompletedProcess[str]:
    """A daemon as a process of its own, until it ends."""
    command = [sys.executable, "-m", "hoopd", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False, env=ENVIRONMENT)


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
        refused = daemon.wait_for(event="command_refused", command="reference")
        assert (moved.returncode, moved.stderr) == (2, f"hoopd: reference: refused: {refused['reason']}\n")
        off = hoopd("disarm", "--set", here)
        assert off.returncode == 0 and re.fullmatch(r"disarm: (DISARMED|FAULT)\b.*\n", off.stdout)
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


def test_another_controller_is_loaded_by_name_and_hash(tmp_path: Path) -> None:
    controllers, elsewhere = tmp_path / "controllers", tmp_path / "elsewhere"
    for folder in (controllers, elsewhere):
        folder.mkdir()
        text = (defaults_folder() / "controllers" / "lqg.yaml").read_text()
        (folder / "mine.yaml").write_text(text.replace("name: lqg", f"name: {folder.name}"))
    with Daemon(tmp_path, config={"control": {"folder": str(controllers)}}, fifo=fifo_granted()) as daemon:
        listening(daemon)
        here = ("--set", f"commands.socket={daemon.socket}")
        daemon.command("disarm")  # in whatever mode a busy machine's faults leave it
        other = hoopd("controller", str(elsewhere / "mine.yaml"), *here)
        assert other.returncode == 2 and "controller: refused: mine.yaml: its hash is" in other.stderr
        with pytest.raises(CommandError, match=r"a law that is code is never loaded"):
            daemon.command("controller", key="law.py@0123456789ab")
        done = hoopd("controller", str(controllers / "mine.yaml"), *here)
        assert (done.returncode, done.stderr) == (0, "") and "mine.yaml@" in done.stdout
        asked = daemon.wait_for(event="command", command="controller")
        loaded = daemon.wait_for(event="controller", file="mine.yaml")
        assert asked["uid"] == os.getuid() and loaded["by"] == f"user {os.getuid()}, process {os.getpid()}"
        told = daemon.command("status")["status"]["controller"]
        assert (told["file"], told["sha256"], told["trial"]) == ("mine.yaml", loaded["sha256"], False)
        for name in ("accept", "revert"):
            assert "there is no trial" in hoopd(name, *here).stderr
        near = (defaults_folder() / "models" / "hoop.yaml").read_text().replace("1.518e-3", "1.52e-3")
        (controllers / "near.yaml").write_text(near)
        (controllers / "other.yaml").write_text(text.replace("models/hoop.yaml", "near.yaml"))
        daemon.command("controller", key=key_of(controllers / "other.yaml"))
        assert daemon.command("status")["status"]["controller"]["file"] == "other.yaml"
        assert daemon.stop() == 0
        result = replay(daemon.result().recordings[0])
        assert result["equal"], result["first_difference"]


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
            beside = started("--sim", "--camera", "direct", "--duration", "1", "--set", f"commands.socket={path}",
                           "--set", "telemetry.enabled=false")  # fmt: skip
            assert beside.returncode == 0 and "another daemon of this device runs" in beside.stderr
            assert following.command("status")["ok"]


def test_a_second_daemon_of_a_device_is_refused_in_one_line(tmp_path: Path) -> None:
    master, slave = os.openpty()
    first = listening_socket("hoop", str(tmp_path / "hoop.sock"))
    try:
        port = os.ttyname(slave)
        second = started("--set", f"serial.port={port}", "--set", "camera.command=[cat]",
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
            for _ in range(2):
                assert daemon.command("disarm")["ok"]
            before = daemon.command("status")["status"]
            time.sleep(1.0)
            after = daemon.command("status")["status"]
            assert after["ticks"] > before["ticks"]  # it goes on
            with on_the_clock():
                assert after["t"] - before["t"] > 0.9
            assert after["recorder"]["failures"] == 0
            assert hoopd("disarm", "--set", f"commands.socket={daemon.socket}").returncode == 0
        finally:
            idle.kill()
            idle.wait(10)
        assert daemon.stop() == 0


@pytest.mark.realtime
def test_messages_of_40_mb_cost_neither_ticks_nor_memory(tmp_path: Path) -> None:
    """With commands off, and on: 64 KiB is what zenoh takes of a message."""
    users = tmp_path / "users.txt"
    users.write_text("operator:turn\n")
    proof = {"transport/auth/usrpwd/user": "hoop", "transport/auth/usrpwd/password": "x"}
    control = {"endpoint": f"tcp/127.0.0.1:{free_port()}", "zenoh": {**proof, DICTIONARY: str(users)}}
    telemetry = {"endpoint": f"tcp/127.0.0.1:{free_port()}", "commands": True, "control": control}
    operator = {"transport/auth/usrpwd/user": "operator", "transport/auth/usrpwd/password": "turn"}
    places = [(telemetry["endpoint"], {}), (control["endpoint"], operator)]

    def check(folder: Path, witness: Witness) -> None:
        with Daemon(folder, fifo=fifo_granted(), config={"telemetry": telemetry}, commands=REFERENCE) as daemon:
            daemon.wait_running()
            process = psutil.Process(daemon.process.pid)
            before, start = process.memory_info().rss, time.monotonic()
            command = [sys.executable, "-c", HUGE, json.dumps(places)]
            largest = 0
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT) as peer:
                while peer.poll() is None and time.monotonic() < start + 60.0:
                    largest = max(largest, process.memory_info().rss)
                    time.sleep(0.01)
                peer.kill()
                assert peer.stdout is not None
                said = peer.stdout.read().splitlines()
            assert peer.returncode == 0
            stop = time.monotonic()
            assert set(said) == {"arm Timeout", "disarm Timeout", "reference Timeout"}  # of the asker's own
            assert largest - before < 30 * 10**6
            assert daemon.command("disarm")["mode"] in ("DISARMED", "FAULT")
            assert daemon.stop() == 0
            run = daemon.result()
        undelayed(run, witness, start, stop)
        assert not any(command.name == "arm" for row in run.inputs for command in row.commands if row.t > 3.0)

    witnessed(tmp_path, check)


def test_a_refused_arm_is_told_with_the_reason_of_the_log(tmp_path: Path) -> None:
    with Daemon(tmp_path, fifo=fifo_granted()) as daemon:
        listening(daemon)
        [board] = daemon.family("boardprocess")
        board.kill()
        daemon.wait_for(event="fault", fault="link_lost")
        told = hoopd("arm", "--set", f"commands.socket={daemon.socket}")
        logged = daemon.wait_for(event="command_refused", command="arm")
        assert "link_lost" in logged["reason"]
        assert (told.returncode, told.stdout, told.stderr) == (2, "", f"hoopd: arm: refused: {logged['reason']}\n")
        assert daemon.stop() == 0


def test_without_a_daemon_every_command_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    here = (
        "--set",
        f"commands.socket={tmp_path / 'hoop.sock'}",
        "--set",
        f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}",
    )
    for words in (("arm",), ("disarm",), ("stop",), ("clear",), ("ref", "0.1"), ("tune", "gain", "1"), ("status",)):
        done = hoopd(*words, *here)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == f"hoopd: no daemon of device 'hoop' answers at {tmp_path / 'hoop.sock'}\n"
    for value in ("nan", "inf", "-1e999"):
        done = hoopd("ref", value, *here)
        assert done.returncode == 2 and "must be a finite number" in done.stderr and done.stderr.count("\n") == 1


def test_a_blocked_terminal_holds_neither_control_nor_the_exit(tmp_path: Path) -> None:
    (tmp_path / "rec").mkdir()
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(write, False)
    os.write(write, b"." * 4096)
    os.set_blocking(write, True)
    process = subprocess.Popen(
        [sys.executable, "-m", "hoopd", "--sim", "--camera", "direct", "--record", str(tmp_path / "rec"), "--duration",
         "2.5", "--set", "telemetry.enabled=false", "--set", f"sim.directory={tmp_path}"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=write, env=ENVIRONMENT,
    )  # fmt: skip
    os.close(write)
    try:
        process.wait(60.0)  # for ever, if it were held; a busy machine takes its time
    finally:
        process.kill()
        process.wait()
        os.close(read)
    assert process.returncode == 0
