"""Does the ball in the pictures answer the hoop? Its angle over a second and a half against what the hoop did.

The hoop's motion drives the ball, whatever moves the hoop: with the model at the bottom

    psi'' = carried theta'' + hoop_rate theta' + ball_rate psi' - stiffness sin psi

Integrated twice over a window, every term is a known function of time, the derivatives are gone, and the angle is
linear in what is not known:

    psi = p0 + p1 t + lean stiffness t^2/2 - k stiffness II(sin psi) + g carried theta
          + d (hoop_rate I(theta) + ball_rate I(psi)) + dry stiffness II(sign(theta' - psi')) - late carried theta'
          + (an encoder that is uneven)

A ball has a stiffness k and a gain g of about one, a lean (of the frame, of the camera's zero), dry friction (an angle:
where it holds a ball that rolls, about a degree) and a lateness of about zero. The window is fitted twice: as a ball,
with what a real device may be off, and freely. The evidence against a ball is by how much the free fit is better, in
windows in which the hoop moves enough to tell. A push is explained by neither and is no evidence; a window that fits a
ball takes all evidence away. A ball that slips whenever the hoop is torn away does not answer it, and is told as none.

Rules of this file: pure; times are those of the samples; nothing is learned, so that no lie is absorbed.
"""

from __future__ import annotations

from collections import deque
from itertools import chain
from math import inf, isfinite, pi, tau
from typing import Any, NamedTuple

import numpy as np

from hoopd.core.records import CameraSample, DriverSample, Vector

WINDOW_S = 1.5  # two swings of the ball
EVERY_S = 0.3
HOOP_S = 3.0  # what is kept of the hoop: a window, and the oldest that pictures may be
# What of an angle the model may leave unexplained: the camera's noise, a frame that shakes, an uneven ring. Where the
# free fit leaves more than that, so much is taken for it: what neither explains, as a push, is weak evidence.
SIGMA_RAD = 0.01
# Evidence of one window in nats times two: beyond it the window speaks against a ball. Thirty percent of g or k cost 4.
LEAST_EVIDENCE = 7.0
# Below it a window that tells something speaks for a ball; between both it says nothing.
MOST_DOUBT = 3.0
# A lateness beyond some 50 ms is no linear term: where the free fit leaves more, it is tried with an older hoop.
OLDER_S = (0.08, 0.16, 0.24, 0.32, 0.4)
GOOD_RAD = 0.005
# A window tells something of the ball, for or against it, when it fixes g as well as this. Where the hoop hardly moves,
# a frame that shakes is all that moves the ball, and fits any stiffness.
INFORMATIVE = 0.35
# Windows that overlap one push last 1.5 s; this is more than two pushes spoil.
ENOUGH_S = 3.3
FEWEST_SAMPLES = 50
JITTER_S = 0.01  # of the samples' times
WIDEST_RAD = 1.2  # beyond, a ball may leave the ring
JUMP_RAD = 10.0  # between two reports: the board has begun to count anew

ROLLING_RAD_S = 0.3  # a ball that rolls: slower, the direction is the encoder's noise

# An encoder runs out, is oval, or sits on a coupling: the first harmonics of its error, each with two parts in rad.
HARMONICS = (1, 2, 3)
_RIPPLE = [0.03] * (2 * len(HARMONICS))

# Of p0, p1, lean rad, k, g, d, late s, dry friction rad, and the encoder's harmonics.
_MEAN = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, *np.zeros_like(_RIPPLE)])
_BALL = np.array([1e3, 1e3, 0.05, 0.15, 0.15, 3.0, 0.02, 0.02, *_RIPPLE])
_FREE = np.array([1e3, 1e3, 0.05, 3.0, 3.0, 3.0, 0.2, 0.02, *_RIPPLE])
_GAIN = 4


class BallMotion(NamedTuple):
    """The model's ball at the bottom, see the head of the file."""

    carried: float
    hoop_rate: float  # 1/s
    ball_rate: float  # 1/s
    stiffness: float  # 1/s^2
    late_s: float = 0.0  # by how much pictures are known to be later than the encoder


class Judgement(NamedTuple):
    """What one window says."""

    evidence: float  # against a ball
    gain_sd: float  # how well the window fixes g


class WindowFit(NamedTuple):
    """Least squares of one window."""

    least: float  # the least sum
    residual_rad: float  # rms
    gain_sd: float  # deviation of g


