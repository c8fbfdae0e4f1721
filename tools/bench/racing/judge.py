"""Who judges a race: the board's own log of torque, the recorded modes, and what was sent.

Rules of this file: nothing of the tick's own code is asked; what a command may lead to is written down here and in
`tools/harness/referee.py` once more. Times are run time in s.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import inf, nan
from typing import NamedTuple

from harness.referee import REVOKING, Referee
from harness.runs import Run

STOPPING_S = 1.0
WIRE_S = 0.005  # a request on the wire, and the board's slew limit from full torque to none
DEAF_S = 0.105  # a board that hears nothing goes on for so long
EVENTS_S = 0.2  # an arm may wait so long


class Wrong(NamedTuple):
    """Where the rule is broken; a time that is not a number concerns the whole run."""

    t: float
    text: str


class Taken(NamedTuple):
    """Commands of one tick, and when the board heard what the tick made of them."""

    t: float
    heard: float
    names: tuple[str, ...]


class Window(NamedTuple):
    """One race: how it began, when, until when something was sent, and until when it was watched."""

    begins: str
    begin: float
    end: float
    until: float
    sent: Counter[str]


class Outcome(NamedTuple):
    """One race, judged."""

    seed: int
    begins: str
    mode: str  # in which it really began
    sent: Counter[str]
    obeyed: int  # arms that energised
    revoked: int  # arms that were taken back
    faults: int  # that began within it
    left_on: bool  # when the next race is prepared
    wrong: tuple[str, ...]


def taken(found: Run) -> list[Taken]:
    """Every tick that took a command; how long a tick lasted is told by the next one."""
    executions = [*(inputs.execution_s for inputs in found.inputs[1:]), 0.0]
    return [
        Taken(inputs.t, inputs.t + execution_s, tuple(command.name for command in inputs.commands))
        for inputs, execution_s in zip(found.inputs, executions, strict=True)
        if inputs.commands
    ]


def modes_wrong(found: Run) -> list[Wrong]:
    """Where the recorded modes break the rule."""
    referee, wrong = Referee(), []
    for inputs, tick in zip(found.inputs, found.ticks, strict=False):
        referee.look([command.name for command in inputs.commands], tick.mode, tick.u)
        wrong += [Wrong(tick.t, text) for text in referee.wrong]
        referee.wrong.clear()
    return wrong


def torque_wrong(
    found: Run,
    rows: Sequence[Taken],
    deaf: Sequence[tuple[float, float]] = (),
    *,
    zero: float = 0.0,
    margin_s: float = WIRE_S,
) -> list[Wrong]:
    """Where the board had torque or its drive on after a command that switches off, before anybody armed again.

    `deaf`: from when to when the board hears nothing; `zero`: run time zero on the board's clock; `margin_s`: how late
    the board may be.
    """
    wrong = []
    ends = [*(row.t for row in rows[1:]), found.torque.rows[-1].t - zero]
    off_from = inf  # the board must be off
    for row, end in zip(rows, ends, strict=True):
        if any(name in REVOKING for name in row.names):
            off_from = min(off_from, row.heard + margin_s + (0.0 if "disarm" in row.names else STOPPING_S + 0.04))
        elif "arm" in row.names:
            off_from = inf
        start = max([off_from, *(_heard(off_from, a, b) for a, b in deaf)])
        if start < end and _is_on(found, zero + start, zero + end - 1e-6):
            wrong.append(Wrong(max(start, row.t), "the board is on, and nobody armed it"))
            off_from = inf  # told once
    return wrong


def _heard(t: float, start: float, stop: float) -> float:
    """When the board has heard of a request, or has given up, at the latest."""
    return min(stop + 0.025, start + DEAF_S) if start - 0.03 <= t <= stop else t


def _is_on(found: Run, start: float, end: float) -> bool:
    log = found.torque
    enabled = log.enabled_at(start) or any(row.enabled for row in log.rows if start <= row.t < end)
    return enabled or log.max_abs(start, end) > 0.0


def armed_by_nobody(armed_t: Sequence[float], rows: Sequence[Taken], slack_s: float = 0.0) -> list[Wrong]:
    """Arms that the tick was given before so many were sent: one, the automatic, before all that switches off.

    `armed_t`: when arms were sent; `slack_s`: by how much that may be wrong, either way.
    """
    wrong, got, automatic, revoked = [], 0, 0, False
    for row in rows:
        revoked = revoked or any(name in REVOKING for name in row.names)
        got += row.names.count("arm")
        if not revoked and not automatic and got > sum(t + slack_s <= row.t for t in armed_t):
            automatic = 1
        if got > sum(t - slack_s <= row.t for t in armed_t) + automatic:
            wrong.append(Wrong(row.t, "an arm that nobody sent"))
            automatic += 1
    return wrong


def whole(found: Run, replays: bool) -> list[Wrong]:
    """What concerns the whole run."""
    wrong = [] if found.torque.rows[-1].torque_nm == 0.0 else [Wrong(nan, "torque at the end")]
    return wrong if replays else [*wrong, Wrong(nan, "the recording does not replay")]


def outcomes(seed: int, windows: Sequence[Window], found: Run, wrong: Sequence[Wrong]) -> list[Outcome]:
    """What each race came to; what is wrong in a preparation counts for its race, in the whole run for the last."""
    ends = [window.until for window in windows[:-1]] + [inf]
    begins = [-inf, *ends[:-1]]
    shares = [
        [w for w in wrong if a <= w.t < b or (w.t != w.t and b == inf)] for a, b in zip(begins, ends, strict=True)
    ]
    return [_outcome(seed, window, found, share) for window, share in zip(windows, shares, strict=True)]


def _outcome(seed: int, window: Window, found: Run, wrong: Sequence[Wrong]) -> Outcome:
    modes = [tick.mode for tick in found.ticks if window.begin - 0.03 <= tick.t < window.until]
    events = [event for event in found.events if window.begin <= event.t < window.end + EVENTS_S]
    told = [(event.event, event.fields.get("command"), str(event.fields.get("reason", ""))) for event in events]
    return Outcome(
        seed,
        window.begins,
        modes[0] if modes else "",
        window.sent,
        sum(name == "operator" and command == "arm" for name, command, _ in told),
        sum(command == "arm" and reason.startswith("revoked") for _, command, reason in told),
        sum(event.event == "fault" for event in events),
        bool(modes) and modes[-1] in ("READY", "RUNNING"),
        tuple(f"{w.t:.2f} s: {w.text}" for w in wrong),
    )
