"""Modes of operation: which there are and what moves between them.

Rules of this file: transitions are the table, code only reads it; a pair that is not in the table changes
nothing; torque may flow in the modes of `ENERGISED` only, and no entry leads into one of those but from an arm.
Disarm and stop have a row in every mode, also where they change nothing, so that no weaker event is taken beside them.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum


class Mode(StrEnum):
    """What the daemon is doing."""

    DISARMED = "DISARMED"  # asks the board for answers only: torque zero, drive off
    READY = "READY"  # drive on, torque zero, waits for the ball and the board
    RUNNING = "RUNNING"  # the controller acts
    STOPPING = "STOPPING"  # brakes the hoop, then switches off
    FAULT = "FAULT"  # torque zero, drive off, until the operator acknowledges


class Event(StrEnum):
    """What may move the mode."""

    ARM = "arm"  # operator, and nothing forbids it
    DISARM = "disarm"  # operator: off at once
    CLEAR = "clear"  # operator acknowledges, and nothing is wrong any more
    GO = "go"  # board enabled, state known, ball seen
    PAUSE = "pause"  # a fault of action PAUSE
    STOP = "stop"  # operator, the end of the run or a fault of action STOP
    STOPPED = "stopped"  # hoop at rest or the time for it over
    CUT = "cut"  # a fault of action CUT


TRANSITIONS: dict[tuple[Mode, Event], Mode] = {
    (Mode.DISARMED, Event.ARM): Mode.READY,
    (Mode.DISARMED, Event.DISARM): Mode.DISARMED,
    (Mode.DISARMED, Event.STOP): Mode.DISARMED,
    (Mode.READY, Event.GO): Mode.RUNNING,
    (Mode.READY, Event.STOP): Mode.DISARMED,
    (Mode.READY, Event.DISARM): Mode.DISARMED,
    (Mode.READY, Event.CUT): Mode.FAULT,
    (Mode.RUNNING, Event.PAUSE): Mode.READY,
    (Mode.RUNNING, Event.STOP): Mode.STOPPING,
    (Mode.RUNNING, Event.DISARM): Mode.DISARMED,
    (Mode.RUNNING, Event.CUT): Mode.FAULT,
    (Mode.STOPPING, Event.STOPPED): Mode.DISARMED,
    (Mode.STOPPING, Event.STOP): Mode.STOPPING,
    (Mode.STOPPING, Event.DISARM): Mode.DISARMED,
    (Mode.STOPPING, Event.CUT): Mode.FAULT,
    (Mode.FAULT, Event.DISARM): Mode.FAULT,
    (Mode.FAULT, Event.STOP): Mode.FAULT,
    (Mode.FAULT, Event.CLEAR): Mode.DISARMED,
    (Mode.FAULT, Event.ARM): Mode.READY,
}

ENERGISED = frozenset({Mode.READY, Mode.RUNNING, Mode.STOPPING})

# Operators' commands that switch off: each is its event, and takes back every arm and clear that waits or comes in the
# same tick, whatever the order. After a shutdown (SIGTERM, the end of a run) no arm is taken any more.
REVOKING: dict[str, Event] = {"disarm": Event.DISARM, "stop": Event.STOP, "shutdown": Event.STOP}

# Strongest first: when several events come in one tick, the first that the table knows is taken. A stop that is over is
# over, however often somebody asks for it again.
PRECEDENCE = (
    Event.CUT,
    Event.DISARM,
    Event.STOPPED,
    Event.STOP,
    Event.PAUSE,
    Event.CLEAR,
    Event.ARM,
    Event.GO,
)


def next_mode(mode: Mode, events: frozenset[Event]) -> Mode:
    """Mode after one tick."""
    for event in PRECEDENCE:
        if event in events and (mode, event) in TRANSITIONS:
            return TRANSITIONS[mode, event]
    return mode


def mode_words(mode: str, because: Iterable[str], verb: str = "is") -> str:
    """The mode as a refusal names it, with the faults behind it: nobody has to look for them elsewhere."""
    faults = ", ".join(because)
    return f"the mode {verb} {mode}" + (f" ({faults})" if faults else "")
