# Rules of this file: image in, ball out. numpy and cv2 only; no clock, camera, file, thread or log.
# Every threshold and gate is a setting; the detector remembers nothing but where the ball was last.
"""Finds the red ball in one camera picture: coarse search of the whole picture, then a full-resolution window."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hoopd.vision.blobs import BlobShape, blob_mask, edge_contact, fit_visible_arc, measure_blob
from hoopd.vision.shading import evenly_lit_centre

Image = NDArray[np.uint8]
Contour = NDArray[np.int32]
Window = tuple[int, int, int, int]  # x0, y0, x1, y1
Crop = Callable[[int, int, int, int], Image]

# Soft edge: the weight of a pixel rises from 0 at SOFT_LOW * threshold to 1 at SOFT_HIGH * threshold. Pixels on the rim
# count by their share (sub-pixel), pixels inside count alike: neither shading by the lamp nor motion blur moves it.
SOFT_LOW, SOFT_HIGH = 0.5, 1.5
MAX_CANDIDATES = 6  # coarse blobs looked at in full resolution, largest first: bounds the time of a search
MAX_RECENTRE = 2  # the window follows a ball that touches its edge this often before the whole picture is searched
FULL_FILL = 0.97  # a disc's fill with noise on its rim (see blobs.Shape); nothing is rounder than this
LEAST_FILL = 0.80  # below it lie crescents, bars and merged blobs
MAX_ELONGATION = 1.6  # 10 rad/s and 5 ms smear a ball of 44 px by 9 px, elongation 1.15

# ITU-R BT.601, limited range, as in cv2.COLOR_YUV2BGR_I420; rows B, G, R, columns Y-16, U-128, V-128.
BGR_FROM_YUV = np.array([[1.164, 2.018, 0.0], [1.164, -0.391, -0.813], [1.164, 0.0, 1.596]])
YUV_OFFSET = np.array([16.0, 128.0, 128.0])


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """What the detector has to know; lengths in pixels, `weights` in OpenCV's order blue, green, red."""

    weights: tuple[float, float, float] = (-0.5, -0.5, 1.0)
    threshold: float = 70.0
    search_step: int = 8
    window_px: int = 64
    ball_radius_px: float = 22.0
    radius_tolerance: float = 0.35
    ring_centre_px: tuple[float, float] | None = None
    ring_radius_px: float = 0.0
    ring_half_width_px: float = 15.0
    inside: bool = False  # a ball within the ring counts, too: one that flies
    min_confidence: float = 0.3

    def __post_init__(self) -> None:
        """Refuses values that no picture could satisfy (ValueError)."""
        checks = {
            "threshold must lie in 1..254": 1.0 <= self.threshold <= 254.0,
            "search_step must lie in 1..64 and below the ball's diameter": 1
            <= self.search_step
            <= min(64.0, 2.0 * self.ball_radius_px),
            "ball_radius_px must be at least 3": self.ball_radius_px >= 3.0,
            "window_px must be at least 2.5 ball radii": self.window_px >= 2.5 * self.ball_radius_px,
            "radius_tolerance must lie in 0..1": 0.0 < self.radius_tolerance <= 1.0,
            "ring_radius_px must be positive": self.ring_centre_px is None or self.ring_radius_px > 0.0,
            "ring_half_width_px must be positive": self.ring_half_width_px > 0.0,
            "min_confidence must lie in 0..1": 0.0 <= self.min_confidence <= 1.0,
            "weights must be finite": all(map(math.isfinite, self.weights)),
        }
        for reason, valid in checks.items():
            if not valid:
                raise ValueError(reason)

    @classmethod
    def for_ball(
        cls,
        *,
        weights: tuple[float, float, float],
        threshold: float,
        ball_radius_px: float,
        ring_centre_px: tuple[float, float] | None,
        ring_radius_px: float,
        ring_half_width_px: float,
        inside: bool = False,
    ) -> DetectorSettings:
        """Settings whose window (64 px or more) and search step (8 or less) fit the ball."""
        return cls(
            weights=weights,
            threshold=threshold,
            window_px=max(64, 16 * math.ceil(2.7 * ball_radius_px / 16.0)),
            search_step=max(1, min(8, int(ball_radius_px / 2.0))),
            ball_radius_px=ball_radius_px,
            ring_centre_px=ring_centre_px,
            ring_radius_px=ring_radius_px,
            ring_half_width_px=ring_half_width_px,
            inside=inside,
        )


