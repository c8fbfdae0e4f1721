"""Recorder and telemetry as the loop sees them.

Rules of this file: adapts, decides nothing; every call returns at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.shell.recorder import Recorder

if TYPE_CHECKING:
    from hoopd.shell.telemetry import Telemetry

# Rows between two status messages: a second.
STATUS_EVERY = 50


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

    def commands(self, t: float) -> tuple[Command, ...]:
        """What operators asked for since the last tick."""
        return self.telemetry.take_commands()
