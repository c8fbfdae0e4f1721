# Rules of this file: what the detector makes of a picture, for a person to look at; its own formulas, nothing decided.
"""The thresholded view: which pixels of a whole picture the detector counts as ball."""

from __future__ import annotations

import cv2
import numpy as np

from hoopd.vision.detector import (
    BGR_FROM_YUV,
    YUV_OFFSET,
    DetectorSettings,
    Image,
    i420_planes,
    ring_mask,
    soft_matrix,
)

BALL, SEARCHED, OUTSIDE = 255, 60, 0  # grey levels of the view
COUNTS = 127  # a soft edge above this is ball, as in the detector's search


class ThresholdView:
    """Grey pictures of what is ball, what is searched and what is not looked at."""

    def __init__(self, settings: DetectorSettings) -> None:
        self._settings = settings
        weights = np.array(settings.weights)
        self._bgr_matrix = soft_matrix(weights, np.zeros(3), settings.threshold)
        self._yuv_matrix = soft_matrix(weights @ BGR_FROM_YUV, YUV_OFFSET, settings.threshold)
        self._ground: Image = np.zeros((0, 0), np.uint8)

    def of_bgr(self, bgr: Image) -> Image:
        """The view of a height x width x 3 picture."""
        return self._view(np.asarray(cv2.transform(bgr, self._bgr_matrix), np.uint8))

    def of_i420(self, yuv: Image, size: tuple[int, int, int]) -> Image:
        """The view of a flat I420 picture; size is width, height, stride."""
        luma, u, v = i420_planes(yuv, *size)
        whole = (size[0], size[1])
        picture = cv2.merge([luma, cv2.resize(u, whole), cv2.resize(v, whole)])
        return self._view(np.asarray(cv2.transform(picture, self._yuv_matrix), np.uint8))

    def _view(self, soft: Image) -> Image:
        if self._ground.shape != soft.shape:
            self._ground = self._searched(soft.shape[:2])
        ball = cv2.threshold(soft, COUNTS, BALL, cv2.THRESH_BINARY)[1]
        inside = cv2.threshold(self._ground, OUTSIDE, BALL, cv2.THRESH_BINARY)[1]
        return np.asarray(cv2.max(cv2.bitwise_and(ball, inside), self._ground), np.uint8)

    def _searched(self, shape: tuple[int, int]) -> Image:
        """Where a ball may lie, in grey."""
        if self._settings.ring_centre_px is None:
            return np.full(shape, SEARCHED, np.uint8)
        return np.where(ring_mask(shape, self._settings) > 0, SEARCHED, OUTSIDE).astype(np.uint8)
