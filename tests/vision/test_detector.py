"""The detector on drawn pictures: exact, inside its gates, right at every edge."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
import pytest
from harness.picture import Look, ball_centre, picture

from hoopd.vision.calibration import PixelToAngle, wrap
from hoopd.vision.detector import BGR_FROM_YUV, YUV_OFFSET, Detector, DetectorSettings

LOOK = Look()
# the colour that `propose` finds for these pictures: the default weights leave the warm hoop at a third of the
# threshold, which pulls the rim of the ball towards the hoop's side by some tenths of a pixel
RING = DetectorSettings(
    weights=(-0.75, -0.5, 1.0),
    threshold=78.0,
    ring_centre_px=LOOK.centre,
    ring_radius_px=LOOK.track_radius,
    ball_radius_px=LOOK.ball_radius,
)
FREE = dataclasses.replace(RING, ring_centre_px=None)
RED = LOOK.ball_bgr
RIM_BIAS_PX = (
    0.2  # hoop outside and wall inside of the ball differ in grey: the centre moves along the radius, not in psi
)


def i420(bgr: np.ndarray, stride: int = 480) -> np.ndarray:
    """Raw frame with chroma averaged over 2 x 2 pixels (cv2 takes the top left one: half a pixel off)."""
    yuv = bgr.astype(float) @ np.linalg.inv(BGR_FROM_YUV).T + YUV_OFFSET
    height, width = bgr.shape[:2]
    chroma = yuv.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
    planes = [yuv[..., 0], chroma[..., 1], chroma[..., 2]]
    padded = [np.pad(p, ((0, 0), (0, (stride - width) * p.shape[1] // width))) for p in planes]
    return np.concatenate([np.clip(np.rint(p), 0, 255).astype(np.uint8).reshape(-1) for p in padded])


def psi_errors(detector: Detector, dpsi: float, search: bool) -> np.ndarray:
    to_angle = PixelToAngle(LOOK.centre)
    errors = []
    for i, psi in enumerate(np.linspace(-math.pi, math.pi, 36, endpoint=False)):
        if search:
            detector.reset()
        found = detector.detect(picture(psi=float(psi), dpsi=dpsi, seed=i))
        assert found is not None
        errors.append(wrap(to_angle(found.x_px, found.y_px) - float(psi)))
    return np.array(errors)


@pytest.mark.parametrize(
    ("dpsi", "limit_rad"),
    [(0.0, 2e-4), pytest.param(5.0, 4e-4, marks=pytest.mark.proof), pytest.param(-12.0, 1e-3, marks=pytest.mark.proof)],
)
def test_psi_is_exact_all_round_under_lamp_gradient_noise_and_motion_blur(dpsi: float, limit_rad: float) -> None:
    errors = psi_errors(Detector(RING), dpsi, search=True)
    assert np.sqrt(np.mean(errors**2)) < limit_rad
    assert abs(errors.mean()) < limit_rad / 3  # unbiased


def test_tracking_gives_the_same_answer_as_the_search() -> None:
    detector = Detector(RING)
    image = picture(psi=0.7)
    first, second = detector.detect(image), detector.detect(image)
    assert first is not None and second is not None
    assert not first.tracking and second.tracking
    assert second[:2] == pytest.approx(first[:2], abs=0.05)
    assert second.radius_px == pytest.approx(LOOK.ball_radius, abs=0.5)
    assert 0.8 < second.confidence <= 1.0


def test_a_ball_at_15_rad_per_s_is_tracked_from_frame_to_frame() -> None:
    detector = Detector(RING)
    found = [detector.detect(picture(psi=15.0 * 0.02 * k, dpsi=15.0, seed=k)) for k in range(20)]
    assert all(f is not None for f in found)
    assert all(f.tracking for f in found[2:] if f is not None)


def test_a_ball_that_jumps_is_searched_again() -> None:
    detector = Detector(RING)
    detector.detect(picture(psi=0.0))
    found = detector.detect(picture(psi=2.5))
    assert found is not None and not found.tracking
    assert found[:2] == pytest.approx(ball_centre(LOOK, 2.5), abs=RIM_BIAS_PX)


def test_no_ball_is_none_and_the_ball_is_found_when_it_returns() -> None:
    detector = Detector(RING)
    detector.detect(picture())
    assert detector.detect(picture(Look(ball=False))) is None
    assert detector.detect(np.zeros((480, 480, 3), np.uint8)) is None
    assert detector.detect(picture()) is not None


@pytest.mark.parametrize("step", [1, 4, 7, 8, 16])
@pytest.mark.parametrize("size", [(480, 480), (481, 483), (400, 470)])
def test_odd_sizes_and_steps(size: tuple[int, int], step: int) -> None:
    look = dataclasses.replace(LOOK, size=size, centre=(230.0, 190.0), track_radius=150.0, hoop_radius=185.0)
    settings = dataclasses.replace(RING, search_step=step, ring_centre_px=look.centre, ring_radius_px=150.0)
    found = Detector(settings).detect(picture(look, psi=-0.4))
    assert found is not None
    assert found[:2] == pytest.approx(ball_centre(look, -0.4), abs=RIM_BIAS_PX)


@pytest.mark.parametrize(
    ("x", "y"),
    [
        (5.0, 240.6),
        (10.0, 240.6),
        (22.0, 240.6),
        (460.3, 240.6),
        (469.0, 240.6),
        (240.3, 10.0),
        (240.3, 469.0),
        (14, 14),
    ],
)
def test_a_ball_at_the_edge_of_the_picture(x: float, y: float) -> None:
    """Half of the ball may be outside: the visible arc gives its centre."""
    look = dataclasses.replace(LOOK, centre=(x, y - 184.0))
    detector = Detector(FREE)
    for image in (picture(look), picture(look, seed=1)):
        found = detector.detect(image)
        assert found is not None
        assert found[:2] == pytest.approx((x, y), abs=0.8)


@pytest.mark.parametrize("dx", range(-40, 41, 8))
@pytest.mark.parametrize("dy", [-30, 0, 30])
def test_a_ball_at_the_edge_of_the_window(dx: int, dy: int) -> None:
    """Wherever the window starts, the answer is that of a centred window or of a search."""
    detector = Detector(FREE)
    detector.detect(picture())
    x, y = ball_centre(LOOK, 0.0)
    moved = np.roll(picture(), (dy, dx), axis=(0, 1))
    found = detector.detect(moved)
    assert found is not None
    assert found[:2] == pytest.approx((x + dx, y + dy), abs=RIM_BIAS_PX)


def with_shape(kind: str) -> np.ndarray:
    """A picture without the ball, with a red object that is no ball on the ring."""
    image = picture(Look(ball=False))
    top = (238, 53)
    shapes = {
        "off the ring": lambda: cv2.circle(image, (238, 237), 22, RED, -1, cv2.LINE_AA),
        "outside": lambda: cv2.circle(image, (30, 30), 22, RED, -1, cv2.LINE_AA),
        "too small": lambda: cv2.circle(image, top, 10, RED, -1, cv2.LINE_AA),
        "too large": lambda: cv2.circle(image, top, 38, RED, -1, cv2.LINE_AA),
        "bar": lambda: cv2.rectangle(image, (190, 45), (290, 61), RED, -1),
        "crescent": lambda: cv2.ellipse(image, top, (24, 24), 0, 0, 170, RED, 12),
        "wall": lambda: cv2.rectangle(image, (0, 0), (479, 90), RED, -1),
    }
    shapes[kind]()
    return image


@pytest.mark.parametrize("kind", ["off the ring", "outside", "too small", "too large", "bar", "crescent", "wall"])
def test_false_red_objects_are_refused(kind: str) -> None:
    image = with_shape(kind)
    assert Detector(RING).detect(image) is None


@pytest.mark.parametrize("kind", ["off the ring", "outside", "too small", "bar", "crescent"])
def test_the_ball_is_found_beside_false_red_objects(kind: str) -> None:
    image = with_shape(kind)
    ball = picture()
    image[390:455, 200:280] = ball[390:455, 200:280]
    found = Detector(RING).detect(image)
    assert found is not None
    assert found[:2] == pytest.approx(ball_centre(LOOK, 0.0), abs=0.2)


@pytest.mark.parametrize("stride", [480, 512])
def test_i420_gives_the_same_ball(stride: int) -> None:
    """A raw frame, with padded rows too, agrees with the converted picture within the chroma's resolution."""
    detector = Detector(RING)
    for k, psi in enumerate((0.0, 0.1, 0.2, 2.0, -1.3)):
        found = detector.detect_i420(i420(picture(psi=psi, seed=k), stride), 480, 480, stride)
        assert found is not None
        assert found[:2] == pytest.approx(ball_centre(LOOK, psi), abs=RIM_BIAS_PX)
        assert found.tracking == (k in (1, 2))


