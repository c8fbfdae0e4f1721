"""What a camera that lies makes of the ball: the rig's faults of single pictures that carry fresh stamps.

Rules of this file: a function of the script, the time and the state; the same for angles and for pictures.
"""

from __future__ import annotations

from collections import deque
from math import pi, sin

from hoopd.sim.faults import OLDEST_PICTURE_S, FaultScript
from hoopd.vision.calibration import wrap

State = tuple[float, float, float, float]


def seen_state(script: FaultScript, t: float, state: State) -> State:
    """The state that the picture taken at `t` shows: the ball held somewhere, or at a multiple of its angle."""
    theta, dtheta, psi, dpsi = state
    if held := script.active(t, "ball_held"):
        return theta, dtheta, float(held["psi_rad"]), dpsi
    if scale := script.active(t, "picture_scale"):
        factor = float(scale["factor"])
        return theta, dtheta, factor * wrap(psi), factor * dpsi
    return state


def painted_psi(script: FaultScript, t: float) -> float | None:
    """Angle of the ball that is painted on, in place of the real one; it may swing."""
    paint = script.active(t, "picture_ball_painted")
    if paint is None:
        return None
    swing = float(paint["swing_rad"]) * sin(2.0 * pi * (t - paint.at_s) / float(paint["period_s"]))
    return float(paint["psi_rad"]) + swing


def age_s(script: FaultScript, t: float) -> float:
    """How much older than its stamp a picture stamped `t` is."""
    aged = script.active(t, "pictures_aged")
    return float(aged["delay_s"]) if aged else 0.0


class Past:
    """States of the last pictures' times, for a camera that shows an older one."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, State]] = deque()

    def add(self, t: float, state: State) -> None:
        """The state at the time of a picture; times rise."""
        self._rows.append((t, state))
        while self._rows[0][0] < t - OLDEST_PICTURE_S:
            self._rows.popleft()

    def at(self, t: float) -> State:
        """In a straight line between two pictures; the first one that is known before it."""
        after = self._rows[-1]
        for row in reversed(self._rows):
            if row[0] <= t:
                share = 0.0 if after[0] == row[0] else (t - row[0]) / (after[0] - row[0])
                a, b = row[1], after[1]
                return tuple(x + share * (y - x) for x, y in zip(a, b, strict=True))  # type: ignore[return-value]
            after = row
        return after[1]
