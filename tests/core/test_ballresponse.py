"""A ball that answers the hoop, and angles that only look like one."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin, tanh

import numpy as np
import pytest

from hoopd.core.ballresponse import ENOUGH_S, BallMotion, BallResponse
from hoopd.core.records import CameraSample, DriverSample

MOTION = BallMotion(0.402, 0.319, -0.319, 73.7)
PERIOD_S = 0.02
LATE_S = 0.05
Tones = tuple[tuple[float, float], ...]
TONES: Tones = ((0.8, 2.0), (0.4, 5.0), (0.2, 11.0))  # rad and rad/s of the hoop; none of them is the ball's own
Seen = Callable[[float, float], float]  # run time and the ball's true angle -> angle in the picture


class Ball:
    """A hoop that swings as a law makes it, and a ball in it, with the model's equation and parameters of its own."""

    def __init__(self, motion: BallMotion = MOTION, tones: Tones = TONES, dry_rad: float = 0.0) -> None:
        self._motion, self._rng, self._tones, self._dry_rad = motion, np.random.default_rng(0), tones, dry_rad
        self.t = self.psi = self.dpsi = 0.0

    def hoop(self, t: float) -> tuple[float, float, float]:
        """Angle, speed and acceleration."""
        theta = sum(a * sin(w * t) for a, w in self._tones)
        speed = sum(a * w * cos(w * t) for a, w in self._tones)
        return theta, speed, -sum(a * w * w * sin(w * t) for a, w in self._tones)

    def tick(self, period_s: float = PERIOD_S) -> tuple[DriverSample, float]:
        """What the encoder says, and the ball's true angle, one tick later."""
        m, h = self._motion, period_s / 20
        for _ in range(20):
            _, speed, acceleration = self.hoop(self.t)
            force = m.carried * acceleration + m.hoop_rate * speed + m.ball_rate * self.dpsi
            dry = self._dry_rad * tanh((speed - self.dpsi) / 0.02)
            self.dpsi += h * (force - m.stiffness * (sin(self.psi) - dry))
            self.psi += h * self.dpsi
            self.t += h
        theta, speed, _ = self.hoop(self.t)
        noise = 0.05 * self._rng.standard_normal()
        return DriverSample(self.t, 0, 1, 0, theta, speed + noise, 0.0, 0), self.psi


def watch(seconds: float, seen: Seen, ball: Ball, push: tuple[float, ...] = ()) -> float:
    """Most evidence against a ball, in s."""
    response, rng, most = BallResponse(MOTION), np.random.default_rng(1), 0.0
    late: list[CameraSample] = []
    for k in range(round(seconds / PERIOD_S)):
        driver, psi = ball.tick()
        ball.dpsi += sum(1.5 for t in push if abs(ball.t - t) < PERIOD_S / 2)
        psi = seen(ball.t, psi) + 0.002 * rng.standard_normal()
        late.append(CameraSample(k, ball.t, ball.t, psi, 1.0, 0.0, 0.0))
        camera = late.pop(0) if ball.t - late[0].t > LATE_S else None
        response.update(driver, camera, acting=True)
        most = max(most, response.against_s)
    return most


LIES: dict[str, Seen] = {
    "rests": lambda t, psi: 0.1,
    "half": lambda t, psi: 0.5 * psi,
    "double": lambda t, psi: 2.0 * psi,
    "mirrored": lambda t, psi: -psi,
    "swings slowly": lambda t, psi: 0.1 * sin(2 * pi * t / 3.0),
    "swings as a free ball": lambda t, psi: 0.1 * sin(8.6 * t),
}


@pytest.mark.parametrize("lie", LIES)
def test_an_angle_that_does_not_answer_the_hoop_is_told(lie: str) -> None:
    assert watch(12.0, LIES[lie], Ball()) >= ENOUGH_S


def test_an_old_angle_is_told() -> None:
    past: list[float] = []

    def old(t: float, psi: float) -> float:
        past.append(psi)
        return past[-6] if len(past) > 5 else psi

    assert watch(12.0, old, Ball()) >= ENOUGH_S


OFF = {
    "as the model": {},
    "a heavier ball": {"carried": 0.402 * 1.25, "stiffness": 73.7 / 1.2},
    "a lighter ball": {"carried": 0.402 * 0.75, "stiffness": 73.7 * 1.2},
    "rubs": {"hoop_rate": 1.0, "ball_rate": -1.0},
}
TRUE: dict[str, Seen] = {
    "well": lambda t, psi: psi,
    "off by its zero": lambda t, psi: psi + 0.04,
}


@pytest.mark.parametrize("off", OFF)
@pytest.mark.parametrize("seen", TRUE)
def test_a_real_ball_is_left_alone(off: str, seen: str) -> None:
    assert watch(20.0, TRUE[seen], Ball(MOTION._replace(**OFF[off]))) == 0.0


@pytest.mark.parametrize("seen", TRUE)
def test_a_ball_with_dry_friction_in_a_hoop_that_sways_is_left_alone(seen: str) -> None:
    assert watch(20.0, TRUE[seen], Ball(tones=((6.0, 1.6),), dry_rad=0.03)) == 0.0


