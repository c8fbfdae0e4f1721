"""Commands of the operator: checked and queued for the next tick on the daemon's side, sent on the other.

Rules of this file: `disarm` and `stop` are always taken and cannot be crowded out; everything else only when enabled,
finite, in its range and while there is room. A refusal is one line that says what would be right. Nothing here decides
whether the device may run: that is the tick's.
"""

from __future__ import annotations

import json
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec
import zenoh

from hoopd.core.records import Command
from hoopd.files import InputError
from hoopd.shell.session import DEVICE, ENDPOINT, connecting, device_key, reason

ALWAYS = ("disarm", "stop")  # first, and whether commands are enabled or not
NAMES = (*ALWAYS, "arm", "clear", "reference", "tune", "experiment")
WAITING = 16  # commands that one tick may bring: more than a hand can send in 20 ms
PAYLOAD_BYTES = 1000
LOOK_S = 0.05  # between two looks at what became of a command
# What the newest tick looks like once a command has been obeyed.
OUTCOMES: Mapping[str, Callable[[Mapping[str, Any], float | None], bool]] = MappingProxyType(
    {
        "arm": lambda tick, _: tick.get("mode") in ("READY", "RUNNING"),
        "disarm": lambda tick, _: tick.get("mode") in ("DISARMED", "FAULT"),
        "reference": lambda tick, value: tick.get("reference") == value,
    }
)

Range = tuple[float, float]


class Ranges(NamedTuple):
    """What values a command may bring; tune and experiment by key."""

    reference: Range = (-1.5, 1.5)  # rad, of the ball: it leaves the track near a quarter turn
    tune: Mapping[str, Range] = MappingProxyType({})
    experiment: Mapping[str, Range] = MappingProxyType({})


class RefusedError(Exception):
    """A command that was not taken, with the reason in one line."""


class _Payload(msgspec.Struct, forbid_unknown_fields=True):
    value: float | None = None
    key: str = ""


class Gate:
    """Where commands wait for the tick: `offer` from the telemetry thread, `take` from the loop."""

    def __init__(self, ranges: Ranges, *, enabled: bool) -> None:
        self._ranges, self._enabled = ranges, enabled
        self._waiting: deque[Command] = deque()
        self._always: deque[str] = deque()
        self.accepted = self.refused = 0

    def offer(self, name: str, payload: bytes = b"") -> Command:
        """The command as it will be applied; RefusedError with the reason."""
        try:
            command = self._checked(name, payload)
        except RefusedError:
            self.refused += 1
            raise
        self.accepted += 1
        return command

    def take(self) -> tuple[Command, ...]:
        """All that wait, in order, `disarm` and `stop` last: with both in one tick the safe one wins."""
        if not self._waiting and not self._always:
            return ()
        commands = [self._waiting.popleft() for _ in range(len(self._waiting))]
        safe = [Command(self._always.popleft()) for _ in range(len(self._always))]
        return (*commands, *safe)

    def _checked(self, name: str, payload: bytes) -> Command:
        if name in ALWAYS:
            if name not in self._always:
                self._always.append(name)
            return Command(name)
        if not self._enabled:
            raise RefusedError("commands are off: set telemetry.commands to true in the daemon's configuration")
        if name not in NAMES:
            raise RefusedError(f"unknown command {name!r}; known: {', '.join(NAMES)}")
        if len(self._waiting) >= WAITING:
            raise RefusedError(f"busy: {WAITING} commands are waiting for the next tick")
        command = _command(name, _parsed(payload), self._ranges)
        self._waiting.append(command)
        return command


def _parsed(payload: bytes) -> _Payload:
    """A number, or an object with value and key."""
    if len(payload) > PAYLOAD_BYTES:
        raise RefusedError(f"more than {PAYLOAD_BYTES} bytes")
    try:
        content: float | _Payload = msgspec.json.decode(payload or b"{}", type=float | _Payload)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        raise RefusedError('expected a number or {"value": number, "key": text} as JSON') from None
    return content if isinstance(content, _Payload) else _Payload(content)


