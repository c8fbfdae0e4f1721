"""Control laws: from one tick's measurement to the torque that the law wants.

Rules of this file: a law is a pure function of its measurements since `reset`; it neither limits its torque nor knows
the limit: `Measurement.torque_previous` tells what was really sent, and a law with a memory starts from that
(anti-windup): a model of the plant from all of it, a recursion on its own output from its own share. A user's own law
is a class with the methods of `Controller`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import asin, copysign, exp, inf, isfinite, sin, tau
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from hoopd.core.inorder import dot
from hoopd.core.records import Vector

Log = dict[str, float]


class Measurement(NamedTuple):
    """What a law may know of one tick."""

    t: float  # s, run time
    x: Vector  # (4,) estimate at t: theta rad, dtheta rad/s, psi rad, dpsi rad/s
    ready: bool  # the estimate can be used
    psi_measured: float  # rad, as the camera saw it, 2 to 4 ticks ago; NaN without a picture
    psi_fresh: bool  # a new picture, and its angle was plausible
    dtheta_measured: float  # rad/s, NaN without an answer of the board
    reference: float  # rad, wanted psi
    torque_previous: float  # N m, what was sent last tick, after all limits
    dt: float  # s, tick period
    torque_added: float = 0.0  # N m, of the torque sent last tick what others than this law asked for (an experiment)
    speed: float = 0.0  # rad/s, wanted of the hoop while a hand drives it; 0: nobody does, `reference` alone counts


class Controller(Protocol):
    """A control law."""

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """Wanted torque in N m, and numbers worth plotting."""
        ...

    def reset(self) -> None:
        """Forget the past: the torque has been zero."""
        ...

    def tune(self, key: str, value: float) -> bool:
        """Change a named number while running; False when the law has none of that name or it makes no sense."""
        ...


# Why a law has ended when it did what it was made for.
DONE = "done"


@runtime_checkable
class Successor(Protocol):
    """A law that can go on where another one of its kind stopped."""

    def take_over(self, other: Controller) -> bool:
        """Take the other law's memory where it means the same to this one; False where it does not."""
        ...


class Ending(Controller, Protocol):
    """A law that comes to an end by itself, as an experiment does: the tick then brakes the hoop and disarms."""

    ended: str  # empty while it acts, then `DONE` or what went wrong; empty again after `reset`


# ---------------------------------------------------------------------------------------------- LQG


@dataclass(frozen=True)
class LqgGains:
    """Full-state feedback without theta, and how a held reference moves the hoop (see `Lqg`)."""

    k_dtheta: float  # N m / (rad/s)
    k_psi: float  # N m / rad
    k_dpsi: float  # N m / (rad/s)
    # psi = r held: torque = torque_per_sin * sin r + torque_per_speed * dtheta, and then
    # dtheta' = hold_rate (speed_per_sin sin r - dtheta)
    torque_per_sin: float = 0.0
    torque_per_speed: float = 0.0
    speed_per_sin: float = 0.0  # rad/s that the hoop ends at, per sin r
    hold_rate: float = 0.5  # 1/s
    hoop_speed_limit: float = 30.0  # rad/s, no reference may ask for more


# A wanted hoop speed: by how much the ball's angle is ahead of the one that sustains it, and the sine of the largest.
AHEAD = 2.0
DRIVEN_SIN = 0.35
# Sine of the least angle of the ball against which a hoop that a hand drove is braked.
BRAKING_SIN = 0.06
# A wanted speed so near to where it ends has arrived.
STANDING_RAD_S = 1e-3


