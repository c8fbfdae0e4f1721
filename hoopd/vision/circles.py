# Rules of this file: circles through points and in pictures. numpy and cv2 only; no setting belongs to one picture.
"""Circle fits, and the hoop's outer circle found by votes along the gradients."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

WORKING_PX = 240  # the longer side of the picture in which the hoop is sought
EDGE_PERCENTILE = 85.0  # the strongest 15 % of the pixels are edges: follows the brightness of the picture
ALIGNED_COS = math.cos(math.radians(8.0))  # an edge of a circle points at its centre this well, perspective included
RADIUS_RANGE = (0.17, 0.70)  # of the longer side: from a small hoop to one that is cut off by the picture
SECTORS = 72
EDGES_PER_SECTOR = 3  # fewer aligned pixels in 5 degrees of a ring are chance
LEAST_COVERAGE = 0.6  # of the visible sectors: a hoop's edge goes round, other things do not
LEAST_VISIBLE = 0.4  # of a circle inside the picture
RING_REACH = 2.5  # reduced pixels: a circle seen in slight perspective leaves a true circle by this much
VOTE_MARGIN = 0.25  # of the picture's side: the centre may lie this far outside


class Circle(NamedTuple):
    """A circle in pixels."""

    x_px: float
    y_px: float
    radius_px: float


class CircleFit(NamedTuple):
    """A circle through points: rms residual of the points kept and their share."""

    circle: Circle
    residual_px: float
    kept: float


class Edges(NamedTuple):
    """Edge pixels of a reduced picture with their unit gradients."""

    x: Points
    y: Points
    ux: Points
    uy: Points
    shape: tuple[int, int]


def fit_circle(points: Points) -> Circle:
    """Least-squares circle through N x 2 points (Kasa: x^2 + y^2 = 2 a x + 2 b y + c)."""
    mean = points.mean(axis=0)
    p = points - mean
    design = np.column_stack([2.0 * p, np.ones(len(p))])
    a, b, c = np.linalg.lstsq(design, (p**2).sum(axis=1), rcond=None)[0]
    return Circle(float(a + mean[0]), float(b + mean[1]), math.sqrt(max(c + a * a + b * b, 0.0)))


def radial_distance(circle: Circle, points: Points) -> Points:
    """Signed distance of N x 2 points from a circle, positive outside."""
    return np.hypot(points[:, 0] - circle.x_px, points[:, 1] - circle.y_px) - circle.radius_px


def fit_circle_robust(points: Points, tolerance_px: float = 1.0, seed: int = 0) -> CircleFit:
    """Circle through the majority of N x 2 points: best of 100 three-point circles, then trimmed least squares."""
    rng = np.random.default_rng(seed)
    best, best_cost = fit_circle(points), math.inf
    for _ in range(100):
        trial = fit_circle(points[rng.choice(len(points), 3, replace=False)])
        cost = float(np.median(np.abs(radial_distance(trial, points))))
        if cost < best_cost:
            best, best_cost = trial, cost
    for _ in range(10):
        best = fit_circle(points[_near(best, points, tolerance_px)])
    return fit_of(best, points, tolerance_px)


def fit_of(circle: Circle, points: Points, tolerance_px: float = 1.0) -> CircleFit:
    """How a circle fits N x 2 points: those that lie on it, and how far off they are."""
    near = _near(circle, points, tolerance_px)
    residual = radial_distance(circle, points[near])
    return CircleFit(circle, float(np.sqrt(np.mean(residual**2))), float(near.mean()))


def _near(circle: Circle, points: Points, tolerance_px: float) -> NDArray[np.bool_]:
    distance = np.abs(radial_distance(circle, points))
    # 1.4826 median|e| is the standard deviation of a normal law; 3 of them keep 99.7 % of the good points
    return np.asarray(distance <= max(tolerance_px, 3.0 * 1.4826 * float(np.median(distance))))


def places_of(points: Points, cell_px: float = 2.0) -> Points:
    """The mean of N x 2 points in each square cell that has any: a ball at rest is in few of them."""
    _, cell, count = np.unique(np.round(points / cell_px), axis=0, return_inverse=True, return_counts=True)
    return np.column_stack([np.bincount(cell.ravel(), weights=points[:, axis]) / count for axis in (0, 1)])


def find_hoop(bgr: NDArray[np.uint8]) -> tuple[Circle, float] | None:
    """Outer circle of the hoop and the covered share of its visible part, or None."""
    factor = max(1, round(max(bgr.shape[:2]) / WORKING_PX))
    edges = find_edges(bgr, factor)
    if len(edges.x) < SECTORS:
        return None
    x, y = vote_centre(edges)
    found = outer_ring(edges, x, y)
    if found is None:
        return None
    radius, coverage = found
    circle = refine_ring(edges, Circle(x, y, radius))
    return Circle(circle.x_px * factor, circle.y_px * factor, circle.radius_px * factor), coverage


def find_edges(bgr: NDArray[np.uint8], factor: int) -> Edges:
    """Strongest edges over the three channels of the picture reduced by an integer factor."""
    smooth = cv2.GaussianBlur(bgr.astype(np.float32), (0, 0), 0.75 * factor)[::factor, ::factor]
    gx_all: Any = cv2.Sobel(smooth, cv2.CV_32F, 1, 0)
    gy_all: Any = cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    strongest = (gx_all**2 + gy_all**2).argmax(axis=2)[..., None]
    gx = np.take_along_axis(gx_all, strongest, axis=2)[..., 0]
    gy = np.take_along_axis(gy_all, strongest, axis=2)[..., 0]
    size = np.hypot(gx, gy)
    y, x = np.nonzero(size > max(1e-3, float(np.percentile(size, EDGE_PERCENTILE))))
    s = size[y, x].astype(np.float64)
    return Edges(x.astype(float), y.astype(float), gx[y, x] / s, gy[y, x] / s, (size.shape[0], size.shape[1]))


def vote_centre(edges: Edges) -> tuple[float, float]:
    """Point on which the gradients' lines meet most often, over all radii and both directions."""
    side = max(edges.shape)
    radii = np.arange(int(RADIUS_RANGE[0] * side), int(RADIUS_RANGE[1] * side))
    radii = np.concatenate([-radii, radii])
    margin = int(VOTE_MARGIN * side)
    height, width = edges.shape[0] + 2 * margin, edges.shape[1] + 2 * margin
    x = np.rint(edges.x[:, None] + edges.ux[:, None] * radii).astype(np.int32) + margin
    y = np.rint(edges.y[:, None] + edges.uy[:, None] * radii).astype(np.int32) + margin
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    votes = np.bincount(y[inside] * width + x[inside], minlength=height * width).reshape(height, width)
    smooth = cv2.GaussianBlur(votes.astype(np.float32), (0, 0), 1.5)
    row, column = np.unravel_index(int(smooth.argmax()), smooth.shape)
    return float(column - margin), float(row - margin)


