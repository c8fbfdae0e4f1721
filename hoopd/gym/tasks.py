"""What an agent is asked to do with hoop and ball, and how a try is judged: tick by tick a reward, and an end.

    reward of a tick = -(off^2 + (ball speed / 10)^2 + (hoop speed / 60)^2 + (torque / limit)^2 / 10) dt  + bonuses

`off` is the ball's angle from where the task wants it, at most pi. A try ends early when it succeeded, or when it
cannot succeed any more: that costs what a ball that rests as far off as can be would have cost until the try's end, and
`FAILURE_COST`. Otherwise the shortest way out of a task would be worth more than doing nothing.

Rules of this file: pure; a judge sees moments and nothing else, so that it is the same over plant and rig.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, pi, tau
from types import MappingProxyType
from typing import NamedTuple

from hoopd.core.faulttable import SUSPENDABLE, SUSPENDABLE_IN_FLIGHT
from hoopd.plants.hoop.effects.contact_modes import INNER, ROLLING
from hoopd.plants.hoop.maneuver.judgement import SETTLED_HOOP_RAD_S, SETTLED_RAD

BOTTOM, LOOP, THROW, UP = "bottom", "loop", "throw", "up"
# Settled for so long, it stays there.
SETTLED_S = 0.5
# On the top of the inner hoop: so near to it, for so long.
TOP_RAD, TOP_S = 0.2, 2.0
# A flight that no bounce is: a ball that falls freely comes down by 12 cm, more than the hoop's radius.
FLIGHT_S = 0.1
# Rows that a ball raises which goes round the hoop.
ROUND = tuple(SUSPENDABLE)
SUCCESS_BONUS, CATCH_BONUS, FAILURE_COST = 10.0, 5.0, 10.0
PATIENCE_COST_PER_S = pi**2  # at rest, off by pi
USUAL_BALL_RAD_S, USUAL_HOOP_RAD_S, TORQUE_WEIGHT = 10.0, 60.0, 0.1


class Moment(NamedTuple):
    """Hoop and ball at the end of a tick."""

    t: float  # s, of the try
    hoop_speed: float  # rad/s
    ball_angle: float  # rad from the bottom, whole turns counted
    ball_speed: float  # rad/s
    distance: float  # of the ball from the axis, in shares of what it is on the hoop: below 1 it flies
    torque_share: float  # of the limit, in the tick that ends here
    ball_mode: str = ROLLING  # or air, or inner: what it does


class TickVerdict(NamedTuple):
    """What a tick was worth."""

    reward: float  # without the cost of a failure
    over: bool = False
    success: bool = False
    why: str = ""  # it is over


@dataclass(frozen=True)
class GymTask:
    """A task: where a try begins, how long it may take, what ends it."""

    name: str
    seconds: float
    start_rad: float  # the ball begins at rest, this far from the bottom at most
    judge: Callable[[float], TryJudge]  # of a try, from the length of a tick
    suspends: tuple[str, ...] = ()  # rows of the fault table that the task itself would raise
    model: str = "models/hoop.yaml"  # whose plant it is of
    over_rig: bool = True  # the rig's filter and sensors can do it, too

    def failure_cost(self, played_s: float) -> float:
        """Of a try that failed then."""
        return FAILURE_COST + PATIENCE_COST_PER_S * max(self.seconds - played_s, 0.0)


class TryJudge:
    """Of one try; of the bottom, and what all tasks share."""

    goal_rad: float | None = 0.0  # where the ball has to be; None: at any bottom

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self._settled_since = inf

    def see(self, m: Moment) -> TickVerdict:
        """The next moment."""
        cost = self._off(m) ** 2 + (m.ball_speed / USUAL_BALL_RAD_S) ** 2 + (m.hoop_speed / USUAL_HOOP_RAD_S) ** 2
        cost += TORQUE_WEIGHT * m.torque_share**2
        reward = self._bonus(m) - cost * self._tick_s
        if why := self._failed(m):
            return TickVerdict(reward, True, False, why)
        if self._succeeded(m):
            return TickVerdict(reward + SUCCESS_BONUS, True, True, "done")
        return TickVerdict(reward)

    def _off(self, m: Moment) -> float:
        goal = tau * round(m.ball_angle / tau) if self.goal_rad is None else self.goal_rad
        return min(abs(m.ball_angle - goal), pi)

    def _succeeded(self, m: Moment) -> bool:
        """At its goal, and the hoop nearly at rest, for long enough."""
        settled = self._off(m) <= SETTLED_RAD and abs(m.hoop_speed) <= SETTLED_HOOP_RAD_S and m.distance >= 1.0
        self._settled_since = min(self._settled_since, m.t) if settled else inf
        return m.t - self._settled_since >= SETTLED_S

    def _bonus(self, m: Moment) -> float:
        return 0.0

    def _failed(self, m: Moment) -> str:
        return "the ball left the hoop" if m.distance < 1.0 else ""


class LoopJudge(TryJudge):
    """Once round the hoop, as the angle counts, without losing it."""

    goal_rad = tau

    def _failed(self, m: Moment) -> str:
        round_twice = not -pi < m.ball_angle < tau + pi
        return super()._failed(m) or ("the ball went round the wrong way" if round_twice else "")


class ThrowJudge(TryJudge):
    """Off the hoop for a while, caught, and at rest at a bottom."""

    goal_rad = None

    def __init__(self, tick_s: float) -> None:
        super().__init__(tick_s)
        self._off_since = inf
        self._caught = False

    def _bonus(self, m: Moment) -> float:
        """Once, for the first landing after a flight that no bounce is."""
        if m.distance < 1.0:
            self._off_since = min(self._off_since, m.t)
            return 0.0
        flown_s, self._off_since = m.t - self._off_since, inf
        first, self._caught = not self._caught and flown_s >= FLIGHT_S, self._caught or flown_s >= FLIGHT_S
        return CATCH_BONUS if first else 0.0

    def _succeeded(self, m: Moment) -> bool:
        return super()._succeeded(m) and self._caught

    def _failed(self, m: Moment) -> str:
        return ""


class UpJudge(TryJudge):
    """On the inner hoop and near its top, for long enough."""

    def __init__(self, tick_s: float) -> None:
        super().__init__(tick_s)
        self._up_since = inf

    def _off(self, m: Moment) -> float:
        return abs((m.ball_angle % tau) - pi)

    def _succeeded(self, m: Moment) -> bool:
        up = m.ball_mode == INNER and self._off(m) <= TOP_RAD
        self._up_since = min(self._up_since, m.t) if up else inf
        return m.t - self._up_since >= TOP_S

    def _failed(self, m: Moment) -> str:
        return ""


TASKS: Mapping[str, GymTask] = MappingProxyType(
    {
        BOTTOM: GymTask(BOTTOM, 10.0, 1.0, TryJudge),
        LOOP: GymTask(LOOP, 6.0, 0.05, LoopJudge, suspends=ROUND),
        THROW: GymTask(THROW, 8.0, 0.05, ThrowJudge, suspends=(*ROUND, *sorted(SUSPENDABLE_IN_FLIGHT))),
        UP: GymTask(UP, 10.0, 0.05, UpJudge, model="models/inner_hoop.yaml", over_rig=False),
    }
)


def task_of(name: str) -> GymTask:
    """ValueError for a name that is none."""
    if name not in TASKS:
        raise ValueError(f"unknown task {name!r}; known: {', '.join(TASKS)}")
    return TASKS[name]
