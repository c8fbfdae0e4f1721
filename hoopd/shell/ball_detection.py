"""From picture to camera sample: the configured detector and the way from pixel to angle.

Rules of this file: joins vision to the records of the tick; no camera, no clock.
"""

from __future__ import annotations

import zlib
from dataclasses import replace
from math import cos, nan, sin, tau
from statistics import fmean

import numpy as np

from hoopd.core.records import CameraSample
from hoopd.files.reading import InputError
from hoopd.shell.config import Vision
from hoopd.vision.calibration import PixelToAngle
from hoopd.vision.detector import Detection, Detector, DetectorSettings, Image, i420_planes

# Side of the four squares by which equal pictures are known: the hoop is a circle, its picture a rectangle.
CORNER_PX = 32
# Of the circle, by which a homography's track is measured.
CIRCLE_POINTS = 36


class Analyser:
    """Finds the ball in one picture after the other."""

    def __init__(self, vision: Vision, minimum_confidence: float) -> None:
        self._detector = Detector(detector_settings(vision, minimum_confidence))
        self._to_angle = _pixel_to_angle(vision)
        self._track = track_radius(vision, self._to_angle)
        self._band = vision.band_px / vision.circle_px.radius
        self._inner = vision.inner_px / vision.circle_px.radius

    def reset(self) -> None:
        """Forget where the ball was: the camera started again."""
        self._detector.reset()

    def bgr(self, frame: int, t: float, t_arrival: float, picture: Image) -> CameraSample:
        """Sample from a picture of shape (height, width, 3), channels B, G, R."""
        return self._sample(frame, t, t_arrival, self._detector.detect(picture), corners_of(picture))

    def i420(self, frame: int, t: float, t_arrival: float, planes: Image, size: tuple[int, int, int]) -> CameraSample:
        """Sample from the planes of a YUV 4:2:0 picture; size is width, height, stride."""
        found = self._detector.detect_i420(planes, *size)
        return self._sample(frame, t, t_arrival, found, corners_of(i420_planes(planes, *size)[0]))

    def _sample(self, frame: int, t: float, t_arrival: float, found: Detection | None, corners: int) -> CameraSample:
        if found is None:
            return CameraSample(frame, t, t_arrival, nan, 0.0, nan, nan, corners)
        direction, distance = self._to_angle(found.x_px, found.y_px), self._distance(found.x_px, found.y_px)
        on_inner = self._inner > 0.0 and abs(distance - self._inner) < self._band
        if distance < 1.0 - self._band and not on_inner:  # its place is known, but it is no ball on a hoop
            return CameraSample(frame, t, t_arrival, nan, 0.0, found.x_px, found.y_px, corners, direction, distance)
        return CameraSample(
            frame, t, t_arrival, direction, found.confidence, found.x_px, found.y_px, corners, direction, distance
        )

    def _distance(self, x_px: float, y_px: float) -> float:
        """Of the ball from the axis, in shares of its track's radius."""
        return self._to_angle.distance(x_px, y_px) / self._track


def corners_of(picture: Image) -> int:
    """Checksum of the four corners, in which a sensor's noise is all that changes; 0 when they are of one grey alone,
    black or clipped: such a camera shows no noise."""
    n = CORNER_PX
    squares = [
        picture[rows, columns] for rows in (slice(n), slice(-n, None)) for columns in (slice(n), slice(-n, None))
    ]
    data = b"".join(np.ascontiguousarray(square).tobytes() for square in squares)
    if data.count(data[0]) == len(data):
        return 0
    return zlib.crc32(data) or 1


def detector_settings(vision: Vision, minimum_confidence: float) -> DetectorSettings:
    """What the configuration tells the detector; InputError when no picture could satisfy it."""
    red, green, blue = vision.weights
    try:
        settings = DetectorSettings.for_ball(
            weights=(blue, green, red),
            threshold=vision.threshold,
            ball_radius_px=vision.ball_radius_px,
            ring_centre_px=vision.circle_px.centre,
            ring_radius_px=vision.circle_px.radius,
            ring_half_width_px=vision.band_px,
            inside=vision.flying or vision.inner_px > 0.0,
        )
        return replace(settings, min_confidence=minimum_confidence)
    except ValueError as error:
        raise InputError("configuration", "vision", str(error)) from None


def track_radius(vision: Vision, to_angle: PixelToAngle) -> float:
    """Radius of the ball's track as distances of `PixelToAngle` are measured: pixels, or the mean through a homography
    of the circle on which the picture shows it."""
    (x, y), radius = vision.circle_px.centre, vision.circle_px.radius
    if vision.homography is None:
        return radius
    around = [k * tau / CIRCLE_POINTS for k in range(CIRCLE_POINTS)]
    return fmean(to_angle.distance(x + radius * cos(a), y + radius * sin(a)) for a in around)


def _pixel_to_angle(vision: Vision) -> PixelToAngle:
    if vision.homography is None:
        return PixelToAngle(vision.circle_px.centre, vision.zero_angle_rad)
    try:
        return PixelToAngle.from_homography(vision.homography, vision.zero_angle_rad)
    except ValueError as error:
        raise InputError("configuration", "vision.homography", str(error)) from None