def _command(name: str, content: _Payload, ranges: Ranges) -> Command:
    if name in ("arm", "clear"):
        return Command(name)
    if name == "reference":
        return Command(name, _inside(name, content.value, ranges.reference))
    table: Mapping[str, Range] = getattr(ranges, name)
    if name == "experiment" and not table:
        raise RefusedError("experiment: this daemon holds the ball and starts none; end it and run `hoopd experiment`")
    if content.key not in table:
        raise RefusedError(f"{name}: unknown key {content.key[:40]!r}; known: {', '.join(table) or 'none'}")
    return Command(name, _inside(f"{name} {content.key}", content.value, table[content.key]), content.key)


def _inside(what: str, value: float | None, allowed: Range) -> float:
    low, high = allowed
    if value is None or not math.isfinite(value):
        raise RefusedError(f"{what}: expected a finite number from {low:g} to {high:g}")
    if not low <= value <= high:
        raise RefusedError(f"{what}: {value:g} is outside {low:g} to {high:g}")
    return value


class CommandError(InputError):
    """A command that no daemon took, in one line; the command line ends with exit code 2 on it."""

    def __init__(self, text: str) -> None:
        super().__init__("", "", text)


def send(
    command: str,
    value: float | None = None,
    endpoint: str = ENDPOINT,
    device: str = DEVICE,
    timeout_s: float = 2.0,
    *,
    key: str = "",
    extras: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """The daemon's answer; CommandError when none answers or it refuses."""
    content = json.dumps({"key": key} if value is None else {"value": value, "key": key})
    with _session(endpoint, extras, timeout_s) as session:
        return _ask(session, device_key(device, "cmd", command), content, timeout_s, endpoint, device)


def operate(
    command: str,
    value: float | None = None,
    endpoint: str = ENDPOINT,
    device: str = DEVICE,
    *,
    extras: Mapping[str, Any] = MappingProxyType({}),
    timeout_s: float = 2.0,
) -> str:
    """Send a command and say in one line what became of it; CommandError when the daemon does not do it."""
    if command == "arm":
        with _session(endpoint, extras, timeout_s) as session:
            seen = json.loads(_ask(session, device_key(device, "snapshot"), "", timeout_s, endpoint, device))
        if OUTCOMES["arm"](seen.get("tick") or {}, None):
            return f"{device}: already {seen['tick']['mode']}"
    send(command, value, endpoint, device, timeout_s, extras=extras)
    with _session(endpoint, extras, timeout_s) as session:
        deadline = time.monotonic() + timeout_s
        while True:
            seen = json.loads(_ask(session, device_key(device, "snapshot"), "", timeout_s, endpoint, device))
            tick = seen.get("tick") or {}
            if OUTCOMES[command](tick, value):
                return f"{device}: {tick['mode']}, reference {tick['reference']:g} rad"
            if time.monotonic() > deadline:
                faults = ", ".join(seen.get("status", {}).get("faults") or []) or "see its log"
                raise CommandError(f"{command}: the daemon stays {tick.get('mode', 'silent')} ({faults})")
            time.sleep(LOOK_S)


@contextmanager
def _session(endpoint: str, extras: Mapping[str, Any], timeout_s: float) -> Iterator[zenoh.Session]:
    try:
        with zenoh.open(connecting(endpoint, extras, timeout_s)) as session:
            if not session.info.transports():
                raise CommandError(f"the daemon at {endpoint} does not let us in (user, password or certificate?)")
            yield session
    except zenoh.ZError as error:
        raise CommandError(f"no daemon answers at {endpoint}: {reason(error)}") from None


def _ask(session: zenoh.Session, key: str, content: str, timeout_s: float, endpoint: str, device: str) -> str:
    return _answer(list(session.get(key, payload=content, timeout=timeout_s)), endpoint, device)


def _answer(replies: list[zenoh.Reply], endpoint: str, device: str) -> str:
    for reply in replies:
        if reply.ok is not None:
            return str(reply.ok.payload.to_string())
        if reply.err is not None:
            raise CommandError(f"refused: {reply.err.payload.to_string()}")
    raise CommandError(
        f"no daemon of device {device!r} answers at {endpoint} (or it is flooded, or its access rules forbid it)"
    )
