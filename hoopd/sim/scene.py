"""Pictures of the rig: a hoop that turns, a red ball that rolls in it, a lamp, noise and motion blur.

Rules of this file: a picture is a function of settings, state and picture number; the ball's centre is exact to a few
hundredths of a pixel; light is added where it is linear (before the camera's curve) only for the blur of the ball.
psi is positive to the picture's left and zero at the bottom; theta turns the same way (clockwise, from the bottom
to the left).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, hypot, isfinite, pi, sin

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Colour = tuple[float, float, float]  # B, G, R

# Everything round is drawn this many times larger and reduced with area averaging: smooth edges without a bias.
SUPERSAMPLE = 4
# Noise pictures drawn once; a picture takes one at a random place, so that no two pictures share their noise.
NOISE_MARGIN = 64
SHIFT_BITS = 6  # cv2 draws with coordinates in 1/64 px


@dataclass(frozen=True)
class SceneSettings:
    """What the camera looks at; lengths in pixels."""

    width: int = 480
    height: int = 480
    centre: tuple[float, float] = (240.0, 240.0)
    track_radius: float = 182.0  # of the ball's centre
    ball_radius: float = 23.0
    inner_radius: float = 0.0  # of the inner hoop, on whose outside a ball may roll; 0: there is none
    exposure_s: float = 0.005
    noise_sigma: float = 2.5  # grey levels
    lamp: float = 0.25  # brightness lost from the lit corner to the opposite one
    ball_colour: Colour = (38.0, 30.0, 205.0)
    hoop_colour: Colour = (196.0, 214.0, 222.0)
    background: Colour = (46.0, 44.0, 42.0)
    seed: int = 0


class Scene:
    """Renders one picture after the other."""

    def __init__(self, settings: SceneSettings) -> None:
        self.settings = settings
        self._still = _still_parts(settings)
        self._hoop = _hoop_sprite(settings)
        self._outside = _outside(settings)
        self._lamp = _lamp(settings)
        self._noise = _noise(settings)

    def render(
        self,
        frame: int,
        state: tuple[float, float, float, float],
        *,
        ball: bool = True,
        red_object: tuple[float, float, float] | None = None,
        brightness: float = 1.0,
        distance: float = 1.0,
    ) -> Image:
        """Picture of shape (height, width, 3), B G R; `red_object` is x, y, radius of something red elsewhere,
        `distance` the ball's from the centre, in shares of its track's radius."""
        theta, _, psi, dpsi = state
        picture = self._turned(theta)
        if red_object is not None:
            self._blend(picture, red_object[0], red_object[1], red_object[2], 0.0, 0.0)
        if ball and isfinite(psi):
            self._ball(picture, psi, dpsi, distance)
        lit = cv2.multiply(picture, self._lamp, scale=brightness, dtype=cv2.CV_8U)
        return self._with_noise(np.asarray(lit, np.uint8), frame)

    def paint_ball(self, picture: Image, psi: float) -> None:
        """Lay a ball at rest over a finished picture: without the camera's noise and lamp."""
        self._ball(picture, psi, 0.0)

    def ball_centre(self, psi: float, distance: float = 1.0) -> tuple[float, float]:
        """Where the ball's centre is in the picture."""
        cx, cy = self.settings.centre
        radius = self.settings.track_radius * distance
        return cx - radius * sin(psi), cy + radius * cos(psi)

    def _turned(self, theta: float) -> Image:
        """Hoop turned by theta over what stands still."""
        # cv2 turns counter-clockwise for positive angles; theta turns clockwise in the picture.
        matrix = cv2.getRotationMatrix2D(self.settings.centre, -degrees(theta % (2 * pi)), 1.0)
        size = (self.settings.width, self.settings.height)
        picture = cv2.warpAffine(self._hoop, matrix, size, flags=cv2.INTER_LINEAR)
        cv2.copyTo(self._still, self._outside, picture)
        return picture  # type: ignore[return-value]

    def _ball(self, picture: Image, psi: float, dpsi: float, distance: float = 1.0) -> None:
        x, y = self.ball_centre(psi, distance)
        blur = dpsi * self.settings.exposure_s * self.settings.track_radius * distance
        # along the track: from the bottom to the left
        self._blend(picture, x, y, self.settings.ball_radius, -cos(psi) * blur, -sin(psi) * blur)

    def _blend(self, picture: Image, x: float, y: float, radius: float, blur_x: float, blur_y: float) -> None:
        """Lay a shaded disc, smeared along (blur_x, blur_y), over the picture."""
        reach = int(radius + hypot(blur_x, blur_y) / 2 + 3)
        x0, y0 = int(x) - reach, int(y) - reach
        left, top = max(0, x0), max(0, y0)
        right, bottom = min(self.settings.width, x0 + 2 * reach), min(self.settings.height, y0 + 2 * reach)
        if left >= right or top >= bottom:
            return
        cover = _smeared_disc(2 * reach, x - x0, y - y0, radius, blur_x, blur_y)
        shade = _shading(2 * reach, x - x0, y - y0, radius)
        part = (slice(top - y0, bottom - y0), slice(left - x0, right - x0))
        alpha = cover[part][..., None]
        colour = np.array(self.settings.ball_colour, np.float32) * shade[part][..., None]
        patch = picture[top:bottom, left:right].astype(np.float32)
        picture[top:bottom, left:right] = np.clip(patch + alpha * (colour - patch) + 0.5, 0, 255).astype(np.uint8)

    def _with_noise(self, picture: Image, frame: int) -> Image:
        if self._noise is None:
            return picture
        dx, dy = np.random.default_rng([self.settings.seed, 3, frame]).integers(0, NOISE_MARGIN, 2)
        noise = self._noise[dy : dy + self.settings.height, dx : dx + self.settings.width]
        return cv2.add(picture, noise, dtype=cv2.CV_8U)  # type: ignore[return-value]


