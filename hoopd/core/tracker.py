"""The law of a maneuver: a planned motion of hoop and ball with its feedback, given up outside of its envelope.

    waits for nothing: at its first tick hoop and ball are at rest at the bottom, or it ends at once
    plan     u_k = u*_k - K_k (x_k - x*_k),  one row a tick
    over     ends as `DONE`; the law of before is back in the same tick; where the plan ends on an inner hoop it lets
             the ball down first, as if it had been given up
    given up the hoop is braked until hoop and ball are nearly at rest, then it ends with the reason; so, too, by
             somebody's word, while what the plan suspends stays suspended: the ball was where it should be

Rules of this file: pure; a plan is played once; what it left it never takes up again; the torque of a maneuver that was
given up is the brake's alone, and the brake ends whatever the ball does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, isfinite, nan, tau

import numpy as np

from hoopd.core.controllers import DONE, Controller, Log, Measurement
from hoopd.core.faulttable import SUSPENDABLE, SUSPENDABLE_IN_FLIGHT
from hoopd.core.records import Vector

# Rows of the fault table are suspended for a plan, and no plan is longer.
LONGEST_PLAN_TICKS = 500
LARGEST_UNMODELLED = 1000.0  # as of a ball that a hand may hold
# After a landing, until the filter has seen it: pictures are two to four ticks old, and it takes three of them.
CAUGHT_TICKS = 8
STATES = ("theta", "dtheta", "psi", "dpsi")


@dataclass(frozen=True)
class Tolerances:
    """How far a state may be from the planned one: hoop speed, ball angle, ball speed."""

    dtheta_rad_s: float
    psi_rad: float
    dpsi_rad_s: float

    def __post_init__(self) -> None:
        """Refuse a bound that bounds nothing."""
        if not all(isfinite(one) and one > 0.0 for one in (self.dtheta_rad_s, self.psi_rad, self.dpsi_rad_s)):
            raise ValueError("tolerances must be finite and above zero")

    def breach(self, x: Vector, planned: Vector) -> str:
        """Which state is too far off; empty when none is."""
        return self._breach(x, planned, 3)

    def hoop_breach(self, x: Vector, planned: Vector) -> str:
        """The same of the hoop alone."""
        return self._breach(x, planned, 1)

    def _breach(self, x: Vector, planned: Vector, states: int) -> str:
        bounds = (self.dtheta_rad_s, self.psi_rad, self.dpsi_rad_s)
        rows = zip(STATES[1:], ("rad/s", "rad", "rad/s"), (1, 2, 3), bounds, strict=True)
        for name, unit, index, bound in [*rows][:states]:
            off = float(x[index]) - float(planned[index])
            if not abs(off) <= bound:
                return f"{name} {off:+.3g} {unit} off, {bound:g} allowed"
        return ""


@dataclass(frozen=True)
class FlightTicks:
    """When the plan's ball is in the air, and what is suspended from its first tick there until it has been caught."""

    first_tick: int
    ticks: int
    unmodelled: float  # as of the plan, while the filter's ball does not move as it
    suspends: tuple[str, ...] = ()

    def lasts(self, k: int) -> bool:
        """Whether row k of the plan is one of the flight, or soon after: pictures come late, and a ball bounces."""
        return self.first_tick <= k < self.first_tick + self.ticks + CAUGHT_TICKS


@dataclass(frozen=True)
class Brake:
    """What takes the energy out of a maneuver that was given up."""

    nm_per_rad_s: float = 0.005  # hoop inertia 1.5e-3 kg m2: a time constant of 0.3 s
    limit_nm: float = 0.1
    calm: Tolerances = Tolerances(3.0, 0.3, 2.0)  # then the bottom's law holds the ball
    longest_s: float = 3.0

    def torque(self, dtheta: float) -> float:
        """Against the hoop's motion."""
        return min(self.limit_nm, max(-self.limit_nm, -self.nm_per_rad_s * dtheta))


class PlannedMotion:
    """Tables of a maneuver; ValueError when they do not fit each other."""

    def __init__(
        self,
        torques_nm: Sequence[float],
        states: Sequence[Sequence[float]],
        feedback: Sequence[Sequence[float]],
        *,
        start: Tolerances,
        envelope: Tolerances,
        unmodelled: float = 0.0,
        suspends: Sequence[str] = (),
        flight: FlightTicks | None = None,
        let_down: bool = False,
        brake: Brake = Brake(),
    ) -> None:
        """`states`: (n + 1, 4) from rest at the bottom; `feedback`: (n, 4) N m per state; `unmodelled`: density of what
        the model may leave of so fast a motion, (rad/s)^2/s; `suspends`: rows of the fault table that the plan itself
        would raise; `flight`: of a throw; `let_down`: it ends where no law of the bottom holds the ball."""
        self.torques_nm = np.array(torques_nm, float)
        self.states, self.feedback = np.array(states, float), np.array(feedback, float)
        self.start, self.envelope, self.brake = start, envelope, brake
        self.unmodelled, self.suspends, self.flight = float(unmodelled), tuple(suspends), flight
        self.let_down = let_down
        n = len(self.torques_nm)
        if not 1 <= n <= LONGEST_PLAN_TICKS:
            raise ValueError(f"a plan has 1 to {LONGEST_PLAN_TICKS} ticks, not {n}")
        if self.states.shape != (n + 1, 4) or self.feedback.shape != (n, 4):
            raise ValueError(f"{n} torques need {n + 1} rows of four states and {n} rows of four gains")
        if not all(np.isfinite(one).all() for one in (self.torques_nm, self.states, self.feedback)):
            raise ValueError("torques, states and gains must be finite")
        for density in (self.unmodelled, flight.unmodelled if flight else 0.0):
            if not 0.0 <= density <= LARGEST_UNMODELLED:
                raise ValueError(f"unmodelled must be from 0 to {LARGEST_UNMODELLED:g}, not {density:g}")
        if flight is not None and not 0 < flight.first_tick < flight.first_tick + flight.ticks < n:
            raise ValueError(f"a flight begins and ends within the plan's {n} ticks")
        if start.breach(self.states[0], np.zeros(4)):
            raise ValueError(f"a plan begins at rest at the bottom: {start.breach(self.states[0], np.zeros(4))}")
        for named, known in ((self.suspends, SUSPENDABLE), (flight.suspends if flight else (), SUSPENDABLE_IN_FLIGHT)):
            if unknown := [name for name in named if name not in known]:
                raise ValueError(f"{unknown[0]!r} may not be suspended: only {', '.join(sorted(known))}")


