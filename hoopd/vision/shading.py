# Rules of this file: one blob of one window; numpy and cv2 only; coordinates are the window's own.
"""Centre of a ball that is not lit evenly, from the shares of its pixels that it covers.

A pixel at the rim, or where a moving ball was for a part of the exposure, is covered by a share of 0 to 1; the shares
have their centre where the ball's was in the middle of the exposure. A pixel's level is its share times the light
there, and a ball is brighter towards its lamp: one threshold over all of it cuts its dark end and its bright one at
different shares, and of a smear of 18 px (20 rad/s, 5 ms) that is a pixel's error whose direction turns with the ball.
So the light is a plane through the ball's middle, which is covered wholly, and a share is the level over that plane.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hoopd.vision.blobs import BlobMask, BlobShape

Mask = NDArray[np.uint8]

# The ball's middle: of a smear as long as the ball's radius all of its pixels are covered wholly.
MIDDLE = 0.5
# Of the middle's mean level: less has a highlight, which is white.
LEAST_LEVEL = 0.85
# A sphere's light does not go on outside as it does inside, and what is smeared is its rim.
BENT = 0.65
# A share counts from 0 to 1 between these two: what is behind the ball is not black. Alike from both ends, so that they
# move no centre.
FIRST, LAST = 0.25, 0.75
# Pixels around the thresholded blob that may have a share: half of what a smear of 20 px has there.
AROUND = np.ones((11, 11), np.uint8)
# The picture is smooth over three pixels: a highlight reaches one further.
NEXT = np.ones((3, 3), np.uint8)


def evenly_lit_centre(level: Mask, mask: BlobMask, shape: BlobShape) -> tuple[float, float] | None:
    """Centre of a blob; None where no plane can be laid through its middle.

    Parameters
    ----------
    level
        What tells the ball from the rest, not saturated on it.
    mask, shape
        Where it is above the threshold, and its measure by that.
    """
    x, y, radius = shape.x_px, shape.y_px, shape.radius_px
    light = _light(level, _middle(level, x, y, MIDDLE * radius), (x, y), BENT * radius)
    if light is None:
        return None
    scale = 255.0 / (LAST - FIRST)
    share: Any = cv2.divide(level, light, scale=scale, dtype=cv2.CV_32F)
    below: Any = FIRST * scale
    counted = cv2.subtract(share, below, dtype=cv2.CV_8U)  # saturated on both sides
    # a highlight that is white is no hole
    moments = cv2.moments(cv2.max(cv2.bitwise_and(counted, cv2.dilate(mask.filled, AROUND)), mask.solid))
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]


def _middle(level: Mask, x: float, y: float, radius: float) -> Mask:
    """Pixels around a point that are lit as most of them are."""
    middle = np.zeros_like(level)
    cv2.circle(middle, (round(x), round(y)), round(radius), 255, cv2.FILLED)
    lit = cv2.threshold(level, LEAST_LEVEL * cv2.mean(level, middle)[0], 255, cv2.THRESH_BINARY)[1]
    return np.asarray(cv2.erode(cv2.bitwise_and(middle, lit), NEXT), np.uint8)


def _light(level: Mask, middle: Mask, at: tuple[float, float], reach: float) -> NDArray[np.float32] | None:
    """The plane through the levels of `middle`; farther than `reach` from a point it goes on as it is there."""
    of_mask, of_level = cv2.moments(middle), cv2.moments(cv2.bitwise_and(level, middle))
    n, total = of_mask["m00"] / 255.0, of_level["m00"]
    # least squares by central moments: [[a, b], [b, d]] slope = [s_x, s_y]
    a, b, d = (of_mask[name] / 255.0 for name in ("mu20", "mu11", "mu02"))
    determinant = a * d - b * b
    if determinant <= 0.0 or total <= 0.0:
        return None
    mean, x_mean, y_mean = total / n, of_mask["m10"] / of_mask["m00"], of_mask["m01"] / of_mask["m00"]
    s_x, s_y = of_level["m10"] - x_mean * total, of_level["m01"] - y_mean * total
    x_slope, y_slope = (d * s_x - b * s_y) / determinant, (a * s_y - b * s_x) / determinant
    across = x_slope * (_near(level.shape[1], at[0], reach) - x_mean)
    down = y_slope * (_near(level.shape[0], at[1], reach) - y_mean) + mean
    plane = np.add.outer(down.astype(np.float32), across.astype(np.float32))
    return np.asarray(np.maximum(plane, np.float32(0.25 * mean)), np.float32)


def _near(count: int, at: float, reach: float) -> NDArray[np.float64]:
    """Places 0 to `count`, none farther than `reach` from `at`."""
    return np.clip(np.arange(count), at - reach, at + reach)
