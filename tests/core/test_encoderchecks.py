"""Encoders that lie of a hoop under torque, and honest ones of hoops that are not as the model says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, sin, tau
from typing import Any

import numpy as np
import pytest

from hoopd.core.encoderchecks import EQUAL_SPEEDS, EncoderChecks, HoopMotion, SpeedNoise
from hoopd.core.faulttable import BY_NAME
from hoopd.core.records import DriverSample

MOTION = HoopMotion(582.0, -0.484, 0.0)
PERIOD_S, COUNT = 0.02, tau / 4096
MISMATCH_RAD_S = 6.0
Told = tuple[float, float]  # angle and speed
Lie = Callable[[Told, Told], Told]  # what was true when it began, what is true -> what is told
Law = Callable[[float, Told], float]  # time and what is told -> torque


@dataclass
class Hoop:
    """A hoop with what a real one may have."""

    gain: float = MOTION.gain
    friction_nm: float = 0.0
    dead_nm: float = 0.0
    saturates_nm: float = 0.7
    no_load_rad_s: float = 1e9
    drag_nm_s2: float = 0.0
    push_nm: Callable[[float], float] = lambda t: 0.0
    late_s: float = 0.0

    def __post_init__(self) -> None:
        self.t = self.theta = self.speed = 0.0
        self._asked = [(-1.0, 0.0)]

    def turn(self, torque_nm: float) -> Told:
        self._asked.append((self.t + self.late_s, torque_nm))
        h = PERIOD_S / 20
        for _ in range(20):
            force = self._motor([u for t, u in self._asked if t <= self.t + 1e-9][-1]) + self.push_nm(self.t)
            force -= self.drag_nm_s2 * self.speed * abs(self.speed)
            free = self.speed + h * self.gain * force + h * MOTION.friction * self.speed
            rub = self.gain * self.friction_nm * h
            self.speed = free - copysign(min(rub, abs(free)), free)
            self.theta += h * self.speed
            self.t += h
        self._asked = self._asked[-6:]
        return self.theta, self.speed

    def _motor(self, u: float) -> float:
        left = min(max(abs(u) - self.dead_nm, 0.0), self.saturates_nm)
        return copysign(min(left, 0.7 * max(0.0, 1.0 - abs(self.speed) / self.no_load_rad_s)), u)


def steps(t: float, told: Told) -> float:
    """Follows a speed that changes its sign, as a reference makes it."""
    wanted = 10.0 if t % 4.0 < 2.0 else -10.0
    return float(np.clip(0.01 * (wanted - told[1]), -0.7, 0.7))


def turned(t: float, told: Told) -> float:
    """Makes 15 rad/s, then lets the hoop run."""
    return 0.0 if t > 1.9 else float(np.clip(0.05 * (15.0 - told[1]), -0.7, 0.7))


def watch(
    hoop: Hoop, seconds: float, lie: Lie | None = None, law: Law = steps, noise: float = 0.05, lost: float = 0.0
) -> dict[str, float]:
    """When each row came, in s after the lie began."""
    checks, rng = EncoderChecks(MOTION, MISMATCH_RAD_S, PERIOD_S), np.random.default_rng(2)
    begins, torque, acted = 2.0, 0.0, 0.0
    told, true, start = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    bad: dict[str, int] = {}
    came: dict[str, float] = {}
    for k in range(round((begins + seconds) / PERIOD_S)):
        t = k * PERIOD_S
        true = hoop.turn(acted)
        seen = (COUNT * round(true[0] / COUNT), true[1] + noise * rng.standard_normal())
        if t < begins or lie is None:
            told, start = seen, seen
        else:
            told = lie(start, seen)
        heard = rng.random() >= lost
        # the answer is of the beginning of this tick's period: the torque of the tick before acts until then
        answer = DriverSample(t + PERIOD_S, 0, int(k > 25), 0, *told, 0.0, 0)
        for name, weight in checks.update(t + PERIOD_S, answer if heard else None, acted, 0.0).items():
            bad[name] = bad.get(name, 0) + weight if weight else 0
            if bad[name] >= BY_NAME[name].on:
                came.setdefault(name, t - begins)
        acted, torque = torque, law(t, told) if k > 25 else 0.0
    return came


HONEST: dict[str, dict[str, Any]] = {
    "as the model": {},
    "light": {"gain": MOTION.gain * 1.4},
    "light and strong": {"gain": MOTION.gain * 1.8},
    "heavy": {"gain": MOTION.gain * 0.7},
    "rubs": {"friction_nm": 0.02},
    "has a dead zone": {"dead_nm": 0.02},
    "saturates": {"saturates_nm": 0.06},
    "has no torque at speed": {"no_load_rad_s": 9.0},
    "drags": {"drag_nm_s2": 1e-4},
    "is late": {"late_s": 0.04},
    "is touched": {"push_nm": lambda t: 0.03 * (0.0 < t % 1.3 < 0.3)},
    "is knocked": {"push_nm": lambda t: 0.1 * (0.0 < t % 1.3 < 0.1)},
    "is struck": {"push_nm": lambda t: 0.3 * (0.0 < t % 1.3 < 0.04)},
    "has cogs": {"push_nm": lambda t: 0.01 * sin(31.0 * t)},
}


@pytest.mark.parametrize("kind", HONEST)
@pytest.mark.parametrize("law", ["steps", "waves", "bangs"])
def test_an_honest_encoder_is_believed(kind: str, law: str) -> None:
    laws: dict[str, Law] = {
        "steps": steps,
        "waves": lambda t, told: 0.05 * sin(8.6 * t),
        "bangs": lambda t, told: 0.1 * copysign(1.0, sin(5.0 * t)) - 0.002 * told[1],
    }
    assert watch(Hoop(**HONEST[kind]), 12.0, law=laws[law], lost=0.05) == {}


def test_a_frozen_angle_under_torque_is_told() -> None:
    came = watch(Hoop(), 1.0, lambda start, true: (start[0], 0.0), law=lambda t, told: 0.08 * (t > 2.0))
    assert came["torque_without_motion"] <= 0.3


@pytest.mark.parametrize("lie", ["frozen", "coasts"])
def test_a_speed_that_stays_the_same_is_told_though_nothing_moves(lie: str) -> None:
    lies: dict[str, Lie] = {
        "frozen": lambda start, true: (start[0], 0.0),
        "coasts": lambda start, true: (true[0], start[1]),
    }
    came = watch(Hoop(), 1.0, lies[lie], law=lambda t, told: 0.0)
    assert set(came) == {"speed_noiseless"} and came["speed_noiseless"] <= (EQUAL_SPEEDS + 1) * PERIOD_S


def test_a_speed_without_noise_from_the_beginning_says_nothing() -> None:
    assert watch(Hoop(), 3.0, law=lambda t, told: 0.0, noise=0.0) == {}


def test_a_turned_encoder_is_told_under_torque() -> None:
    came = watch(Hoop(), 3.0, lambda start, true: (2 * start[0] - true[0], -true[1]))
    assert came["hoop_innovation"] <= 0.8


@pytest.mark.parametrize(
    ("factor", "lost"), [(-1.0, 0.0), (0.0, 0.0), (0.2, 0.0), (2.0, 0.0), (3.0, 0.0), (-1.0, 0.2), (3.0, 0.2)]
)
def test_a_speed_and_an_angle_that_jump_as_no_hand_makes_them_are_told_at_once(factor: float, lost: float) -> None:
    """The hoop turns at 15 rad/s; half of that might be a blow."""
    lie: Lie = lambda start, true: (start[0] + factor * (true[0] - start[0]), factor * true[1])  # noqa: E731
    came = watch(Hoop(), 0.3, lie, law=turned, lost=lost)
    assert came["hoop_innovation"] <= (2 if lost == 0.0 else 5) * PERIOD_S


def test_half_the_speed_all_at_once_might_be_a_blow() -> None:
    lie: Lie = lambda start, true: (start[0] + 0.5 * (true[0] - start[0]), 0.5 * true[1])  # noqa: E731
    assert watch(Hoop(), 0.5, lie, law=turned) == {}


@pytest.mark.parametrize("jumps", ["angle", "speed"])
def test_a_jump_of_angle_or_speed_alone_is_none_of_the_hoop(jumps: str) -> None:
    """The board has begun to count anew, or the speed is wrong for a moment: other rows judge that."""
    lies: dict[str, Lie] = {
        "angle": lambda start, true: (true[0] - start[0], true[1]),
        "speed": lambda start, true: (true[0], true[1] + 30.0),
    }
    assert "hoop_innovation" not in watch(Hoop(), 0.1, lies[jumps], law=lambda t, told: 0.0)


@pytest.mark.parametrize("share", [0.0, 0.5, 2.0])
def test_an_angle_that_is_not_the_speed_s_integral_is_told_at_any_speed(share: float) -> None:
    """Two rad/s, a third of what is allowed between two answers."""
    turning: Law = lambda t, told: 0.01 * (2.0 - told[1])  # noqa: E731
    lie: Lie = lambda start, true: (start[0] + share * (true[0] - start[0]), true[1])  # noqa: E731
    came = watch(Hoop(), 2.0, lie, law=turning)
    assert came["speed_implausible"] <= 1.2


def test_without_a_model_the_torque_judges_nothing() -> None:
    checks = EncoderChecks(None, MISMATCH_RAD_S, PERIOD_S)
    for k in range(100):
        judged = checks.update(k * PERIOD_S, DriverSample(k * PERIOD_S, 0, 1, 0, 0.0, 0.0, 0.0, 0), 0.5, 0.0)
        assert judged["torque_without_motion"] == judged["hoop_innovation"] == 0


def test_a_speed_that_runs_out_behind_a_low_pass_has_no_noise() -> None:
    noise, speed, came = SpeedNoise(), 5.0, False
    for k in range(400):
        speed = float(np.float32(0.7 * speed)) if k < 60 else 0.0
        came |= noise.update(DriverSample(k * PERIOD_S, 0, 1, 0, 0.0, speed, 0.0, 0))
    assert not came


def driven(checks: EncoderChecks, lag_s: float, jump: float = 0.0) -> int:
    """Ticks in which speed and angle contradict each other, of a hoop at 220 rad/s^2 whose speed lags."""
    theta = speed = told = 0.0
    bad = 0
    for k in range(40):
        for _ in range(20):  # milliseconds
            acceleration = 220.0 if k % 20 < 10 else -220.0
            speed += 1e-3 * acceleration
            theta += 1e-3 * speed
            told = speed if lag_s == 0.0 else told + 1e-3 * (speed - told) / lag_s
        t = 0.02 * (k + 1)
        driver = DriverSample(t, k % 256, 1, 0, theta, told + (jump if k > 20 else 0.0), 0.0, int(1e3 * t))
        bad += checks.update(t, driver, 0.3, 0.0)["speed_implausible"]
    return bad


def test_a_speed_that_lags_as_the_model_says_contradicts_nothing() -> None:
    knowing, ignorant = MOTION._replace(speed_lag_s=0.039), MOTION
    assert driven(EncoderChecks(ignorant, 6.0, 0.02), 0.039) >= 10
    assert driven(EncoderChecks(knowing, 6.0, 0.02), 0.039) == 0
    # what contradicts beside it is told as before
    assert driven(EncoderChecks(knowing, 6.0, 0.02), 0.039, jump=8.0) >= 15
    assert driven(EncoderChecks(ignorant, 6.0, 0.02), 0.0) == 0