class Detection(NamedTuple):
    """The ball in pixels (centre of the top left pixel is 0, 0); confidence 0..1; tracking: found without a search."""

    x_px: float
    y_px: float
    radius_px: float
    confidence: float
    tracking: bool


class Detector:
    """Finds the ball picture by picture; holds the last two positions to place the tracking window."""

    def __init__(self, settings: DetectorSettings) -> None:
        self.settings = settings
        self._shape = (0, 0)
        self._mask: Image | None = None
        self._coarse_mask: Image | None = None
        weights, yuv_weights = np.array(settings.weights), np.array(settings.weights) @ BGR_FROM_YUV
        # soft for where the ball is, level for its centre
        self._bgr_matrices = (
            soft_matrix(weights, np.zeros(3), settings.threshold), level_matrix(weights, np.zeros(3)),
        )  # fmt: skip
        self._yuv_matrices = (
            soft_matrix(yuv_weights, YUV_OFFSET, settings.threshold), level_matrix(yuv_weights, YUV_OFFSET),
        )  # fmt: skip
        self._matrix, self._level_matrix = self._bgr_matrices
        self.reset()

    def reset(self) -> None:
        """Forgets where the ball was: the next picture is searched as a whole."""
        self._last: Detection | None = None
        self._step_px = (0.0, 0.0)

    def detect(self, bgr: Image) -> Detection | None:
        """The ball in a height x width x 3 picture (uint8, blue green red), or None."""
        if bgr.ndim != 3 or bgr.shape[2] != 3 or bgr.dtype != np.uint8:
            raise ValueError("the picture must be height x width x 3 of uint8")
        self._matrix, self._level_matrix = self._bgr_matrices
        self._prepare((bgr.shape[0], bgr.shape[1]))

        def crop(x0: int, y0: int, x1: int, y1: int) -> Image:
            return bgr[y0:y1, x0:x1]

        return self._detect(crop, lambda: self._reduced(bgr))

    def detect_i420(self, yuv: Image, width: int, height: int, stride: int) -> Detection | None:
        """The ball in a raw I420 buffer (flat uint8, chroma stride is stride // 2); only the window is converted."""
        luma, u, v = i420_planes(yuv, width, height, stride)
        self._matrix, self._level_matrix = self._yuv_matrices
        self._prepare((height, width))

        def crop(x0: int, y0: int, x1: int, y1: int) -> Image:
            size = (x1 - x0, y1 - y0)
            chroma = np.s_[y0 // 2 : y1 // 2, x0 // 2 : x1 // 2]
            planes = [luma[y0:y1, x0:x1], cv2.resize(u[chroma], size), cv2.resize(v[chroma], size)]
            return np.asarray(cv2.merge(planes), np.uint8)

        def coarse() -> Image:
            return np.asarray(cv2.merge([self._reduced(plane) for plane in (luma, u, v)]), np.uint8)

        return self._detect(crop, coarse)

    def _detect(self, crop: Crop, coarse: Callable[[], Image]) -> Detection | None:
        """Window first, whole picture second; remembers the result."""
        found = self._track(crop) or self._search(crop, coarse())
        if found is not None and self._last is not None:
            self._step_px = (found.x_px - self._last.x_px, found.y_px - self._last.y_px)
        else:
            self._step_px = (0.0, 0.0)
        self._last = found
        return found

    def _reduced(self, plane: Image) -> Image:
        """A picture or plane on the coarse grid; linear interpolation reads the 2 x 2 pixels amid each step."""
        size = (self._shape[1] // self.settings.search_step, self._shape[0] // self.settings.search_step)
        return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), np.uint8)

    def _track(self, crop: Crop) -> Detection | None:
        """The ball near where its last two positions lead, or None."""
        if self._last is None:
            return None
        return self._look(crop, self._last.x_px + self._step_px[0], self._last.y_px + self._step_px[1], tracking=True)

    def _search(self, crop: Crop, coarse: Image) -> Detection | None:
        """The most confident ball among the coarse blobs of the whole picture, or None."""
        soft = cv2.transform(coarse, self._matrix)
        if self._coarse_mask is not None:
            cv2.bitwise_and(soft, self._coarse_mask, dst=soft)
        binary = cv2.threshold(soft, 127, 255, cv2.THRESH_BINARY)[1]
        count, _, stats, centroids = cv2.connectedComponentsWithStats(binary, connectivity=8)
        if count < 2:
            return None
        order = np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")[:MAX_CANDIDATES] + 1
        best: Detection | None = None
        for i in order:
            # centre of coarse pixel k: (k + 1/2) width / coarse width - 1/2
            x = (centroids[i][0] + 0.5) * self._shape[1] / coarse.shape[1] - 0.5
            y = (centroids[i][1] + 0.5) * self._shape[0] / coarse.shape[0] - 0.5
            found = self._look(crop, float(x), float(y), tracking=False)
            if found is not None and (best is None or found.confidence > best.confidence):
                best = found
        return best

    def _look(self, crop: Crop, x_px: float, y_px: float, tracking: bool) -> Detection | None:
        """The ball in the window around a point; the window follows a ball that touches its edge."""
        for _ in range(1 + MAX_RECENTRE):
            x0, y0, x1, y1 = self._window(x_px, y_px)
            blobs = self._blobs(crop, x0, y0, x1, y1)
            if not blobs:
                return None
            best = max(blobs, key=lambda blob: (blob.confidence, blob.radius_px))
            if not best.touches_window:
                break
            x_px, y_px = best.x_px, best.y_px
        if best.touches_window or best.confidence < self.settings.min_confidence:
            return None
        return Detection(best.x_px, best.y_px, best.radius_px, best.confidence, tracking)

    def _window(self, x_px: float, y_px: float) -> tuple[int, int, int, int]:
        """Window corners moved, not cut, to lie inside the picture; even, so that chroma planes share them."""
        height, width = self._shape
        half, size = self.settings.window_px // 2, self.settings.window_px
        x0 = max(0, min(round(x_px) - half, width - size)) // 2 * 2
        y0 = max(0, min(round(y_px) - half, height - size)) // 2 * 2
        # one pixel more in an odd picture: the last column must not be out of reach
        return x0, y0, min(width, x0 + size + width % 2), min(height, y0 + size + height % 2)

    def _blobs(self, crop: Crop, x0: int, y0: int, x1: int, y1: int) -> list[Blob]:
        """Blobs above the threshold inside one window, measured."""
        # a 3 x 3 mean takes two thirds of the camera's noise away and moves no centre
        smooth = cv2.blur(crop(x0, y0, x1, y1), (3, 3))
        soft: Any = cv2.transform(smooth, self._matrix)
        if self._mask is not None:
            cv2.bitwise_and(soft, self._mask[y0:y1, x0:x1], dst=soft)
        binary = cv2.threshold(soft, 127, 255, cv2.THRESH_BINARY)[1]
        contours: Any = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        # A blob of less than a quarter of the ball's area is noise or a far too small object.
        least_area = 0.25 * math.pi * self.settings.ball_radius_px**2
        window = (x0, y0, x1, y1)
        large = [contour for contour in contours if cv2.contourArea(contour) > least_area]
        level: Any = cv2.transform(smooth, self._level_matrix) if large else soft
        return [self._measure(soft, level, contour, window) for contour in large]

    def _measure(self, soft: Image, level: Image, contour: Contour, window: Window) -> Blob:
        """One blob in picture coordinates; a ball cut by the picture's edge is a circle through its visible arc."""
        mask = blob_mask(contour, soft.shape)
        shape = measure_blob(soft, mask)
        at_window, at_picture = edge_contact(contour, window, self._shape)
        if at_picture and not at_window:
            shape = fit_visible_arc(contour, soft.shape, shape)
        elif not at_window and (centre := evenly_lit_centre(level, mask, shape)) is not None:
            shape = shape._replace(x_px=centre[0], y_px=centre[1])
        placed = shape._replace(x_px=shape.x_px + window[0], y_px=shape.y_px + window[1])
        return Blob(placed.x_px, placed.y_px, placed.radius_px, self._confidence(placed), at_window)

    def _confidence(self, shape: BlobShape) -> float:
        """0..1: product of size, roundness and grey level; 0 outside of a gate."""
        settings = self.settings
        size = 1.0 - ((shape.radius_px / settings.ball_radius_px - 1.0) / settings.radius_tolerance) ** 2
        round_ = (shape.fill - LEAST_FILL) / (FULL_FILL - LEAST_FILL)
        on_ring = self._on_ring(shape.x_px, shape.y_px)
        if size <= 0.0 or round_ <= 0.0 or shape.elongation > MAX_ELONGATION or not on_ring:
            return 0.0
        return size * min(1.0, round_) * min(1.0, shape.level)

    def _on_ring(self, x: float, y: float) -> bool:
        """Whether a ball's centre may lie here."""
        settings = self.settings
        if settings.ring_centre_px is None:
            return True
        off = math.hypot(x - settings.ring_centre_px[0], y - settings.ring_centre_px[1]) - settings.ring_radius_px
        return (off if settings.inside else abs(off)) <= settings.ring_half_width_px

    def _prepare(self, shape: tuple[int, int]) -> None:
        """Masks of the ring band, made once for a picture size."""
        if shape == self._shape:
            return
        self._shape = shape
        self.reset()
        if self.settings.ring_centre_px is not None:
            self._mask = ring_mask(shape, self.settings)
            self._coarse_mask = self._reduced(self._mask)


