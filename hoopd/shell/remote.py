"""Commands over zenoh, from another machine or another program: a query on the exact key, and the daemon's answer.

Rules of this file: every failure is one line; on the daemon's own machine `hoopd.shell.operator` is the way.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any

import zenoh

from hoopd.core.succession import LOADED
from hoopd.shell.operator import LOAD_PATIENCE_S, CommandError, NoDaemonError
from hoopd.shell.session import DEVICE, ENDPOINT, connecting, device_key, reason


def send(
    command: str,
    value: float | None = None,
    endpoint: str = ENDPOINT,
    device: str = DEVICE,
    timeout_s: float = 3.0,
    *,
    key: str = "",
    extras: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """The daemon's answer; CommandError when none answers or it refuses."""
    with _session(endpoint, extras, timeout_s) as session:
        return ask(session, command, value, endpoint, device, timeout_s, key=key)


def ask(
    session: zenoh.Session,
    command: str,
    value: float | None,
    endpoint: str,
    device: str,
    timeout_s: float,
    *,
    key: str = "",
) -> dict[str, Any]:
    """The daemon's answer over a session that is open; CommandError when none answers or it refuses.

    What names a file is waited for longer: it is read, checked, made ready and watched first.
    """
    timeout_s = max(timeout_s, LOAD_PATIENCE_S) if command in LOADED else timeout_s
    content = json.dumps({"key": key} if value is None else {"value": value, "key": key})
    replies = session.get(device_key(device, "cmd", command), payload=content, timeout=timeout_s)
    return _answer(command, list(replies), endpoint, device)


def configuration(session: zenoh.Session, endpoint: str, device: str, timeout_s: float) -> str:
    """A daemon's configuration as it tells it, without secrets; CommandError when none answers."""
    try:
        replies = list(session.get(device_key(device, "config"), timeout=timeout_s))
    except zenoh.ZError as error:  # the connection went meanwhile
        raise CommandError(f"config: no answer: {error}") from None
    text = _answer("config", replies, endpoint, device).get("config")
    if not isinstance(text, str):
        raise CommandError("config: not the answer of a daemon")
    return text


@contextmanager
def _session(endpoint: str, extras: Mapping[str, Any], timeout_s: float) -> Iterator[zenoh.Session]:
    try:
        with zenoh.open(connecting(endpoint, extras, timeout_s)) as session:
            if not session.info.transports():
                raise CommandError(f"the daemon at {endpoint} does not let us in (user, password or certificate?)")
            yield session
    except zenoh.ZError as error:
        raise NoDaemonError(f"no daemon answers at {endpoint}: {reason(error)}") from None


def _answer(command: str, replies: list[zenoh.Reply], endpoint: str, device: str) -> dict[str, Any]:
    for reply in replies:
        if reply.ok is not None:
            return _understood(command, reply.ok.payload.to_bytes())
        if reply.err is not None:
            raise CommandError(f"{command}: refused: {reply.err.payload.to_string().removeprefix(f'{command}: ')}")
    raise NoDaemonError(
        f"no daemon of device {device!r} answers at {endpoint} (or it is flooded, or its access rules forbid it)"
    )


def _understood(command: str, payload: bytes) -> dict[str, Any]:
    try:
        answer = json.loads(payload)
    except (ValueError, RecursionError):
        answer = None
    if not isinstance(answer, dict):
        raise CommandError(f"{command}: not the answer of a daemon")
    return answer