def _smeared_disc(size: int, x: float, y: float, radius: float, blur_x: float, blur_y: float) -> NDArray[np.float32]:
    """Share of each pixel that the moving disc covered; soft by one pixel at its rim."""
    blur = hypot(blur_x, blur_y)
    steps = 1 if blur < 0.5 else min(16, 2 + int(blur))
    total = np.zeros((size, size), np.float32)
    for k in range(steps):
        along = (k + 0.5) / steps - 0.5
        total += np.clip(radius + 0.5 - _distance(size, x + along * blur_x, y + along * blur_y), 0.0, 1.0)
    return (total / steps).astype(np.float32)


def _distance(size: int, x: float, y: float) -> NDArray[np.float32]:
    across = (np.arange(size, dtype=np.float32) - np.float32(x)) ** 2
    down = (np.arange(size, dtype=np.float32) - np.float32(y)) ** 2
    away = np.empty((size, size), np.float32)
    np.sqrt(down[:, None] + across[None, :], out=away)
    return away


def _shading(size: int, x: float, y: float, radius: float) -> NDArray[np.float32]:
    """Brightness over a sphere lit from above left, with a small highlight."""
    body = 1.0 - 0.28 * (_distance(size, x - 0.35 * radius, y - 0.45 * radius) / radius) ** 2 / 2
    spot = 0.25 * np.exp(-((_distance(size, x - 0.3 * radius, y - 0.4 * radius) / (0.22 * radius)) ** 2))
    return np.asarray(np.clip(body + spot, 0.3, 1.25), np.float32)


# --- what is drawn once -------------------------------------------------------------------------------------------


