"""State estimator: an extended Kalman filter that fuses every sample at the time it was taken.

Rules of this file: no clock, no randomness, the same calls give the same bits. The model comes as a callable.

The past is a list of nodes in time order. A node is a torque switch or a measurement with the state and covariance
right after it, so that each node is a checkpoint. A late sample is put between its neighbours and everything after
it runs again. A sample is judged once, when it comes in; afterwards it only runs along.

    t_k-3      t_k-2      t_k-1      t_k
    |.u        |.u        |.u        |        . board: torque switch and sample of theta, dtheta
        c                            |        c camera: arrives now, 2 to 4 ticks old
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, inf, isfinite, nan, sqrt, tau

import numpy as np

from hoopd.core.covariance import Measured, corrected
from hoopd.core.records import CameraSample, DriverSample, Estimate, Vector

# (x, torque N m, h s <= 20 ms) -> state after h, and its derivative by x (4, 4)
Step = Callable[[Vector, float, float], tuple[Vector, Vector]]
Ahead = Callable[[Vector, float, float], Vector]  # the state alone, of the same bits

ROLLING = "rolling"  # the mode that this filter knows; those of a ball that flies are `hybrid_estimator`'s
LONGEST_STEP_S = 0.02  # what a `Step` is accurate for
SAME_INSTANT_S = 1e-3  # a sample this close to a torque switch was taken by the same request
RESTART_GAP_S = 1.0  # a gap this long outlives the ball's swing: start again rather than predict
THETA_JUMP_RAD = 1.0  # no prediction misses by this much: the board restarted its count
# No hoop within its board's limit carries a ball so fast (85 rad/s, docs/reference/board.md); beyond half a turn a
# picture the angles of a slow ball fit a fast one as well, and a filter that took it for fast would never come back.
IMPOSSIBLE_RAD_S = 100.0
BALL_SPEED_LIMIT_RAD_S = 15.0  # rejected samples that move faster are not one ball; one let go at the side has 12


@dataclass(frozen=True)
class EkfSettings:
    """Noise, gate and memory of the filter."""

    # process noise, variance per second: unmodelled accelerations of hoop (rad/s)^2/s and ball
    q: tuple[float, float, float, float] = (1e-8, 4.0, 1e-6, 0.1)
    # A hand on the ball undoes up to K2 sin psi = 70 rad/s^2 for as long as it likes: (70 rad/s^2)^2 over 0.2 s.
    q_held_dpsi: float = 1000.0
    r_theta: float = (tau / 4096) ** 2 / 12  # rad^2, one count's quantisation
    r_dtheta: float = 0.05**2  # (rad/s)^2
    r_psi: float = 0.004**2  # rad^2
    # Normalised innovation squared, chi-square with one degree of freedom: 25 is 5 sigma. With a right model a good
    # sample in 2 million is lost; the width above 3 sigma is for the 20 % of parameter error that must not blind it.
    gate_nis: float = 25.0
    reacquire_after: int = 5  # samples in a row, alike, against the prediction: the prediction is wrong
    horizon_s: float = 0.25  # the oldest camera sample that is still fused, with room for missed ticks
    # uncertainty of speeds nobody has measured, (rad/s)^2
    start_dtheta: float = 10.0**2
    start_dpsi: float = 3.0**2

    def __post_init__(self) -> None:
        """Refuse noises a filter cannot work with."""
        positive = {"r_theta": self.r_theta, "r_dtheta": self.r_dtheta, "r_psi": self.r_psi, "gate_nis": self.gate_nis}
        for name, value in {**positive, "horizon_s": self.horizon_s}.items():
            if not (isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be above zero, not {value}")
        if len(self.q) != 4 or not all(isfinite(value) and value >= 0.0 for value in self.q):
            raise ValueError(f"q must be four numbers not below zero, not {self.q}")


def ahead_of(step: Step) -> Ahead:
    """A step without its derivative: where it offers one (`ahead`), in a third of the time."""
    return getattr(step, "ahead", None) or (lambda x, u, h: step(x, u, h)[0])


class _Node:
    """One instant of the past: torque from here on, what was measured here, state and covariance after it."""

    __slots__ = (
        "distance",
        "dtheta",
        "free",
        "mode",
        "p",
        "psi",
        "q",
        "start_air",
        "start_ball",
        "start_hoop",
        "t",
        "theta",
        "u",
        "x",
    )

    def __init__(self, t: float, u: float, q: Vector, x: Vector, p: Vector, mode: str = ROLLING) -> None:
        self.t, self.u, self.q, self.x, self.p, self.mode = t, u, q, x, p, mode  # u and q from here on
        self.free = False  # from here on the ball may leave its mode
        self.theta = self.dtheta = self.psi = self.distance = nan  # NaN: not measured here
        # the measurement replaces the prediction
        self.start_hoop = self.start_ball = self.start_air = False


class DelayedEkf:
    """Extended Kalman filter over (theta, dtheta, psi, dpsi) with late samples; see the head of the file."""

    def __init__(self, step: Step, settings: EkfSettings | None = None) -> None:
        self.settings = settings or EkfSettings()
        self._step, self._ahead = step, ahead_of(step)
        self._q_free = np.array(self.settings.q)
        self._q_held = np.array([*self.settings.q[:3], self.settings.q_held_dpsi])
        self.reset()

    def reset(self) -> None:
        """Know nothing: the next samples initialise."""
        self._nodes: list[_Node] = []
        self._t = -inf
        self._hoop_seen = self._ball_seen = False
        self._rejected = 0
        self._rejected_psi = self._rejected_t = nan

    @property
    def covariance(self) -> Vector:
        """(4, 4) right after the newest node."""
        return self._nodes[-1].p.copy() if self._nodes else np.diag(self._start_variance())

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
        """Estimate at `t`: the torque acts since `t_applied`; None or NaN samples predict only; times in s.

        `held`: nobody controls the ball, so that a hand may hold it or carry it round against the model. `unmodelled`:
        density of what a fast motion adds to the ball's unmodelled accelerations, (rad/s)^2/s. `may_fly`: nothing to
        this filter, whose ball rolls.
        """
        self._open(t)
        hoop, judged = (nan, nan, nan), (False, nan, nan)
        switch = max(min(t, t_applied), self._nodes[0].t)
        late = camera is not None and camera.t < switch
        # a late picture first: then the newest instants run once, not twice
        if camera is not None and late:
            judged = self._fuse_camera(camera)
        node = self._insert(switch)
        node.u = torque_previous if isfinite(torque_previous) else 0.0
        node.q, node.free = self._q_held if held else self._q_free, may_fly
        if unmodelled > 0.0 and not held:
            node.q = np.array([*self.settings.q[:3], self.settings.q[3] + unmodelled])
        if driver is not None:
            hoop = self._fuse_driver(driver)
        if camera is not None and not late:
            judged = self._fuse_camera(camera)
        x = self._at(t)
        if not all(map(isfinite, x.tolist())):
            self.reset()  # the caller sees that it is lost, and the next samples begin anew
            return Estimate(np.full(4, nan), False, nan, nan, False, nan)
        accepted, innovation_psi, nis = judged
        ready = self._hoop_seen and self._ball_seen
        surprise = (hoop[1], hoop[2], copysign(sqrt(nis), innovation_psi))
        return Estimate(x, ready, innovation_psi, hoop[0], accepted, nis, surprise)

    # ------------------------------------------------------------------------------------------ nodes

    def _open(self, t: float) -> None:
        """Begin the tick at `t`: start again after a gap, drop the nodes that no sample can reach any more."""
        if not self._t < t < self._t + RESTART_GAP_S:
            self.reset()
        self._t = t
        nodes, oldest = self._nodes, t - self.settings.horizon_s
        if not nodes:
            nodes.append(_Node(oldest, 0.0, self._q_held, np.zeros(4), np.diag(self._start_variance())))
        while len(nodes) > 1 and nodes[1].t <= oldest:
            nodes.pop(0)

    def _insert(self, t: float) -> _Node:
        """A new node with the predicted state, the last one at its time."""
        index = self._index_before(t)
        node = self._nodes[index]
        new = _Node(t, node.u, node.q, *self._predict(node, t))
        new.free = node.free
        self._nodes.insert(index + 1, new)
        return new

    def _index_before(self, t: float) -> int:
        """Index of the last node not after `t`, which is not before the first."""
        index = len(self._nodes) - 1
        while self._nodes[index].t > t:
            index -= 1
        return index

    def _usable(self, t: float, *values: float) -> bool:
        """Finite, not from the future, not older than the memory."""
        return self._nodes[0].t <= t <= self._t and all(isfinite(value) for value in values)

    def _rerun(self, node: _Node) -> None:
        """Take in what `node` measured and bring the nodes after it up to date."""
        self._absorb(node)
        nodes = self._nodes
        for index in range(nodes.index(node) + 1, len(nodes)):
            before, after = nodes[index - 1], nodes[index]
            after.x, after.p, after.mode = self._predict(before, after.t)
            self._absorb(after)

    # ------------------------------------------------------------------------------------------ samples

    def _fuse_driver(self, driver: DriverSample) -> tuple[float, float, float]:
        """Put the board's sample in its place; innovation of theta, those of theta and dtheta over
        what is expected, NaN when it is refused."""
        if not self._usable(driver.t, driver.theta, driver.dtheta):
            return nan, nan, nan
        node = self._nodes[self._index_before(min(self._t, driver.t + SAME_INSTANT_S))]
        if abs(node.t - driver.t) > SAME_INSTANT_S or isfinite(node.theta) or isfinite(node.psi):
            node = self._insert(driver.t)
        innovation, off = driver.theta - float(node.x[0]), driver.dtheta - float(node.x[1])
        # e / sqrt(S)
        theta = innovation / sqrt(float(node.p[0, 0]) + self.settings.r_theta)
        dtheta = off / sqrt(float(node.p[1, 1]) + self.settings.r_dtheta)
        node.theta, node.dtheta = driver.theta, driver.dtheta
        node.start_hoop = not self._hoop_seen or abs(innovation) > THETA_JUMP_RAD
        self._hoop_seen = True
        self._rerun(node)
        return innovation, theta, dtheta

    def _fuse_camera(self, camera: CameraSample) -> tuple[bool, float, float]:
        """Put the picture's angle in its place if it passes the gate; returns accepted, innovation, NIS."""
        if not self._usable(camera.t, camera.psi):
            return False, nan, nan
        node = self._insert(camera.t)
        predicted = float(node.x[2])
        if not isfinite(predicted):
            return False, nan, nan  # lost: `update` says so
        psi = camera.psi + tau * round((predicted - camera.psi) / tau)  # the turn nearest to the estimate at that time
        innovation = psi - predicted
        nis = innovation * innovation / (float(node.p[2, 2]) + self._r_psi(node))
        surprising = nis > self.settings.gate_nis
        lost = not self._ball_seen or abs(float(node.x[3])) > IMPOSSIBLE_RAD_S
        node.start_ball = lost or (surprising and self._insists(camera))
        if surprising and not node.start_ball:
            self._nodes.remove(node)
            return False, innovation, nis
        node.psi = psi
        self._ball_seen, self._rejected = True, 0
        self._rerun(node)
        return True, innovation, nis

    def _insists(self, camera: CameraSample) -> bool:
        """Enough rejected samples in a row that could be one moving ball: the filter has lost it."""
        moved = abs(camera.psi - self._rejected_psi) % tau
        alike = min(moved, tau - moved) <= BALL_SPEED_LIMIT_RAD_S * (camera.t - self._rejected_t)
        self._rejected = self._rejected + 1 if alike else 1
        self._rejected_psi, self._rejected_t = camera.psi, camera.t
        return self._rejected >= self.settings.reacquire_after

    # ------------------------------------------------------------------------------------------ filter

    def _start_variance(self) -> tuple[float, float, float, float]:
        return (tau**2, self.settings.start_dtheta, 1.0, self.settings.start_dpsi)

    def _predict(self, node: _Node, t: float) -> tuple[Vector, Vector, str]:
        """State, covariance and mode of a node carried on to `t`: x' = f(x, u, h), P' = F P F' + q h."""
        x, p, h = node.x, node.p, t - node.t
        while h > 0.0:
            piece = min(h, LONGEST_STEP_S)
            x, f = self._step(x, node.u, piece)
            p = f.dot(p).dot(f.T)  # the operator @ takes twice as long for matrices this small
            p = 0.5 * (p + p.T)  # symmetric to the bit
            p.ravel()[::5] += node.q * piece
            h -= piece
        return x, p, ROLLING

    def _absorb(self, node: _Node) -> None:
        """Correct a node's state by what was measured there."""
        self._absorb_hoop(node)
        self._absorb_ball(node)

    def _absorb_hoop(self, node: _Node) -> None:
        s = self.settings
        if node.start_hoop:
            self._start(node, 0, (node.theta, node.dtheta), (s.r_theta, s.r_dtheta))
        elif node.theta == node.theta:  # not NaN
            self._measure(node, (0, node.theta, s.r_theta), (1, node.dtheta, s.r_dtheta))

    def _absorb_ball(self, node: _Node) -> None:
        s = self.settings
        if node.start_ball:
            self._start(node, 2, (node.psi, 0.0), (self._r_psi(node), s.start_dpsi))
        elif node.psi == node.psi:
            self._measure(node, (2, node.psi, self._r_psi(node)))

    def _r_psi(self, node: _Node) -> float:
        """Variance of the camera's angle, rad^2."""
        return self.settings.r_psi

    @staticmethod
    def _start(node: _Node, first: int, values: tuple[float, float], variances: tuple[float, float]) -> None:
        """States `first` and `first` + 1 as measured, the prediction forgotten."""
        x, p = node.x.copy(), node.p.copy()
        for index, value, variance in zip((first, first + 1), values, variances, strict=True):
            x[index] = value
            p[index, :] = p[:, index] = 0.0
            p[index, index] = variance
        node.x, node.p = x, p

    @staticmethod
    def _measure(node: _Node, *measured: Measured) -> None:
        """States as they were measured, one after the other."""
        node.x, node.p = corrected(node.x, node.p, measured)

    def _at(self, t: float) -> Vector:
        """State at `t`, not before the newest node."""
        node = self._nodes[-1]
        x, h = node.x, t - node.t
        while h > 0.0:
            x = self._ahead(x, node.u, min(h, LONGEST_STEP_S))
            h -= LONGEST_STEP_S
        return x.copy()
