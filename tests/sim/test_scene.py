"""The rendered pictures: the ball is where it should be, things turn the right way, motion blurs, noise repeats."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import load
from hoopd.sim.camera import i420
from hoopd.sim.scene import Scene, SceneSettings

ANGLES = np.arange(0.0, math.tau, math.tau / 61)  # no multiple of a spoke's or of a screw's angle
FAST_RAD_S = 9.0  # of a ball let go at 1 rad
WHITE, BLACK = (250.0, 250.0, 250.0), (0.0, 0.0, 0.0)
State = tuple[float, float, float, float]


class Matte:
    """What the ball covers, whatever its shading: two scenes, bright and dark, with the ball and without."""

    def __init__(self) -> None:
        self._scenes = [
            Scene(SceneSettings(noise_sigma=0.0, lamp=0.0, background=grey, hoop_colour=grey))
            for grey in (WHITE, BLACK)
        ]

    def cover(self, state: State) -> NDArray[np.float64]:
        """Share of each pixel, from bright - dark = (1 - cover) (bright - dark without the ball)."""
        contrast = []
        for ball in (True, False):
            bright, dark = (scene.render(1, state, ball=ball)[..., 1].astype(float) for scene in self._scenes)
            contrast.append(bright - dark)
        return np.where(contrast[1] > 60, 1.0 - contrast[0] / np.maximum(contrast[1], 1.0), 0.0)


def moments(cover: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centre (x, y) and covariance of a cover."""
    down, across = np.nonzero(cover > 0.02)
    weights = cover[down, across]
    points = np.stack([across, down])
    return np.average(points, axis=1, weights=weights), np.cov(points, aweights=weights)


@pytest.fixture(scope="module")
def matte() -> Matte:
    return Matte()


@pytest.fixture(scope="module")
def noisy() -> Scene:
    return Scene(SceneSettings())


def analyser() -> Analyser:
    """As shipped."""
    config = load(None, sim=True, overrides=[])
    return Analyser(config.vision, config.faults.minimum_confidence)


@pytest.mark.parametrize("dpsi", [0.0, FAST_RAD_S])
def test_the_balls_centre_is_exact(matte: Matte, dpsi: float) -> None:
    scene = Scene(SceneSettings(noise_sigma=0.0))
    errors = []
    for number, psi in enumerate(ANGLES):
        centre, _ = moments(matte.cover((0.3 * number, 0.0, psi, dpsi)))
        errors.append(centre - scene.ball_centre(psi))
    assert np.abs(errors).max() < 0.05
    assert np.abs(np.mean(errors, axis=0)).max() < 0.01


def test_psi_is_positive_to_the_left_of_the_bottom(matte: Matte) -> None:
    bottom, _ = moments(matte.cover((0.0, 0.0, 0.0, 0.0)))
    left, _ = moments(matte.cover((0.0, 0.0, math.pi / 2, 0.0)))
    np.testing.assert_allclose(bottom, (240.0, 422.0), atol=0.05)
    np.testing.assert_allclose(left, (58.0, 240.0), atol=0.05)


@pytest.mark.parametrize("theta", [-0.3, 0.11, 0.3])
def test_theta_turns_the_hoop_as_psi_turns_the_ball(theta: float) -> None:
    """Brightness along the circle of the rim's screws, turned by theta."""
    scene = Scene(SceneSettings(noise_sigma=0.0, lamp=0.0))
    radius = scene.settings.track_radius + 1.55 * scene.settings.ball_radius
    psi = np.linspace(-math.pi, math.pi, 3600, endpoint=False)
    x, y = (240.0 - radius * np.sin(psi)).astype(np.float32), (240.0 + radius * np.cos(psi)).astype(np.float32)

    def profile(angle: float) -> NDArray[np.float64]:
        picture = scene.render(1, (angle, 0.0, 0.0, 0.0), ball=False)[..., 1]
        values = cv2.remap(picture, x[None], y[None], cv2.INTER_LINEAR)[0].astype(float)
        return np.asarray(values - values.mean())

    likeness = np.fft.ifft(np.fft.fft(profile(theta)) * np.conj(np.fft.fft(profile(0.0)))).real
    near = np.abs(psi) < math.pi / 8  # eight screws
    turned = psi[near][np.argmax(np.roll(likeness, 1800)[near])]
    assert turned == pytest.approx(theta, abs=0.005)


