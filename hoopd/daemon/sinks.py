"""Recorder, telemetry and the gate of commands as the loop sees them.

Rules of this file: adapts, decides nothing; every call returns at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.shell.commands import Gate
from hoopd.shell.commandserver import StatusTicket
from hoopd.shell.recorder import Recorder

if TYPE_CHECKING:
    from hoopd.shell.telemetry import Telemetry

# Rows between two status messages: a second.
STATUS_EVERY = 50
STATUS_WAITING = 16  # questions after the status that one tick answers


class RecorderSink:
    """The recorder as the loop sees it."""

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder

    @property
    def trouble(self) -> bool:
        """Rows were lost or cannot be written."""
        return self.recorder.trouble

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """Record one tick."""
        self.recorder.put(record, inputs)

    def note(self, t: float, note: Note) -> None:
        """Record one fact."""
        self.recorder.event(t, note.name, note.level, **note.fields)


class TelemetrySink:
    """Telemetry as the loop sees it."""

    def __init__(self, telemetry: Telemetry, status: Callable[[], dict[str, Any]]) -> None:
        self.telemetry, self._status, self._rows = telemetry, status, 0

    @property
    def trouble(self) -> bool:
        """Rows were dropped."""
        return self.telemetry.trouble

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """Publish one tick, and now and then what the status message tells beside it."""
        self.telemetry.put(record)
        self._rows += 1
        if self._rows % STATUS_EVERY == 0:
            self.telemetry.set_status(self._status())

    def note(self, t: float, note: Note) -> None:
        """Publish one fact."""
        self.telemetry.event(t, note.name, note.level, **note.fields)


class CommandSink:
    """The gate of commands as the loop sees it: gives the tick what was asked for, tells who asked what came of it."""

    trouble = False

    def __init__(self, gate: Gate, session: str, status: Callable[[], dict[str, Any]]) -> None:
        """`session`: tells this run from every other."""
        self.gate, self.session, self._status = gate, session, status
        self._asked: deque[StatusTicket] = deque(maxlen=STATUS_WAITING)
        self._record: TickRecord | None = None

    def ask(self, ticket: StatusTicket) -> None:
        """Fill the ticket in the next tick; from any thread."""
        self._asked.append(ticket)

    def commands(self, t: float) -> tuple[Command, ...]:
        """What operators asked for since the last tick."""
        return self.gate.take()

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """Look at one tick, and tell how it stands to who asked."""
        self._record = record
        if self._asked:
            fields = self._status()
            while self._asked:
                self._asked.popleft().fields = fields

    def note(self, t: float, note: Note) -> None:
        """Settle the commands that a fact speaks of."""
        if self._record is not None:
            self.gate.settle(note, self._record)
