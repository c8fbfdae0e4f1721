"""The filter of a ball that may leave the hoop: `DelayedEkf` whose nodes have a mode each.

    rolling  (theta, dtheta, psi, dpsi)
    inner    the same, on an inner hoop
    air      (theta, dtheta, psi, dpsi, spin, dspin, distance, ddistance): psi is the direction from the axis

A node's mode follows from the node before by the guards of the model; a late picture makes take-off and landing run
again with all that came after. A picture that shows a ball where the mode cannot have it changes the mode: off the
track it flies, and what contradicts a flight twice in a row begins it anew from there.

Rules of this file: as of `estimator`; where nobody lets the ball fly (`may_fly`) it is that filter, to the last bit.
"""

from __future__ import annotations

from math import isfinite, nan, sqrt, tau

import numpy as np

from hoopd.core.ball_modes import BallModes, BallState, carried, jumped, probability
from hoopd.core.estimator import LONGEST_STEP_S, ROLLING, DelayedEkf, EkfSettings, Step, _Node
from hoopd.core.records import BallPlace, CameraSample, DriverSample, Estimate, Vector

AIR, INNER = "air", "inner"
DIRECTION, DISTANCE = 2, 6
# Off its track by so much of its radius a ball does not roll: 7 mm, five times what a bounce on rubber lifts it.
OFF_TRACK = 0.08
# Two degrees of freedom; as `gate_nis`, with room for the model's share.
GATE_NIS = 30.0
# In a row, against a flight: then the flight is another one.
CONTRADICTIONS = 2
# Of a flight that begins where a picture shows the ball: its speeds, rad/s and m/s.
UNKNOWN_RAD_S, UNKNOWN_M_S = 8.0, 1.0
# A ball nearer to the axis than this share of its track has no direction worth its pixels.
NEAREST = 0.1


