"""Is a law on trial worse than the one that was accepted? Running costs of both, and a supervisor who has to be there.

    cost = (distance of psi from the references of the last four seconds)^2 + (torque weight * torque)^2

A step of the reference costs nothing while the ball is between the old and the new one, or as far beyond either,
whatever law moves it.

Rules of this file: a pure function of the ticks; it says that a trial is over and why, others act.
"""

from __future__ import annotations

from collections import deque
from math import isfinite, tau

# Of the shipped laws `arx` takes longest for a step of the reference: its ball is away for up to four seconds.
BAND_S = 4.0
# A torque that is always at the limit of 0.7 N m costs as much as an angle of 0.07 rad.
TORQUE_WEIGHT_RAD_PER_NM = 0.1
# The accepted law's cost is a mean over so long, and at least over so long before a trial may begin.
BASELINE_S, LEAST_BASELINE_S = 10.0, 3.0
# A trial is judged by its last swing, from the first half swing on.
WINDOW_S, LEAST_WINDOW_S = 1.0, 0.5
# Of one and the same law (`lqg`, `arx`; 40 s on the rig, steps of up to 0.3 rad every 2.5 to 3 s) means over one second
# reach 2.5 times what counts of the ten seconds before; a law that does not hold the ball passes any factor.
FACTOR = 4.0
# A ball within 0.03 rad (3 mm) is held well, whatever the accepted law does; one that is 0.1 rad off is not.
FLOOR_RAD2 = 0.03**2
MOST_RAD2 = 0.1**2
# A supervisor says every few seconds that it watches.
SILENCE_S = 5.0
# How the reasons begin that say nothing against the law but of single seconds, or of who watches it.
DEAR, SILENT = ("cost", "its supervisor was silent")


class References:
    """What was wanted of the ball of late."""

    def __init__(self) -> None:
        self._past: deque[tuple[float, float]] = deque()  # until when, rad
        self._now = 0.0

    def distance(self, t: float, reference: float, psi: float) -> float:
        """How far the ball, from the nearest bottom, is outside of all that was wanted in the last `BAND_S`, rad.

        A step of d moves it by up to d the other way first, and by as much beyond its end: that is not counted.
        """
        if reference != self._now:
            self._past.append((t, self._now))
            self._now = reference
        while self._past and self._past[0][0] < t - BAND_S:
            self._past.popleft()
        wanted = [reference, *(before for _, before in self._past)]
        low, high = min(wanted), max(wanted)
        angle, room = psi - tau * round(psi / tau), high - low
        return max(angle - high - room, low - room - angle, 0.0)


class RunningCost:
    """Mean cost over the last seconds in which a law acted."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._costs: deque[tuple[float, float]] = deque()  # s, rad^2
        self._sum = 0.0

    def add(self, t: float, cost: float) -> None:
        """One tick."""
        self._costs.append((t, cost))
        self._sum += cost
        while self._costs[0][0] < t - self._window_s:
            self._sum -= self._costs.popleft()[1]

    def clear(self) -> None:
        """No law acts."""
        self._costs.clear()
        self._sum = 0.0

    @property
    def seconds(self) -> float:
        """How long the window is filled."""
        return self._costs[-1][0] - self._costs[0][0] if self._costs else 0.0

    @property
    def mean(self) -> float:
        """In rad^2; 0 before the first tick."""
        return max(0.0, self._sum) / len(self._costs) if self._costs else 0.0


class LawTrial:
    """One law on trial."""

    def __init__(self, t: float, baseline: float) -> None:
        """`baseline`: mean cost of the accepted law before it, rad^2."""
        self.bound = min(MOST_RAD2, FACTOR * max(baseline, FLOOR_RAD2))
        self.cost = RunningCost(WINDOW_S)
        self._alive = t

    def alive(self, t: float) -> None:
        """The supervisor is there."""
        self._alive = t

    def verdict(self, t: float, cost: float) -> str:
        """Why the trial is over; empty while it goes on."""
        if not isfinite(cost):
            return "the estimate was lost"
        self.cost.add(t, cost)
        if t - self._alive > SILENCE_S:
            return f"{SILENT} for {SILENCE_S:g} s"
        if self.cost.seconds >= LEAST_WINDOW_S and self.cost.mean > self.bound:
            return f"{DEAR} {self.cost.mean:.3g} rad^2, the accepted law's bound is {self.bound:.3g}"
        return ""


def cost_of(distance_rad: float, torque_nm: float) -> float:
    """Cost of one tick in rad^2."""
    # J = e^2 + (w u)^2
    return distance_rad**2 + (TORQUE_WEIGHT_RAD_PER_NM * torque_nm) ** 2