class Blob(NamedTuple):
    """One measured blob in picture coordinates."""

    x_px: float
    y_px: float
    radius_px: float
    confidence: float
    touches_window: bool


def soft_matrix(weights: NDArray[np.float64], offset: NDArray[np.float64], threshold: float) -> NDArray[np.float32]:
    """1 x 4 matrix for cv2.transform: 0 at SOFT_LOW, 127.5 at 1, 255 at SOFT_HIGH times the threshold."""
    # soft = 255 (w (p - offset) - SOFT_LOW t) / ((SOFT_HIGH - SOFT_LOW) t), saturated by uint8
    scale = 255.0 / ((SOFT_HIGH - SOFT_LOW) * threshold)
    bias = -scale * (float(weights @ offset) + SOFT_LOW * threshold)
    return np.array([[*(scale * weights), bias]], np.float32)


def level_matrix(weights: NDArray[np.float64], offset: NDArray[np.float64]) -> NDArray[np.float32]:
    """1 x 4 matrix for cv2.transform: w (p - offset), up to the brightest pixel that there can be."""
    brightest = 255.0 * float(np.maximum(weights, 0.0).sum())
    scale = 255.0 / brightest if brightest > 0.0 else 1.0
    return np.array([[*(scale * weights), -scale * float(weights @ offset)]], np.float32)