class MotionTracker:
    """Plays a `PlannedMotion`; see the head of the file."""

    def __init__(self, plan: PlannedMotion) -> None:
        self.plan = plan
        self.reset()

    def reset(self) -> None:
        """The plan begins anew."""
        self._k = 0
        self._origin = np.zeros(4)
        self._given_up, self._braking_since = "", nan
        self._is_off_plan = False  # which is why it was given up
        self._is_called_off = False  # somebody said so
        self.ended = ""

    @property
    def suspended(self) -> tuple[str, ...]:
        """Rows of the fault table that the plan would raise: while it is followed, and while it is braked though hoop
        and ball were where it wants them."""
        if self._k == 0 or self._is_off_plan or self.ended:
            return ()
        return (*self.plan.suspends, *(self.plan.flight.suspends if self.plan.flight and self._flies else ()))

    @property
    def unmodelled(self) -> float:
        """What the filter has to expect beside its model until the maneuver is over, (rad/s)^2/s."""
        if self.ended:
            return 0.0
        return self.plan.flight.unmodelled if self.plan.flight and self._flies else self.plan.unmodelled

    @property
    def may_fly(self) -> bool:
        """Whether the ball may be in the air: of a throw, from its first tick until the maneuver is over."""
        return self.plan.flight is not None and self._k > 0 and not self.ended

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """The next torque; zero once it has ended."""
        if not self.ended and self._k == 0:
            self._begin(measurement)
        if self.ended:
            return 0.0, {}
        if not self._given_up:
            self._given_up = self._breach(measurement)
            self._is_off_plan = bool(self._given_up)
        if self._given_up:
            return self._braked(measurement), {}
        if self._k >= len(self.plan.torques_nm):
            if self.plan.let_down:
                self._given_up = DONE
                return self._braked(measurement), {}
            self.ended = DONE
            return 0.0, {}
        planned, k = self.plan.states[self._k] + self._origin, self._k
        self._k += 1
        off = measurement.x - planned
        fed_back = float(self.plan.feedback[k] @ off)
        return float(self.plan.torques_nm[k]) - fed_back, {
            "planned_psi_rad": float(planned[2]),
            "feedback_nm": -fed_back,
        }

    def give_up(self, reason: str) -> bool:
        """Somebody's word: brake from the next tick on, or go on braking; False where it is not played, and of the
        second word."""
        if self._k == 0 or self.ended or self._is_called_off:
            return False
        self._is_called_off = True
        if not self._is_off_plan:
            self._given_up = reason
        return True

    def follow(self, measurement: Measurement) -> tuple[float, Log]:
        """Another law drives the hoop: the plan has not begun."""
        return 0.0, {}

    def take_over(self, other: Controller) -> bool:
        """It has no memory that another law could fill."""
        return True

    def tune(self, key: str, value: float) -> bool:
        """Nothing: the plan is what the recording says it is."""
        return False

    @property
    def _flies(self) -> bool:
        """The plan's ball is in the air, or just caught."""
        return self.plan.flight is not None and self.plan.flight.lasts(self._k)

    def _begin(self, m: Measurement) -> None:
        """Where the hoop is, and the bottom that the ball is at, are the plan's zero."""
        if not _known(m):
            self.ended = "the estimate is not ready"
            return
        self._origin = np.array([float(m.x[0]), 0.0, tau * round(float(m.x[2]) / tau), 0.0])
        if breach := self.plan.start.breach(m.x, self._origin):
            self.ended = f"not begun, not at rest at the bottom: {breach}"

    def _breach(self, m: Measurement) -> str:
        if not _known(m):
            return "the estimate was lost"
        planned = self.plan.states[self._k] + self._origin
        if self._flies:  # the filter's ball rolls, whatever the real one does
            return self.plan.envelope.hoop_breach(m.x, planned)
        return self.plan.envelope.breach(m.x, planned)

    def _braked(self, m: Measurement) -> float:
        """The brake's torque until hoop and ball are calm, or it has taken too long."""
        brake = self.plan.brake
        self._k += self._flies  # a flight that has begun goes on, and is over, as planned
        if not isfinite(self._braking_since):
            self._braking_since = m.t
        calm = _known(m) and not brake.calm.breach(m.x, np.array([0.0, 0.0, tau * round(float(m.x[2]) / tau), 0.0]))
        if calm or not _known(m) or m.t - self._braking_since >= brake.longest_s:
            self.ended = self._end_of_brake(m)
            return 0.0
        return brake.torque(float(m.x[1]))

    def _end_of_brake(self, m: Measurement) -> str:
        """A ball that was let down rolls to and fro below the axis, where the law of the bottom takes it over."""
        if self._given_up != DONE:
            return f"given up: {self._given_up}"
        if not _known(m):
            return "let down: the estimate was lost"
        return DONE if cos(float(m.x[2])) > 0.0 else "let down: the ball is still above the axis"


def _known(m: Measurement) -> bool:
    return m.ready and all(map(isfinite, m.x.tolist()))
