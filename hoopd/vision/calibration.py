# Rules of this file: pixels to angle, and proposals for a person to accept. numpy and cv2 only; nothing is saved here.
# psi is 0 at the resting ball, positive to the picture's left. One picture tells circle and zero, not perspective.
"""Pixel to psi by homography or circle; circle, zero angle and colour proposed from one picture or a recorded run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.vision.candidates import BallCandidate, Colour, choose_colour, find_candidates
from hoopd.vision.circles import Circle, Points, find_hoop, fit_circle_robust, fit_of, places_of
from hoopd.vision.detector import Detector, DetectorSettings

Image = NDArray[np.uint8]

LEAST_SCORE = 0.4  # product of seven marks; the real pictures give 1, half dark or noisy ones 0.5 and more
RIVAL_SCORE = 0.5  # share of the best score that makes a second ball worth a note
TILT_NOTE_RAD = 0.35  # a camera is mounted straighter than 20 degrees: beyond, the ball is hardly at rest
LEAST_POSITIONS = 20
LEAST_KEPT = 0.5  # share of a run on one circle; below, the positions are something else
MOST_RESIDUAL = 0.05  # of the radius: 9 px on a track of 182 px, fifteen times what the real device leaves
SHORT_ARC_RAD = 1.0  # a shorter arc leaves centre and radius to the noise
REST_SAMPLES = 25  # half a second at 50 fps
REST_SPREAD_RAD = 0.01  # 2 px on a track of 182 px: detection noise of a ball that lies still
SWING_RAD = 0.05  # extremes closer than this are noise, not a swing
NO_PERSPECTIVE = "one picture gives circle and zero angle, not perspective"


class CalibrationError(ValueError):
    """The picture or the run does not show what a proposal needs; the text says what."""


@dataclass(frozen=True, slots=True)
class PixelToAngle:
    """psi of a pixel: by `homography` (9 numbers, row by row) when given, else by the circle's `centre_px`."""

    centre_px: tuple[float, float] = (0.0, 0.0)
    zero_angle_rad: float = 0.0
    homography: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Refuses a homography that is no 3 x 3 matrix of full rank (ValueError)."""
        if self.homography is None:
            return
        h = np.array(self.homography, float)
        if h.shape != (9,) or not np.isfinite(h).all() or abs(np.linalg.det(h.reshape(3, 3))) < 1e-12:
            raise ValueError("homography must be 9 finite numbers, row by row, of an invertible matrix")

    @classmethod
    def from_homography(cls, matrix: ArrayLike, zero_angle_rad: float = 0.0) -> PixelToAngle:
        """Through a 3 x 3 matrix H from pixels to the hoop's plane (x down, y to the left of the picture)."""
        return cls(zero_angle_rad=zero_angle_rad, homography=tuple(float(v) for v in np.asarray(matrix).ravel()))

    def __call__(self, x_px: float, y_px: float) -> float:
        """psi in (-pi, pi]."""
        down, left, _ = self._place(x_px, y_px)
        # psi = atan2(p_y / p_z, p_x / p_z) - zero
        return wrap(math.atan2(left, down) - self.zero_angle_rad)

    def distance(self, x_px: float, y_px: float) -> float:
        """From the axis: in pixels, through a homography in the units of its plane."""
        down, left, scale = self._place(x_px, y_px)
        return math.hypot(down, left) / scale if scale > 0.0 else math.inf

    def _place(self, x_px: float, y_px: float) -> tuple[float, float, float]:
        """From the axis, down and to the picture's left, and by what both are to be divided (above zero)."""
        if self.homography is None:
            return y_px - self.centre_px[1], self.centre_px[0] - x_px, 1.0
        # p = H [x, y, 1]
        h = self.homography
        w = h[6] * x_px + h[7] * y_px + h[8]
        px, py = h[0] * x_px + h[1] * y_px + h[2], h[3] * x_px + h[4] * y_px + h[5]
        return math.copysign(1.0, w) * px, math.copysign(1.0, w) * py, abs(w)


@dataclass(frozen=True, slots=True)
class Proposal:
    """What one picture tells; `track` is the circle of the ball's centre: concentric with the hoop."""

    ball: Circle
    track: Circle
    hoop: Circle  # outer edge of the hoop
    hoop_coverage: float  # share of the visible outer edge that was seen, 0..1
    colour: Colour
    zero_angle_rad: float
    confidence: float  # 0..1
    notes: tuple[str, ...]

    def settings(self) -> DetectorSettings:
        """The detector's settings with this proposal in them."""
        return detector_settings(self.colour, self.ball, self.track)

    def pixel_to_angle(self) -> PixelToAngle:
        """The circle and zero angle of this proposal."""
        return PixelToAngle((self.track.x_px, self.track.y_px), self.zero_angle_rad)