class Lqg:
    """State feedback on the filter's estimate; hoop speed is regulated, the hoop's angle is free.

    Holding the ball off the bottom needs a hoop that accelerates until friction carries the ball (about 4 to 7 rad/s
    per degree, reached in some seconds). So a reference r comes with the hoop speed w that the plant itself demands:

        u = u_r - k_dtheta (dtheta - w) - k_psi (psi - r) - k_dpsi dpsi
        u_r = torque_per_sin sin r + torque_per_speed w,   w' = hold_rate (speed_per_sin sin r - w)

    and the step is tracked without the regulator working against itself. From one reference to another w goes on from
    where it is, through zero too and back to the bottom (r = 0): a hoop that is turned round or stopped faster takes
    the ball along, far beyond the reference. Where this law takes over at the bottom the hoop is braked. At
    `hoop_speed_limit` w stops and r falls back to the angle which that speed sustains: a larger angle can only be held
    for a while; a hoop that is faster slows down with the ball at the bottom.

    A wanted hoop speed s is the same the other way round: r is twice the angle that sustains it, so that w is there
    after ln 2 / hold_rate from rest, and w stops at s. Where the hand asks for less, or lets go, the ball is carried on
    the other side, as far as w had carried it and at least 0.06 rad, until w is there.
    """

    def __init__(self, gains: LqgGains) -> None:
        self.gains = gains
        self.reset()

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """See the class; zero torque until the estimate is ready."""
        if not measurement.ready:
            return 0.0, {}
        g = self.gains
        _, dtheta, psi, dpsi = measurement.x.tolist()
        r, w = self._target(measurement)
        hold = g.torque_per_sin * sin(r) + g.torque_per_speed * w
        # the ball's own turn of psi: a ball that went round the hoop is regulated to the nearest bottom
        off = psi - r
        off -= tau * round(off / tau)
        torque = hold - g.k_dtheta * (dtheta - w) - g.k_psi * off - g.k_dpsi * dpsi
        return torque, {"reference_rad": r, "reference_speed_rad_s": w, "hold_nm": hold}

    def reset(self) -> None:
        """The hoop owes no speed to a reference, nor to a hand."""
        self._speed, self._by_hand = 0.0, False

    def follow(self, measurement: Measurement) -> tuple[float, Log]:
        """The torque while another law drives the hoop: what speed it has is owed to the reference already."""
        if measurement.ready:
            at_bottom = self._wanted(measurement)[0] == 0.0
            self._speed = 0.0 if at_bottom else float(measurement.x[1])
        return self.update(measurement)

    def take_over(self, other: Controller) -> bool:
        """The hoop owes the same speed whatever the gains are."""
        if not isinstance(other, Lqg):
            return False
        self._speed, self._by_hand = other._speed, other._by_hand
        return True

    def tune(self, key: str, value: float) -> bool:
        """Any number of `LqgGains` by its name."""
        if not isfinite(value) or not hasattr(self.gains, key) or (key == "hoop_speed_limit" and value < 0.0):
            return False
        self.gains = replace(self.gains, **{key: value})
        return True

    @property
    def tunables(self) -> Log:
        """What `tune` changes, as it is now."""
        return asdict(self.gains)

    @property
    def speed_limit(self) -> float:
        """The fastest hoop, rad/s, that this law can be asked for; 0: it follows none."""
        g = self.gains
        follows = g.hold_rate > 0.0 and abs(g.speed_per_sin) > 0.0
        return min(g.hoop_speed_limit, abs(g.speed_per_sin) * DRIVEN_SIN / AHEAD) if follows else 0.0

    def _wanted(self, measurement: Measurement) -> tuple[float, float]:
        """Angle of the ball, and the hoop speed at which it is held no longer."""
        g, limit = self.gains, self.speed_limit
        if not self._is_driven(measurement):
            return measurement.reference, g.hoop_speed_limit
        speed = min(limit, max(-limit, measurement.speed))
        # speed_per_sin sin r = AHEAD s
        return asin(AHEAD * speed / g.speed_per_sin), abs(speed)

    def _is_driven(self, measurement: Measurement) -> bool:
        """A hand asks for a speed that this law follows."""
        return abs(measurement.speed) > 0.0 and self.speed_limit > 0.0

    def _target(self, measurement: Measurement) -> tuple[float, float]:
        """Angle and hoop speed to go for now."""
        g, before = self.gains, self._speed
        reference, limit = self._wanted(measurement)
        if not g.hold_rate > 0.0:
            self._speed = 0.0
            return reference, 0.0
        stays = exp(-g.hold_rate * measurement.dt)
        by_hand = self._is_driven(measurement)
        self._by_hand = by_hand or (self._by_hand and reference == 0.0 and before != 0.0)
        if self._by_hand and abs(before) > (limit if by_hand else 0.0):
            return self._braked(limit if by_hand else 0.0, stays)
        if abs(before) > limit:
            # too fast: it slows down by itself while the ball is at the bottom
            self._speed = copysign(max(limit, abs(before) * stays), before)
            return 0.0, self._speed
        end = g.speed_per_sin * sin(reference)
        self._speed = end + (before - end) * stays
        if abs(self._speed - end) < STANDING_RAD_S:
            self._speed = end
        if self._speed * end <= 0.0 or abs(self._speed) < limit:
            return reference, self._speed
        self._speed = copysign(limit, self._speed)
        return reference * self._speed / end, self._speed

    def _braked(self, limit: float, stays: float) -> tuple[float, float]:
        """A hoop that a hand drove slows down to `limit` against a ball that it carries on the other side."""
        g, before = self.gains, self._speed
        against = min(max(abs(before / g.speed_per_sin), BRAKING_SIN), DRIVEN_SIN)
        end = -copysign(abs(g.speed_per_sin) * against, before)
        speed = end + (before - end) * stays
        self._speed = speed if speed * before > 0.0 and abs(speed) > limit else copysign(limit, before)
        return asin(end / g.speed_per_sin), self._speed


# ---------------------------------------------------------------------------------------------- LQG, identified model


class LinearGains(NamedTuple):
    """Model in innovation form with outputs (dtheta, psi), and its feedback."""

    a: Vector  # (n, n)
    b: Vector  # (n,)
    c: Vector  # (2, n)
    filter_gain: Vector  # (n, 2), x = x + M (y - C x) in the tick of y
    feedback: Vector  # (n,)
    feedforward: float  # N m per rad of reference


