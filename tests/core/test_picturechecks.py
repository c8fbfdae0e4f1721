"""Pictures and angles that no camera gives of a ball."""

from __future__ import annotations

from collections.abc import Callable
from math import nan, sin

import numpy as np
import pytest

from hoopd.core.ballresponse import BallMotion
from hoopd.core.picturechecks import IDENTICAL_PICTURES, NAMES, PictureChecks
from hoopd.core.records import CameraSample, DriverSample, Inputs, LinkCounts

MOTION = BallMotion(0.402, 0.319, -0.319, 73.7)
PERIOD_S = 0.02
Angle = Callable[[int, float], float]  # number of the picture and noise -> angle


class Bench:
    """Ticks with a picture each, after a second without torque in which the camera is as it should be."""

    def __init__(self, motion: BallMotion | None = MOTION, noise_rad: float = 0.002, corners: bool = True) -> None:
        self.checks, self._noise, self._corners = PictureChecks(motion), noise_rad, corners
        self._rng, self.k = np.random.default_rng(0), 0
        self.last = CameraSample(0, 0.0, 0.0, nan, 0.0, nan, nan)
        self.run(60, lambda k, noise: noise, torque_nm=0.0)

    def run(
        self,
        ticks: int,
        angle: Angle,
        *,
        torque_nm: float = 0.01,
        speed: Callable[[float], float] = lambda t: 0.0,
        frozen: bool = False,
    ) -> set[str]:
        """Names that were raised at the end."""
        weights = {}
        for _ in range(ticks):
            self.k += 1
            t = self.k * PERIOD_S
            noise = self._noise * float(self._rng.standard_normal())
            fresh = CameraSample(self.k, t - 0.05, t, angle(self.k, noise), 1.0, 0.0, 0.0, self.k * self._corners)
            self.last = self.last._replace(frame=self.k, t=t - 0.05, t_arrival=t) if frozen else fresh
            driver = DriverSample(t, 0, 1, 0, 0.0, speed(t), 0.0, 0)
            inputs = Inputs(self.k, t, self.last, driver, LinkCounts(good=1), (), 0.0, 0.0, False, 0)
            weights = self.checks.update(inputs, torque_nm)
        assert set(weights) == set(NAMES)
        return {name for name, weight in weights.items() if weight}


def resting(k: int, noise: float) -> float:
    return noise


def test_the_same_picture_again_and_again_is_told() -> None:
    bench = Bench()
    assert bench.run(IDENTICAL_PICTURES - 1, resting, frozen=True) == set()
    assert bench.run(1, resting, frozen=True) == {"pictures_identical"}
    assert bench.run(1, resting) == set()


def test_a_camera_without_noise_is_not_told_for_a_ball_at_rest() -> None:
    """Its pictures have been equal from the beginning on, whenever nothing moved."""
    bench = Bench(noise_rad=0.0, corners=False)
    assert bench.run(200, resting) == set()
    still = PictureChecks(MOTION)
    for k in range(400):
        camera = CameraSample(k, k * PERIOD_S, k * PERIOD_S, 0.0, 1.0, 0.0, 0.0, 77)
        inputs = Inputs(k, k * PERIOD_S, camera, None, LinkCounts(), (), 0.0, 0.0, False, 0)
        assert not any(still.update(inputs, 0.01 * (k > 100)).values())


def swaying(t: float) -> float:
    return 3.0 * sin(5.0 * t)


def test_an_equal_angle_while_the_hoop_moves_the_ball_is_told() -> None:
    bench = Bench(noise_rad=0.0, corners=False)
    assert bench.run(60, lambda k, noise: 0.1, speed=swaying) == {"angle_stuck"}


def test_an_equal_angle_of_a_hoop_at_rest_is_no_fault() -> None:
    bench = Bench(noise_rad=0.0, corners=False)
    assert bench.run(300, lambda k, noise: 0.1) == set()
    assert bench.run(300, lambda k, noise: 0.1, speed=lambda t: 20.0) == {"angle_stuck"}  # it was sped up at once


def test_an_angle_that_changes_in_its_last_bits_is_not_stuck() -> None:
    bench = Bench(noise_rad=0.0, corners=False)
    assert bench.run(200, lambda k, noise: 0.1 + 1e-9 * (k % 2), speed=swaying) <= {"ball_unresponsive"}


def test_a_camera_that_is_as_late_as_it_may_be_is_not_stuck() -> None:
    """A clean camera on a ball that rests until the hoop starts: its first pictures of the motion are on their way."""
    bench = Bench(noise_rad=0.0, corners=False)
    bench.run(50, lambda k, noise: 0.1)
    start = bench.k
    assert bench.run(3, lambda k, noise: 0.1, speed=lambda t: 100.0 * (t - start * PERIOD_S)) == set()


def test_an_angle_that_has_lost_its_noise_is_told() -> None:
    bench = Bench()
    assert bench.run(200, resting) == set()
    assert "angle_noiseless" in bench.run(80, lambda k, noise: 0.01 * sin(0.1 * k))
    assert bench.run(60, resting) == set()


def test_pictures_that_hung_before_the_run_do_not_switch_the_row_off() -> None:
    bench = Bench()
    bench.checks = PictureChecks(MOTION)
    bench.run(60, resting, torque_nm=0.0, frozen=True)
    bench.run(120, resting, torque_nm=0.0)
    assert bench.run(100, resting) == set()
    assert "angle_noiseless" in bench.run(80, lambda k, noise: 0.01 * sin(0.1 * k))


@pytest.mark.parametrize("share", [0.3, 1.0, 4.0])
def test_noise_that_changes_with_the_light_is_no_fault(share: float) -> None:
    bench = Bench()
    assert bench.run(400, lambda k, noise: share * noise) == set()


@pytest.mark.parametrize("every", [20, 8])
def test_false_detections_before_the_run_are_not_taken_for_noise(every: int) -> None:
    bench = Bench()
    bench.checks = PictureChecks(MOTION)
    bench.run(60, lambda k, noise: 1.0 if k % every == 0 else noise, torque_nm=0.0)
    assert "angle_noiseless" not in bench.run(100, resting)


def test_a_swing_and_a_law_that_jerks_have_more_than_noise_in_them_and_not_less() -> None:
    bench = Bench(noise_rad=0.0003)
    assert bench.run(200, lambda k, noise: 0.5 * sin(0.17 * k) + noise) <= {"ball_unresponsive"}
    assert bench.run(100, resting) == set()


def test_without_a_model_of_a_ball_pictures_alone_are_judged() -> None:
    bench = Bench(motion=None)
    assert bench.run(80, lambda k, noise: 0.1, speed=swaying, frozen=True) == {"pictures_identical", "angle_noiseless"}