def aligned_edges(edges: Edges, x: float, y: float) -> tuple[NDArray[np.bool_], Points, Points]:
    """Which edges point at (x, y), and all distances and directions from there."""
    dx, dy = edges.x - x, edges.y - y
    distance = np.hypot(dx, dy)
    aligned = np.abs(dx * edges.ux + dy * edges.uy) > ALIGNED_COS * distance
    return aligned, distance, np.arctan2(dy, dx)


def outer_ring(edges: Edges, x: float, y: float) -> tuple[float, float] | None:
    """Radius and coverage of the outermost ring around a centre whose edge goes round."""
    aligned, distance, angle = aligned_edges(edges, x, y)
    sector = ((angle + math.pi) / (2.0 * math.pi) * SECTORS).astype(int) % SECTORS
    side = max(edges.shape)
    radii = np.arange(int(RADIUS_RANGE[0] * side), int(RADIUS_RANGE[1] * side))
    coverage = np.zeros(len(radii))
    for i, radius in enumerate(radii):
        on = aligned & (np.abs(distance - radius) <= RING_REACH)
        full = np.bincount(sector[on], minlength=SECTORS) >= EDGES_PER_SECTOR
        visible = visible_sectors(edges.shape, x, y, float(radius))
        if visible.mean() >= LEAST_VISIBLE:
            coverage[i] = (full & visible).sum() / visible.sum()
    good = np.flatnonzero(coverage >= LEAST_COVERAGE)
    if len(good) == 0:
        return None
    # the outermost ring is seen at all radii within its reach: the one amid most of its edge is its own
    outermost = good[good > good[-1] - round(2.0 * RING_REACH) - 1]
    count = [int((aligned & (np.abs(distance - radii[i]) <= 1.5)).sum()) for i in outermost]
    best = int(outermost[int(np.argmax(count))])
    return float(radii[best]), float(coverage[best])


def visible_sectors(shape: tuple[int, int], x: float, y: float, radius: float) -> NDArray[np.bool_]:
    """Which sectors of a circle lie inside the picture."""
    angle = (np.arange(SECTORS) + 0.5) / SECTORS * 2.0 * math.pi - math.pi
    px, py = x + radius * np.cos(angle), y + radius * np.sin(angle)
    return np.asarray((px >= 1) & (px < shape[1] - 1) & (py >= 1) & (py < shape[0] - 1))


def refine_ring(edges: Edges, circle: Circle) -> Circle:
    """Robust circle through the aligned edges near a first guess (in pixels of the reduced picture)."""
    aligned, distance, _ = aligned_edges(edges, circle.x_px, circle.y_px)
    near = aligned & (np.abs(distance - circle.radius_px) <= 3.0)
    return fit_circle_robust(np.column_stack([edges.x[near], edges.y[near]])).circle