def test_i420_of_the_wrong_size_is_refused() -> None:
    with pytest.raises(ValueError, match="no I420 picture"):
        Detector(RING).detect_i420(np.zeros(100, np.uint8), 480, 480, 480)


def test_a_picture_of_the_wrong_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="height x width x 3"):
        Detector(RING).detect(np.zeros((480, 480), np.uint8))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"threshold": 0.0}, "threshold"),
        ({"search_step": 0}, "search_step"),
        ({"search_step": 60}, "search_step"),
        ({"ball_radius_px": 2.5, "search_step": 1}, "ball_radius_px"),
        ({"window_px": 40}, "window_px"),
        ({"radius_tolerance": 0.0}, "radius_tolerance"),
        ({"ring_radius_px": 0.0}, "ring_radius_px"),
        ({"min_confidence": 2.0}, "min_confidence"),
        ({"weights": (0.0, math.nan, 1.0)}, "weights"),
    ],
)
def test_impossible_settings_are_refused(change: dict[str, object], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        dataclasses.replace(RING, **change)


@pytest.mark.parametrize(("radius", "window", "step"), [(22.0, 64, 8), (30.0, 96, 8), (14.0, 64, 7)])
def test_window_and_step_follow_the_ball(radius: float, window: int, step: int) -> None:
    look = dataclasses.replace(LOOK, ball_radius=radius)
    settings = DetectorSettings.for_ball(
        weights=RING.weights,
        threshold=78.0,
        ball_radius_px=radius,
        ring_centre_px=look.centre,
        ring_radius_px=look.track_radius,
        ring_half_width_px=15.0,
    )
    assert (settings.window_px, settings.search_step) == (window, step)
    found = Detector(settings).detect(picture(look, psi=0.5))
    assert found is not None
    assert found[:2] == pytest.approx(ball_centre(look, 0.5), abs=0.3)