@dataclass(frozen=True, slots=True)
class RunProposal:
    """What a run of positions tells; `track` is the circle of the ball's centre."""

    track: Circle
    residual_px: float  # rms of the positions kept
    kept: float  # share of the positions kept
    span_rad: float  # arc that the run covers
    zero_angle_rad: float
    zero_from: str  # "rest", "swing" or "none"
    notes: tuple[str, ...]

    def pixel_to_angle(self) -> PixelToAngle:
        """The circle and zero angle of this proposal."""
        return PixelToAngle((self.track.x_px, self.track.y_px), self.zero_angle_rad)


def wrap(angle_rad: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)


def propose(bgr: Image) -> Proposal:
    """Circle, zero angle and colour from one picture of the ball at rest; or CalibrationError."""
    found = find_hoop(bgr)
    if found is None:
        raise CalibrationError("no hoop found: no circular edge goes round far enough")
    hoop, coverage = found
    candidates = find_candidates(bgr, hoop)
    if not candidates or candidates[0].score < LEAST_SCORE:
        raise CalibrationError("no ball found: nothing red, round and of a ball's size lies on the hoop's ring")
    guess, agreeing = consensus(candidates)
    colour = choose_colour(bgr, hoop, guess)
    ball = refine_ball(bgr, colour, guess)
    zero = math.atan2(hoop.x_px - ball.x_px, ball.y_px - hoop.y_px)
    track = Circle(hoop.x_px, hoop.y_px, math.hypot(ball.x_px - hoop.x_px, ball.y_px - hoop.y_px))
    notes = picture_notes(candidates, agreeing, colour, zero)
    return Proposal(ball, track, hoop, coverage, colour, zero, candidates[0].score * coverage, notes)


def consensus(candidates: list[BallCandidate]) -> tuple[Circle, list[BallCandidate]]:
    """Median circle of the good candidates at the best one's place, and those candidates."""
    best = candidates[0]
    agreeing = [
        c
        for c in candidates
        if c.score >= RIVAL_SCORE * best.score and math.hypot(c.x_px - best.x_px, c.y_px - best.y_px) < best.radius_px
    ]
    x, y, radius = np.median([(c.x_px, c.y_px, c.radius_px) for c in agreeing], axis=0)
    return Circle(float(x), float(y), float(radius)), agreeing


def refine_ball(bgr: Image, colour: Colour, guess: Circle) -> Circle:
    """The ball as the detector sees it with the proposed colour; the guess where it does not see it there."""
    there = Circle(guess.x_px, guess.y_px, 1.0)
    seen = Detector(detector_settings(colour, guess, there)).detect(bgr)
    return guess if seen is None else Circle(seen.x_px, seen.y_px, seen.radius_px)


def detector_settings(colour: Colour, ball: Circle, track: Circle) -> DetectorSettings:
    """Settings for this ball on this track; a circle from one picture may be some pixels off all round."""
    return DetectorSettings.for_ball(
        weights=colour.weights,
        threshold=colour.threshold,
        ball_radius_px=ball.radius_px,
        ring_centre_px=(track.x_px, track.y_px),
        ring_radius_px=track.radius_px,
        ring_half_width_px=0.6 * ball.radius_px,
    )


def picture_notes(
    candidates: list[BallCandidate], agreeing: list[BallCandidate], colour: Colour, zero: float
) -> tuple[str, ...]:
    """What a person should know before accepting the proposal."""
    notes = [NO_PERSPECTIVE]
    best = candidates[0]
    away = [c for c in candidates if math.hypot(c.x_px - best.x_px, c.y_px - best.y_px) > 2.0 * best.radius_px]
    if away and away[0].score >= RIVAL_SCORE * best.score:
        notes.append(f"a second ball-like object at {away[0].x_px:.0f}, {away[0].y_px:.0f} px")
    if abs(zero) > TILT_NOTE_RAD:
        notes.append(f"the ball is {math.degrees(zero):.0f} degrees from the picture's bottom: was it at rest?")
    if colour.gap <= 0.0:
        notes.append("ball and ring overlap in every weighting: more light or another background is needed")
    elif colour.gap < 20.0:
        notes.append(f"ball and ring are only {colour.gap:.0f} grey levels apart: more light would help")
    if len(agreeing) < 5:
        notes.append("few weightings and levels agree on the ball")
    return tuple(notes)


