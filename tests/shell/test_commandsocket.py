"""The command socket: whose it is, what comes through it, and who cannot keep others out of it."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from harness.timing import on_the_clock
from shell.peers import Ticks, wait_until

from hoopd.core.records import Command
from hoopd.files.reading import InputError
from hoopd.shell import commandserver, operator
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.commandserver import CommandServer, Peer
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


def test_what_the_gate_refuses_stands_in_the_log_with_the_same_reason(tmp_path: Path) -> None:
    path = tmp_path / "hoop.sock"
    told: list[tuple[str, str, Mapping[str, Any]]] = []
    gate = Gate(RANGES)
    server = CommandServer(
        listening_socket("hoop", str(path)), gate, lambda _: None, on_event=lambda *e: told.append(e)
    )
    server.start()
    try:
        with pytest.raises(CommandError) as caught:
            ask({"command": "reference", "value": 9.0}, "hoop", str(path))
        wait_until(lambda: bool(told))
    finally:
        assert server.close(5.0)
    ((event, level, fields),) = told
    assert (event, level, fields["command"], fields["uid"]) == ("command_refused", "warning", "reference", os.getuid())
    assert str(caught.value) == f"reference: refused: {fields['reason'].removeprefix('reference: ')}"
    assert "9 is outside" in fields["reason"] and str(caught.value).count("reference") == 1


def test_a_loop_that_hangs_is_told_and_status_says_so(tmp_path: Path) -> None:
    path = tmp_path / "hoop.sock"
    with serving(path) as ticks:
        assert ask({"command": "status"}, "hoop", str(path))["status"] == {"mode": "DISARMED"}
        ticks.hang()
        with pytest.raises(CommandError, match="the loop did not tell what became of it"):
            ask({"command": "arm"}, "hoop", str(path))
        with pytest.raises(CommandError, match="the loop has not ticked"):
            ask({"command": "status"}, "hoop", str(path))


def test_who_asks_late_is_told_what_became_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commandserver, "SETTLE_S", 0.4)
    monkeypatch.setattr(commandserver, "TALK_S", 10.0)
    path = tmp_path / "hoop.sock"
    with serving(path) as ticks, socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(10.0)
        connection.connect(str(path))
        time.sleep(0.6)
        connection.sendall(b'{"command": "arm"}\n')
        answer = json.loads(connection.makefile().readline())
        assert (answer["ok"], answer.get("mode")) == (True, "READY"), answer
        assert list(ticks.taken) == [Command("arm")]


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
        (b'{"command": "tune", "key": "gain", "value": NaN}\n', "expected one line of JSON"),
        (b'{"command": "tune", "key": "gain", "value": 1e999}\n', "expected one line of JSON"),
        (b'{"command": "tune", "key": "gain", "value": 1e308}\n', "1e+308 is outside 0 to 3"),
        (b'{"command": "tune", "key": "gain", "value": ' + b"1" * 400 + b"}\n", "expected one line of JSON"),
        (b'{"command": "tune", "key": "gain", "value": ' + b"[" * 3900 + b"}\n", "expected one line of JSON"),
        (b'{"command": "tune", "key": "gain", "value": null}\n', "expected a finite number from 0 to 3"),
        (b'{"command": "tune", "key": "\\u0000\\n", "value": 1}\n', r"unknown key '\x00\n'"),
        (b'{"command": "tune", "key": "' + b"k" * 3000 + b'", "value": 1}\n', "more than 1000 bytes"),
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


def test_who_holds_most_connections_makes_room_even_while_they_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    greedy, patient = Peer(1, 0, 0), Peer(2, 0, 0)
    came = [greedy] * commandserver.CONNECTIONS + [patient]
    monkeypatch.setattr(commandserver, "_peer", lambda connection: came.pop(0))
    path = tmp_path / "hoop.sock"
    with serving(path) as ticks, contextlib.ExitStack() as stack:
        ticks.hang()  # so that each of them waits for an answer
        for _ in range(commandserver.CONNECTIONS):
            waiting = stack.enter_context(socket.socket(socket.AF_UNIX))
            waiting.connect(str(path))
            waiting.sendall(b'{"command": "arm"}\n')
        with socket.socket(socket.AF_UNIX) as slow:
            slow.settimeout(10.0)
            slow.connect(str(path))
            assert wait_until(lambda: not came)  # heard of, and nothing said yet
            time.sleep(3 * commandserver.POLL_S)
            slow.sendall(b'{"command": "disarm"}\n')
            assert b"the loop did not tell" in slow.recv(4096)


def test_a_connection_that_goes_wrong_ends_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "hoop.sock"
    with serving(path) as ticks:
        with monkeypatch.context() as patch:
            patch.setattr(Gate, "offer", lambda *_: 1 / 0)
            with pytest.raises(CommandError, match="no answer"):
                ask({"command": "arm"}, "hoop", str(path))
        assert ask({"command": "arm"}, "hoop", str(path))["ok"]
        assert list(ticks.taken) == [Command("arm")]


def test_what_switches_off_is_said_again_when_there_was_no_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, closed = tmp_path / "hoop.sock", []
    attend = CommandServer._attend

    def full(self: CommandServer, client: Any) -> None:
        if len(closed) < 3:
            closed.append(client)
            self._drop(client)
        else:
            attend(self, client)

    monkeypatch.setattr(CommandServer, "_attend", full)
    with serving(path) as ticks:
        assert ask({"command": "disarm"}, "hoop", str(path))["ok"] and len(closed) == 3
        closed.clear()
        with pytest.raises(CommandError, match="the daemon ended, or had no room: no answer"):
            ask({"command": "arm"}, "hoop", str(path))  # it might have been taken, and revoked since
        assert list(ticks.taken) == [Command("disarm")]


def test_a_daemon_that_hangs_keeps_no_disarm_from_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator, "PATIENCE_S", 0.3)
    monkeypatch.setattr(operator, "folders", lambda: [tmp_path / "a", tmp_path / "b"])
    for name in ("a", "b"):
        (tmp_path / name).mkdir(mode=0o700)
    with socket.socket(socket.AF_UNIX) as hangs, serving(tmp_path / "b" / "hoop.sock") as ticks:
        hangs.bind(str(tmp_path / "a" / "hoop.sock"))
        hangs.listen()
        with pytest.raises(CommandError, match=r"a/hoop\.sock: no answer in time; obeyed: DISARMED$"):
            ask({"command": "disarm"}, "hoop")
        assert list(ticks.taken) == [Command("disarm")]
        with pytest.raises(CommandError, match="two daemons of device 'hoop' run: name one by"):
            ask({"command": "arm"}, "hoop")
        assert list(ticks.taken) == [Command("disarm")]


def test_both_daemons_of_a_name_are_disarmed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir(mode=0o700)
    monkeypatch.setattr(operator, "folders", lambda: folders)
    with serving(folders[0] / "hoop.sock") as first, serving(folders[1] / "hoop.sock") as second:
        assert ask({"command": "disarm"}, "hoop")["mode"] == "DISARMED"
        assert list(first.taken) == list(second.taken) == [Command("disarm")]


def test_a_strangers_folder_is_no_daemon_of_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever lays a socket where ours would be could say that he has disarmed."""
    folder = tmp_path / "hoopd"
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(operator, "folders", lambda: [folder])
    with serving(folder / "hoop.sock") as ticks:
        folder.chmod(0o711)
        with pytest.raises(NoDaemonError, match=r"hoopd: others may enter it \(mode 711\)"):
            ask({"command": "disarm"}, "hoop")
        folder.chmod(0o700)
        if os.getuid() == 0:
            os.chown(folder, 12345, 12345)
            with pytest.raises(NoDaemonError, match="belongs to user 12345, not to us"):
                ask({"command": "disarm"}, "hoop")
            os.chown(folder, 0, 0)
        folder.rename(tmp_path / "real")
        folder.symlink_to(tmp_path / "real")
        with pytest.raises(NoDaemonError, match="is no folder"):
            ask({"command": "disarm"}, "hoop")
        folder.unlink()
        (tmp_path / "real").rename(folder)
        assert list(ticks.taken) == []
        assert ask({"command": "disarm"}, "hoop")["ok"]


def test_a_link_in_place_of_the_socket_is_left_alone(tmp_path: Path) -> None:
    path, other = tmp_path / "hoop.sock", tmp_path / "precious"
    other.write_text("kept")
    path.symlink_to(other)
    with pytest.raises(InputError, match=r"hoop\.sock: commands\.socket: exists and is no socket"):
        listening_socket("hoop", str(path))
    path.unlink()
    path.with_suffix(".lock").unlink()
    path.with_suffix(".lock").symlink_to(other)
    with pytest.raises(InputError, match=r"hoop\.sock: commands\.socket: too many levels of symbolic links"):
        listening_socket("hoop", str(path))
    assert other.read_text() == "kept"


def test_an_address_that_is_too_long_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(NoDaemonError, match="longer than the 107 bytes of a socket's address"):
        ask({"command": "status"}, "hoop", str(tmp_path / ("h" * 120)))


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
    assert "\n" not in str(caught.value)
    with on_the_clock():
        assert time.monotonic() - begun < 5.0
