"""The operator's side of the command socket: one request, one answer.

Rules of this file: every failure is one line; where two daemons of a name answer, nobody guesses which is meant; a
request goes to all that it concerns before any answer is waited for; what switches off is said again when others left
no room for it.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoopd.core.succession import LOADED
from hoopd.files.reading import InputError, os_reason
from hoopd.shell.commands import ALWAYS, LOAD_S
from hoopd.shell.socketfile import PATH_BYTES, SERVICE_FOLDER, check_private, folders

PATIENCE_S = 3.0  # the server's own bounds are below it
LOAD_PATIENCE_S = LOAD_S + PATIENCE_S  # a file has to be read and checked, a model made ready and watched
TRIES = 20  # where the server hangs up without an answer; what may not be said twice has one
REPEATABLE = (*ALWAYS, "status")
ANSWER_BYTES = 2**20
HUNG_UP = "the daemon ended, or had no room: no answer"
NO_ADDRESS = f"longer than the {PATH_BYTES} bytes of a socket's address"


class CommandError(InputError):
    """A command that no daemon took, in one line; the command line ends with exit code 2 on it."""

    def __init__(self, text: str) -> None:
        super().__init__("", "", text)


class NoDaemonError(CommandError):
    """Nobody answers at the command socket."""


class _HungUpError(CommandError):
    """The server closed without a word."""


Connection = tuple[Path, socket.socket]


def ask(request: Mapping[str, Any], device: str, configured: str = "") -> dict[str, Any]:
    """The answer of the daemon of this device; CommandError when none answers, or when it refuses.

    `disarm` and `stop` go to every daemon of that name that this user may command, everything else to one.
    """
    for _ in range(TRIES - 1 if request["command"] in REPEATABLE else 0):
        with contextlib.suppress(_HungUpError):
            return _ask_once(request, device, configured)
    return _ask_once(request, device, configured)


def _ask_once(request: Mapping[str, Any], device: str, configured: str) -> dict[str, Any]:
    paths = [Path(configured)] if configured else [folder / f"{device}.sock" for folder in folders()]
    connections, closed = _connected(paths, trusted=bool(configured))
    if not connections:
        raise NoDaemonError(_nobody(device, paths, closed))
    with contextlib.ExitStack() as stack:
        for _, connection in connections:
            stack.enter_context(connection)
        if len(connections) > 1 and request["command"] not in ALWAYS:
            names = " and ".join(str(path) for path, _ in connections)
            raise CommandError(
                f"two daemons of device {device!r} run: name one by --set commands.socket=PATH ({names})"
            )
        return _exchanged(request, connections)


def _exchanged(request: Mapping[str, Any], connections: list[Connection]) -> dict[str, Any]:
    """The first answer; CommandError when any of them failed or refused."""
    line = json.dumps(request).encode() + b"\n"
    for _, connection in connections:
        if request["command"] in LOADED:
            connection.settimeout(LOAD_PATIENCE_S)
        with contextlib.suppress(OSError):  # the answer tells: it may have been refused before all was said
            connection.sendall(line)
    answers, failures = [], []
    for path, connection in connections:
        try:
            answers.append(_answer(request, path, connection))
        except CommandError as error:
            failures.append(error)
    if len(failures) > 1 or (failures and answers):
        raise CommandError("; ".join([*map(str, failures), *(f"obeyed: {answer['mode']}" for answer in answers)]))
    if failures:
        raise failures[0]
    return answers[0]


def _connected(paths: list[Path], *, trusted: bool) -> tuple[list[Connection], list[str]]:
    """Connections to who listens there, and what is there but not for us; `trusted`: the user named the file."""
    connections, closed = [], []
    for path in dict.fromkeys(paths):
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        # Before a full queue a socket with Python's own time-out would give up at once instead of standing in line.
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(PATIENCE_S), 0))
        try:
            if not trusted and path.parent != SERVICE_FOLDER:
                check_private(path.parent)  # whoever laid it there could answer in the daemon's name
            connection.connect(str(path))
            connection.settimeout(PATIENCE_S)
        except (FileNotFoundError, ConnectionRefusedError, NotADirectoryError):  # none, or a dead one's file
            connection.close()
        except InputError as error:
            connection.close()
            closed.append(str(error))
        except OSError as error:
            connection.close()
            closed.append(f"{path}: {os_reason(error, NO_ADDRESS)}{_group_hint(error)}")
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


def _answer(request: Mapping[str, Any], path: Path, connection: socket.socket) -> dict[str, Any]:
    """One line back; CommandError for none, and for a refusal."""
    line = b""
    try:
        while not line.endswith(b"\n") and len(line) < ANSWER_BYTES and (data := connection.recv(65536)):
            line += data
    except ConnectionResetError:
        raise _HungUpError(f"{path}: {HUNG_UP}") from None
    except OSError as error:
        raise CommandError(f"{path}: {os_reason(error, 'no answer in time')}") from None
    if not line:
        raise _HungUpError(f"{path}: {HUNG_UP}")
    try:
        answer = json.loads(line)
    except (ValueError, RecursionError):
        answer = None
    if not isinstance(answer, dict):
        raise CommandError(f"{path}: not the answer of a daemon")
    if not answer.get("ok"):
        name, reason = request["command"], str(answer.get("reason", "no reason given"))
        raise CommandError(f"{name}: refused: {reason.removeprefix(f'{name}: ')}")
    return answer
