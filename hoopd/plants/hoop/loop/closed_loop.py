"""The closed loop on the nonlinear plant, without bytes and pictures: for design and for tests of the laws.

Rules of this file: pure and seeded; the time-line is the daemon's: at t_k the tick sees the newest answer of the
board (sampled WIRE_S after t_k-1) and the newest picture delivered, its torque acts from t_k + WIRE_S.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, nan, pi, tau
from typing import Protocol

import numpy as np

from hoopd.core.controllers import Controller, Measurement
from hoopd.core.estimator import DelayedEkf
from hoopd.core.feedforward import FeedForward
from hoopd.core.late import LateEstimator
from hoopd.core.limits import Limiter
from hoopd.core.records import CameraSample, DriverSample, Estimate, Vector
from hoopd.plants.compiled import zero_order_hold
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.effects.contact_modes import INNER, ROLLING, ContactCourse, ContactModes
from hoopd.plants.hoop.plant import HoopPlant

WIRE_S = 8 * 10 / 115200  # a request's time on the wire
MOST_STEPS = 1000  # step lengths that `LinearPlant` keeps: rounding makes new ones out of the same time-line


class Moving(Protocol):
    """What moves under a held torque: a `HoopPlant`, its linear model, or a `FreeBall`."""

    def advance(self, x: Vector, u: float, h: float) -> Vector:
        """State (4,) after `h` seconds with the torque `u` held."""
        ...


class LinearPlant:
    """The linear model of a plant at rest, as a plant: what the closed loop would do if it were linear."""

    def __init__(self, plant: HoopPlant) -> None:
        self._model = plant.linearize()
        self._over: dict[float, tuple[Vector, Vector]] = {}

    def advance(self, x: Vector, u: float, h: float) -> Vector:
        """State (4,) after `h` seconds with the torque `u` held, exact."""
        if h not in self._over:
            if len(self._over) > MOST_STEPS:
                self._over.clear()
            self._over[h] = zero_order_hold(*self._model, h)
        a, b = self._over[h]
        return a @ x + b[:, 0] * u


class FreeBall:
    """A plant whose ball may leave its track, as `HoopPlant`; for one run, which begins on the inner hoop or not."""

    def __init__(self, found: FoundEffects, *, inner: bool) -> None:
        self._modes = ContactModes(found.plant, found.effects())
        self._course = ContactCourse(self._modes, found.values, self._modes.rolling.beginning(np.zeros(4)))
        self._course.restart(np.zeros(self._modes.rolling.nz), INNER if inner else ROLLING)
        self._t = 0.0

    @property
    def mode(self) -> str:
        """What the ball does."""
        return self._course.mode

    @property
    def distance(self) -> float:
        """Of the ball from the axis, in shares of its track's radius."""
        return self._course.distance

    def advance(self, x: Vector, u: float, h: float) -> Vector:
        """State (4,) after `h` seconds with the torque `u` held; in the air it goes on from where it is."""
        if not self._course.flies:
            z = self._course.z.copy()
            z[:4] = x
            self._course.z = z
        self._course.advance(u, h, self._t)
        self._t += h
        return self._course.seen()[:4].copy()


@dataclass(frozen=True)
class Scenario:
    """One run: what the plant starts from, what the sensors do to it, what is asked of the law."""

    duration_s: float = 6.0
    psi0_rad: float = 0.0
    # as the ball is let go: speeds of hoop and ball, rad/s
    pushed: tuple[float, float] = (0.0, 0.0)
    period_s: float = 0.02
    latency_s: float = 0.0  # the picture shows psi so much before its stamp
    delay_frames: int = 2  # picture delivered so long after the middle of its exposure
    phase_s: float = 0.006  # the camera's clock against the tick's: the first exposure's middle
    psi_noise_rad: float = 0.002
    dtheta_noise_rad_s: float = 0.05
    encoder_counts: int = 4096  # 0: no quantisation
    angle_offset_rad: float = 0.0  # what the camera adds to psi: its zero angle is wrong
    disturbance_rad: float = 0.0  # added to one picture's angle ...
    disturbance_at_s: float = 1.0  # ... the first one after this time
    reference: Callable[[float], float] = field(default=lambda _t: 0.0)
    start_s: float = 0.2  # torque is zero until then and the ball is held: the filter settles first
    psi_missing: Callable[[float], bool] = field(default=lambda _t: False)  # by capture time
    hoop_missing: Callable[[float], bool] = field(default=lambda _t: False)
    seed: int = 1


