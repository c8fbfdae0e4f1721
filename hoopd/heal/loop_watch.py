"""What is seen of a running loop: since when a law acts, whether the model drifts, how long which fault was active.

A change is told by the daemon's own drift: by then at least `CERTAIN_S` seconds are of the changed loop, so that the
minutes which are diagnosed begin there. What comes to nothing again and again is looked at ever more seldom.

Rules of this file: pure; its only clock is the ticks' own; it says when minutes begin that are worth a diagnosis, and
nothing of what becomes of them.
"""

from __future__ import annotations

from collections.abc import Collection

from hoopd.core.drift import BLOCK_S, BLOCKS
from hoopd.heal.plan import HealPlan

# The median of the blocks is beyond its bound when half of them are: of these all but the first are of the changed loop
# from their beginning on.
CERTAIN_S = (BLOCKS // 2 - 1) * BLOCK_S
STATUS_S = 2.0  # a status comes every second
# Why what acts is not the version's law, though the loop runs: somebody's trial or experiment, gains of another size, a
# hand that drives the hoop.
ANOTHER, TUNED, DRIVEN = ("another law", "tuned gains", "a hand")
# Every pause after something that came to nothing is twice the one before, so often.
MOST_DOUBLED = 4


class LoopWatch:
    """One run of a daemon, as far as the next diagnosis needs it."""

    def __init__(self) -> None:
        self.t = 0.0
        self.acts_since = 0.0  # since when the law that acts is followed without a pause
        self.controlled = False  # by whatever law
        self.running = False  # and it is the version's law, by nobody's hand
        self.changed_at = 0.0  # when that was told last to be so, or not
        self._foreign = set[str]()
        self.gathered_from: float | None = None
        self._drift_at: float | None = None
        self._faults: dict[str, list[tuple[float, float | None]]] = {}
        self._last_look: float | None = None
        self._quiet_until, self._fruitless = 0.0, 0

    def tick(self, t: float, running: bool) -> bool:
        """One tick; whether the law begins to act in it, or no longer does: minutes without it are none."""
        self.t, self.controlled = t, running
        if not running:
            self._foreign.discard(DRIVEN)  # every hand lets go there
        running = running and not self._foreign
        if self._last_look is None:
            self._last_look = t
        if running == self.running:
            return False
        self.running, self.acts_since = running, t
        self.gathered_from = self._drift_at = None
        return True

    def is_not_own(self, why: str) -> None:
        """What acts from now on is not the version's law: one of the reasons above."""
        self._foreign.add(why)
        self.changed_at = self.t

    def is_own(self, why: str) -> None:
        """This reason is over."""
        self._foreign.discard(why)
        self.changed_at = self.t

    def is_foreign(self, why: str) -> bool:
        """Whether this reason goes on."""
        return why in self._foreign

    def drifts(self) -> None:
        """The model no longer fits."""
        if self.t >= self._quiet_until and self._drift_at is None:
            self._drift_at = self.t

    def fault_begins(self, name: str) -> None:
        """A row of the fault table is active from now on; told again, by an event and a status, it is the same."""
        spans = self._faults.setdefault(name, [])
        if not spans or spans[-1][1] is not None:
            spans.append((self.t, None))

    def fault_ends(self, name: str) -> None:
        """It no longer is."""
        spans = self._faults.get(name)
        if spans and spans[-1][1] is None:
            spans[-1] = (spans[-1][0], self.t)

    def faults_are(self, active: Collection[str]) -> None:
        """The rows that a status has as active: what began before anybody listened, and what nobody heard the end of.

        A status may be older than the last word about a row, which is believed first.
        """
        for name in dict.fromkeys([*self._faults, *active]):
            begin, end = self._faults[name][-1] if name in self._faults else (-STATUS_S, -STATUS_S)
            is_open = end is None
            if is_open != (name in active) and self.t - (begin if end is None else end) >= STATUS_S:
                (self.fault_ends if is_open else self.fault_begins)(name)

    def faults_s(self, from_s: float, to_s: float) -> dict[str, float]:
        """For how long each row was active between two times."""
        found = {}
        for name, spans in self._faults.items():
            inside = [min(to_s, to_s if end is None else end) - max(from_s, begin) for begin, end in spans]
            if (seconds := sum(one for one in inside if one > 0.0)) > 0.0:
                found[name] = seconds
        return found

    def begin(self, plan: HealPlan) -> str:
        """Gather minutes from now on where there is a reason for it; the reason, empty where there is none."""
        if not self.running or self.t < self._quiet_until:
            return ""
        if self._drift_at is not None:
            self.gathered_from = max(self.acts_since, self._drift_at - CERTAIN_S)
            return "the model drifts"
        if plan.every_s > 0.0 and self._last_look is not None and self.t - self._last_look >= plan.every_s:
            self.gathered_from = max(self.acts_since, self.t - plan.window_s)
            return f"{plan.every_s:.0f} s have passed"
        return ""

    def gathered(self, plan: HealPlan) -> bool:
        """Whether enough was recorded of the changed loop."""
        return self.gathered_from is not None and self.t - self.gathered_from >= plan.window_s

    def law_changed(self) -> None:
        """Another law acts: what was told of the one before is over, and its minutes are none of this one's."""
        self._foreign.discard(TUNED)
        self.gathered_from = self._drift_at = None
        self.acts_since = self._last_look = self.t
        self._fruitless = 0

    def came_to_nothing(self, pause_s: float) -> None:
        """Look again after a pause, every time a longer one."""
        self.gathered_from = self._drift_at = None
        self.acts_since = self._last_look = self.t
        self._quiet_until = self.t + pause_s * 2**self._fruitless
        self._fruitless = min(self._fruitless + 1, MOST_DOUBLED)
