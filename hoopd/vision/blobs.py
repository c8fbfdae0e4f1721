# Rules of this file: one blob of one window, measured. numpy and cv2 only; coordinates are the window's own.
"""Centre, radius and shape of a blob from its soft-edged grey picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hoopd.vision.circles import fit_circle

RIM_PX = 2  # soft rim kept around the thresholded blob; inside it holes (specular highlights) are filled
LEAST_ARC_POINTS = 8  # a shorter arc gives no circle worth the name
LEAST_CONVEXITY = 0.9  # of the hull's area
RIM = np.ones((2 * RIM_PX + 1, 2 * RIM_PX + 1), np.uint8)


class BlobShape(NamedTuple):
    """Measured blob: fill is its area over that of the ellipse with the same moments (disc 1, square 0.955)."""

    x_px: float
    y_px: float
    radius_px: float
    fill: float
    elongation: float  # longest over shortest axis
    level: float  # mean of the soft grey inside, 0..1


class BlobMask(NamedTuple):
    """Where a blob is: 255 there, else 0."""

    filled: NDArray[np.uint8]  # above the threshold, with its holes
    solid: NDArray[np.uint8]  # of it what is no rim


def blob_mask(contour: NDArray[np.int32], size: tuple[int, ...]) -> BlobMask:
    """Of the blob within a contour, in a window of this size."""
    filled = np.zeros(size, np.uint8)
    cv2.drawContours(filled, [contour], -1, 255, cv2.FILLED)
    return BlobMask(filled, np.asarray(cv2.erode(filled, RIM), np.uint8))


def measure_blob(soft: NDArray[np.uint8], mask: BlobMask) -> BlobShape:
    """Moments of the blob with a soft rim and its holes filled."""
    filled = mask.filled
    rim = cv2.bitwise_and(soft, cv2.dilate(filled, RIM))
    m = cv2.moments(cv2.max(rim, mask.solid))
    area = m["m00"] / 255.0
    # the ellipse with these second moments has the area 4 pi sqrt(det(covariance))
    spread = math.sqrt(max(m["mu20"] * m["mu02"] - m["mu11"] ** 2, 1e-12)) / m["m00"]
    return BlobShape(
        m["m10"] / m["m00"],
        m["m01"] / m["m00"],
        math.sqrt(area / math.pi),
        area / (4.0 * math.pi * spread),
        axis_ratio(m),
        cv2.mean(soft, filled)[0] / 255.0,
    )


def axis_ratio(m: dict[str, float]) -> float:
    """Longest over shortest axis of the ellipse with these central moments."""
    half_sum = 0.5 * (m["mu20"] + m["mu02"])
    difference = math.hypot(0.5 * (m["mu20"] - m["mu02"]), m["mu11"])
    return math.sqrt((half_sum + difference) / max(half_sum - difference, 1e-12))


def edge_contact(
    contour: NDArray[np.int32], window: tuple[int, int, int, int], shape: tuple[int, int]
) -> tuple[bool, bool]:
    """Whether a blob (window coordinates) touches an inner edge of its window, and an edge of the picture."""
    x, y, w, h = cv2.boundingRect(contour)
    x0, y0, x1, y1 = window
    contact = (x <= 0, y <= 0, x + w >= x1 - x0, y + h >= y1 - y0)
    picture = (x0 == 0, y0 == 0, x1 == shape[1], y1 == shape[0])
    at_picture = any(c and p for c, p in zip(contact, picture, strict=True))
    at_window = any(c and not p for c, p in zip(contact, picture, strict=True))
    return at_window, at_picture


def fit_visible_arc(contour: NDArray[np.int32], size: tuple[int, ...], shape: BlobShape) -> BlobShape:
    """The shape replaced by the circle through the part of its contour that is not the picture's edge."""
    # the hull bridges a highlight that opens to the picture's edge; a blob that is not convex is no ball
    hull: NDArray[np.int32] = np.asarray(cv2.convexHull(contour), np.int32)
    if cv2.contourArea(contour) < LEAST_CONVEXITY * cv2.contourArea(hull):
        return shape._replace(fill=0.0)
    points = hull.reshape(-1, 2).astype(np.float64)
    inside = (points > 0).all(axis=1) & (points < np.array([size[1] - 1, size[0] - 1])).all(axis=1)
    points = points[inside]
    if len(points) < LEAST_ARC_POINTS:
        return shape._replace(fill=0.0)
    x, y, radius = fit_circle(points)
    residual_px = float(np.sqrt(np.mean((np.hypot(points[:, 0] - x, points[:, 1] - y) - radius) ** 2)))
    # contour points lie in the outermost pixels, half a pixel inside the rim; 5 % of residual closes the shape gate
    return BlobShape(x, y, radius + 0.5, 1.0 - 4.0 * residual_px / max(radius, 1.0), 1.0, shape.level)
