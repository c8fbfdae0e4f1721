"""What the rig's camera makes of the plant's state: a ball angle directly, or a picture that is then analysed.

Rules of this file: everything random is drawn from one generator per run, once per picture, whatever happens to
the picture afterwards, so that a fault does not shift the noise of later pictures.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, isfinite, nan, sin
from typing import Protocol

import numpy as np

from hoopd.core.records import CameraSample
from hoopd.shell.ball_detection import Analyser
from hoopd.sim import lies
from hoopd.sim.camera import Painter
from hoopd.sim.faults import FaultScript
from hoopd.vision.calibration import wrap

State = lies.State
# Off its track by more of its radius a ball is outside of the ring in which the detector looks (15 of 182 px).
SEEN_SHARE = 0.08
# Nearer to the axis than this share of the track a place has no direction.
NEAREST = 0.05


class Watcher(Protocol):
    """Turns the plant's state at a capture time into what the camera saw."""

    def see(self, frame: int, t: float, state: State, distance: float = 1.0) -> CameraSample: ...


@dataclass(frozen=True)
class Disturbance:
    """An angle added to what one picture shows: the thesis's output disturbance."""

    at_s: float = 0.0
    size_rad: float = 0.0

    def of(self, t: float, frame_s: float) -> float:
        """Size for the one picture whose period holds `at_s`."""
        return self.size_rad if self.size_rad and self.at_s <= t < self.at_s + frame_s else 0.0


class DirectWatcher:
    """Angles without pictures: noise, zero-angle error, and the camera's faults in terms of the result."""

    def __init__(
        self,
        script: FaultScript,
        seed: int,
        *,
        noise_rad: float,
        offset_rad: float,
        centre_px: tuple[float, float],
        radius_px: float,
        inner: float = 0.0,  # track of a ball on an inner hoop, in shares of the outer one's radius
        disturbance: Disturbance = Disturbance(),
        frame_s: float = 0.02,
    ) -> None:
        self._script, self._rng = script, np.random.default_rng([seed, 2])
        self._across = np.random.default_rng([seed, 5])  # of its own: the angles' noise is as without it
        self._noise, self._offset = noise_rad, offset_rad
        self._centre, self._radius = centre_px, radius_px
        self._inner = inner
        self._disturbance, self._frame_s = disturbance, frame_s
        self._frozen: CameraSample | None = None

    def see(self, frame: int, t: float, state: State, distance: float = 1.0) -> CameraSample:
        """One sample of the ball's angle; `distance`: of the ball from the axis, in shares of its track's radius."""
        noise = self._noise * self._rng.standard_normal()
        seen = distance + self._noise * self._across.standard_normal()
        sample = self._see(frame, t, state, noise / max(distance, NEAREST), seen)
        if self._script.active(t, "pictures_frozen") is None:
            self._frozen = None
            return sample
        self._frozen = self._frozen or sample
        return self._frozen._replace(frame=frame, t=t, t_arrival=t)

    def _see(self, frame: int, t: float, state: State, noise: float, distance: float) -> CameraSample:
        if self._script.active(t, "black_pictures") or self._script.active(t, "ball_gone"):
            return CameraSample(frame, t, t, nan, 0.0, nan, nan, frame)
        psi = lies.painted_psi(self._script, t)
        if psi is None:
            shown = lies.seen_state(self._script, t, state)[2]
            psi = shown + self._offset + noise + self._disturbance.of(t, self._frame_s)
        x = self._centre[0] - self._radius * distance * sin(psi)
        y = self._centre[1] + self._radius * distance * cos(psi)
        direction = wrap(psi)
        on_inner = self._inner > 0.0 and abs(distance - self._inner) < SEEN_SHARE
        if abs(distance - 1.0) > SEEN_SHARE and not on_inner:  # its place is known, but it is no ball on a hoop
            return CameraSample(frame, t, t, nan, 0.0, x, y, frame, direction, distance)
        # what differs from picture to picture, as a sensor's noise does
        return CameraSample(frame, t, t, direction, 1.0 if isfinite(psi) else 0.0, x, y, frame, direction, distance)


class PictureWatcher:
    """Angles from rendered pictures, by the same analysis as on the device."""

    def __init__(self, painter: Painter, analyser: Analyser, frame_s: float) -> None:
        self._painter, self._analyser, self._frame_s = painter, analyser, frame_s

    def see(self, frame: int, t: float, state: State, distance: float = 1.0) -> CameraSample:
        """Render and analyse one picture."""
        return self._analyser.bgr(frame, t, t, self._painter.paint(frame, t, state, self._frame_s, distance))
