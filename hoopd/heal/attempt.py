"""The version in hand: how far it is, what is asked of the daemon and of whoever computes for it, how it is kept.

Rules of this file: it decides nothing; every change is written down before anything follows from it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from hoopd.design.comparison import WantedCommand
from hoopd.files.heal_versions import HealVersion, State, VersionFolder
from hoopd.heal.loop_watch import LoopWatch
from hoopd.heal.plan import REMEMBER, REMEMBERED, HealPlan, HealWork


@dataclass
class Attempt:
    """What a healing has in hand; `clock`: s, of dates; `tell`: a line for whoever looks."""

    folder: VersionFolder
    plan: HealPlan
    clock: Callable[[], float]
    tell: Callable[[str], None]
    run: str = ""  # name of the daemon's run
    watch: LoopWatch = field(default_factory=LoopWatch)
    phase: str = "watching"
    since: float = 0.0  # s, run time: when the phase began
    on_trial: bool = False
    orders: list[WantedCommand] = field(default_factory=list)
    _to_remember: deque[HealWork] = field(default_factory=deque)  # beside what is asked for, which nobody waits for
    _work: HealWork | None = None  # asked for last: of anything else no result is wanted any more
    _is_begun: bool = False
    _version: HealVersion | None = None

    @property
    def holds_one(self) -> bool:
        """Whether there is a version in hand."""
        return self._version is not None

    @property
    def version(self) -> HealVersion:
        """The one in hand."""
        assert self._version is not None
        return self._version

    @property
    def passed_s(self) -> float:
        """Since the phase began."""
        return self.watch.t - self.since

    def take(self, version: HealVersion) -> None:
        """Have this one in hand."""
        self._version = version

    def enter(self, phase: str) -> None:
        """The next phase begins now."""
        self.phase, self.since = phase, self.watch.t

    def order(self, name: str, key: str = "") -> None:
        """Ask the daemon for something."""
        self.orders.append(WantedCommand(name, key=key))

    def compute(self, name: str, from_s: float, to_s: float) -> None:
        """Ask for a computation."""
        self._work, self._is_begun = HealWork(name, self.version.number, from_s, to_s), False

    def weigh(self, from_s: float) -> None:
        """Ask what the seconds since then cost."""
        self.enter("weighing")
        self.compute("weigh", from_s, self.watch.t)

    def keep_round(self, result: Mapping[str, Any], bad: str) -> None:
        """What was weighed, and why it is bad, as evidence."""
        self.version.evidence.setdefault("rounds", []).append({**result, "bad": bad})

    def remember(self, version: HealVersion) -> None:
        """Ask that what a version has found is remembered; the second time changes nothing."""
        self._to_remember.append(HealWork(REMEMBER, version.number, version.from_s, version.to_s))

    def remembered(self, number: int) -> None:
        """A memory has what a version has found: nobody needs to ask again."""
        version = self.folder.read(number)
        version.evidence[REMEMBERED] = True
        self.folder.keep(version, self.clock())

    def take_work(self) -> HealWork | None:
        """What is to be computed, once."""
        if self._is_begun or self._work is None:
            return self._to_remember.popleft() if self._to_remember else None
        self._is_begun = True
        return self._work

    def waits_for(self, work: HealWork) -> bool:
        """Whether its result is wanted."""
        return self.holds_one and work == self._work

    def keep(self, state: State, what: str = "") -> None:
        """Write the version down."""
        self.version.state = state
        self.folder.keep(self.version, self.clock(), what)

    def let_go(self, state: State, what: str) -> None:
        """It stays as it is; the loop is watched again."""
        self.keep(state, what)
        self._version = None
        self.enter("watching")

    def end(self, state: State, reason: str = "") -> None:
        """Nothing more comes of it; the loop is watched again, after a pause."""
        version = self.version
        version.reason = reason or version.reason
        self.on_trial = False
        self.watch.came_to_nothing(self.plan.pause_s)
        self.let_go(state, version.reason)
        self.tell(f"version {version.number}: {state.replace('_', ' ')}, {version.reason}")

    def note(self, **told: Any) -> None:
        """More of what is known about it."""
        self.version.evidence |= told
