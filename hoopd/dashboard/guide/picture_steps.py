"""Steps of a calibration that look at pictures: exposure, circle, threshold, zero angle.

Rules of this file: pictures and numbers in, results out; `hoopd.vision` computes; nothing is written.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hoopd.dashboard.calibration import LEAST_COVERAGE, LEAST_GAP, About
from hoopd.dashboard.guide.steps import CurveOfStep, Drawing, StepResult
from hoopd.vision.calibration import NO_PERSPECTIVE, TILT_NOTE_RAD, CalibrationError, Proposal, propose, wrap
from hoopd.vision.circles import Circle
from hoopd.vision.draw import BALL_INK, HOOP_INK, TRACK_INK, draw_circle, draw_zero, enlarge

Image = NDArray[np.uint8]

BRIGHT, MOST_WASHED = 250, 0.15  # the lamp's highlight on a ball is less than a sixth of it
LEAST_LIGHT = 60.0  # of the brightest twentieth: below, noise and ball are of one size
LEAST_PICTURES = 8
STILL_RAD = 0.005  # spread of a ball at rest: a pixel on a track of 182 px
STILL_RAD_S = 0.2  # of the hoop: its own noise is 0.05 rad/s
SIDES = 1.96
SHOWN_PX, QUALITY = 480, 80


class LookedPicture(NamedTuple):
    """One picture as it was sent, and what belongs to it; `scale`: pixels of the camera in one of it."""

    image: Image
    about: About
    scale: float


def exposure(scene: LookedPicture) -> StepResult:
    """Whether there is light enough where hoop and ball are, and not so much that the ball loses its colour."""
    inside, (ball, of_what) = scene.image[_disc(scene)], _ball_pixels(scene)
    brightest = inside.max(axis=1)
    # a pixel of which two channels are at their limit has no colour any more
    washed, light = float(np.mean(np.sort(ball, axis=1)[:, 1] >= BRIGHT)), float(np.percentile(brightest, 95))
    good = washed <= MOST_WASHED and light >= LEAST_LIGHT
    why = f"{washed:.0%} of {of_what} washed out, the brightest twentieth of the picture above {light:.0f} of 255"
    if washed > MOST_WASHED:
        why += ": too bright, less camera.gain or exposure_s, or a softer lamp"
    elif not good:
        why += ": too dark, a lamp first, then camera.gain"
    counts, edges = np.histogram(brightest, 64, (0, 256))
    bars = CurveOfStep.of("pixels", "bars", edges[:-1], counts / max(1, counts.max()))
    drawing = Drawing("brightest channel, 0 to 255", "pixels, share of the most", (bars,), {"limit": float(BRIGHT)})
    return StepResult(good, why, {"washed": washed, "light": light}, drawings=(drawing,), picture=jpeg(scene.image))


def _ball_pixels(scene: LookedPicture) -> tuple[Image, str]:
    """The ball's pixels and what they are called; the hoop's where no ball is found."""
    try:
        ball = propose(scene.image).ball
    except CalibrationError:
        return scene.image[_disc(scene)], "the hoop (no ball is found)"
    return scene.image[_distance(scene.image.shape, ball.x_px, ball.y_px) <= ball.radius_px], "the ball"


def circle(scene: LookedPicture) -> StepResult:
    """The circle on which the ball's centre moves, and the ball's size."""
    found = propose(scene.image)
    x, y, radius, ball = _in_camera(found, scene.scale)
    good = found.hoop_coverage >= LEAST_COVERAGE and found.confidence >= 0.5
    why = f"{found.hoop_coverage:.0%} of the hoop's edge seen, confidence {found.confidence:.2f}"
    part = {
        "vision": {
            "circle_px": {"centre": [round(x, 2), round(y, 2)], "radius": round(radius, 2)},
            "ball_radius_px": round(ball, 2),
            "band_px": round(found.settings().ring_half_width_px * scene.scale, 1),
        }
    }
    now = scene.about.circle_px
    values = {"moved_px": [round(a - b, 2) for a, b in zip((x, y, radius), now, strict=True)]}
    return StepResult(good, why, values, part, notes=_notes(found), picture=jpeg(_drawn(scene.image, found)))


def threshold(scene: LookedPicture) -> StepResult:
    """Weights of the colours and the grey level that tells the ball from its ring."""
    found = propose(scene.image)
    colour, grey = found.colour, _grey(scene.image, found.colour.weights)
    distance = _distance(scene.image.shape, found.ball.x_px, found.ball.y_px)
    ring = abs(_distance(scene.image.shape, *found.track[:2]) - found.track.radius_px) < found.ball.radius_px
    of_ball, beside = grey[distance < 0.8 * found.ball.radius_px], grey[ring & (distance > 1.5 * found.ball.radius_px)]
    good = colour.gap >= LEAST_GAP
    why = f"ball and ring are {colour.gap:.0f} grey levels apart" + ("" if good else ": a lamp, or another background")
    curves = [_share(name, values) for name, values in (("ring", beside), ("ball", of_ball))]
    marks = {"threshold": round(colour.threshold, 1), "in force": scene.about.threshold}
    blue, green, red = colour.weights
    part = {"vision": {"weights": [red, green, blue], "threshold": round(colour.threshold, 1)}}
    seen = np.asarray(np.where(grey >= colour.threshold, 255, grey // 4), np.uint8)
    drawing = Drawing("grey level with these weights", "share of the most", curves, marks)
    return StepResult(good, why, {"gap": colour.gap}, part, (drawing,), _notes(found), picture=jpeg(seen))


def zero(
    positions_px: Sequence[tuple[float, float]], centre_px: tuple[float, float], now_rad: float, hoop_rad_s: float
) -> StepResult:
    """The angle at which the ball rests, over many pictures, each as the detector measured it."""
    cx, cy = centre_px
    # psi = atan2(cx - x, y - cy) - zero
    angles = np.array([math.atan2(cx - x, y - cy) for x, y in positions_px])
    if len(angles) < LEAST_PICTURES:
        return StepResult(False, f"the ball was found in {len(angles)} pictures: {LEAST_PICTURES} at least")
    middle = float(np.angle(np.exp(1j * angles).mean()))
    off = np.array([wrap(angle - middle) for angle in angles])
    mean, spread = middle + float(off.mean()), float(off.std(ddof=1))
    half = SIDES * spread / math.sqrt(len(angles))
    still, upright = spread <= STILL_RAD and hoop_rad_s <= STILL_RAD_S, abs(mean) <= TILT_NOTE_RAD
    why = f"{mean:+.4f} ± {half:.4f} rad of {len(angles)} pictures, {wrap(mean - now_rad):+.4f} from what is in force"
    if not still:
        why += f": the ball or the hoop moves (spread {spread:.3f} rad, hoop {hoop_rad_s:.1f} rad/s)"
    elif not upright:
        why += ": far from the bottom of the picture; a ball that rests elsewhere?"
    drawing = Drawing(
        "picture", "angle of the ball in the picture, rad",
        (CurveOfStep.of("measured", "points", np.arange(len(angles)), middle + off),
         CurveOfStep("mean", "line", [0, len(angles) - 1], [mean, mean])),
    )  # fmt: skip
    part = {"vision": {"zero_angle_rad": round(mean, 5)}}
    values = {"zero_angle_rad": [mean, mean - half, mean + half], "spread_rad": spread}
    return StepResult(still and upright, why, values, part, (drawing,))


def jpeg(image: Image) -> bytes:
    """For the page and for a version."""
    side = max(image.shape[:2])
    if side > SHOWN_PX:
        image = np.asarray(cv2.resize(image, None, fx=SHOWN_PX / side, fy=SHOWN_PX / side), np.uint8)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


def _in_camera(found: Proposal, scale: float) -> tuple[float, float, float, float]:
    """Centre, radius and ball's radius in the camera's own pixels."""
    x, y = ((value + 0.5) * scale - 0.5 for value in found.track[:2])
    return x, y, found.track.radius_px * scale, found.ball.radius_px * scale


def _notes(found: Proposal) -> list[str]:
    return [note for note in found.notes if note != NO_PERSPECTIVE]


def _drawn(image: Image, found: Proposal) -> Image:
    canvas = enlarge(image, 1)
    for one, ink in ((found.hoop, HOOP_INK), (found.track, TRACK_INK), (found.ball, BALL_INK)):
        draw_circle(canvas, Circle(*one), 1, ink)
    draw_zero(canvas, found.track, found.zero_angle_rad, 1)
    return canvas


def _disc(scene: LookedPicture) -> NDArray[np.bool_]:
    """Pixels of the hoop and a little beyond, by the circle in force; all of them where that lies elsewhere."""
    x, y, radius = ((value + 0.5) / scene.scale - 0.5 for value in scene.about.circle_px)
    inside = _distance(scene.image.shape, x, y) <= 1.3 * radius
    return inside if inside.any() else np.ones(scene.image.shape[:2], bool)


def _distance(shape: tuple[int, ...], x: float, y: float) -> NDArray[np.float64]:
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    found: NDArray[np.float64] = np.hypot(columns - x, rows - y)
    return found


def _grey(image: Image, weights: Sequence[float]) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.clip(image @ np.asarray(weights, float), 0.0, 255.0)
    return found


def _share(name: str, values: NDArray[np.float64]) -> CurveOfStep:
    counts, edges = np.histogram(values, 64, (0, 256))
    return CurveOfStep.of(name, "bars", edges[:-1], counts / max(1, counts.max()))
