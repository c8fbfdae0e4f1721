# Rules of this file: circles through points and in pictures. numpy and cv2 only.
"""Circle fits, and the hoop's outer circle found by votes along the gradients."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def fit_circle(points: NDArray[np.float64]) -> tuple[float, float, float]:
    """Least-squares circle (x, y, radius) through N x 2 points (Kasa: x^2 + y^2 = 2 a x + 2 b y + c)."""
    mean = points.mean(axis=0)
    p = points - mean
    design = np.column_stack([2.0 * p, np.ones(len(p))])
    a, b, c = np.linalg.lstsq(design, (p**2).sum(axis=1), rcond=None)[0]
    return float(a + mean[0]), float(b + mean[1]), math.sqrt(max(c + a * a + b * b, 0.0))