class LqgLinear:
    """LQG on a discrete linear model of what arrives: the camera's delay is part of the model.

    x = A x + B u_previous,   x += M (y - C x) for the samples that came,   u = feedforward r - L x
    """

    def __init__(self, gains: LinearGains) -> None:
        self.gains = gains
        self._x: Vector = np.zeros(len(gains.b))

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """See the class; a missing output leaves its prediction."""
        g = self.gains
        x = g.a @ self._x + g.b * measurement.torque_previous
        predicted = g.c @ x
        innovation = self._innovation(measurement, predicted)
        x = x + g.filter_gain @ innovation
        self._x = x if isfinite(float(x.sum())) else np.zeros_like(x)
        torque = g.feedforward * measurement.reference - float(g.feedback @ self._x)
        return torque, {"psi_predicted_rad": float(predicted[1]), "innovation_psi_rad": float(innovation[1])}

    def reset(self) -> None:
        """The model rests at the bottom."""
        self._x = np.zeros(len(self.gains.b))

    def take_over(self, other: Controller) -> bool:
        """States of the same model mean the same, whatever corrects them and whatever is fed back."""
        if not isinstance(other, LqgLinear):
            return False
        mine, its = self.gains, other.gains
        if not all(map(np.array_equal, (mine.a, mine.b, mine.c), (its.a, its.b, its.c))):
            return False
        self._x = other._x
        return True

    def tune(self, key: str, value: float) -> bool:
        """`feedforward` alone: the rest only fits together."""
        if key != "feedforward" or not isfinite(value):
            return False
        self.gains = self.gains._replace(feedforward=value)
        return True

    @property
    def tunables(self) -> Log:
        """What `tune` changes, as it is now."""
        return {"feedforward": self.gains.feedforward}

    @staticmethod
    def _innovation(measurement: Measurement, predicted: Vector) -> Vector:
        speed, psi = measurement.dtheta_measured - float(predicted[0]), measurement.psi_measured - float(predicted[1])
        psi -= tau * round(psi / tau) if isfinite(psi) else 0.0
        return np.array([speed if isfinite(speed) else 0.0, psi if measurement.psi_fresh and isfinite(psi) else 0.0])


# ---------------------------------------------------------------------------------------------- PID, lead


class TransferFunctionController:
    """u = C(z) (reference - psi) for any proper C; sees measured psi alone (the thesis's PID and lead).

        a_0 u_k = b_0 e_k + b_1 e_k-1 + ... - a_1 u_k-1 - a_2 u_k-2 - ...

    The past torques are those really sent, less what others added (its integrator would add that up): with C's
    integrator in `a`, a saturated torque does not wind up.
    A tick without a new angle keeps the last error.
    """

    def __init__(self, b: Sequence[float], a: Sequence[float], gain: float = 1.0) -> None:
        if len(a) == 0 or len(b) == 0 or a[0] == 0.0 or len(b) > len(a) or not all(map(isfinite, (*b, *a))):
            raise ValueError("a transfer function needs finite b and a, a[0] not zero, b not longer than a")
        lead = [0.0] * (len(a) - len(b))  # b is written for the lowest powers: a shorter one is delayed
        self._b, self._a = [value / a[0] for value in (*lead, *b)], [value / a[0] for value in a]
        self.gain = gain
        self._error = 0.0  # rad
        self._errors = [0.0] * len(self._b)
        self._torques = [0.0] * (len(self._a) - 1)  # N m

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """See the class."""
        own_nm = measurement.torque_previous - measurement.torque_added
        self._torques = [own_nm, *self._torques][: len(self._a) - 1]
        if measurement.psi_fresh and isfinite(measurement.psi_measured):
            self._error = measurement.reference - measurement.psi_measured
        self._errors = [self._error, *self._errors[:-1]]
        torque = self.gain * dot(self._b, self._errors)
        torque -= dot(self._a[1:], self._torques)
        return torque, {"error_rad": self._error}

    def reset(self) -> None:
        """No error and no torque in the past."""
        self._error = 0.0
        self._errors = [0.0] * len(self._b)
        self._torques = [0.0] * (len(self._a) - 1)

    def take_over(self, other: Controller) -> bool:
        """Past errors and past torques are the same of any coefficients, if there are enough of them."""
        if not isinstance(other, TransferFunctionController):
            return False
        errors, torques = len(self._errors), len(self._torques)
        if errors > len(other._errors) or torques > len(other._torques):
            return False
        self._error, self._errors, self._torques = other._error, other._errors[:errors], other._torques[:torques]
        return True

    def tune(self, key: str, value: float) -> bool:
        """`gain`, a factor on the whole law."""
        if key != "gain" or not 0.0 <= value < inf:
            return False
        self.gain = value
        return True

    @property
    def tunables(self) -> Log:
        """What `tune` changes, as it is now."""
        return {"gain": self.gain}
