"""What three operators do at once: drawn from a seed, as commands, faults and stalls of one run of several races.

Rules of this file: data only, times in ticks of 20 ms from the run's start; every race begins from a stated mode and is
followed by quiet, in which nothing is sent.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

PERIOD_S = 0.02
OPERATORS = 3
FIRST = 52  # the tick around which a rig arms itself
RACE_AT, RACE_TICKS = 40, 20  # a race after its preparation, and how long commands are sent in it
QUIET = 60  # ticks after it, more than a second: a fault is well again, a stop is over
SIGTERM = "SIGTERM"
ARMS_ITSELF = "about to arm itself"
COMMANDS = ("arm", "arm", "arm", "disarm", "disarm", "stop", "clear", "reference")
# Ticks between two commands of one operator.
STEPS = (0, 0, 0, 0, 1, 1, 1, 2, 3, 5, 9)


class Sent(NamedTuple):
    """One command of one operator."""

    tick: int
    name: str


@dataclass
class Race:
    """One race: how it began, who sent what, what went wrong beside it."""

    begins: str
    slot: int  # tick at which its preparation begins
    tick: int  # at which the first command may come
    sent: list[Sent] = field(default_factory=list)


@dataclass
class Script:
    """One run."""

    races: list[Race] = field(default_factory=list)
    prepared: list[Sent] = field(default_factory=list)  # commands that bring about the stated modes
    faults: list[dict[str, Any]] = field(default_factory=list)
    stalls: dict[int, float] = field(default_factory=dict)  # s by which the host is late for a deadline

    @property
    def sent(self) -> list[Sent]:
        """All commands in the order of their ticks, signals left out."""
        every = [*self.prepared, *(sent for race in self.races for sent in race.sent)]
        return sorted((sent for sent in every if sent.name != SIGTERM), key=lambda sent: sent.tick)

    @property
    def signals(self) -> list[int]:
        """Ticks of SIGTERM."""
        return sorted(sent.tick for race in self.races for sent in race.sent if sent.name == SIGTERM)

    @property
    def ticks(self) -> int:
        """How long it lasts."""
        return self.races[-1].tick + RACE_TICKS + QUIET

    def shift_first(self, ticks: int) -> None:
        """The loop begins so much later than at run time zero, and with it the race that is about its beginning."""
        first = self.races[0]
        if first.begins == ARMS_ITSELF:
            moved = [Sent(sent.tick + ticks, sent.name) for sent in first.sent]
            self.races[0] = Race(first.begins, first.slot, first.tick + ticks, moved)

    def fault(self, kind: str, tick: int, ticks: int, **params: Any) -> None:
        """Something goes wrong for so many ticks."""
        self.faults.append(
            {"kind": kind, "at_s": at_s(tick), "for_s": round(ticks * PERIOD_S, 9), "params": dict(params)}
        )


def at_s(tick: int) -> float:
    """Shortly before the tick, so that it is this one that takes it."""
    return round(tick * PERIOD_S - 0.001, 9)


def _armed(script: Script, start: int) -> None:
    script.prepared += [Sent(start + 10, "arm"), Sent(start + 18, "reference")]


def _ready(script: Script, start: int) -> None:
    script.fault("ball_gone", start, RACE_AT + RACE_TICKS + 10)
    script.prepared.append(Sent(start + 20, "arm"))


def _stopping(script: Script, start: int) -> None:
    _armed(script, start)
    script.prepared.append(Sent(start + RACE_AT - 3, "stop"))


def _fault_over(script: Script, start: int) -> None:
    _armed(script, start)
    script.fault("board_fault", start + 30, 5)


def _fault_lasts(script: Script, start: int) -> None:
    _armed(script, start)
    script.fault("board_fault", start + 30, RACE_AT - 30 + 12)


def _timed_out(script: Script, start: int) -> None:
    script.prepared.append(Sent(start + 10, "arm"))
    script.stalls[start + 20] = 0.13


class Beginning(NamedTuple):
    """What is done before a race, and how many ticks after the slot's start it begins."""

    prepare: Callable[[Script, int], None]
    race_at: int = RACE_AT


# By the mode that they lead to.
BEGINNINGS: dict[str, Beginning] = {
    "DISARMED": Beginning(lambda script, start: None),
    "READY, no ball": Beginning(_ready),
    "RUNNING": Beginning(_armed),
    "STOPPING": Beginning(_stopping),
    "FAULT, latched": Beginning(_fault_over),
    "FAULT, lasts": Beginning(_fault_lasts),
    "FAULT, timed out": Beginning(_timed_out, 20 + 7 + 52),  # a stall forbids arms for a second
}


def _beside(script: Script, tick: int, draw: random.Random) -> None:
    """In every other race something goes wrong in the midst of it."""
    kind = draw.choice(["", "", "", "board_fault", "board_silent", "board_reset", "camera_stall", "ball_gone"])
    if kind:
        script.fault(kind, tick + draw.randrange(8), draw.choice([1, 2, 4, 6, 9]))


def _operator(race: Race, draw: random.Random) -> None:
    """One of the three: a few commands, close to those of the others."""
    tick = race.tick + draw.choice([0, 1, 2, 2, 3, 4, 6])
    for _ in range(draw.randint(1, 4)):
        if tick < race.tick + RACE_TICKS:
            race.sent.append(Sent(tick, draw.choice(COMMANDS)))
        tick += draw.choice(STEPS)


def _signalled(race: Race, draw: random.Random) -> None:
    """SIGTERM in the midst of a race, and now and then again."""
    tick = race.tick + draw.randrange(10)
    race.sent.append(Sent(tick, SIGTERM))
    if draw.random() < 0.3:
        race.sent.append(Sent(tick + draw.choice([1, 2, 5]), SIGTERM))


def make_script(seed: int, races: int, origin: int = 0) -> Script:
    """A run of so many races: the first when the rig is about to arm itself, the last ended by SIGTERM.

    `origin`: tick before which no other than the first begins.
    """
    draw = random.Random(seed)
    script, start = Script(), 0 if races > 1 else origin
    for index in range(races):
        first = index == 0 and races > 1
        begins = ARMS_ITSELF if first else draw.choice(list(BEGINNINGS))
        at = draw.randrange(FIRST - 6, FIRST + 2) if first else start + BEGINNINGS[begins].race_at
        race = Race(begins, start, at)
        if not first:
            script.prepared += [Sent(start, "disarm"), Sent(start + 5, "clear")]
            BEGINNINGS[begins].prepare(script, start)
            _beside(script, race.tick, draw)
        for _ in range(OPERATORS):
            _operator(race, draw)
        if index == races - 1:
            _signalled(race, draw)
        draw.shuffle(race.sent)  # in one tick, nobody is first
        script.races.append(race)
        start = max(origin, race.tick + RACE_TICKS + QUIET)
    return script
