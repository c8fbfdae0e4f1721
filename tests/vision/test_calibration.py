"""Pixel to angle, and proposals: from drawn pictures, from the real ones and their variants, from runs."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from harness.picture import Image, Look, ball_centre, picture
from samples import sampled

from hoopd.vision.calibration import CalibrationError, PixelToAngle, propose, propose_from_run, wrap
from hoopd.vision.circles import fit_circle, fit_circle_robust
from hoopd.vision.detector import Detector
from hoopd.vision.draw import draw_proposal, draw_run
from tests.shared import shared_path

LOOK = Look()
# measured by hand, +-1.5 px
REAL = {"exp01_meas_pos01": (236.0, 426.0), "exp03_meas_pos01": (235.0, 409.7), "led": (238.5, 423.3)}
TOLERANCE_PX = 3.0
Variant = Callable[[Image, tuple[float, float]], tuple[Image, tuple[float, float]]]


# --- pixel to angle


@pytest.mark.parametrize(
    ("x", "y", "psi"), [(0, 10, 0.0), (-10, 0, math.pi / 2), (10, 0, -math.pi / 2), (0, -10, math.pi)]
)
def test_psi_is_zero_at_the_bottom_and_positive_to_the_left(x: float, y: float, psi: float) -> None:
    assert PixelToAngle((240.0, 240.0))(240.0 + x, 240.0 + y) == pytest.approx(psi)


def test_zero_angle_is_subtracted_and_the_result_wrapped() -> None:
    to_angle = PixelToAngle((0.0, 0.0), zero_angle_rad=-0.5)
    assert to_angle(0.0, 10.0) == pytest.approx(0.5)
    assert to_angle(0.1, -10.0) == pytest.approx(-math.pi + 0.5 + 0.01, abs=1e-3)
    assert wrap(-math.pi) == pytest.approx(math.pi)
    assert wrap(math.pi) == pytest.approx(math.pi)


def test_a_homography_sees_through_a_tilted_camera() -> None:
    h = np.array([[0.0, 0.45, -108.0], [-0.45, 0.0, 108.0], [2e-4, -3e-4, 1.0]])
    to_angle = PixelToAngle.from_homography(h, zero_angle_rad=0.1)
    for psi in np.linspace(-3.0, 3.0, 13):
        p = np.linalg.solve(h, [85.0 * math.cos(psi), 85.0 * math.sin(psi), 1.0])
        assert wrap(to_angle(p[0] / p[2], p[1] / p[2]) - (psi - 0.1)) == pytest.approx(0.0, abs=1e-9)
        scaled = PixelToAngle.from_homography(-h, zero_angle_rad=0.1)
        assert scaled(p[0] / p[2], p[1] / p[2]) == pytest.approx(to_angle(p[0] / p[2], p[1] / p[2]))


@pytest.mark.parametrize("numbers", [(1.0,) * 9, (1.0,) * 8, (math.nan,) * 9])
def test_a_homography_that_is_none_is_refused(numbers: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="homography"):
        PixelToAngle(homography=numbers)


@pytest.mark.parametrize("name", ["exp01", "exp03"])
def test_real_homographies_agree_with_the_circle_in_sign_and_zero(name: str) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    h = scipy_io.loadmat(shared_path(f"frames/{name}_calibData_hom.mat"))["H"]
    by_plane = PixelToAngle.from_homography(h)
    x, y = REAL[f"{name}_meas_pos01"]
    assert abs(by_plane(x, y)) < math.radians(2.0)
    found = propose(real(f"{name}_meas_pos01"))
    by_circle = found.pixel_to_angle()
    for psi in np.linspace(-1.5, 1.5, 7):
        px = found.track.x_px - found.track.radius_px * math.sin(psi)
        py = found.track.y_px + found.track.radius_px * math.cos(psi)
        # one picture knows no perspective: some 4 px of a centre's error on 184 px
        assert wrap(by_plane(px, py) - by_circle(px, py)) == pytest.approx(0.0, abs=0.04)


# --- one picture


@pytest.mark.parametrize("psi", [0.0, 0.05, -0.08])
@pytest.mark.parametrize(
    "look",
    [
        LOOK,
        Look(hoop_bgr=(170, 70, 20), wall_bgr=(215, 235, 240)),
        Look(hoop_bgr=(30, 75, 95), wall_bgr=(3, 5, 6), ball_bgr=(1, 6, 60), noise=2.0),
        Look(size=(420, 520), centre=(270.0, 205.0), hoop_radius=190.0, track_radius=152.0, ball_radius=18.0),
    ],
    ids=["white", "blue on bright", "dark", "other size"],
)
def test_drawn_pictures_give_ball_circle_and_zero(look: Look, psi: float) -> None:
    found = propose(picture(look, psi=psi))
    assert found.ball[:2] == pytest.approx(ball_centre(look, psi), abs=0.5)
    assert found.ball.radius_px == pytest.approx(look.ball_radius, abs=1.5)
    assert found.track[:2] == pytest.approx(look.centre, abs=1.0)
    assert found.track.radius_px == pytest.approx(look.track_radius, abs=1.0)
    assert found.hoop.radius_px == pytest.approx(look.hoop_radius, abs=1.5)
    assert found.zero_angle_rad == pytest.approx(psi, abs=0.006)
    assert found.pixel_to_angle()(*found.ball[:2]) == pytest.approx(0.0, abs=1e-12)
    assert found.confidence > 0.8
    assert any("perspective" in note for note in found.notes)


def test_the_proposed_settings_find_the_ball_all_round() -> None:
    detector = Detector(propose(picture()).settings())
    to_angle = propose(picture()).pixel_to_angle()
    errors = []
    for psi in np.linspace(-3.1, 3.1, 21):
        detector.reset()
        found = detector.detect(picture(psi=float(psi), dpsi=3.0, seed=3))
        assert found is not None
        errors.append(wrap(to_angle(found.x_px, found.y_px) - float(psi)))
    assert np.sqrt(np.mean(np.square(errors))) < 0.004


def test_a_second_ball_on_the_ring_is_named() -> None:
    image = picture()
    image[390:455, 20:100] = 0
    other = picture(psi=1.2)
    x, y = (round(v) for v in ball_centre(LOOK, 1.2))
    image[y - 30 : y + 30, x - 30 : x + 30] = other[y - 30 : y + 30, x - 30 : x + 30]
    assert any("second ball" in note for note in propose(image).notes)


def test_a_ball_far_from_the_bottom_is_named() -> None:
    assert any("at rest" in note for note in propose(picture(psi=0.9)).notes)


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (picture(Look(ball=False)), "no ball found"),
        (picture(Look(ball_bgr=(200, 60, 40))), "no ball found"),
        (np.zeros((480, 480, 3), np.uint8), "no hoop found"),
        (np.full((480, 480, 3), 255, np.uint8), "no hoop found"),
        (np.random.default_rng(0).integers(0, 256, (480, 480, 3)).astype(np.uint8), "no hoop found"),
        (np.zeros((8, 8, 3), np.uint8), "no hoop found"),
        (np.zeros((1, 1, 3), np.uint8), "no hoop found"),
    ],
    ids=["no ball", "blue ball", "black", "white", "noise", "tiny", "one pixel"],
)
def test_what_lacks_hoop_or_ball_says_so(image: Image, reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        propose(image)


# --- the real pictures


def real(name: str) -> Image:
    return np.asarray(cv2.imread(str(shared_path(f"frames/{name}.png"))), np.uint8)


def scaled(factor: float) -> Variant:
    return lambda im, c: (np.clip(np.rint(im * factor), 0, 255).astype(np.uint8), c)


def mirrored(code: int) -> Variant:
    def change(im: Image, c: tuple[float, float]) -> tuple[Image, tuple[float, float]]:
        x = im.shape[1] - 1 - c[0] if code in (1, -1) else c[0]
        y = im.shape[0] - 1 - c[1] if code in (0, -1) else c[1]
        return np.asarray(cv2.flip(im, code), np.uint8), (x, y)

    return change


def moved(dx: float, dy: float, border: int, degrees: float = 0.0) -> Variant:
    def change(im: Image, c: tuple[float, float]) -> tuple[Image, tuple[float, float]]:
        matrix = cv2.getRotationMatrix2D((239.5, 239.5), degrees, 1.0) + np.array([[0, 0, dx], [0, 0, dy]])
        x, y = matrix @ np.array([*c, 1.0])
        out = cv2.warpAffine(im, matrix, (im.shape[1], im.shape[0]), borderMode=border)
        return np.asarray(out, np.uint8), (float(x), float(y))

    return change


def noisy(sigma: float) -> Variant:
    def change(im: Image, c: tuple[float, float]) -> tuple[Image, tuple[float, float]]:
        noise = np.random.default_rng(5).normal(0.0, sigma, im.shape)
        return np.clip(np.rint(im + noise), 0, 255).astype(np.uint8), c

    return change


def hue_turned(degrees: int) -> Variant:
    def change(im: Image, c: tuple[float, float]) -> tuple[Image, tuple[float, float]]:
        hsv = cv2.cvtColor(im, cv2.COLOR_BGR2HSV)
        hsv[..., 0] = (hsv[..., 0].astype(int) + degrees // 2) % 180
        return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR), np.uint8), c

    return change


def tinted(*bgr: float) -> Variant:
    return lambda im, c: (np.clip(np.rint(im * np.array(bgr)), 0, 255).astype(np.uint8), c)


VARIANTS: dict[str, Variant] = {
    "plain": lambda im, c: (im, c),
    "left-right": mirrored(1),
    "upside down": mirrored(0),
    "both": mirrored(-1),
    "shift reflected": moved(40, -30, cv2.BORDER_REFLECT_101),
    "shift edge-filled": moved(-45, 20, cv2.BORDER_REPLICATE),
    "shift black": moved(60, -60, cv2.BORDER_CONSTANT),
    "turned": moved(0, 0, cv2.BORDER_REPLICATE, 8.0),
    "0.7": scaled(0.7),
    "0.5": scaled(0.5),
    "0.35": scaled(0.35),
    "brighter": scaled(1.3),
    "noise": noisy(10.0),
    "blur": lambda im, c: (np.asarray(cv2.GaussianBlur(im, (0, 0), 2.0), np.uint8), c),
    "hue": hue_turned(-12),
    "hue to orange": hue_turned(12),
    "cold": tinted(1.3, 1.0, 0.8),
    "warm": tinted(0.7, 1.0, 1.2),
}


@pytest.mark.parametrize("variant", sampled(VARIANTS, ["0.35", "hue to orange"]))
@pytest.mark.parametrize("name", REAL)
def test_the_real_ball_is_found(name: str, variant: str) -> None:
    image, (x, y) = VARIANTS[variant](real(name), REAL[name])
    found = propose(image)
    assert math.hypot(found.ball.x_px - x, found.ball.y_px - y) < TOLERANCE_PX
    assert 0.72 < found.track.radius_px / found.hoop.radius_px < 0.9
    seen = Detector(found.settings()).detect(image)
    assert seen is not None
    assert math.hypot(seen.x_px - x, seen.y_px - y) < TOLERANCE_PX


@pytest.mark.parametrize("name", REAL)
def test_without_its_ball_a_real_picture_has_none(name: str) -> None:
    """exp03 has another red ball at its right edge: it must not be taken."""
    image, (x, y) = real(name), REAL[name]
    spot = (round(x), round(y))
    mask = np.asarray(cv2.circle(np.zeros(image.shape[:2], np.uint8), spot, 34, 255, -1), np.uint8)
    painted = [np.asarray(cv2.inpaint(image, mask, 5, cv2.INPAINT_TELEA), np.uint8), image[:360], image[:380, :, :]]
    painted += [np.asarray(cv2.circle(image.copy(), spot, 30, ink, -1), np.uint8) for ink in ((0, 0, 0), (200, 60, 40))]
    for picture_without in painted:
        with pytest.raises(CalibrationError, match="found"):
            propose(picture_without)


# --- a run of positions


def swing(decay: float = 0.15, offset: float = 0.03, noise_px: float = 0.3, seconds: float = 12.0) -> np.ndarray:
    t = np.arange(0.0, seconds, 0.02)
    psi = 0.9 * np.exp(-decay * t) * np.cos(8.5 * t) + offset
    rng = np.random.default_rng(1)
    points = np.column_stack([238.0 - 182.0 * np.sin(psi), 236.0 + 182.0 * np.cos(psi)])
    return points + rng.normal(0.0, noise_px, points.shape)


def test_a_free_swing_gives_circle_and_zero() -> None:
    found = propose_from_run(swing())
    assert found.track == pytest.approx((238.0, 236.0, 182.0), abs=0.6)
    assert found.residual_px == pytest.approx(0.3, abs=0.1)
    assert found.zero_from == "swing"
    assert found.zero_angle_rad == pytest.approx(0.03, abs=0.01)


def test_rest_after_a_swing_gives_the_zero() -> None:
    found = propose_from_run(swing(decay=1.2, noise_px=0.2))
    assert found.zero_from == "rest"
    assert found.zero_angle_rad == pytest.approx(0.03, abs=0.003)


def test_a_ball_that_rests_for_most_of_a_run_does_not_draw_the_circle_into_its_noise() -> None:
    found = propose_from_run(swing(decay=2.5, noise_px=0.5, seconds=40.0))
    assert found.track == pytest.approx((238.0, 236.0, 182.0), abs=5.0)
    assert found.kept > 0.95 and found.residual_px == pytest.approx(0.5, abs=0.1)


def test_outliers_and_missing_positions_do_not_move_the_circle() -> None:
    points = swing()
    rng = np.random.default_rng(2)
    points[rng.choice(len(points), 90, replace=False)] = rng.uniform(0.0, 480.0, (90, 2))
    points[::7] = np.nan
    found = propose_from_run(points)
    assert found.track == pytest.approx((238.0, 236.0, 182.0), abs=1.0)
    assert 0.8 < found.kept < 0.95


def test_a_run_round_and_round_has_a_circle_but_no_zero() -> None:
    psi = np.linspace(0.0, 12.0, 300)
    found = propose_from_run(np.column_stack([238.0 - 182.0 * np.sin(psi), 236.0 + 182.0 * np.cos(psi)]))
    assert found.zero_from == "none"
    assert any("not determined" in note for note in found.notes)


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.zeros((5, 2)), "too few"),
        (np.full((50, 2), np.nan), "too few"),
        (np.full((50, 2), 240.0), "does not move"),
        (np.zeros((50, 3)), "N x 2"),
    ],
)
def test_runs_without_a_circle_say_so(points: np.ndarray, reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        propose_from_run(points)


def test_circle_fits() -> None:
    angle = np.linspace(0.0, 2.0, 40)
    points = np.column_stack([10.0 + 5.0 * np.cos(angle), -3.0 + 5.0 * np.sin(angle)])
    assert fit_circle(points) == pytest.approx((10.0, -3.0, 5.0))
    points[::5] += 4.0
    assert fit_circle_robust(points).circle == pytest.approx((10.0, -3.0, 5.0), abs=0.05)


# --- drawings


def test_drawings_show_the_picture_and_the_numbers() -> None:
    image = picture()
    drawn = draw_proposal(image, propose(image))
    assert drawn.shape[1] == 960 and drawn.shape[0] > 960
    assert (drawn[:960] != np.repeat(np.repeat(image, 2, 0), 2, 1)).any(axis=2).sum() > 2000
    run = propose_from_run(swing())
    assert draw_run(swing(), run).shape[2] == 3
    assert draw_run(swing(), run, image).shape[1] == 960


def test_positions_on_a_line_are_no_circle() -> None:
    line = np.column_stack([np.linspace(0.0, 400.0, 200), np.linspace(0.0, 400.0, 200)])
    scattered = np.random.default_rng(1).uniform(0.0, 480.0, (300, 2))
    for points in (line, scattered):
        with pytest.raises(CalibrationError):
            propose_from_run(points)
