"""What a block of control cost, by the weights of the design and by what was measured: the same for both laws.

    cost of a tick = (e/0.2 rad)^2 + (psi'/1.2 rad/s)^2 + ((theta' - w)/6 rad/s)^2 + (u/0.05 N m)^2

e is the picture's angle less the reference of the time at which it was taken; psi' the slope of the last five pictures;
w the hoop speed by which a ball is held at the reference, where that is known (`Lqg`).

Rules of this file: never by the filter's estimate, which believes the very model that is to be judged; pure.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, isfinite, sin, sqrt, tau
from typing import Any, NamedTuple

from hoopd.design.weights import Weights

# Of a tenth of a second: long against a picture's noise, short against a swing of the ball (0.7 s).
PICTURES = 5
REST_AFTER_S = 1.0  # longer than a swing of the ball
REFERENCES = 32  # ticks that are remembered: a picture is two to four old


class TickSample(NamedTuple):
    """What is looked at of one tick; NaN where nothing was measured."""

    t: float  # s, run time
    running: bool
    u: float  # N m
    dtheta: float  # rad/s
    ball: float  # rad, as the picture shows it
    ball_t: float  # s, when the picture was taken
    reference: float  # rad


class HeldSpeed(NamedTuple):
    """How the hoop has to turn for a ball that is held off the bottom: w' = rate (per_sin sin r - w)."""

    per_sin: float  # rad/s
    rate: float  # 1/s


def held_speed(gains: Mapping[str, Any]) -> HeldSpeed | None:
    """How the hoop has to turn for a reference, as far as a controller's numbers tell."""
    per_sin, rate = gains.get("speed_per_sin"), gains.get("hold_rate")
    return HeldSpeed(per_sin, rate) if isinstance(per_sin, float) and isinstance(rate, float) else None


class BlockFigures(NamedTuple):
    """What one block was like."""

    cost: float
    ball_rms_rad: float
    ticks: int
    pictures: int
    rest_rms_nm: float | None  # torque a while after the reference went to the bottom; None: it never stayed there


@dataclass
class _Sums:
    cost: float = 0.0
    ticks: int = 0
    angle: float = 0.0
    slope: float = 0.0
    angles: int = 0
    slopes: int = 0
    rest: float = 0.0
    rests: int = 0


class Yardstick:
    """Sums of one block after the other."""

    def __init__(
        self, weights: Weights | None = None, held: HeldSpeed | None = None, rest_after_s: float = REST_AFTER_S
    ) -> None:
        """`held`: None leaves the hoop's speed out; `rest_after_s`: the ball rests so long after a zero reference."""
        self._weights, self._held, self._rest_after_s = weights or Weights(), held, rest_after_s
        self._referred: tuple[float, float] | None = None  # reference, and since when
        self._references: deque[tuple[float, float]] = deque(maxlen=REFERENCES)
        self._pictures: deque[tuple[float, float]] = deque(maxlen=PICTURES)
        self._speed = 0.0  # rad/s that the reference asks for
        self._t: float | None = None
        self._sums = _Sums()

    def begin(self) -> None:
        """Forget what was summed up."""
        self._sums = _Sums()

    def put(self, sample: TickSample, *, counts: bool) -> None:
        """Look at one tick; it is summed up when it counts."""
        self._references.append((sample.t, sample.reference))
        if self._referred is None or self._referred[0] != sample.reference:
            self._referred = sample.reference, sample.t
        self._follow(sample)
        fresh = isfinite(sample.ball) and isfinite(sample.ball_t)
        if fresh:
            self._pictures.append((sample.ball_t, sample.ball))
        if not counts:
            return
        sums, weights = self._sums, self._weights
        sums.ticks += 1
        sums.cost += (sample.u / weights.torque_nm) ** 2
        if self._is_at_rest(sample.t):
            sums.rest, sums.rests = sums.rest + sample.u**2, sums.rests + 1
        if self._held is not None and isfinite(sample.dtheta):
            sums.cost += ((sample.dtheta - self._speed) / weights.dtheta_rad_s) ** 2
        if fresh:
            off = sample.ball - self._reference_at(sample.ball_t)
            sums.angle += (off - tau * round(off / tau)) ** 2
            sums.angles += 1
            if len(self._pictures) == PICTURES:
                sums.slope += _slope(self._pictures) ** 2
                sums.slopes += 1

    @property
    def figures(self) -> BlockFigures:
        """Mean cost of a tick and root mean square of the ball's error, of what counted since `begin`."""
        sums, weights = self._sums, self._weights
        angle, slope = sums.angle / max(1, sums.angles), sums.slope / max(1, sums.slopes)
        cost = sums.cost / max(1, sums.ticks) + angle / weights.psi_rad**2 + slope / weights.dpsi_rad_s**2
        rest = sqrt(sums.rest / sums.rests) if sums.rests else None
        return BlockFigures(cost, sqrt(angle), sums.ticks, sums.angles, rest)

    def _is_at_rest(self, t: float) -> bool:
        return self._referred is not None and self._referred[0] == 0.0 and t - self._referred[1] >= self._rest_after_s

    def _follow(self, sample: TickSample) -> None:
        passed, self._t = 0.0 if self._t is None else sample.t - self._t, sample.t
        if self._held is None:
            return
        end = self._held.per_sin * sin(sample.reference)
        self._speed += (end - self._speed) * (1.0 - exp(-self._held.rate * max(0.0, passed)))

    def _reference_at(self, t: float) -> float:
        """The reference in force when a picture was taken."""
        return next((wanted for since, wanted in reversed(self._references) if since <= t), self._references[0][1])


def _slope(points: deque[tuple[float, float]]) -> float:
    """Of the straight line through points by least squares."""
    mean_t, mean_y = (sum(column) / len(points) for column in zip(*points, strict=True))
    spread = sum((t - mean_t) ** 2 for t, _ in points)
    return sum((t - mean_t) * (y - mean_y) for t, y in points) / spread if spread > 0.0 else 0.0
