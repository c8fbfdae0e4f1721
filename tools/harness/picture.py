"""Synthetic pictures for the vision tests: hoop, spokes, screws, red ball, lamp gradient, noise, motion blur.

Drawn apart from the rig's renderer on purpose: a mistake made there is not repeated here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
OVERSAMPLING = 2
SHIFT = 5


@dataclass(frozen=True)
class Look:
    """What a picture shows; lengths in px, psi positive to the left."""

    size: tuple[int, int] = (480, 480)  # height, width
    centre: tuple[float, float] = (238.3, 236.8)
    hoop_radius: float = 228.0
    track_radius: float = 184.0
    ball_radius: float = 22.0
    theta: float = 0.3
    hoop_bgr: tuple[int, int, int] = (150, 190, 200)
    wall_bgr: tuple[int, int, int] = (45, 40, 38)
    ball_bgr: tuple[int, int, int] = (30, 45, 205)
    lamp: float = 0.25  # relative brightness from right edge to left edge
    noise: float = 3.0  # grey levels
    blur: float = 0.7  # px
    ball: bool = True


def ball_centre(look: Look, psi: float) -> tuple[float, float]:
    """True centre of the ball."""
    return look.centre[0] - look.track_radius * math.sin(psi), look.centre[1] + look.track_radius * math.cos(psi)


def fixed(x: float, y: float) -> tuple[int, int]:
    scale = OVERSAMPLING
    return round(((x + 0.5) * scale - 0.5) * 2**SHIFT), round(((y + 0.5) * scale - 0.5) * 2**SHIFT)


def disc(canvas: Image, centre: tuple[float, float], radius: float, bgr: tuple[int, int, int]) -> None:
    cv2.circle(canvas, fixed(*centre), round(radius * OVERSAMPLING * 2**SHIFT), bgr, -1, cv2.LINE_AA, SHIFT)


def polar(look: Look, angle: float, radius: float) -> tuple[float, float]:
    return look.centre[0] + radius * math.cos(angle), look.centre[1] + radius * math.sin(angle)


def draw_sharp(look: Look, psi: float) -> NDArray[np.float32]:
    """One instant without noise."""
    height, width = look.size
    canvas = np.full((height * OVERSAMPLING, width * OVERSAMPLING, 3), look.wall_bgr, np.uint8)
    disc(canvas, look.centre, look.hoop_radius, look.hoop_bgr)
    disc(canvas, look.centre, look.track_radius + look.ball_radius, (60, 70, 72))
    disc(canvas, look.centre, look.track_radius + 0.6 * look.ball_radius, look.wall_bgr)
    for k in range(4):
        angle = look.theta + k * math.pi / 2
        start, end = fixed(*polar(look, angle, 90.0)), fixed(*polar(look, angle, look.track_radius + 15.0))
        cv2.line(canvas, start, end, look.hoop_bgr, 26 * OVERSAMPLING, cv2.LINE_AA, SHIFT)
    disc(canvas, look.centre, 95.0, look.hoop_bgr)
    for k in range(12):
        disc(canvas, polar(look, look.theta + k * math.pi / 6, look.hoop_radius - 8.0), 5.0, (90, 100, 100))
    if look.ball:
        x, y = ball_centre(look, psi)
        disc(canvas, (x, y), look.ball_radius, look.ball_bgr)
        disc(canvas, (x - 5.0, y - 7.0), 2.5, (200, 205, 235))  # highlight
    return cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)


def picture(
    look: Look | None = None, psi: float = 0.0, dpsi: float = 0.0, exposure_s: float = 0.005, seed: int = 0
) -> Image:
    """A camera picture; psi is that of the middle of the exposure."""
    look = look or Look()
    shares = np.linspace(-0.5, 0.5, 8) if dpsi else [0.0]
    mean = np.mean([draw_sharp(look, psi + dpsi * exposure_s * share) for share in shares], axis=0)
    lamp = 1.0 + look.lamp * np.linspace(0.5, -0.5, look.size[1])[None, :, None]
    blurred = cv2.GaussianBlur(mean * lamp, (0, 0), look.blur) if look.blur else mean * lamp
    noise = np.random.default_rng(seed).normal(0.0, look.noise, mean.shape)
    return np.asarray(np.clip(np.rint(blurred + noise), 0, 255), np.uint8)
