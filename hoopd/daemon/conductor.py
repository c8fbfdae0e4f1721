"""Who watches an experiment: from the first tick to the last, with an eye on the terminal.

Rules of this file: it only ever asks the loop to stop; nothing here makes torque, and nothing here may wait.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import inf, isfinite

from hoopd.core.modes import ENERGISED, REVOKING, Mode
from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.daemon.operator_abort import ABORTED, heard_from_terminal
from hoopd.shell.loop import Loop

# From the start, or from the operator's arm, until the ball is seen and the drive is on; measured: 1.1 s on the rig.
START_PATIENCE_S = 20.0


class Conductor:
    """Watches a run from its first tick to its last and ends it when the experiment is over."""

    trouble = False
    loads: Sequence[str] = ()

    def __init__(self, seconds: float, *, armed: bool) -> None:
        """`seconds` of signal; `armed`: the run arms by itself, so that its patience counts from the start."""
        self.seconds = seconds
        self.outcome = ""  # why it ended
        self.started_t = self.ended_t = float("nan")  # s, first tick of the signal and first one after it
        self._patience_from = 0.0 if armed else inf
        self._armed = armed
        self._mode = Mode.DISARMED
        self._loop: Loop | None = None
        self._asked = False  # the loop was told to end
        self._record: TickRecord | None = None
        self._causes: tuple[str, ...] = ()
        self._refused = False  # it went off before the signal began

    @contextmanager
    def attend(self, loop: Loop) -> Iterator[None]:
        """Listen to the terminal while the loop runs; Ctrl-C and the abort keys switch the drive off at once."""
        self._loop = loop
        with heard_from_terminal(self.abort):
            yield

    def abort(self) -> None:
        """Off at once, then an orderly end."""
        self._end(ABORTED)
        if self._loop is not None:
            self._loop.request_stop()  # asked again it disarms at once

    def commands(self, t: float) -> tuple[Command, ...]:
        """None: the signal is the law itself."""
        return ()

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """Look at one tick; what the last one led to is judged first, now that its notes are known."""
        self._judge(record.t)
        self._record, before, self._mode = record, self._mode, Mode(record.mode)
        if self._mode is Mode.RUNNING and not isfinite(self.started_t):
            self.started_t = record.t
        if before is Mode.RUNNING and self._mode is not Mode.RUNNING:
            self.ended_t = record.t
        if before not in ENERGISED and self._mode in ENERGISED:
            self._patience_from = min(self._patience_from, record.t)
        self._refused = before in ENERGISED and self._mode not in ENERGISED

    def note(self, t: float, note: Note) -> None:
        """Remember why it ended."""
        if note.name == "law_ended":
            self.outcome = self.outcome or note.fields["reason"]
        elif note.name == "operator" and note.fields["command"] in REVOKING:
            self._refused = self._refused or self._armed  # it does not arm by itself any more
        elif note.name == "mode":
            self._causes = tuple(note.fields["because"]) or self._causes

    def status(self) -> str:
        """How far it is, and the way out."""
        record = self._record
        if record is None:
            return "waiting for the first tick"
        played = record.t - self.started_t if isfinite(self.started_t) else 0.0
        return (
            f"{played:5.1f} of {self.seconds:.1f} s {record.mode:8} psi {record.x_hat[2]:+.3f} rad"
            f"  hoop {record.x_hat[1]:+6.2f} rad/s  u {record.u:+.3f} N m   q: stop"
        )

    def _judge(self, t: float) -> None:
        if isfinite(self.started_t):
            if self._mode not in (Mode.RUNNING, Mode.STOPPING):
                self._end(f"stopped: {', '.join(self._causes) or 'by the operator'}")
        elif self._refused:  # nothing arms it again
            self._end(f"not started: {', '.join(self._causes) or 'disarmed by the operator'}")
        elif t - self._patience_from > START_PATIENCE_S:
            self._end(f"not started: {self._missing()}")

    def _missing(self) -> str:
        """What it waited for in vain."""
        tick = None if self._loop is None else self._loop.tick
        found = () if tick is None else (*tick.faults, *tick.health.arming_hindrances())
        return ", ".join(dict.fromkeys(found)) or "the drive did not go on"

    def _end(self, outcome: str) -> None:
        self.outcome = self.outcome or outcome
        if self._loop is not None and not self._asked:
            self._asked = True
            self._loop.request_stop()
