"""Who asks for maneuvers, one after another: waits until the ball rests, asks, watches it settle, asks again.

    resting -> asked -> (played or given up) -> settling -> resting ... -> the end of the run

Rules of this file: it asks through the tick's own commands and for the end of the run; it makes no torque, and nothing
here may wait.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import inf, isfinite, nan, tau

from hoopd.core.modes import ENERGISED, REVOKING, Mode
from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.succession import EXPERIMENT
from hoopd.core.tick import Note
from hoopd.core.tracker import Tolerances
from hoopd.daemon.operator_abort import ABORTED, heard_from_terminal
from hoopd.shell.loop import Loop

# From the start of a run that arms by itself, from the operator's arm, or from the last maneuver, until the ball rests.
REST_PATIENCE_S = 25.0
# It has to rest for so long, so that the filter knows it, and settles for so long before the next one is asked for.
REST_S, SETTLE_S = 0.5, 3.0
# Well inside of what a plan begins with.
RESTING = Tolerances(dtheta_rad_s=0.8, psi_rad=0.05, dpsi_rad_s=0.35)


class ManeuverConductor:
    """Asks for `repeat` maneuvers in one run, and ends it after the last one or at the first that cannot go on."""

    trouble = False
    loads: Sequence[str] = ()  # no file: its command brings the text

    def __init__(self, text: str, repeat: int, *, armed: bool) -> None:
        """`text`: of the command that loads the maneuver; `armed`: the run arms by itself."""
        self.outcome = ""  # why the run ended; empty: all were played
        self.played = 0
        self._text, self._repeat = text, repeat
        self._asked_t = self._resting_since = self._settling_since = nan
        self._patience_from = 0.0 if armed else inf
        self._mode = Mode.DISARMED
        self._was_running = False
        self._loop: Loop | None = None
        self._record: TickRecord | None = None
        self._done = False

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
        """The maneuver, once the ball has rested long enough."""
        waits = isfinite(self._asked_t) or isfinite(self._settling_since) or self._done
        if waits or not (self._mode is Mode.RUNNING and t - self._resting_since >= REST_S):
            return ()
        self._asked_t = t
        return (Command(EXPERIMENT, text=self._text),)

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """Look at one tick."""
        self._record, self._mode = record, Mode(record.mode)
        if self._mode in ENERGISED:
            self._patience_from = min(self._patience_from, record.t)
        self._was_running = self._was_running or self._mode is Mode.RUNNING
        if self._was_running and self._mode not in ENERGISED and not self._done:
            self._end("stopped: the drive is off")
        if not _rests(record):
            self._resting_since = nan
        elif not isfinite(self._resting_since):
            self._resting_since = record.t
        self._go_on(record.t)

    def note(self, t: float, note: Note) -> None:
        """What became of what was asked for, and why it ended."""
        if note.name == "experiment_ended":
            self.played += 1
            self._asked_t, self._settling_since = nan, t
        elif note.name == "command_refused" and note.fields["command"] == EXPERIMENT:
            self._end(f"refused: {note.fields['reason']}")
        elif self._done:
            return  # the end of the run switches the drive off, and is no news
        elif note.name == "mode" and note.fields["because"]:
            self.outcome = self.outcome or f"stopped: {', '.join(note.fields['because'])}"
        elif note.name == "operator" and note.fields["command"] in REVOKING:
            self.outcome = self.outcome or "stopped: by the operator"

    def status(self) -> str:
        """How far it is, and the way out."""
        record = self._record
        if record is None:
            return "waiting for the first tick"
        doing = "playing" if isfinite(self._asked_t) else "settling" if isfinite(self._settling_since) else "resting"
        return (
            f"{doing:8} {self.played} of {self._repeat} {record.mode:8} psi {record.x_hat[2]:+.3f} rad"
            f"  hoop {record.x_hat[1]:+6.2f} rad/s  u {record.u:+.3f} N m   q: stop"
        )

    def _go_on(self, t: float) -> None:
        if isfinite(self._settling_since):
            if t - self._settling_since >= SETTLE_S:
                self._settling_since, self._patience_from = nan, t
                if self.played >= self._repeat:
                    self._end("")
        elif not isfinite(self._asked_t) and t - self._patience_from > REST_PATIENCE_S:
            self._end(f"the ball did not come to rest within {REST_PATIENCE_S:g} s")

    def _end(self, outcome: str) -> None:
        self.outcome = self.outcome or outcome
        if self._loop is not None and not self._done:
            self._done = True
            self._loop.request_stop()


def _rests(record: TickRecord) -> bool:
    _, dtheta, psi, dpsi = record.x_hat
    off = (dtheta, psi - tau * round(psi / tau) if isfinite(psi) else nan, dpsi)
    bounds = (RESTING.dtheta_rad_s, RESTING.psi_rad, RESTING.dpsi_rad_s)
    return all(abs(value) <= bound for value, bound in zip(off, bounds, strict=True))