class BallResponse:
    """Follows hoop and ball while the law acts."""

    def __init__(self, motion: BallMotion) -> None:
        self.motion = motion
        self.reset()

    def reset(self) -> None:
        """A run begins: nothing was seen."""
        self.against_s = 0.0  # s of windows that speak against a ball
        self._restart()

    def _restart(self) -> None:
        """Samples of before do not belong to what comes."""
        self._hoop: deque[tuple[float, float, float]] = deque()
        self._ball: deque[tuple[float, float]] = deque()
        self._next_t = inf  # of the next judgement

    def update(self, driver: DriverSample | None, camera: CameraSample | None, *, acting: bool) -> bool:
        """Take in one tick; True in the tick in which there is enough evidence that this is no ball."""
        if not acting:  # a hand may move the ball; what was found out in this run stays
            self._restart()
            return False
        if driver is not None:
            self._add_hoop(driver)
        if camera is not None and isfinite(camera.psi):
            self._add_ball(camera)
        if not self._hoop or self._hoop[-1][0] < self._next_t:
            return False
        self._next_t = self._hoop[-1][0] + EVERY_S - JITTER_S
        self._weigh(self._judge())
        return self.against_s >= ENOUGH_S

    def _add_hoop(self, driver: DriverSample) -> None:
        if self._hoop and abs(driver.theta - self._hoop[-1][1]) > JUMP_RAD:
            self._restart()
        if not self._hoop:
            self._next_t = driver.t + WINDOW_S - JITTER_S
        self._hoop.append((driver.t, driver.theta, driver.dtheta))
        while self._hoop[0][0] < driver.t - HOOP_S:
            self._hoop.popleft()

    def _add_ball(self, camera: CameraSample) -> None:
        before = self._ball[-1][1] if self._ball else 0.0
        self._ball.append((camera.t - self.motion.late_s, camera.psi + tau * round((before - camera.psi) / tau)))
        while self._ball[0][0] < self._ball[-1][0] - WINDOW_S:
            self._ball.popleft()

    def _weigh(self, judged: Judgement | None) -> None:
        if judged is None or judged.gain_sd > INFORMATIVE:
            return
        if judged.evidence > LEAST_EVIDENCE:
            self.against_s += EVERY_S
        elif judged.evidence < MOST_DOUBT:
            self.against_s = 0.0

    def _judge(self) -> Judgement | None:
        """None when the window cannot be judged."""
        if len(self._hoop) < FEWEST_SAMPLES or len(self._ball) < FEWEST_SAMPLES:
            return None
        rows = _table(self._ball, 2)
        rows = rows[rows[:, 0] > rows[-1, 0] - WINDOW_S]
        hoop = _table(self._hoop, 3)
        if (
            len(rows) < FEWEST_SAMPLES
            or np.ptp(rows[:, 1]) > pi
            or np.abs(np.sin(rows[:, 1] / 2)).max() > np.sin(WIDEST_RAD / 2)
        ):
            return None
        x, y = self._terms(rows[:, 0], rows[:, 1], hoop) / SIGMA_RAD, rows[:, 1] / SIGMA_RAD
        squares, products = x.T @ x, x.T @ y
        ball, free = (_fit(x, y, squares, products, deviation) for deviation in (_BALL, _FREE))
        for late_s in OLDER_S:
            if ball.least - free.least < LEAST_EVIDENCE or free.residual_rad < GOOD_RAD:
                break
            x = self._terms(rows[:, 0], rows[:, 1], hoop, late_s) / SIGMA_RAD
            older = _fit(x, y, x.T @ x, x.T @ y, _FREE)
            free = min(free, older, key=lambda fit: fit.least)
        left = max(1.0, free.residual_rad / SIGMA_RAD)
        return Judgement((ball.least - free.least) / (left * left), left * free.gain_sd)

    def _terms(self, t: Vector, psi: Vector, hoop: Vector, late_s: float = 0.0) -> Vector:
        """Column by column the functions of time that the angle is made of; `late_s`: of a hoop of so long ago."""
        m, at = self.motion, t - t[0]
        theta = np.interp(t - late_s, hoop[:, 0], hoop[:, 1])
        speed = np.interp(t - late_s, hoop[:, 0], hoop[:, 2])
        moved, rolled = theta - theta[0], speed - np.gradient(psi, t)
        half = 0.5 * np.diff(t)
        columns = (
            np.ones_like(at),
            at,
            0.5 * m.stiffness * at * at,
            -m.stiffness * _integral(half, _integral(half, np.sin(psi))),
            m.carried * moved,
            _integral(half, m.hoop_rate * moved + m.ball_rate * psi),
            -m.carried * speed,
            m.stiffness * _integral(half, _integral(half, np.tanh(rolled / ROLLING_RAD_S))),
            *(m.carried * turned(n * theta) for n in HARMONICS for turned in (np.sin, np.cos)),
        )
        return np.column_stack(columns)


def _table(rows: deque[Any], width: int) -> Vector:
    """Rows of as many numbers each as an array; of a deque numpy itself asks row by row."""
    return np.fromiter(chain.from_iterable(rows), float, width * len(rows)).reshape(-1, width)


def _integral(half: Vector, y: Vector) -> Vector:
    """From the first sample on, by trapezoids; `half`: of the time from each sample to the next."""
    out = np.zeros_like(y)
    np.cumsum((y[1:] + y[:-1]) * half, out=out[1:])
    return out


def _fit(x: Vector, y: Vector, squares: Vector, products: Vector, deviation: Vector) -> WindowFit:
    """Least squares with known means and deviations; `squares`: x'x, `products`: x'y.

    N p = b with N = x'x + 1/s^2, b = x'y + m/s^2; the least sum is y'y + m^2/s^2 - b p
    """
    weight = 1.0 / (deviation * deviation)
    inverse = np.linalg.inv(squares + np.diag(weight))
    b = products + weight * _MEAN
    p: Vector = inverse @ b
    residual = y - x @ p
    return WindowFit(
        float(y @ y + (weight * _MEAN * _MEAN).sum() - b @ p),
        float(np.sqrt(residual @ residual / len(y))) * SIGMA_RAD,
        float(np.sqrt(inverse[_GAIN, _GAIN])),
    )
