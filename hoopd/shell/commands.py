"""Commands of the operator: checked and queued for the next tick, with a ticket that tells what became of each.

Rules of this file: `disarm` and `stop` are always taken and cannot be crowded out; everything else only from who is
trusted, finite, in its range and while there is room. A refusal is one line that says what would be right. Nothing here
decides whether the device may run: that is the tick's, and its notes settle the tickets.

`offer` is called from the threads of the transports, `take` and `settle` from the loop's. What they share are single
operations of a deque or a dict, so that no lock can hold the loop. A file that a command names is read and checked by a
thread of its own, one at a time, so that neither loop nor transport waits for it.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec

from hoopd.core.modes import ENERGISED
from hoopd.core.operator import FOLLOWED, SPEED
from hoopd.core.records import Command, TickRecord
from hoopd.core.succession import ACCEPT, LOADED, NAMES as CHANGES, REVERT
from hoopd.core.tick import Note
from hoopd.files.reading import InputError
from hoopd.shell.helpers import start_helper

ALWAYS = ("disarm", "stop")  # first, and from everybody
NAMES = (*ALWAYS, "arm", "clear", "reference", SPEED, "tune", *CHANGES)
WAITING = 16  # commands that one tick may bring: more than a hand can send in 20 ms
TAKEN = 64  # tickets that may wait for their note; older ones are answered as unsettled
PAYLOAD_BYTES = 1000
# From a command to the note of what became of it: an arm waits 0.2 s for the board at most, the rest one tick.
SETTLE_S = 1.0
# A file is read and checked, a model made ready in a process of its own (some seconds, 20 at most), then
# watched for two seconds.
LOAD_S = 24.0
# Who asked for these stands in the log each time.
LOGGED = (*LOADED, ACCEPT, REVERT)
UNSETTLED = "the loop did not tell what became of it"
# What is wrong with `telemetry.commands: true` alone, as it stood in configurations of before.
NO_CONTROL = (
    "needs telemetry.control with an endpoint and users or certificates (docs/reference/telemetry.md); take the key "
    "away if commands come from this machine only: `hoopd arm` goes through the command socket and needs none"
)
REFUSED = "command_refused"
# Notes of the tick that settle commands, and of which command each speaks when it does not say so itself.
SETTLING: Mapping[str, str] = MappingProxyType(
    {"operator": "", "controller": "", REFUSED: "", "reference": "reference", SPEED: SPEED, "tuned": "tune"}
)
ONE_NOTE_EACH = frozenset({"reference", SPEED, "tune", *CHANGES})  # of the others one note settles all that were sent

Range = tuple[float, float]
# Key of a file, and who asked -> what the command brings; InputError says why there is none.
Load = Callable[[str, str], str]


class Ranges(NamedTuple):
    """What values a command may bring; tune by key."""

    reference: Range = (-1.5, 1.5)  # rad, of the ball: it leaves the track near a quarter turn
    tune: Mapping[str, Range] = MappingProxyType({})
    speed: Range = (-40.0, 40.0)  # rad/s, of the hoop: the law's own limit, which the tick holds, is no wider


class RefusedError(Exception):
    """A command that was not taken, with the reason in one line."""


class Payload(msgspec.Struct, forbid_unknown_fields=True):
    """What a command may bring."""

    value: float | None = None
    key: str = ""


class CommandOutcome(NamedTuple):
    """What the loop made of a command, and how it stood after that tick."""

    refused: str  # why; empty when it was obeyed
    t: float  # s, run time
    mode: str
    reference: float  # rad


@dataclass
class Ticket:
    """A command on its way; the loop sets the outcome once it is known."""

    command: Command
    outcome: CommandOutcome | None = None
    patience_s: float = SETTLE_S  # how long its sender waits for the outcome

    def answer(self) -> dict[str, Any]:
        """What its sender is told, in fields of JSON; RefusedError with the loop's own reason."""
        if self.outcome is None:
            raise RefusedError(UNSETTLED)
        if self.outcome.refused:
            raise RefusedError(self.outcome.refused)
        name, value, key, _ = self.command
        _, t, mode, reference = self.outcome
        return {"ok": True, "command": name, "value": value, "key": key, "t": t, "mode": mode, "reference": reference}


