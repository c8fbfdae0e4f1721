"""The command socket: whose it is, what comes through it, and who cannot keep others out of it."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from shell.peers import Ticks

from hoopd.core.records import Command
from hoopd.files import InputError
from hoopd.shell import commandserver
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.commandserver import CommandServer
from hoopd.shell.operator import CommandError, NoDaemonError, ask
from hoopd.shell.socketfile import listening_socket, socket_path

RANGES = Ranges((-0.5, 0.5), {"gain": (0.0, 3.0)})


@contextlib.contextmanager
def serving(path: Path, **refused: str) -> Iterator[Ticks]:
    """A server at that path whose loop refuses these commands with these reasons."""
    gate = Gate(RANGES)
    ticks = Ticks(gate, refused)
    server = CommandServer(listening_socket("hoop", str(path)), gate, ticks.asked.append, session="abc")
    server.start()
    try:
        with ticks:
            yield ticks
    finally:
        assert server.close(5.0)
    assert not path.exists()


def raw(path: Path, data: bytes) -> dict[str, Any]:
    """What the server answers to these bytes."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(10.0)
        connection.connect(str(path))
        connection.sendall(data)
        answer: dict[str, Any] = json.loads(connection.makefile().readline())
        return answer


def test_a_command_is_answered_with_what_became_of_it(tmp_path: Path) -> None:
    path = tmp_path / "hoop.sock"
    with serving(path) as ticks:
        answer = ask({"command": "arm"}, "hoop", str(path))
        assert (answer["ok"], answer["command"], answer["mode"], answer["session"]) == (True, "arm", "READY", "abc")
        assert list(ticks.taken) == [Command("arm")]


def test_a_refusal_carries_the_reason_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "hoop.sock"
    with serving(path, arm="link_lost, camera_lost"), pytest.raises(CommandError) as caught:
        ask({"command": "arm"}, "hoop", str(path))
    assert str(caught.value) == "arm: refused: link_lost, camera_lost"


def test_a_loop_that_hangs_is_told_and_status_says_so(tmp_path: Path) -> None:
    path = tmp_path / "hoop.sock"
    with serving(path) as ticks:
        assert ask({"command": "status"}, "hoop", str(path))["status"] == {"mode": "DISARMED"}
        ticks.hang()
        with pytest.raises(CommandError, match="the loop did not tell what became of it"):
            ask({"command": "arm"}, "hoop", str(path))
        with pytest.raises(CommandError, match="the loop has not ticked"):
            ask({"command": "status"}, "hoop", str(path))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"arm\n", "expected one line of JSON"),
        (b"\xff\xfe\n", "expected one line of JSON"),
        (b"[" * 4000 + b"\n", "expected one line of JSON"),
        (b"{}\n", "expected one line of JSON"),
        (b'{"command": "arm", "when": 1}\n', "expected one line of JSON"),
        (b'{"command": "fly"}\n', "unknown command 'fly'"),
        (b'{"command": "reference", "value": 9}\n', "9 is outside -0.5 to 0.5"),
        (b'{"command": "tune", "key": "mass", "value": 1}\n', "unknown key 'mass'; known: gain"),
        (b"x" * 5000, "more than 4096 bytes in a line"),
        (b'{"command": "' + b"x" * 4000 + b'"}\n', "unknown command"),
    ],
)
def test_whatever_comes_is_answered_with_one_line(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "hoop.sock"
    with serving(path) as ticks:
        answer = raw(path, data)
        assert answer["ok"] is False and says in answer["reason"] and len(answer["reason"]) < 300
        assert ask({"command": "disarm"}, "hoop", str(path))["ok"]
        assert list(ticks.taken) == [Command("disarm")]


def test_idle_connections_keep_nobody_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commandserver, "TALK_S", 60.0)  # it is not their time-out that makes room
    path = tmp_path / "hoop.sock"
    with serving(path), contextlib.ExitStack() as stack:
        for _ in range(300):
            idle = stack.enter_context(socket.socket(socket.AF_UNIX))
            idle.connect(str(path))
        before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
        assert ask({"command": "disarm"}, "hoop", str(path))["mode"] == "DISARMED"
        assert before - 300 < 60  # those of the server are not among them: it holds eight at most


def test_a_connection_that_says_nothing_is_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commandserver, "TALK_S", 0.1)
    path = tmp_path / "hoop.sock"
    with serving(path), socket.socket(socket.AF_UNIX) as idle:
        idle.settimeout(10.0)
        idle.connect(str(path))
        idle.sendall(b'{"command": ')
        assert idle.recv(100) == b""


def test_a_dead_daemons_file_is_taken_over_and_a_living_ones_is_not(tmp_path: Path) -> None:
    path = tmp_path / "hoop.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    living = listening_socket("hoop", str(path))
    with pytest.raises(InputError, match=r"hoop\.sock: another daemon of this device runs on this machine"):
        listening_socket("hoop", str(path))
    living.close()
    listening_socket("hoop", str(path)).close()


def test_folders_of_strangers_links_and_open_ones_are_refused(tmp_path: Path) -> None:
    environ = {"XDG_RUNTIME_DIR": str(tmp_path)}
    folder = tmp_path / "hoopd"
    folder.mkdir(mode=0o755)
    with pytest.raises(InputError, match="others may enter it"):
        listening_socket("hoop", environ=environ)
    folder.chmod(0o700)
    mine = listening_socket("hoop", environ=environ)
    assert stat.S_IMODE(mine.path.stat().st_mode) == 0o600
    mine.close()
    folder.rename(tmp_path / "real")
    folder.symlink_to(tmp_path / "real")
    with pytest.raises(InputError, match="is no folder"):
        listening_socket("hoop", environ=environ)
    folder.unlink()
    if os.getuid() == 0:
        folder.mkdir(mode=0o700)
        os.chown(folder, 12345, 12345)
        with pytest.raises(InputError, match="belongs to user 12345"):
            listening_socket("hoop", environ=environ)


def test_where_it_lies(tmp_path: Path) -> None:
    assert socket_path("hoop", environ={"XDG_RUNTIME_DIR": "/run/user/7"}) == Path("/run/user/7/hoopd/hoop.sock")
    assert socket_path("hoop", environ={}) == Path(f"/tmp/hoopd-{os.getuid()}/hoop.sock")
    assert socket_path("hoop", environ={"RUNTIME_DIRECTORY": "/run/hoopd"}) == Path("/run/hoopd/hoop.sock")
    with pytest.raises(InputError, match="longer than the 107 bytes"):
        listening_socket("h" * 120, environ={"RUNTIME_DIRECTORY": str(tmp_path)})


def test_the_services_socket_is_for_its_group(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        service = listening_socket("hoop", environ={"RUNTIME_DIRECTORY": str(tmp_path)})
    finally:
        os.umask(before)
    assert stat.S_IMODE(service.path.stat().st_mode) == 0o660
    service.close()


def test_nobody_there_is_one_line(tmp_path: Path) -> None:
    begun = time.monotonic()
    with pytest.raises(NoDaemonError, match=r"no daemon of device 'hoop' answers at .*hoop\.sock") as caught:
        ask({"command": "arm"}, "hoop", str(tmp_path / "hoop.sock"))
    assert "\n" not in str(caught.value) and time.monotonic() - begun < 5.0
