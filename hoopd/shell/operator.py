"""The operator's side of the command socket: one request, one answer.

Rules of this file: every failure is one line; where two daemons of a name answer, nobody guesses which is meant.
"""

from __future__ import annotations

import json
import os
import socket
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoopd.files import InputError, os_reason
from hoopd.shell.commands import ALWAYS
from hoopd.shell.socketfile import folders

PATIENCE_S = 3.0  # the server's own bounds are below it
ANSWER_BYTES = 2**20


class CommandError(InputError):
    """A command that no daemon took, in one line; the command line ends with exit code 2 on it."""

    def __init__(self, text: str) -> None:
        super().__init__("", "", text)


class NoDaemonError(CommandError):
    """Nobody answers at the command socket."""


def ask(request: Mapping[str, Any], device: str, configured: str = "") -> dict[str, Any]:
    """The answer of the daemon of this device; CommandError when none answers, or when it refuses.

    `disarm` and `stop` go to every daemon of that name that this user may command, everything else to one.
    """
    paths = [Path(configured)] if configured else [folder / f"{device}.sock" for folder in folders()]
    connections, closed = _connected(paths)
    if not connections:
        raise NoDaemonError(_nobody(device, paths, closed))
    if len(connections) > 1 and request["command"] not in ALWAYS:
        names = " and ".join(str(path) for path, _ in connections)
        raise CommandError(f"two daemons of device {device!r} run: name one by --set commands.socket=PATH ({names})")
    answers = [_exchange(path, connection, request) for path, connection in connections]
    for answer in answers:
        if not answer.get("ok"):
            raise CommandError(f"{request['command']}: refused: {answer.get('reason', 'no reason given')}")
    return answers[0]


def _connected(paths: list[Path]) -> tuple[list[tuple[Path, socket.socket]], list[str]]:
    """Connections to who listens there, and what is there but not for us."""
    connections, closed = [], []
    for path in dict.fromkeys(paths):
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        # Before a full queue a socket with Python's own time-out would give up at once instead of standing in line.
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(PATIENCE_S), 0))
        try:
            connection.connect(str(path))
            connection.settimeout(PATIENCE_S)
        except (FileNotFoundError, ConnectionRefusedError, NotADirectoryError):  # none, or a dead one's file
            connection.close()
        except OSError as error:
            connection.close()
            closed.append(f"{path}: {os_reason(error)}{_group_hint(error)}")
        else:
            connections.append((path, connection))
    return connections, closed


def _nobody(device: str, paths: list[Path], closed: list[str]) -> str:
    if closed:
        return "; ".join(closed)
    return f"no daemon of device {device!r} answers at {' or '.join(str(path) for path in dict.fromkeys(paths))}"


def _group_hint(error: OSError) -> str:
    if not isinstance(error, PermissionError):
        return ""
    user = os.environ.get("USER", "NAME")
    return f" (operators are in group hoopd: sudo usermod -aG hoopd {user}, then log in again)"


def _exchange(path: Path, connection: socket.socket, request: Mapping[str, Any]) -> dict[str, Any]:
    """One line there, one line back."""
    with connection:
        try:
            connection.sendall(json.dumps(request).encode() + b"\n")
            line = b""
            while not line.endswith(b"\n") and len(line) < ANSWER_BYTES and (data := connection.recv(65536)):
                line += data
            answer = json.loads(line)
        except OSError as error:
            raise CommandError(f"{path}: {os_reason(error, 'no answer in time')}") from None
        except ValueError:
            raise CommandError(f"{path}: the daemon ended, or had no room: no answer") from None
    if not isinstance(answer, dict):
        raise CommandError(f"{path}: not the answer of a daemon")
    return answer