def propose_from_run(positions_px: Points) -> RunProposal:
    """Circle and zero angle from N x 2 pixel positions in order of time, NaN where no ball was seen."""
    points = np.asarray(positions_px, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise CalibrationError("positions must be N x 2 pixels")
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < LEAST_POSITIONS:
        raise CalibrationError(f"{len(points)} positions are too few: a circle needs {LEAST_POSITIONS}")
    if float(np.ptp(points, axis=0).max()) < 5.0:
        raise CalibrationError("the ball does not move: a circle needs an arc")
    # each place once: a ball at rest for most of a run would draw the circle into its own noise
    fit = fit_of(fit_circle_robust(places_of(points)).circle, points)
    if fit.kept < LEAST_KEPT or fit.residual_px > MOST_RESIDUAL * fit.circle.radius_px:
        raise CalibrationError(
            f"no circle: only {100 * fit.kept:.0f} % of the positions lie on one, to {fit.residual_px:.1f} px"
        )
    angle = np.unwrap(np.arctan2(fit.circle.x_px - points[:, 0], points[:, 1] - fit.circle.y_px))
    span = float(np.subtract(*np.percentile(angle, [99.0, 1.0])))
    zero, source = run_zero(angle)
    notes = ["a circle leaves perspective out: a homography needs four known points of the hoop's plane"]
    if span < SHORT_ARC_RAD:
        notes.append(f"the run covers {math.degrees(span):.0f} degrees only: centre and radius are uncertain")
    if source == "none":
        notes.append("neither rest nor free swing in the run: the zero angle is not determined and left at 0")
    if source == "rest":
        notes.append("the zero angle takes the part in which the ball lies still as the bottom")
    return RunProposal(fit.circle, fit.residual_px, fit.kept, min(span, 2.0 * math.pi), zero, source, tuple(notes))


def run_zero(angle: Points) -> tuple[float, str]:
    """Zero angle of an unwrapped run: from its longest rest, else from the middle of its swings."""
    rest = longest_rest(angle)
    if rest is not None:
        return wrap(float(np.mean(angle[rest]))), "rest"
    extremes = turning_points(angle)
    if len(extremes) >= 3:
        # (e0 + 2 e1 + e2) / 4 cancels the decay of a swing to first order
        middles = (extremes[:-2] + 2.0 * extremes[1:-1] + extremes[2:]) / 4.0
        return wrap(float(np.median(middles))), "swing"
    return 0.0, "none"


def longest_rest(angle: Points) -> slice | None:
    """Longest stretch that stays within REST_SPREAD_RAD of its own middle for REST_SAMPLES at least."""
    best: slice | None = None
    start = 0
    low = high = float(angle[0])
    for i, value in enumerate(angle):
        low, high = min(low, value), max(high, value)
        if high - low > 2.0 * REST_SPREAD_RAD:
            start = rest_start(angle, start, i)
            low, high = float(angle[start : i + 1].min()), float(angle[start : i + 1].max())
        if i + 1 - start >= REST_SAMPLES and (best is None or i + 1 - start > best.stop - best.start):
            best = slice(start, i + 1)
    return best


def rest_start(angle: Points, start: int, end: int) -> int:
    """First index from which all values up to `end` fit into the rest's spread."""
    outside = np.flatnonzero(np.abs(angle[start : end + 1] - angle[end]) > 2.0 * REST_SPREAD_RAD)
    if len(outside):
        start += int(outside[-1]) + 1
    while np.ptp(angle[start : end + 1]) > 2.0 * REST_SPREAD_RAD:
        start += 1
    return start


def turning_points(angle: Points) -> Points:
    """Alternating extremes that differ by SWING_RAD at least."""
    extremes: list[float] = []
    low = high = float(angle[0])
    rising = 0
    for value in angle:
        low, high = min(low, value), max(high, value)
        if rising >= 0 and value < high - SWING_RAD:
            if rising > 0:
                extremes.append(high)
            rising, low = -1, value
        elif rising <= 0 and value > low + SWING_RAD:
            if rising < 0:
                extremes.append(low)
            rising, high = 1, value
    return np.array(extremes)