def picture_timing(delay_s: float, period_s: float) -> dict[str, float]:
    """`delay_frames` and `phase_s` of a `Scenario` in which a tick's newest picture is `delay_s` old."""
    frames = int(delay_s / period_s + 1e-9)
    rest = delay_s - frames * period_s
    return {"delay_frames": frames, "phase_s": period_s - rest if rest > 1e-9 else 0.0}


@dataclass(frozen=True)
class ClosedLoopRun:
    """What happened, one row a tick."""

    t: Vector  # s, zero at the release
    x: Vector  # (n, 4), true state
    u: Vector  # N m
    psi_measured: Vector  # rad, newest picture's angle, as measured
    x_hat: Vector  # (n, 4)

    @property
    def psi(self) -> Vector:
        """True ball angle in rad."""
        return self.x[:, 2]

    @property
    def dtheta(self) -> Vector:
        """True hoop speed in rad/s."""
        return self.x[:, 1]

    @property
    def signals(self) -> dict[str, Vector]:
        """What a figure shows of it, by name and unit."""
        return {"ball angle (rad)": self.psi, "hoop speed (rad/s)": self.dtheta, "torque (N m)": self.u}

    def settled_s(self, values: Vector, bound: float) -> float:
        """Time after which |values| stays below a bound; inf when it does not."""
        outside = np.flatnonzero(np.abs(values) >= bound)
        if len(outside) == 0:
            return 0.0
        return float(self.t[outside[-1] + 1]) if outside[-1] + 1 < len(self.t) else float("inf")


class _World:
    """The true plant and its two sensors."""

    def __init__(self, plant: Moving, scenario: Scenario) -> None:
        self.s, self.plant = scenario, plant
        self.rng = np.random.default_rng(scenario.seed)
        self.x = np.array([0.0, 0.0, scenario.psi0_rad, 0.0])
        self.t, self.u, self.held = 0.0, 0.0, True
        self._frame, self._next_frame = 0, scenario.phase_s
        self._pictures: list[CameraSample] = []
        self._disturbed = scenario.disturbance_rad == 0.0

    def hold(self, held: bool) -> None:
        """By hands, or let go with a push."""
        if self.held and not held:
            self.x = self.x + np.array([0.0, self.s.pushed[0], 0.0, self.s.pushed[1]])
        self.held = held

    def run_to(self, t: float) -> None:
        """Advance, exposing the pictures on the way."""
        while self._next_frame <= t:
            self._move(self._next_frame)
            self._expose()
            self._next_frame = self.s.phase_s + self._frame * self.s.period_s
        self._move(t)

    def picture(self, now: float) -> CameraSample | None:
        """The newest picture delivered by now; older ones are dropped."""
        newest = None
        while self._pictures and self._pictures[0].t_arrival <= now + 1e-9:
            newest = self._pictures.pop(0)
        return newest

    def answer(self, seq: int) -> DriverSample:
        """The board's sample of this instant."""
        s, theta = self.s, float(self.x[0])
        if s.encoder_counts:
            theta = tau / s.encoder_counts * np.floor(theta * s.encoder_counts / tau)
        dtheta = float(self.x[1]) + s.dtheta_noise_rad_s * self.rng.normal()
        return DriverSample(self.t, seq % 256, 1, 0, theta, dtheta, 0.0, 0)

    def _move(self, t: float) -> None:
        while not self.held and self.t < t:
            piece = min(t - self.t, 0.02)
            self.x = self.plant.advance(self.x, self.u, piece)
            self.t += piece
        self.t = t

    def _expose(self) -> None:
        s, t = self.s, self.t
        psi = float(self.x[2]) + s.angle_offset_rad + s.psi_noise_rad * self.rng.normal()
        if not self._disturbed and t >= s.start_s + s.disturbance_at_s:
            psi, self._disturbed = psi + s.disturbance_rad, True
        psi = (psi + pi) % tau - pi
        place = (nan, nan)
        if isinstance(self.plant, FreeBall):
            place = (psi, self.plant.distance + s.psi_noise_rad * self.rng.normal())
        self._frame += 1
        if not s.psi_missing(t - s.start_s):
            stamp = t + s.latency_s
            arrival = stamp + s.delay_frames * s.period_s
            self._pictures.append(CameraSample(self._frame, stamp, arrival, psi, 1.0, 0.0, 0.0, 0, *place))