class Gate:
    """Where commands wait for the tick."""

    def __init__(self, ranges: Ranges, load: Load | None = None) -> None:
        """`load`: reads the file that a command names; None where none is read."""
        self._ranges, self._load = ranges, load
        self._loading: Ticket | None = None  # the last one that named a file
        self._loading_until = 0.0
        self._waiting: deque[Ticket] = deque()
        self._always: dict[str, Ticket] = {}  # one that waits is enough: others share its ticket
        self._taken: deque[Ticket] = deque(maxlen=TAKEN)  # by the loop, not settled yet
        self.accepted = self.refused = 0

    def offer(self, name: str, payload: bytes = b"", *, untrusted: str = "", by: str = "") -> Ticket:
        """The ticket of a command that the next tick takes, of one that names a file the next one after it was read;
        RefusedError with the reason.

        Parameters
        ----------
        name, payload : command, and a number or an object with value and key as JSON
        untrusted : empty, or why the sender may not send what is not always taken
        by : who asked, for the record of what was loaded
        """
        try:
            ticket = self._checked(name, payload, untrusted, by)
        except RefusedError:
            self.refused += 1
            raise
        self.accepted += 1
        return ticket

    def take(self) -> tuple[Command, ...]:
        """All that wait, in order, `disarm` and `stop` last."""
        if not self._waiting and not self._always:
            return ()
        # Looked for first: an arm that was offered before one of these comes in its tick, which revokes it, or in an
        # earlier one, but never in a later one, where it would energise.
        safe = [self._always.pop(name) for name in list(self._always)]
        tickets = [self._waiting.popleft() for _ in range(len(self._waiting))] + safe
        self._taken += tickets
        return tuple(ticket.command for ticket in tickets)

    def settle(self, note: Note, record: TickRecord) -> None:
        """What a note of the tick says of the commands that were taken."""
        if not self._taken or note.name not in SETTLING:
            return
        name = note.fields.get("command") or SETTLING[note.name]
        concerned = [ticket for ticket in self._taken if ticket.command.name == name]
        refused = str(note.fields.get("reason", "")) if note.name == REFUSED else ""
        if name in ONE_NOTE_EACH:
            concerned = concerned[:1]
        elif refused.startswith(FOLLOWED):
            concerned = self._before(name, refused.removeprefix(FOLLOWED))
        for ticket in concerned:
            if name == "arm" and not refused and record.mode not in ENERGISED:
                refused = f"obeyed, and at once {record.mode}"  # a cut in the same tick
            ticket.outcome = CommandOutcome(refused, record.t, record.mode, record.reference)
            self._taken.remove(ticket)

    def _before(self, name: str, follower: str) -> list[Ticket]:
        """Tickets of a name up to the first of its follower: the note knows nothing of what came after that."""
        names = [ticket.command.name for ticket in self._taken]
        end = names.index(follower) if follower in names else len(names)
        return [ticket for ticket in list(self._taken)[:end] if ticket.command.name == name]

    def _checked(self, name: str, payload: bytes, untrusted: str, by: str) -> Ticket:
        if name in ALWAYS:
            return self._always.setdefault(name, Ticket(Command(name)))
        if name not in NAMES:
            raise RefusedError(f"unknown command {name[:40]!r}; known: {', '.join(NAMES)}")
        if untrusted:
            raise RefusedError(untrusted)
        if len(self._waiting) >= WAITING:
            raise RefusedError(f"busy: {WAITING} commands are waiting for the next tick")
        content = _parsed(payload)
        if name in LOADED:
            return self._begin_load(name, content.key, by)
        ticket = Ticket(_command(name, content, self._ranges))
        self._waiting.append(ticket)
        return ticket

    def _begin_load(self, name: str, key: str, by: str) -> Ticket:
        """A ticket whose command waits for the tick once its file was read."""
        if self._load is None:
            raise RefusedError(f"{name}: this daemon loads none")
        now = time.monotonic()
        if self._loading is not None and self._loading.outcome is None and now < self._loading_until:
            raise RefusedError(f"busy: {self._loading.command.key[:40]} is being loaded")
        ticket = Ticket(Command(name, 0.0, key), patience_s=LOAD_S)
        self._loading, self._loading_until = ticket, now + LOAD_S
        start_helper("loading", partial(self._finish_load, self._load, ticket, by))
        return ticket

    def _finish_load(self, load: Load, ticket: Ticket, by: str) -> None:
        """In a thread of its own: read, and let the tick decide; or tell why not."""
        command, refused = ticket.command, ""
        try:
            ticket.command = command._replace(text=load(command.key, by))
        except InputError as error:
            refused = str(error)
        except Exception as error:  # whoever waits for an answer gets one
            refused = f"{type(error).__name__}: {error}"
        if refused:
            self.refused += 1
            ticket.outcome = CommandOutcome(refused, math.nan, "", math.nan)
        else:
            self._waiting.append(ticket)


def _parsed(payload: bytes) -> Payload:
    """A number, or an object with value and key."""
    if len(payload) > PAYLOAD_BYTES:
        raise RefusedError(f"more than {PAYLOAD_BYTES} bytes")
    try:
        content: float | Payload = msgspec.json.decode(payload or b"{}", type=float | Payload)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        raise RefusedError('expected a number or {"value": number, "key": text} as JSON') from None
    return content if isinstance(content, Payload) else Payload(content)


def _command(name: str, content: Payload, ranges: Ranges) -> Command:
    if name == "reference":
        return Command(name, _inside(name, content.value, ranges.reference))
    if name == SPEED:
        return Command(name, _inside(name, content.value, ranges.speed))
    if name != "tune":
        return Command(name)
    table = ranges.tune
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
