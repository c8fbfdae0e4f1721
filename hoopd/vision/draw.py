# Rules of this file: a proposal drawn for a person to judge; nothing is computed that decides. numpy and cv2 only.
"""Pictures of a proposal: ball, track circle, hoop circle, zero direction and the colour found."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from hoopd.vision.calibration import Proposal, RunProposal
from hoopd.vision.circles import Circle, Points

Image = NDArray[np.uint8]
Ink = tuple[int, int, int]  # blue, green, red

BALL_INK: Ink = (255, 255, 0)
TRACK_INK: Ink = (0, 255, 0)
HOOP_INK: Ink = (255, 0, 255)
ZERO_INK: Ink = (0, 220, 255)
TEXT_INK: Ink = (255, 255, 255)
SHIFT = 4  # cv2 draws with 2^-4 pixel
LINE_PX = 22  # height of a line of text


def draw_proposal(bgr: Image, proposal: Proposal, scale: int = 2) -> Image:
    """The picture enlarged, with the proposal on it and its numbers below."""
    canvas = enlarge(bgr, scale)
    draw_circle(canvas, proposal.hoop, scale, HOOP_INK)
    draw_circle(canvas, proposal.track, scale, TRACK_INK)
    draw_circle(canvas, proposal.ball, scale, BALL_INK)
    draw_cross(canvas, proposal.ball, scale, BALL_INK)
    draw_zero(canvas, proposal.track, proposal.zero_angle_rad, scale)
    blue, green, red = proposal.colour.weights
    lines = [
        (f"ball {circle_text(proposal.ball)}   confidence {proposal.confidence:.2f}", BALL_INK),
        (f"track of the ball's centre {circle_text(proposal.track)}", TRACK_INK),
        (f"hoop, outer edge {circle_text(proposal.hoop)}", HOOP_INK),
        (f"zero angle {proposal.zero_angle_rad:+.4f} rad ({math.degrees(proposal.zero_angle_rad):+.2f} deg)", ZERO_INK),
        (f"grey = {red:g} R {green:+g} G {blue:+g} B   threshold {proposal.colour.threshold:.1f}", TEXT_INK),
        *((note, TEXT_INK) for note in proposal.notes),
    ]
    return with_text(canvas, lines)


def draw_run(positions_px: Points, proposal: RunProposal, bgr: Image | None = None, scale: int = 2) -> Image:
    """The positions of a run with the circle and zero angle found, on a picture where there is one."""
    points = np.asarray(positions_px, float)
    points = points[np.isfinite(points).all(axis=1)]
    canvas = enlarge(bgr if bgr is not None else blank(points, proposal.track), scale)
    for x, y in points:
        cv2.circle(canvas, fixed(x, y, scale), fixed_length(0.8, scale), BALL_INK, -1, cv2.LINE_AA, SHIFT)
    draw_circle(canvas, proposal.track, scale, TRACK_INK)
    draw_zero(canvas, proposal.track, proposal.zero_angle_rad, scale)
    lines = [
        (f"{len(points)} positions, {proposal.kept:.0%} kept, residual {proposal.residual_px:.2f} px rms", BALL_INK),
        (f"track of the ball's centre {circle_text(proposal.track)}", TRACK_INK),
        (f"zero angle {proposal.zero_angle_rad:+.4f} rad from {proposal.zero_from}", ZERO_INK),
        *((note, TEXT_INK) for note in proposal.notes),
    ]
    return with_text(canvas, lines)


def enlarge(bgr: Image, scale: int) -> Image:
    """The picture with every pixel `scale` times as large."""
    return np.repeat(np.repeat(bgr, scale, axis=0), scale, axis=1)


def blank(points: Points, track: Circle) -> Image:
    """A dark picture that holds the points and the circle."""
    reach = np.array([[track.x_px + track.radius_px, track.y_px + track.radius_px]])
    width, height = (np.ceil(np.vstack([points, reach]).max(axis=0)) + 20).astype(int)
    return np.full((min(int(height), 4000), min(int(width), 4000), 3), 40, np.uint8)


def fixed(x_px: float, y_px: float, scale: int) -> tuple[int, int]:
    """Picture coordinates in cv2's fixed-point coordinates of the enlarged picture."""
    return (round(((x_px + 0.5) * scale - 0.5) * 2**SHIFT), round(((y_px + 0.5) * scale - 0.5) * 2**SHIFT))


def fixed_length(length_px: float, scale: int) -> int:
    """A length in cv2's fixed-point units of the enlarged picture."""
    return round(length_px * scale * (1 << SHIFT))


def draw_circle(canvas: Image, circle: Circle, scale: int, ink: Ink) -> None:
    """One thin circle."""
    centre = fixed(circle.x_px, circle.y_px, scale)
    cv2.circle(canvas, centre, fixed_length(circle.radius_px, scale), ink, 1, cv2.LINE_AA, SHIFT)


def draw_cross(canvas: Image, circle: Circle, scale: int, ink: Ink) -> None:
    """A cross at a circle's centre."""
    for dx, dy in ((6.0, 0.0), (0.0, 6.0)):
        start = fixed(circle.x_px - dx, circle.y_px - dy, scale)
        cv2.line(canvas, start, fixed(circle.x_px + dx, circle.y_px + dy, scale), ink, 1, cv2.LINE_AA, SHIFT)


def draw_zero(canvas: Image, track: Circle, zero_angle_rad: float, scale: int) -> None:
    """Line from the centre towards psi = 0, a little beyond the track, and the side to which psi grows."""

    def point(angle: float, share: float) -> tuple[int, int]:
        # psi = atan2(cx - x, y - cy): positive to the left
        reach = share * track.radius_px
        return fixed(track.x_px - reach * math.sin(angle), track.y_px + reach * math.cos(angle), scale)

    draw_cross(canvas, track, scale, ZERO_INK)
    cv2.line(canvas, point(zero_angle_rad, 0.0), point(zero_angle_rad, 1.25), ZERO_INK, 1, cv2.LINE_AA, SHIFT)
    x, y = (v >> SHIFT for v in point(zero_angle_rad + 0.25, 0.7))
    cv2.putText(canvas, "psi > 0", (x - 60, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, ZERO_INK, 1, cv2.LINE_AA)


def circle_text(circle: Circle) -> str:
    """Centre and radius in one line."""
    return f"({circle.x_px:.1f}, {circle.y_px:.1f}) px, radius {circle.radius_px:.1f} px"


def with_text(canvas: Image, lines: list[tuple[str, Ink]]) -> Image:
    """The picture with a dark bar of text below it."""
    bar = np.zeros((LINE_PX * len(lines) + 8, canvas.shape[1], 3), np.uint8)
    for i, (text, ink) in enumerate(lines):
        cv2.putText(bar, text, (8, LINE_PX * (i + 1) - 4), cv2.FONT_HERSHEY_SIMPLEX, 0.55, ink, 1, cv2.LINE_AA)
    return np.vstack([canvas, bar])