def test_terms_are_functions_of_time_whatever_the_picture_rate() -> None:
    hoop_t = 0.005 * np.arange(400)
    hoop = np.column_stack([hoop_t, 0.3 * np.sin(4 * hoop_t), 1.2 * np.cos(4 * hoop_t)])

    def terms(rate: int) -> np.ndarray:
        t = np.arange(int(1.5 * rate)) / rate
        return BallResponse(MOTION)._terms(t, 0.2 * np.sin(6 * t), hoop)[:: rate // 50]

    plain = terms(50)
    for rate in (100, 200):
        assert np.abs(terms(rate) - plain).max() < 0.01 * np.abs(plain).max()
        assert (np.abs(terms(rate) - plain).max(axis=0) < 0.05 * np.abs(plain).max(axis=0) + 1e-9).all()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_an_uneven_encoder_of_a_hoop_that_turns_is_no_ball_that_fails_to_answer(n: int) -> None:
    response, rng = BallResponse(MOTION), np.random.default_rng(0)
    for k in range(1000):
        t = k * PERIOD_S
        theta, speed = 4.0 * t, 4.0 + 0.05 * rng.standard_normal()
        ripple = 0.03 * sin(n * theta)
        driver = DriverSample(t, 0, 1, 0, theta + ripple, speed + 0.03 * n * 4.0 * cos(n * theta), 0.0, 0)
        response.update(driver, CameraSample(k, t, t, 0.03 + 0.002 * rng.standard_normal(), 1.0, 0.0, 0.0), acting=True)
    assert response.against_s == 0.0


def test_pushes_are_no_evidence_that_lasts() -> None:
    assert watch(30.0, TRUE["well"], Ball(), push=(5.01, 9.01, 14.01, 21.01)) <= 0.5 * ENOUGH_S


def test_who_does_not_act_judges_nothing() -> None:
    ball, response = Ball(), BallResponse(MOTION)
    for k in range(800):
        driver, _ = ball.tick()
        camera = CameraSample(k, ball.t - LATE_S, ball.t, 0.1, 1.0, 0.0, 0.0)
        assert not response.update(driver, camera, acting=k % 50 != 0)
    assert response.against_s == 0.0


def test_a_hoop_at_rest_tells_nothing_of_a_ball_at_rest() -> None:
    response, rng = BallResponse(MOTION), np.random.default_rng(0)
    for k in range(1000):
        t = k * PERIOD_S
        driver = DriverSample(t, 0, 1, 0, 0.0, 0.05 * rng.standard_normal(), 0.0, 0)
        camera = CameraSample(k, t - LATE_S, t, 0.02 + 0.002 * rng.standard_normal(), 1.0, 0.0, 0.0)
        assert not response.update(driver, camera, acting=True)
    assert response.against_s == 0.0


def test_a_frame_that_shakes_tells_nothing_of_a_ball_in_a_hoop_that_follows() -> None:
    response, rng = BallResponse(MOTION), np.random.default_rng(0)
    for k in range(1000):
        t = k * PERIOD_S
        speed = 0.1 * sin(25.0 * t) + 0.05 * rng.standard_normal()
        driver = DriverSample(t, 0, 1, 0, -0.004 * cos(25.0 * t), speed, 0.0, 0)
        angle = 0.008 * sin(25.0 * t + 0.3) + 0.002 * rng.standard_normal()
        response.update(driver, CameraSample(k, t, t, angle, 1.0, 0.0, 0.0), acting=True)
    assert response.against_s == 0.0


def test_lateness_that_the_model_knows_is_taken_off() -> None:
    response, ball, past = BallResponse(MOTION._replace(late_s=0.1)), Ball(), []
    for k in range(800):
        driver, psi = ball.tick()
        past.append(psi)
        if k > 10:
            response.update(driver, CameraSample(k, ball.t, ball.t, past[-6], 1.0, 0.0, 0.0), acting=True)
    assert response.against_s == 0.0


def test_a_short_tick_is_another_number_of_samples_and_no_other_verdict() -> None:
    response, ball, rng, late = BallResponse(MOTION), Ball(), np.random.default_rng(1), list[CameraSample]()
    for k in range(4000):
        driver, psi = ball.tick(PERIOD_S / 4)
        camera = None
        if k % 4 == 0:
            late.append(CameraSample(k, ball.t, ball.t, psi + 0.002 * rng.standard_normal(), 1.0, 0.0, 0.0))
            camera = late.pop(0) if ball.t - late[0].t > LATE_S else None
        response.update(driver, camera, acting=True)
        assert response.against_s == 0.0


def test_a_pause_takes_no_evidence_away_and_a_new_run_does() -> None:
    response, ball, rng = BallResponse(MOTION), Ball(), np.random.default_rng(1)
    for k in range(1500):
        driver, _ = ball.tick()
        blank = k % 200 >= 165  # 0.7 s in 4 s
        psi = 0.1 + 0.002 * rng.standard_normal()
        if response.update(driver, CameraSample(k, ball.t - LATE_S, ball.t, psi, 1.0, 0.0, 0.0), acting=not blank):
            break
    assert response.against_s >= ENOUGH_S
    response.reset()
    assert response.against_s == 0.0
