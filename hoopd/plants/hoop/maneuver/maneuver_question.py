"""What may be asked of a plan: once round, a swing to an angle and back, a throw, up; how long, which way round.

Rules of this file: a question checks itself and says where its motion begins and ends; nothing is solved here.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, pi, tau

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.collocation import MotionEnds
from hoopd.plants.hoop.maneuver.judgement import LEAST_TOP_S
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits

Array = NDArray[np.float64]

LOOP, SWING, THROW, UP = KINDS = ("loop", "swing", "throw", "up")
LONGEST_S = 10.0
LONGEST_HOLD_S = 8.0
# Of a swing: beyond, the ball would have to stop where it falls off.
LARGEST_SWING_RAD = 1.5


@dataclass(frozen=True)
class ManeuverQuestion:
    """What is asked for.

    Attributes
    ----------
    kind : str
        loop, swing, throw or up.
    limits : MotionLimits
        What the plan keeps.
    angle_rad : float
        Of a swing: how far out.
    seconds : float, optional
        How long it takes; None: as suits it.
    tick_s : float
        Length of a tick in s.
    turn : int
        1 or -1: which way round, as psi counts.
    flight_s : float
        Of a throw: how long the ball is in the air, whole ticks.
    hold_s : float
        Up: how long the ball is held on the top; at least as long as it has to be there to have arrived.
    """

    kind: str
    limits: MotionLimits
    angle_rad: float = 1.0
    seconds: float | None = None
    tick_s: float = 0.02
    turn: int = 1
    flight_s: float = 0.18
    hold_s: float = 3.0

    def __post_init__(self) -> None:
        """ValueError for a question that has no answer."""
        if self.kind not in KINDS:
            raise ValueError(f"unknown maneuver {self.kind!r}; known: {', '.join(KINDS)}")
        if self.turn not in (1, -1):
            raise ValueError(f"turn must be 1 or -1, not {self.turn}")
        if self.kind == SWING and not 0.0 < self.angle_rad <= LARGEST_SWING_RAD:
            raise ValueError(f"angle must be above 0 and at most {LARGEST_SWING_RAD:g} rad, not {self.angle_rad:g}")
        if self.kind == THROW and not self._is_whole_ticks(self.flight_s):
            raise ValueError(f"flight must be whole ticks of {self.tick_s:g} s, not {self.flight_s:g}")
        if self.kind in (THROW, UP) and self.seconds is not None:
            raise ValueError("seconds cannot be told of a throw: its parts take the time that suits them")
        if self.kind == UP and not LEAST_TOP_S <= self.hold_s <= LONGEST_HOLD_S:
            raise ValueError(f"hold must be {LEAST_TOP_S:g} to {LONGEST_HOLD_S:g} s, not {self.hold_s:g}")
        if self.seconds is not None and not 10 * self.tick_s <= self.seconds <= LONGEST_S:
            raise ValueError(f"seconds must be {10 * self.tick_s:g} to {LONGEST_S:g}, not {self.seconds:g}")

    def _is_whole_ticks(self, seconds: float) -> bool:
        ticks = seconds / self.tick_s
        return ticks > 0.5 and abs(ticks - round(ticks)) < 1e-6

    @property
    def ends(self) -> MotionEnds:
        """From rest at the bottom to rest at a bottom."""
        rest = np.array([0.0, 0.0, 0.0, 0.0])
        if self.kind == LOOP:
            return MotionEnds(rest, np.array([nan, 0.0, self.turn * tau, 0.0]))
        out = np.array([nan, nan, self.turn * self.angle_rad, 0.0])
        return MotionEnds(rest, np.array([nan, 0.0, 0.0, 0.0]), {0.5: out})

    def guess(self, ticks: int) -> Array:
        """A ball that goes smoothly, in a hoop at rest, (ticks + 1, 4)."""
        share, seconds = np.linspace(0.0, 1.0, ticks + 1), ticks * self.tick_s
        states = np.zeros((ticks + 1, 4))
        if self.kind == LOOP:
            states[:, 2] = self.turn * tau * (3.0 - 2.0 * share) * share**2
            states[:, 3] = self.turn * tau * 6.0 * (1.0 - share) * share / seconds
        else:
            states[:, 2] = self.turn * self.angle_rad * np.sin(pi * share) ** 2
            states[:, 3] = self.turn * self.angle_rad * pi * np.sin(tau * share) / seconds
        return states