def simulate(
    plant: Moving,
    controller: Controller,
    estimator: DelayedEkf | LateEstimator,
    limiter: Limiter,
    scenario: Scenario | None = None,
    watch: Callable[[float, Estimate], object] = lambda t, estimate: None,
    feedforward: FeedForward | None = None,
) -> ClosedLoopRun:
    """Run one scenario; the ball is held until `start_s`, where the rows' time begins; `watch` sees every estimate."""
    s = scenario or Scenario()
    world, answer, flies = _World(plant, s), None, isinstance(plant, FreeBall)
    controller.reset()
    estimator.reset()
    limiter.reset()
    ticks = round((s.start_s + s.duration_s) / s.period_s)
    rows: list[tuple[float, ...]] = []
    forward = feedforward or FeedForward()
    torque, added, applied, psi_last = 0.0, 0.0, -s.period_s + WIRE_S, float("nan")
    for k in range(ticks):
        t = k * s.period_s
        world.run_to(t)
        camera = world.picture(t)
        estimate = estimator.update(t, torque, applied, answer, camera, held=world.held, may_fly=flies)
        psi_last = psi_last if camera is None else camera.psi
        world.hold(t < s.start_s - 1e-9)
        wanted = demanded = 0.0
        before = torque - added
        if not world.held:
            watch(t, estimate)
            wanted, _ = controller.update(_measurement(t, s, estimate, (answer, camera), before))
            demanded = forward.demand(_acted_on(estimate), wanted) if estimate.ready else wanted
        torque, added, applied = limiter.apply(demanded), demanded - wanted, t + WIRE_S
        if not world.held:
            rows.append((t - s.start_s, *world.x, torque, psi_last, *estimate.x))
        world.run_to(applied)
        world.u = torque
        answer = None if s.hoop_missing(applied - s.start_s) else world.answer(k)
    table = np.array(rows)
    return ClosedLoopRun(table[:, 0], table[:, 1:5], table[:, 5], table[:, 6], table[:, 7:11])


def _acted_on(estimate: Estimate) -> Vector:
    """The state on which this tick's torque will act."""
    return estimate.x if estimate.ahead is None else estimate.ahead


class LateTorque:
    """A plant whose torque acts `delay_s` late; for one run."""

    def __init__(self, plant: Moving, delay_s: float) -> None:
        self._plant, self._delay_s, self._t = plant, delay_s, 0.0
        self._torques: deque[tuple[float, float]] = deque([(-inf, 0.0)])  # since when it acts

    def advance(self, x: Vector, u: float, h: float) -> Vector:
        """State (4,) after `h` seconds in which `u` is demanded."""
        self._torques.append((self._t + self._delay_s, u))
        end = self._t + h
        while end - self._t > 1e-12:
            while len(self._torques) > 1 and self._torques[1][0] <= self._t + 1e-12:
                self._torques.popleft()
            following = self._torques[1][0] if len(self._torques) > 1 else inf
            until = min(end, following)
            x = self._plant.advance(x, self._torques[0][1], until - self._t)
            self._t = until
        return x


def _measurement(
    t: float, s: Scenario, estimate: Estimate, samples: tuple[DriverSample | None, CameraSample | None], before: float
) -> Measurement:
    answer, camera = samples
    return Measurement(
        t=t,
        x=_acted_on(estimate),
        ready=estimate.ready,
        psi_measured=float("nan") if camera is None else camera.psi,
        psi_fresh=camera is not None and estimate.psi_accepted,
        dtheta_measured=float("nan") if answer is None else answer.dtheta,
        reference=s.reference(t - s.start_s),
        torque_previous=before,
        dt=s.period_s,
    )