def ring_mask(shape: tuple[int, int], settings: DetectorSettings) -> Image:
    """255 where any pixel of a ball on the ring may lie, else 0."""
    assert settings.ring_centre_px is not None
    y, x = np.ogrid[: shape[0], : shape[1]]
    distance = np.hypot(x - settings.ring_centre_px[0], y - settings.ring_centre_px[1])
    # the ball's radius with its tolerance, so that the mask never cuts the rim of a ball it should pass
    reach = settings.ring_half_width_px + settings.ball_radius_px * (1.0 + settings.radius_tolerance)
    off = distance - settings.ring_radius_px
    return np.where((off if settings.inside else np.abs(off)) <= reach, 255, 0).astype(np.uint8)


def i420_planes(yuv: Image, width: int, height: int, stride: int) -> tuple[Image, Image, Image]:
    """Views of the Y, U, V planes of a flat I420 buffer; ValueError when the sizes do not fit."""
    flat = yuv.reshape(-1)
    if width % 2 or height % 2 or stride % 2 or stride < width or flat.size < stride * height * 3 // 2:
        raise ValueError(f"{flat.size} bytes are no I420 picture of {width} x {height} with stride {stride}")
    luma, quarter = stride * height, stride * height // 4
    half = (height // 2, stride // 2)
    u, v = flat[luma : luma + quarter].reshape(half), flat[luma + quarter : luma + 2 * quarter].reshape(half)
    return flat[:luma].reshape(height, stride)[:, :width], u[:, : width // 2], v[:, : width // 2]