@pytest.mark.parametrize("psi", [0.0, 0.8, 2.5, -1.2])
def test_motion_blurs_along_the_track(matte: Matte, psi: float) -> None:
    """Smeared evenly over b, a disc's variance grows by b^2 / 12 along the motion and not across it."""
    s = SceneSettings()
    _, still = moments(matte.cover((0.0, 0.0, psi, 0.0)))
    _, moving = moments(matte.cover((0.0, 0.0, psi, FAST_RAD_S)))
    along, across = np.array([math.cos(psi), math.sin(psi)]), np.array([-math.sin(psi), math.cos(psi)])
    growth = moving - still
    blur_px = FAST_RAD_S * s.exposure_s * s.track_radius
    assert along @ growth @ along == pytest.approx(blur_px**2 / 12, rel=0.1)
    assert abs(across @ growth @ across) < 0.2


def test_the_same_seed_and_frame_give_the_same_picture() -> None:
    state = (0.4, 3.0, 0.2, 1.0)
    one, two, other = (Scene(SceneSettings(seed=seed)) for seed in (1, 1, 2))
    one.render(3, state)  # what was drawn before does not matter
    assert np.array_equal(one.render(7, state), two.render(7, state))
    assert not np.array_equal(one.render(7, state), one.render(8, state))
    assert not np.array_equal(one.render(7, state), other.render(7, state))


def test_noise_has_the_width_it_is_said_to_have(noisy: Scene) -> None:
    state = (0.0, 0.0, 0.0, 0.0)
    difference = noisy.render(1, state).astype(float) - noisy.render(2, state).astype(float)
    middle = difference[100:350, 100:350]
    assert middle.std() == pytest.approx(noisy.settings.noise_sigma * math.sqrt(2), rel=0.1)
    assert abs(middle.mean()) < 0.05


@pytest.mark.parametrize("dpsi", [0.0, FAST_RAD_S])
def test_psi_of_the_shipped_analysis(noisy: Scene, dpsi: float) -> None:
    """Over a full turn; what is left is the lamp's shading of the ball's rim, not noise."""
    eye, errors = analyser(), []
    for number, psi in enumerate(ANGLES):
        sample = eye.bgr(number, 0.0, 0.0, noisy.render(number, (0.3 * number, 0.0, psi, dpsi)))
        errors.append(math.remainder(sample.psi - psi, math.tau))
    assert math.sqrt(np.mean(np.square(errors))) < 0.004
    assert np.abs(errors).max() < 0.008


@pytest.mark.parametrize("stride", [480, 512])
def test_raw_pictures_give_the_same_ball(noisy: Scene, stride: int) -> None:
    """Planes of a camera, wider rows included; their colour has half the resolution, which costs 0.1 px."""
    plain, raw, apart = analyser(), analyser(), []
    for number, psi in enumerate(ANGLES):
        picture = noisy.render(number, (0.3 * number, 0.0, psi, 0.0))
        planes = np.frombuffer(i420(picture, stride), np.uint8)
        assert len(planes) == stride * 480 * 3 // 2
        one = plain.bgr(number, 0.0, 0.0, picture)
        two = raw.i420(number, 0.0, 0.0, planes, (480, 480, stride))
        apart.append((one.x_px - two.x_px, one.y_px - two.y_px))
    assert np.sqrt(np.mean(np.square(apart), axis=0)).max() < 0.1
    assert np.abs(apart).max() < 0.15


def test_chroma_is_the_mean_of_two_by_two_pixels() -> None:
    """A red column one pixel wide gives half its colour; OpenCV's own conversion would give all of it or nothing."""
    picture = np.full((4, 4, 3), 100, np.uint8)
    picture[:, 1] = (0, 0, 200)
    even = np.full((4, 4, 3), 100, np.uint8)
    even[:, :2] = (50, 50, 150)
    planes = np.frombuffer(i420(picture, 8), np.uint8)
    mean = np.frombuffer(i420(even, 8), np.uint8)
    assert np.array_equal(planes[32:], mean[32:])
    luma = planes[:32].reshape(4, 8)
    assert np.all(luma[:, 4:] == 0) and len(set(luma[0, :4])) == 2
    v = planes[40:].reshape(2, 4)
    assert np.all(v[:, 2:] == 0) and np.all(v[:, 0] > 128) and np.all(v[:, 1] == 128)
