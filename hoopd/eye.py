"""From picture to camera sample: the configured detector and the way from pixel to angle.

Rules of this file: joins vision to the records of the tick; no camera, no clock.
"""

from __future__ import annotations

from dataclasses import replace
from math import nan

from hoopd.core.records import CameraSample
from hoopd.files import InputError
from hoopd.shell.config import Vision
from hoopd.vision.calibration import PixelToAngle
from hoopd.vision.detector import Detection, Detector, DetectorSettings, Image


class Analyser:
    """Finds the ball in one picture after the other."""

    def __init__(self, vision: Vision, minimum_confidence: float) -> None:
        self._detector = Detector(_settings(vision, minimum_confidence))
        self._to_angle = _pixel_to_angle(vision)

    def reset(self) -> None:
        """Forget where the ball was: the camera started again."""
        self._detector.reset()

    def bgr(self, frame: int, t: float, t_arrival: float, picture: Image) -> CameraSample:
        """Sample from a picture of shape (height, width, 3), channels B, G, R."""
        return self._sample(frame, t, t_arrival, self._detector.detect(picture))

    def i420(self, frame: int, t: float, t_arrival: float, planes: Image, size: tuple[int, int, int]) -> CameraSample:
        """Sample from the planes of a YUV 4:2:0 picture; size is width, height, stride."""
        return self._sample(frame, t, t_arrival, self._detector.detect_i420(planes, *size))

    def _sample(self, frame: int, t: float, t_arrival: float, found: Detection | None) -> CameraSample:
        if found is None:
            return CameraSample(frame, t, t_arrival, nan, 0.0, nan, nan)
        psi = self._to_angle(found.x_px, found.y_px)
        return CameraSample(frame, t, t_arrival, psi, found.confidence, found.x_px, found.y_px)


def _settings(vision: Vision, minimum_confidence: float) -> DetectorSettings:
    red, green, blue = vision.weights
    try:
        settings = DetectorSettings.for_ball(
            weights=(blue, green, red),
            threshold=vision.threshold,
            ball_radius_px=vision.ball_radius_px,
            ring_centre_px=vision.circle_px.centre,
            ring_radius_px=vision.circle_px.radius,
            ring_half_width_px=vision.band_px,
        )
        return replace(settings, min_confidence=minimum_confidence)
    except ValueError as error:
        raise InputError("configuration", "vision", str(error)) from None


def _pixel_to_angle(vision: Vision) -> PixelToAngle:
    if vision.homography is None:
        return PixelToAngle(vision.circle_px.centre, vision.zero_angle_rad)
    try:
        return PixelToAngle.from_homography(vision.homography, vision.zero_angle_rad)
    except ValueError as error:
        raise InputError("configuration", "vision.homography", str(error)) from None
