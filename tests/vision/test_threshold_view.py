"""The thresholded view shows what the detector counts."""

from __future__ import annotations

import cv2
import numpy as np

from hoopd.sim.camera import i420
from hoopd.vision.detector import Detector, DetectorSettings
from hoopd.vision.threshold_view import BALL, OUTSIDE, SEARCHED, ThresholdView

SETTINGS = DetectorSettings(ring_centre_px=(120.0, 120.0), ring_radius_px=80.0)


def picture(*balls: tuple[int, int]) -> np.ndarray:
    """Grey, with red discs."""
    bgr = np.full((240, 240, 3), 90, np.uint8)
    for ball in balls:
        cv2.circle(bgr, ball, 22, (30, 30, 220), -1, cv2.LINE_AA)
    return bgr


def test_white_is_where_the_detector_finds_the_ball_in_both_kinds_of_picture() -> None:
    bgr, view = picture((120, 200)), ThresholdView(SETTINGS)
    found = Detector(SETTINGS).detect(bgr)
    assert found is not None
    for grey in (view.of_bgr(bgr), view.of_i420(np.frombuffer(i420(bgr, 256), np.uint8), (240, 240, 256))):
        rows, columns = np.nonzero(grey == BALL)
        assert abs(columns.mean() - found.x_px) < 0.5 and abs(rows.mean() - found.y_px) < 0.5
        assert abs(np.sqrt(rows.size / np.pi) - found.radius_px) < 1.0


def test_what_is_not_looked_at_is_black_whatever_its_colour() -> None:
    grey = ThresholdView(SETTINGS).of_bgr(picture((120, 120)))
    assert grey[120, 120] == OUTSIDE
    assert grey[200, 120] == SEARCHED
    assert not (grey == BALL).any()
