"""What a program of this machine can do to a daemon's ways in, each until it is ended.

Rules of this file: an attack is a function of the daemon's zenoh endpoint and command socket, and runs in a process of
its own; it goes on whatever the daemon answers.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import resource
import socket
import time
from collections.abc import Callable, Iterator

import zenoh

from hoopd.shell.session import DEVICE, connecting, device_key

Attack = Callable[[str, str], None]
CONNECTIONS = 2000
HUGE_BYTES = 400 * 10**6
WAIT_S = 0.5
SPELLINGS = (
    "NaN",
    "1e999",
    "-Infinity",
    "1" * 400,
    "1" * 3500,
    "[" * 3500,
    '{"value":' * 400,
    "1e308",
    "null",
    '"gain"',
)


def connected(path: str, *, wait: bool = True) -> socket.socket:
    """A connection to the command socket; without `wait`, perhaps one that is still under way."""
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(WAIT_S if wait else 0.0)
    with contextlib.suppress(OSError):
        connection.connect(path)
    return connection


def slow_loris(endpoint: str, path: str) -> None:
    """Many connections, of which each says a byte of a command now and then."""
    lines = [(connected(path, wait=False), iter(b'{"command": "reference", "value": 0.1}')) for _ in range(200)]
    while True:
        for index, (connection, text) in enumerate(lines):
            try:
                connection.send(bytes([next(text)]))
            except (OSError, StopIteration):
                connection.close()
                lines[index] = (connected(path, wait=False), iter(b'{"command": "reference", "value": 0.1}'))
        time.sleep(0.05)


def garbage(endpoint: str, path: str) -> None:
    """Random bytes, with an end of line or without, up to twice what a line may have."""
    draw = random.Random(0)
    while True:
        _say(path, draw.randbytes(draw.choice((1, 20, 300, 4095, 4097, 8000))) + draw.choice((b"", b"\n")))


def half_messages(endpoint: str, path: str) -> None:
    """Commands that break off, and hang up."""
    draw, text = random.Random(0), b'{"command": "reference", "value": 0.1}\n'
    while True:
        with connected(path) as connection, contextlib.suppress(OSError):
            connection.send(text[: draw.randrange(len(text))])


def never_reads(endpoint: str, path: str) -> None:
    """Asks, and leaves the answer where it is."""
    held: list[socket.socket] = []
    while True:
        connection = connected(path)
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
            connection.send(b'{"command": "status"}\n')
        held.append(connection)
        if len(held) > 100:
            held.pop(0).close()


def idle(endpoint: str, path: str) -> None:
    """Connections that say nothing, at both ways in, as many as the table holds."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
    while True:
        with contextlib.ExitStack() as held:
            for _ in range(CONNECTIONS):
                held.enter_context(connected(path, wait=False))
                other = held.enter_context(socket.socket())
                other.settimeout(0.0)
                with contextlib.suppress(OSError):
                    other.connect((host, int(port)))
            time.sleep(1.0)


def commands(endpoint: str, path: str) -> None:
    """References, as fast as they are answered, from one connection each."""
    while True:
        _say(path, b'{"command": "reference", "value": 0.1}\n', read=True)


def commands_unread(endpoint: str, path: str) -> None:
    """References, as fast as they can be sent: nobody waits for an answer."""
    while True:
        _say(path, b'{"command": "reference", "value": 0.1}\n')


def questions(endpoint: str, path: str) -> None:
    """Questions after the status, a hundred at once."""
    while True:
        with contextlib.ExitStack() as held:
            for _ in range(100):
                with contextlib.suppress(OSError):
                    held.enter_context(connected(path)).send(b'{"command": "status"}\n')


def tuning(endpoint: str, path: str) -> None:
    """Values that are none: not a number, without end, too deep."""
    draw = random.Random(0)
    while True:
        _say(path, f'{{"command": "tune", "key": "gain", "value": {draw.choice(SPELLINGS)}}}\n'.encode(), read=True)


def huge_queries(endpoint: str, path: str) -> None:
    """400 MB to a command's key."""
    with _session(endpoint) as session:
        payload = bytes(HUGE_BYTES)
        while True:
            for name in ("arm", "disarm"):
                list(session.get(device_key(DEVICE, "cmd", name), payload=payload, timeout=WAIT_S))


def queries(endpoint: str, path: str) -> None:
    """Queries of every key, as fast as they go out."""
    names = ("snapshot", "config", "cmd/arm", "cmd/reference")
    with _session(endpoint) as session:
        while True:
            for name in names:
                key = device_key(DEVICE, *name.split("/"))
                session.get(key, zenoh.handlers.RingChannel(1), payload="0.1", timeout=WAIT_S)


def forged_rows(endpoint: str, path: str) -> None:
    """Rows in the daemon's name."""
    with _session(endpoint) as session:
        row = json.dumps({"t": 1.0, "id": 1, "mode": "RUNNING", "u": 0.7})
        while True:
            session.put(device_key(DEVICE, "tick"), row)


def declarations(endpoint: str, path: str) -> None:
    """Subscribers and tokens without end."""
    with _session(endpoint) as session:
        held = []
        while True:
            held.append(session.declare_subscriber(f"hoopd/{len(held)}", zenoh.handlers.RingChannel(1)))
            held.append(session.liveliness().declare_token(f"hoopd/{os.getpid()}/{len(held)}"))


def sessions(endpoint: str, path: str) -> None:
    """Sessions that come and go."""
    while True:
        with _session(endpoint):
            pass


def no_zenoh(endpoint: str, path: str) -> None:
    """Random bytes where zenoh listens."""
    draw, (host, port) = random.Random(0), endpoint.removeprefix("tcp/").rsplit(":", 1)
    while True:
        with socket.socket() as connection, contextlib.suppress(OSError):
            connection.connect((host, int(port)))
            size = draw.choice((1, 100, 70000))
            connection.send(size.to_bytes(2, "little", signed=False) if size < 65536 else b"\xff\xff")
            connection.send(draw.randbytes(size))


def _say(path: str, text: bytes, *, read: bool = False) -> None:
    with connected(path) as connection, contextlib.suppress(OSError):
        connection.send(text)
        if read:
            connection.recv(4096)


@contextlib.contextmanager
def _session(endpoint: str) -> Iterator[zenoh.Session]:
    """An anonymous session; another try when there is no room."""
    while True:
        try:
            session = zenoh.open(connecting(endpoint, {}, 1.0))
            break
        except zenoh.ZError:
            time.sleep(0.01)
    with session:
        yield session


ATTACKS: dict[str, Attack] = {
    "slow-loris": slow_loris,
    "garbage": garbage,
    "half messages": half_messages,
    "never reads": never_reads,
    "idle": idle,
    "commands": commands,
    "commands unread": commands_unread,
    "questions": questions,
    "tuning": tuning,
    "huge queries": huge_queries,
    "queries": queries,
    "forged rows": forged_rows,
    "declarations": declarations,
    "sessions": sessions,
    "no zenoh": no_zenoh,
}