class HybridEkf(DelayedEkf):
    """See the head of the file."""

    def __init__(self, step: Step, modes: BallModes, settings: EkfSettings | None = None) -> None:
        self.modes = modes
        super().__init__(step, settings)
        q, self._track_m = self.settings.q, modes.tracks_m[ROLLING]
        square = self._track_m**2
        self._q_air = np.array([*q, 0.0, 0.0, q[2] * square, q[3] * square])

    def reset(self) -> None:
        """Know nothing."""
        super().reset()
        self._place: BallPlace | None = None
        self._may_fly, self._against, self._surprise = False, 0, nan

    def update(
        self,
        t: float,
        torque_previous: float,
        t_applied: float,
        driver: DriverSample | None,
        camera: CameraSample | None,
        *,
        held: bool = False,
        unmodelled: float = 0.0,
        may_fly: bool = False,
    ) -> Estimate:
        """As `DelayedEkf.update`; the estimate tells the ball's mode while it may fly."""
        self._may_fly, self._place, self._surprise = may_fly, None, nan
        found = super().update(
            t, torque_previous, t_applied, driver, camera, held=held, unmodelled=unmodelled, may_fly=may_fly
        )
        return found if self._place is None else found._replace(ball=self._place)

    @property
    def covariance(self) -> Vector:
        """(4, 4) right after the newest node."""
        return np.ascontiguousarray(super().covariance[:4, :4])

    # ------------------------------------------------------------------------------------------ samples

    def _fuse_camera(self, camera: CameraSample) -> tuple[bool, float, float]:
        """As of the rolling ball, where it rolls and the picture shows it on its track."""
        if not (self._may_fly and self._usable(camera.t, camera.direction, camera.distance)):
            return super()._fuse_camera(camera)
        node = self._insert(camera.t)
        if not all(map(isfinite, node.x.tolist())):
            return False, nan, nan  # lost: `update` says so
        flies, off = node.mode == AIR, self._off_track(node.mode, camera.distance)
        if not flies and not off:
            self._nodes.remove(node)
            return super()._fuse_camera(camera._replace(psi=camera.direction))
        predicted = float(node.x[DIRECTION])
        node.psi = camera.direction + tau * round((predicted - camera.direction) / tau)
        node.distance = camera.distance * self._track_m
        innovation, nis = node.psi - predicted, nan
        if flies:
            nis = self._judged(node)
            self._against = self._against + 1 if nis > GATE_NIS else 0
            if 0 < self._against < CONTRADICTIONS:
                self._nodes.remove(node)
                return False, innovation, nis
        node.start_air = off and (not flies or self._against > 0)
        node.start_ball = not off and self._against > 0
        self._against, self._rejected, self._ball_seen = 0, 0, True
        self._rerun(node)
        return True, innovation, nis

    def _off_track(self, mode: str, distance: float) -> bool:
        """Whether a ball that is seen there is not on the mode's track; of a flight, on the hoop's."""
        track = self.modes.tracks_m[ROLLING if mode == AIR else mode] / self._track_m
        return distance < track - OFF_TRACK or (mode == INNER and distance > track + OFF_TRACK)

    def _judged(self, node: _Node) -> float:
        """NIS of place, direction and distance together; the distance's own surprise is kept."""
        rows = [DIRECTION, DISTANCE]
        s = node.p[np.ix_(rows, rows)] + np.diag(self._noise(node))
        e = np.array([node.psi, node.distance]) - node.x[rows]
        self._surprise = float(e[1]) / sqrt(float(s[1, 1]))
        det = float(s[0, 0] * s[1, 1] - s[0, 1] * s[1, 0])
        # e' S^-1 e
        return float(s[1, 1] * e[0] ** 2 - 2.0 * s[0, 1] * e[0] * e[1] + s[0, 0] * e[1] ** 2) / det

    def _noise(self, node: _Node) -> tuple[float, float]:
        """Variances of direction (rad^2) and distance (m^2): a camera's noise is one of places."""
        r, track = self.settings.r_psi, self._track_m
        return r * (track / max(float(node.x[DISTANCE]), NEAREST * track)) ** 2, r * track**2

    def _r_psi(self, node: _Node) -> float:
        """Variance of the camera's angle on the node's track."""
        if node.mode != INNER:
            return super()._r_psi(node)
        return super()._r_psi(node) * (self._track_m / self.modes.tracks_m[INNER]) ** 2

    # ------------------------------------------------------------------------------------------ filter

    def _predict(self, node: _Node, t: float) -> tuple[Vector, Vector, str]:
        """Through take-off, flight, touch and landing, where the ball may fly."""
        if node.mode == ROLLING and not node.free:
            return super()._predict(node, t)
        now, h = BallState(node.x, node.p, node.mode), t - node.t
        if not node.free:
            x, p, _ = jumped(self.modes.landing, now, node.u, ROLLING) if node.mode == AIR else now
            return super()._predict(_Node(node.t, node.u, node.q, x, p), t)
        densities = {ROLLING: node.q, INNER: node.q, AIR: self._q_air}
        while h > 0.0:
            now = carried(self.modes, now, node.u, densities, min(h, LONGEST_STEP_S))
            h -= LONGEST_STEP_S
        return now

    def _absorb_ball(self, node: _Node) -> None:
        """Place in the air, angle on the hoop."""
        if node.start_air:
            self._start_air(node)
        elif node.mode != AIR:
            super()._absorb_ball(node)
        elif node.start_ball:
            node.x, node.p, node.mode = jumped(
                self.modes.landing, BallState(node.x, node.p, node.mode), node.u, ROLLING
            )
            super()._absorb_ball(node)
        elif node.psi == node.psi:  # not NaN
            direction, distance = self._noise(node)
            self._measure(node, (DIRECTION, node.psi, direction))
            if node.distance == node.distance:
                self._measure(node, (DISTANCE, node.distance, distance))

    def _start_air(self, node: _Node) -> None:
        """A flight of which only the place is known."""
        now = BallState(node.x, node.p, node.mode)
        if node.mode != AIR:
            now = jumped(self.modes.take_off, now, node.u, AIR)
        node.x, node.p, node.mode = now
        direction, distance = self._noise(node)
        self._start(node, DIRECTION, (node.psi, float(node.x[DIRECTION + 1])), (direction, UNKNOWN_RAD_S**2))
        self._start(node, DISTANCE, (node.distance, float(node.x[DISTANCE + 1])), (distance, UNKNOWN_M_S**2))

    def _at(self, t: float) -> Vector:
        """State at `t`; where the ball may fly, its place is kept."""
        node = self._nodes[-1]
        if node.mode == ROLLING and not node.free:
            return super()._at(t)
        x, p, mode = self._predict(node, t)
        if self._may_fly and all(map(isfinite, x.tolist())):
            distance = (float(x[DISTANCE]) if mode == AIR else self.modes.tracks_m[mode]) / self._track_m
            self._place = BallPlace(mode, probability(self.modes.modes[mode], x, p), distance, self._surprise)
        return np.array(x[:4])