def _still_parts(s: SceneSettings) -> Image:
    """Wall and table behind the hoop."""
    picture = np.empty((s.height, s.width, 3), np.float32)
    picture[:] = s.background
    picture[: s.height // 3] += 10.0
    table = int(0.93 * s.height)
    picture[table:] = (70.0, 92.0, 118.0)
    return picture.astype(np.uint8)


def _outside(s: SceneSettings) -> Image:
    """255 where the hoop never is: there the picture stands still."""
    away = _distance(max(s.width, s.height), *s.centre)[: s.height, : s.width]
    return np.where(away > s.track_radius + 2.0 * s.ball_radius, 255, 0).astype(np.uint8)


def _hoop_sprite(s: SceneSettings) -> Image:
    """The hoop at theta = 0 and the dark wall between its spokes, with smooth edges."""
    scale = SUPERSAMPLE
    size = (s.height * scale, s.width * scale)
    colour = np.empty((*size, 3), np.uint8)
    colour[:] = s.background
    track, ball = s.track_radius, s.ball_radius
    _disc(colour, s, track + 2.0 * ball, s.hoop_colour)
    _disc(colour, s, track + 0.55 * ball, s.background)
    for inner, outer, dark in (
        (track + 0.55 * ball, track + 0.75 * ball, 0.45),
        (track + 0.9 * ball, track + 0.97 * ball, 0.6),
    ):
        _ring(colour, s, (inner, outer), tuple(dark * c for c in s.hoop_colour))
    for k in range(4):
        _spoke(colour, s, k * pi / 2 + pi / 4)
    _disc(colour, s, 0.5 * track, s.hoop_colour)
    _ring(colour, s, (0.36 * track, 0.38 * track), tuple(0.75 * c for c in s.hoop_colour))
    for k in range(8):
        _screw(colour, s, k * pi / 4 + 0.2, track + 1.55 * ball, 0.22 * ball)
        _screw(colour, s, k * pi / 4, 0.25 * track, 0.2 * ball)
    if s.inner_radius > 0.0:
        _ring(colour, s, (0.86 * s.inner_radius, s.inner_radius), tuple(0.6 * c for c in s.hoop_colour))
    _disc(colour, s, 0.05 * track, (30.0, 30.0, 30.0))
    return cv2.resize(colour, (s.width, s.height), interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


def _place(s: SceneSettings, x: float, y: float) -> tuple[int, int]:
    """Picture coordinates in the supersampled sprite, in units of 1/64 px; pixel centres stay pixel centres."""
    unit = 1 << SHIFT_BITS
    return round(((x + 0.5) * SUPERSAMPLE - 0.5) * unit), round(((y + 0.5) * SUPERSAMPLE - 0.5) * unit)


def _disc(image: Image, s: SceneSettings, radius: float, colour: object) -> None:
    _dot(image, s, s.centre, radius, colour)


def _dot(image: Image, s: SceneSettings, at: tuple[float, float], radius: float, colour: object) -> None:
    size = round(radius * SUPERSAMPLE * (1 << SHIFT_BITS))
    cv2.circle(image, _place(s, *at), size, colour, -1, cv2.LINE_8, SHIFT_BITS)  # type: ignore[call-overload]


def _ring(image: Image, s: SceneSettings, radii: tuple[float, float], colour: object) -> None:
    middle, width = (radii[0] + radii[1]) / 2, radii[1] - radii[0]
    size = round(middle * SUPERSAMPLE * (1 << SHIFT_BITS))
    thickness = max(1, round(width * SUPERSAMPLE))
    cv2.circle(image, _place(s, *s.centre), size, colour, thickness, cv2.LINE_8, SHIFT_BITS)  # type: ignore[call-overload]


def _spoke(colour: Image, s: SceneSettings, angle: float) -> None:
    """A pair of bars from the hub to the ring, as on the device."""
    for side in (-1.0, 1.0):
        off = side * 0.22 * s.track_radius
        inner, outer, half = 0.4 * s.track_radius, s.track_radius + 0.8 * s.ball_radius, 0.07 * s.track_radius
        along, across = (cos(angle), sin(angle)), (-sin(angle), cos(angle))
        corners = [
            (s.centre[0] + r * along[0] + w * across[0], s.centre[1] + r * along[1] + w * across[1])
            for r, w in ((inner, off - half), (outer, off - half), (outer, off + half), (inner, off + half))
        ]
        points = np.array([_place(s, x, y) for x, y in corners], np.int32)
        shade = 0.94 if side > 0 else 0.9
        cv2.fillConvexPoly(colour, points, tuple(shade * c for c in s.hoop_colour), cv2.LINE_8, SHIFT_BITS)


def _screw(image: Image, s: SceneSettings, angle: float, radius: float, size: float) -> None:
    at = (s.centre[0] + radius * cos(angle), s.centre[1] + radius * sin(angle))
    _dot(image, s, at, size, (110.0, 118.0, 122.0))
    _dot(image, s, (at[0] - 0.2 * size, at[1] - 0.25 * size), 0.5 * size, (190.0, 196.0, 200.0))


def _lamp(s: SceneSettings) -> NDArray[np.float32]:
    """Brightness over the picture: a lamp at the upper left."""
    down = np.linspace(0.0, 1.0, s.height, dtype=np.float32)[:, None]
    across = np.linspace(0.0, 1.0, s.width, dtype=np.float32)[None, :]
    light = 1.0 + 0.3 * s.lamp - s.lamp * (0.6 * down + 0.4 * across)
    return np.repeat(light[..., None], 3, axis=2)


def _noise(s: SceneSettings) -> NDArray[np.int16] | None:
    if s.noise_sigma <= 0.0:
        return None
    rng = np.random.default_rng([s.seed, 4])
    shape = (s.height + NOISE_MARGIN, s.width + NOISE_MARGIN, 3)
    return np.rint(rng.normal(0.0, s.noise_sigma, shape)).astype(np.int16)
