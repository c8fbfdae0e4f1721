"""What a kind of fault is: how it is made, what the rule says, which message must name it.

Rules of this file: times of a kind count from its fault; `deadline_s` is the rule's, from the moment that `since` names
to its action, and a controlled stop is part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from harness.realrun import Daemon

AT_S: Final = 4.0  # run time at which the fault of a first trial begins
BOARD_TIMEOUT_S: Final = 0.1
STOPPING_S: Final = 1.0  # a controlled stop may take this long
CAMERA_S: Final = 0.06  # a picture is two to three periods old when it is judged
CUT_S: Final = 0.04  # one tick until the answer is there, one until it is judged
LOOK_S: Final = 0.005  # the board's own cut (docs/reference/board.md)

# "bounded": torque may flow, but the board keeps the hoop below its limit and ends it with the fault. "untold": a lie
# that nothing can tell from the truth; it is shown what came of it, and passes.
Outcome = Literal["goes on", "pause", "stop", "cut", "bounded", "untold"]
# The moment from which a deadline counts: the fault's beginning, the first report of hoop or ball that is 5 sigma from
# the truth, or the hoop's true speed beyond the board's limit.
Since = Literal["fault", "hoop departs", "ball departs", "overspeed"]

Row = Mapping[str, Any]
NOTHING_TO_SAY: Final = ("",)  # causes of a kind that no message need name


def reference(at_s: float, value: float) -> Row:
    """A command of the operator at a run time."""
    return {"at_s": at_s, "name": "reference", "value": value}


# The motor works and the hoop turns, faster every second.
KEEP_BUSY: Final = (reference(2.8, 0.1),)
# The hoop turns to and fro and carries the ball along: what a lie about either is measured against.
STEPS: Final = tuple(reference(3.0 + 2.0 * k, 0.15 * (-1) ** k) for k in range(9))


@dataclass(frozen=True)
class Kind:
    """One kind of fault."""

    outcome: Outcome
    deadline_s: float
    causes: tuple[str, ...]  # any of these in the log or the recording, in the summary of the line, or none needed
    script: Row | None = None  # of `sim.faults`
    commands: tuple[Row, ...] = ()  # of the operator; the first one's time is the fault's
    act: Callable[[Daemon], float] | None = None  # does it in real time, tells when
    since: Since = "fault"
    exit_code: int = 0
    pictures: bool = False  # without pictures there is nothing to see or to kill
    sim: Row = field(default_factory=dict)  # keys of the rig's section
    busy: tuple[Row, ...] = KEEP_BUSY  # the operator's references, in run time
    observe_s: float = 3.0  # after the fault

    @property
    def realtime_only(self) -> bool:
        """A script cannot make it."""
        return self.act is not None

    def rig(self, at_s: float) -> dict[str, Any]:
        """Keys of the rig's section with the fault at this run time."""
        faults = [{**self.script, "at_s": at_s}] if self.script else []
        commands = [*self.busy, *({**row, "at_s": at_s + row["at_s"]} for row in self.commands)]
        return {"faults": faults, "commands": [dict(row) for row in commands], **self.sim}


def scripted(kind: str, for_s: float = 1.0, **params: Any) -> Row:
    """A row of `sim.faults`; a duration of zero means for good."""
    return {"kind": kind, "for_s": for_s, "params": params}


def operator(*names: str, later_s: float = 0.0) -> tuple[Row, ...]:
    """Rows of `sim.commands`, all in one tick."""
    return tuple({"at_s": later_s, "name": name} for name in names)
