"""Commands of the operator: checked and queued for the next tick, with a ticket that tells what became of each.

Rules of this file: `disarm` and `stop` are always taken and cannot be crowded out; everything else only from who is
trusted, finite, in its range and while there is room. A refusal is one line that says what would be right. Nothing here
decides whether the device may run: that is the tick's, and its notes settle the tickets.

`offer` is called from the threads of the transports, `take` and `settle` from the loop's. What they share are single
operations of a deque or a dict, so that no lock can hold the loop.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec

from hoopd.core.modes import ENERGISED
from hoopd.core.operator import FOLLOWED
from hoopd.core.records import Command, TickRecord
from hoopd.core.tick import Note

ALWAYS = ("disarm", "stop")  # first, and from everybody
NAMES = (*ALWAYS, "arm", "clear", "reference", "tune", "experiment")
WAITING = 16  # commands that one tick may bring: more than a hand can send in 20 ms
TAKEN = 64  # tickets that may wait for their note; older ones are answered as unsettled
PAYLOAD_BYTES = 1000
# From a command to the note of what became of it: an arm waits 0.2 s for the board at most, the rest one tick.
SETTLE_S = 1.0
UNSETTLED = "the loop did not tell what became of it"
# What is wrong with `telemetry.commands: true` alone, as it stood in configurations of before.
NO_CONTROL = (
    "needs telemetry.control with an endpoint and users or certificates (docs/reference/telemetry.md); take the key "
    "away if commands come from this machine only: `hoopd arm` goes through the command socket and needs none"
)
REFUSED = "command_refused"
# Notes of the tick that settle commands, and of which command each speaks when it does not say so itself.
SETTLING: Mapping[str, str] = MappingProxyType({"operator": "", REFUSED: "", "reference": "reference", "tuned": "tune"})
ONE_NOTE_EACH = frozenset({"reference", "tune"})  # of the others one note settles all that were sent

Range = tuple[float, float]


class Ranges(NamedTuple):
    """What values a command may bring; tune and experiment by key."""

    reference: Range = (-1.5, 1.5)  # rad, of the ball: it leaves the track near a quarter turn
    tune: Mapping[str, Range] = MappingProxyType({})
    experiment: Mapping[str, Range] = MappingProxyType({})


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

    def answer(self) -> dict[str, Any]:
        """What its sender is told, in fields of JSON; RefusedError with the loop's own reason."""
        if self.outcome is None:
            raise RefusedError(UNSETTLED)
        if self.outcome.refused:
            raise RefusedError(self.outcome.refused)
        name, value, key = self.command
        _, t, mode, reference = self.outcome
        return {"ok": True, "command": name, "value": value, "key": key, "t": t, "mode": mode, "reference": reference}


class Gate:
    """Where commands wait for the tick."""

    def __init__(self, ranges: Ranges) -> None:
        self._ranges = ranges
        self._waiting: deque[Ticket] = deque()
        self._always: dict[str, Ticket] = {}  # one that waits is enough: others share its ticket
        self._taken: deque[Ticket] = deque(maxlen=TAKEN)  # by the loop, not settled yet
        self.accepted = self.refused = 0

    def offer(self, name: str, payload: bytes = b"", *, untrusted: str = "") -> Ticket:
        """The ticket of a command that the next tick takes; RefusedError with the reason.

        Parameters
        ----------
        name, payload : command, and a number or an object with value and key as JSON
        untrusted : empty, or why the sender may not send what is not always taken
        """
        try:
            ticket = self._checked(name, payload, untrusted)
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

    def _checked(self, name: str, payload: bytes, untrusted: str) -> Ticket:
        if name in ALWAYS:
            return self._always.setdefault(name, Ticket(Command(name)))
        if name not in NAMES:
            raise RefusedError(f"unknown command {name[:40]!r}; known: {', '.join(NAMES)}")
        if untrusted:
            raise RefusedError(untrusted)
        if len(self._waiting) >= WAITING:
            raise RefusedError(f"busy: {WAITING} commands are waiting for the next tick")
        ticket = Ticket(_command(name, _parsed(payload), self._ranges))
        self._waiting.append(ticket)
        return ticket


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
