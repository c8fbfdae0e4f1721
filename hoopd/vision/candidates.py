# Rules of this file: a picture and its hoop in, the ball and its colour out. numpy and cv2 only.
# Lengths are shares of the hoop's radius and grey levels come from the picture itself: nothing is tuned to one picture.
"""Ball candidates over several colour weightings and automatic levels; the weighting that parts ball and ring best."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hoopd.vision.circles import Circle

Image = NDArray[np.uint8]
Grey = NDArray[np.float32]
Weights = tuple[float, float, float]  # blue, green, red

# Weightings that look for red: against both others, against green (warm light), against blue, and between.
SEED_WEIGHTS: tuple[Weights, ...] = ((-0.5, -0.5, 1.0), (0.0, -1.0, 1.0), (0.0, -1.5, 1.0), (-1.0, -1.0, 1.0))
FINAL_BLUE = (-1.0, -0.75, -0.5, -0.25, 0.0)
FINAL_GREEN = (-1.5, -1.25, -1.0, -0.75, -0.5, -0.25, 0.0)
LEVELS = 12

# Shares of the hoop's outer radius: (gate, full mark, full mark, gate). A ball of 24.6 mm runs at 85 to 90 mm
# in a hoop of about 108 mm outer radius: 0.114 and 0.81; other builds and perspective widen the marks.
BALL_RADIUS = (0.05, 0.075, 0.13, 0.18)
TRACK_RADIUS = (0.66, 0.72, 0.90, 0.97)
FILL = (0.88, 0.96, 1.1, 1.2)  # see blobs.Shape
AXES = (0.70, 0.88, 1.01, 1.02)  # short over long axis of the blob at rest
RED_SHARE = (0.10, 0.22, 1.0, 2.0)  # red's share of the light inside minus around the ball
RED_FIRST = (0.10, 0.35, 1.0, 2.0)  # (R - max(G, B)) / R inside the ball
RIM = (0.35, 0.65, 1.01, 1.02)  # share of the blob's rim at which the picture's own edge points at the centre
DARK_LEVEL = 6.0  # added to sums of grey levels before a division: camera noise in the dark has no colour


class BallCandidate(NamedTuple):
    """A blob that may be the ball; score 0..1 is the product of its marks."""

    x_px: float
    y_px: float
    radius_px: float
    score: float
    marks: dict[str, float]


class Colour(NamedTuple):
    """Weights (blue, green, red) and threshold; gap is ball minus ring in grey levels, negative when they overlap."""

    weights: Weights
    threshold: float
    gap: float


def mark(value: float, limits: tuple[float, float, float, float]) -> float:
    """0 outside the outer limits, 1 between the inner ones, straight between."""
    low, full_low, full_high, high = limits
    return float(np.interp(value, [low, full_low, full_high, high], [0.0, 1.0, 1.0, 0.0]))


def find_candidates(bgr: Image, hoop: Circle) -> list[BallCandidate]:
    """All blobs with a score, best first."""
    smooth = cv2.GaussianBlur(bgr, (0, 0), 1.2).astype(np.float32)
    distance = distance_from(bgr.shape, hoop.x_px, hoop.y_px) / hoop.radius_px
    # the band holds the whole ball on any track
    band = (distance > TRACK_RADIUS[0] - BALL_RADIUS[3]) & (distance < TRACK_RADIUS[3] + BALL_RADIUS[3])
    red_share = smooth[..., 2] / (smooth.sum(axis=2) + 3.0 * DARK_LEVEL)
    found = []
    for weights in SEED_WEIGHTS:
        grey = np.where(band, smooth @ np.array(weights, np.float32), 0.0).astype(np.float32)
        for level in levels(grey[band]):
            for contour in contours_above(grey, level):
                candidate = judge(contour, smooth, red_share, grey, hoop)
                if candidate is not None:
                    found.append(candidate)
    return sorted(found, key=lambda c: -c.score)


def levels(values: Grey) -> list[float]:
    """Thresholds from the middle of the background to just below the brightest."""
    low, high = float(np.percentile(values, 50.0)), float(values.max())
    return list(np.linspace(low, high, LEVELS + 2)[1:-1]) if high - low >= 4.0 else []


def contours_above(grey: Grey, level: float) -> list[Any]:
    """Outlines of the blobs above a level."""
    binary = (grey > level).astype(np.uint8)
    return list(cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0])


def judge(contour: Any, smooth: Grey, red_share: Grey, grey: Grey, hoop: Circle) -> BallCandidate | None:
    """Candidate with its marks, or None when a mark is zero."""
    m = cv2.moments(contour)
    radius = math.sqrt(m["m00"] / math.pi) + 0.5 if m["m00"] > 0.0 else 0.0
    marks = {"size": mark(radius / hoop.radius_px, BALL_RADIUS)}
    if marks["size"] == 0.0:
        return None
    x, y = m["m10"] / m["m00"], m["m01"] / m["m00"]
    spread = math.sqrt(max(m["mu20"] * m["mu02"] - m["mu11"] ** 2, 1e-12)) / m["m00"]
    half_sum, difference = 0.5 * (m["mu20"] + m["mu02"]), math.hypot(0.5 * (m["mu20"] - m["mu02"]), m["mu11"])
    marks["track"] = mark(math.hypot(x - hoop.x_px, y - hoop.y_px) / hoop.radius_px, TRACK_RADIUS)
    marks["fill"] = mark(m["m00"] / (4.0 * math.pi * spread), FILL)
    marks["axes"] = mark(math.sqrt(max(half_sum - difference, 0.0) / (half_sum + difference)), AXES)
    if min(marks.values()) == 0.0:
        return None
    marks |= colour_marks(smooth, red_share, x, y, radius)
    marks["rim"] = mark(rim_share(grey, x, y, radius), RIM)
    score = math.prod(marks.values())
    return BallCandidate(x, y, radius, score, marks) if score > 0.0 else None


def colour_marks(smooth: Grey, red_share: Grey, x: float, y: float, radius: float) -> dict[str, float]:
    """How red the inside is, and how much redder than what surrounds it."""
    reach = math.ceil(1.6 * radius)
    rows = slice(max(0, int(y) - reach), int(y) + reach + 1)
    columns = slice(max(0, int(x) - reach), int(x) + reach + 1)
    patch, share = smooth[rows, columns], red_share[rows, columns]
    distance = distance_from(patch.shape, x - columns.start, y - rows.start)
    inside, around = distance < 0.8 * radius, (distance > 1.25 * radius) & (distance < 1.6 * radius)
    if not around.any():
        return {"contrast": 0.0, "red": 0.0}
    blue, green, red = np.median(patch[inside], axis=0)
    return {
        "contrast": mark(float(np.median(share[inside]) - np.median(share[around])), RED_SHARE),
        "red": mark(float((red - max(green, blue)) / (red + DARK_LEVEL)), RED_FIRST),
    }


def rim_share(grey: Grey, x: float, y: float, radius: float) -> float:
    """Share of 48 rays along which the grey falls by half of its level within a quarter radius of the rim."""
    angle = np.arange(48) / 48.0 * 2.0 * math.pi
    cos, sin = np.cos(angle), np.sin(angle)

    def sample(share: float) -> Grey:
        columns = np.clip(np.rint(x + share * radius * cos).astype(int), 0, grey.shape[1] - 1)
        rows = np.clip(np.rint(y + share * radius * sin).astype(int), 0, grey.shape[0] - 1)
        return np.asarray(grey[rows, columns])

    inner, outer = sample(0.75), sample(1.25)
    return float(np.mean(outer < inner - 0.25 * max(float(np.median(inner)), 1.0)))


def choose_colour(bgr: Image, hoop: Circle, ball: Circle) -> Colour:
    """Weights with the widest gap between ball and rest of its track per unit of noise; threshold amid the gap."""
    smooth = cv2.GaussianBlur(bgr, (0, 0), 1.0).astype(np.float32)
    to_ball = distance_from(bgr.shape, ball.x_px, ball.y_px) / ball.radius_px
    track_px = math.hypot(ball.x_px - hoop.x_px, ball.y_px - hoop.y_px)
    to_track = np.abs(distance_from(bgr.shape, hoop.x_px, hoop.y_px) - track_px) / ball.radius_px
    inside, ring = smooth[to_ball < 0.85], smooth[(to_track < 1.5) & (to_ball > 1.4)]
    best = Colour(SEED_WEIGHTS[0], 70.0, -math.inf)
    best_merit = -math.inf
    for blue, green in itertools.product(FINAL_BLUE, FINAL_GREEN):
        if 1.0 + blue + green > 0.0:  # white light of any brightness must stay dark
            continue
        weights = (blue, green, 1.0)
        # 10 %: a highlight on the ball; 0.5 %: screws and specks on the ring that the size gate rejects anyway
        w = np.array(weights, np.float32)
        low, high = float(np.percentile(ring @ w, 99.5)), float(np.percentile(inside @ w, 10.0))
        low, high = max(low, 0.0), min(high, 255.0)
        merit = (high - low) / float(np.linalg.norm(w))
        if merit > best_merit:
            best_merit = merit
            best = Colour(weights, min(max(0.5 * (low + high), 2.0), 254.0), high - low)
    return best


def distance_from(shape: tuple[int, ...], x: float, y: float) -> Grey:
    """Distance of every pixel from a point."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return np.hypot(columns - x, rows - y).astype(np.float32)
