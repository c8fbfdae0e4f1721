"""Does the encoder tell of the hoop that the torque turns? Conditions of the fault table, tick by tick.

What an honest encoder can say of a device within its tolerances is an interval. With torque u (N m) and reported speed
w, while a model of the hoop says theta'' = gain u + friction w + gravity sin psi,

    theta'' in gain (least(u, w) .. most(u)) + friction w + gravity sin psi -+ gain (FORCE_NM + drag against w)

least: what is left of u by a weak motor (WEAK), by a dead zone or dry friction (LOST_NM), by a motor that gives no more
(SATURATED_NM) or none at speed (NO_LOAD_RAD_S); the worst of them, not all at once. The torque may act up to LATE_TICKS
late.

Rules of this file: pure; a lie is told from what the encoder says and what was sent, the camera is no part of it;
nothing is learned but whether the reported speed has noise.
"""

from __future__ import annotations

from collections import deque
from math import copysign, exp, fsum, isfinite, sin, sqrt
from operator import sub
from typing import Final, NamedTuple

from hoopd.core.faulttable import BY_NAME
from hoopd.core.frames import STATUS_ENABLED
from hoopd.core.records import DriverSample

NAMES: Final = ("hoop_innovation", "torque_without_motion", "speed_noiseless")
# Without a model of the hoop.
UNJUDGED: Final = {"hoop_innovation": 0, "torque_without_motion": 0}

# Of the torque's effect: parameters 30 % off, a hoop of little inertia with a motor of more than its rated constant.
WEAK, STRONG = 0.65, 1.9
LOST_NM = 0.025
SATURATED_NM = 0.05
NO_LOAD_RAD_S = 8.0
# A bias, cogs, an imbalance, a light touch, of either sign.
FORCE_NM = 0.03
DRAG_NM_S = 2e-3  # viscous friction that has grown threefold
DRAG_NM_S2 = 2e-4
LATE_TICKS = 3

WINDOW_TICKS = 10
RATE_TICKS = 5  # the angle's own speed is its change over so many
SIGMAS = 5.0
# The same over so few that the last two answers are wholly after what came between them and the two before.
JOLT_TICKS, JOLT_RATE_TICKS = 2, 1
# A blow: 3.7 N at the rim, besides the torque. With 582 (rad/s^2)/(N m) 8 rad/s in 40 ms, as the drive's 0.7 N m make
# in 20. A hoop that is stopped faster is in somebody's hand, and a cut is right, too.
JOLT_NM = 0.35
JOLT_WEIGHT = BY_NAME["hoop_innovation"].on  # once is enough
LONGEST_GAP_S = 0.1  # between two ticks or two answers; a longer one begins anew

STILL_RAD = 0.004  # two and a half counts of 4096
# A hoop that turns back stays within STILL_RAD for a while; a torque from rest takes it sixteen times as far meanwhile.
MUST_MOVE_RAD = 0.1

# So many different speeds in a row of a hoop at rest, a quarter of them up and a quarter down, and it is known of this
# board that its speed has noise: one that only runs out, behind a low-pass, has none.
DIFFERENT_SPEEDS = 25
EACH_WAY = 6
EQUAL_SPEEDS = 10

# Angle and speed over half a second, beside an encoder whose ring is off its axis and a speed that is a low-passed one.
PATH_TICKS = 25
APART_RAD = 0.15
APART_SHARE = 0.25
SPEED_LAG_S = 0.15


class HoopMotion(NamedTuple):
    """The model's hoop at the bottom, see the head of the file."""

    gain: float  # (rad/s^2) / (N m)
    friction: float  # 1/s
    gravity: float  # 1/s^2, of the ball that it carries
    late_s: float = 0.0  # by how much torque and readings are known to be late
    speed_sd: float = 0.05  # rad/s
    angle_sd: float = 4.4e-4  # rad
    speed_lag_s: float = 0.0  # of the reported speed behind the angle's, where the model knows one


class Acted(NamedTuple):
    """What acted between two ticks."""

    torque_nm: float
    speed: float  # rad/s, as last reported
    psi: float  # rad, as estimated


class ChangeBounds(NamedTuple):
    """Least and greatest change of speed since the beginning, rad/s, each by lateness."""

    low: tuple[float, ...]
    high: tuple[float, ...]


class Bounds:
    """Least and greatest change of speed since the beginning, by torque, for each lateness."""

    def __init__(self, motion: HoopMotion, tick_s: float) -> None:
        self._motion = motion
        self._late = [motion.late_s + tick_s * index for index in range(LATE_TICKS + 1)]
        self._rows: deque[tuple[float, float, float]] = deque(maxlen=64)  # t, least, greatest

    def add(self, t: float, acted: Acted) -> None:
        """What acted until `t`, the time of this tick."""
        rows = self._rows
        if not rows or not 0.0 < t - rows[-1][0] < LONGEST_GAP_S:
            rows.clear()
            rows.append((t, 0.0, 0.0))
            return
        before, low_before, high_before = rows[-1]
        h = t - before
        low, high = accelerations(self._motion, acted)
        rows.append((t, low_before + h * low, high_before + h * high))

    def at(self, t: float) -> ChangeBounds | None:
        """Least and greatest at `t`, None when that is out of reach."""
        rows = self._rows
        if not rows or t - self._late[-1] < rows[0][0]:
            return None
        low, high, index = [], [], len(rows) - 1
        for late in self._late:
            at = t - late
            while rows[index][0] > at:
                index -= 1
            t0, low0, high0 = rows[index]
            # in a straight line to the next row; the last one stays
            t1, low1, high1 = rows[min(index + 1, len(rows) - 1)]
            share = (at - t0) / (t1 - t0) if t1 > t0 else 0.0
            low.append(low0 + share * (low1 - low0))
            high.append(high0 + share * (high1 - high0))
        return ChangeBounds(tuple(low), tuple(high))


def accelerations(motion: HoopMotion, acted: Acted) -> tuple[float, float]:
    """Least and greatest theta'' in rad/s^2, see the head of the file."""
    u, w = acted.torque_nm, acted.speed
    low, high = sorted((least(u, w), STRONG * u))
    drag = DRAG_NM_S * abs(w) + DRAG_NM_S2 * w * w
    low -= FORCE_NM + (drag if w > 0.0 else 0.0)
    high += FORCE_NM + (drag if w < 0.0 else 0.0)
    known = motion.friction * w + motion.gravity * sin(acted.psi)
    return motion.gain * low + known, motion.gain * high + known


def least(torque_nm: float, speed: float) -> float:
    """N m that are left of a torque at the worst."""
    at_speed = max(0.0, 1.0 - abs(speed) / NO_LOAD_RAD_S)
    return copysign(WEAK * at_speed * min(max(abs(torque_nm) - LOST_NM, 0.0), SATURATED_NM), torque_nm)


class Innovation:
    """The change of speed over a window, of the reported speed and of the angle, outside of its bounds."""

    def __init__(self, motion: HoopMotion, ticks: int, rate_ticks: int, push_nm: float = 0.0) -> None:
        """`rate_ticks`: the angle's own speed is its change over so many; `push_nm`: what else may act, either way."""
        self._rate_ticks = rate_ticks
        self._push = motion.gain * push_nm  # rad/s^2
        # the difference of two readings; the angle's speed is one itself
        self._speed_tolerance = SIGMAS * sqrt(2.0) * motion.speed_sd
        self._angle_tolerance = SIGMAS * 2.0 * motion.angle_sd
        self._samples: deque[tuple[DriverSample, ChangeBounds]] = deque(maxlen=ticks + rate_ticks + 1)

    def update(self, driver: DriverSample, bounds: ChangeBounds | None) -> bool:
        """Both are outside, on the same side."""
        samples = self._samples
        if bounds is None or (samples and not 0.0 < driver.t - samples[-1][0].t < LONGEST_GAP_S):
            samples.clear()
        if bounds is None:
            return False
        samples.append((driver, bounds))
        if len(samples) < (samples.maxlen or 0):
            return False
        by_speed = self._by_speed()
        return by_speed != 0 and by_speed == self._by_angle()

    def _by_speed(self) -> int:
        (before, begun), (now, ended) = self._samples[self._rate_ticks], self._samples[-1]
        pushed = self._push * (now.t - before.t)
        return _side(now.dtheta - before.dtheta, ended, begun, self._speed_tolerance + pushed)

    def _by_angle(self) -> int:
        samples = list(self._samples)
        first, last = samples[: self._rate_ticks + 1], samples[-self._rate_ticks - 1 :]
        change = _rate(last) - _rate(first)
        ended, begun = (_mean([one for _, one in part]) for part in (last, first))
        seconds = min(part[-1][0].t - part[0][0].t for part in (first, last))
        pushed = self._push * (last[-1][0].t - first[-1][0].t)
        return _side(change, ended, begun, self._angle_tolerance / seconds + pushed)


def _rate(samples: list[tuple[DriverSample, ChangeBounds]]) -> float:
    first, last = samples[0][0], samples[-1][0]
    return (last.theta - first.theta) / (last.t - first.t)


def _mean(of: list[ChangeBounds]) -> ChangeBounds:
    low, high = (tuple(fsum(column) / len(of) for column in zip(*rows, strict=True)) for rows in zip(*of, strict=True))
    return ChangeBounds(low, high)


def _side(change: float, ended: ChangeBounds, begun: ChangeBounds, tolerance: float) -> int:
    """-1 below, 1 above what is possible for any lateness, 0 within."""
    if change < min(map(sub, ended.low, begun.low)) - tolerance:
        return -1
    return int(change > max(map(sub, ended.high, begun.high)) + tolerance)


class StandsStill:
    """An angle that does not change, and the path on which the torque must have taken the hoop meanwhile."""

    def __init__(self, motion: HoopMotion) -> None:
        self._gain = motion.gain
        self.reset()

    def reset(self) -> None:
        """The hoop moves."""
        self._angle: float | None = None
        self._recent: deque[float] = deque([0.0] * LATE_TICKS, maxlen=LATE_TICKS)
        self._speed = self._path = 0.0

    def update(self, theta: float | None, torque_nm: float, seconds: float) -> bool:
        """`theta`: as reported in this tick, if it was."""
        late = self._recent[0]
        self._recent.append(torque_nm)
        moved = theta is not None and (self._angle is None or abs(theta - self._angle) > STILL_RAD)
        acceleration = self._gain * least(late, 0.0)
        if moved or acceleration * self._speed < 0.0 or acceleration == 0.0:
            self._speed = self._path = 0.0
        if moved:
            self._angle = theta
        self._speed += acceleration * seconds
        self._path += self._speed * seconds
        return abs(self._path) > MUST_MOVE_RAD


class SpeedNoise:
    """Counts reported speeds that are equal to the one before, once it is known that they differ at rest."""

    def __init__(self) -> None:
        self._last, self._equal, self._known = 0.0, 0, False
        self._up = self._down = 0  # at rest, in a row
        self._angle = 0.0

    def update(self, driver: DriverSample) -> bool:
        """The same speed has come too often."""
        change, self._last = driver.dtheta - self._last, driver.dtheta
        self._equal = self._equal + 1 if change == 0.0 else 0
        if not self._known:
            self._learn(driver.theta, change)
        return self._known and self._equal >= EQUAL_SPEEDS

    def _learn(self, theta: float, change: float) -> None:
        rests = abs(theta - self._angle) <= STILL_RAD
        self._angle = self._angle if rests else theta
        if not rests or change == 0.0:
            self._up = self._down = 0
        self._up += change > 0.0
        self._down += change < 0.0
        each = min(self._up, self._down)
        self._known = each >= EACH_WAY and self._up + self._down >= DIFFERENT_SPEEDS


class AngleAgainstSpeed:
    """The angle's change and the integral of the speed, from answer to answer and over `PATH_TICKS`.

    Where the model knows that the reported speed lags, by T w' = theta' - w, it is compared with the angle's behind the
    same lag: 39 ms are 8 rad/s while a maneuver's torque acts.
    """

    def __init__(self, mismatch_rad_s: float, tick_s: float) -> None:
        self._mismatch_rad_s, self._tick_s = mismatch_rad_s, tick_s
        self._samples: deque[DriverSample] = deque(maxlen=PATH_TICKS + 1)
        self._speeds: deque[float] = deque(maxlen=PATH_TICKS + 1)  # rad/s, of the samples
        self._paths: deque[float] = deque(maxlen=PATH_TICKS)  # rad, between two samples by their speeds
        self.lag_s = 0.0  # of the speed, as the model knows it
        self._behind = 0.0  # rad/s, the angle's speed behind that lag

    def update(self, driver: DriverSample) -> bool:
        """They contradict each other."""
        samples = self._samples
        if samples and not 0.0 < driver.t - samples[-1].t < LONGEST_GAP_S:
            for kept in (samples, self._speeds, self._paths):
                kept.clear()
        if samples:
            before = samples[-1]
            self._paths.append((driver.t - before.t) * (driver.dtheta + before.dtheta) / 2.0)
        else:
            self._behind = driver.dtheta
        samples.append(driver)
        self._speeds.append(driver.dtheta)
        return len(samples) > 1 and (self._step_off() or self._path_off())

    def _step_off(self) -> bool:
        before, now = self._samples[-2], self._samples[-1]
        seconds = now.t - before.t
        mean, reported = (now.theta - before.theta) / seconds, 0.5 * (now.dtheta + before.dtheta)
        if self.lag_s > 0.0:
            earlier, share = self._behind, 1.0 - exp(-seconds / self.lag_s)
            self._behind = earlier + share * (mean - earlier)
            mean = 0.5 * (earlier + self._behind)
        return seconds < 3 * self._tick_s and abs(reported - mean) > self._mismatch_rad_s

    def _path_off(self) -> bool:
        if len(self._samples) <= PATH_TICKS:
            return False
        samples, speeds, told = self._samples, self._speeds, fsum(self._paths)
        turned = samples[-1].theta - samples[0].theta
        allowed = APART_RAD + APART_SHARE * max(abs(turned), abs(told)) + SPEED_LAG_S * (max(speeds) - min(speeds))
        return abs(turned - told) > allowed


class AgainstTorque:
    """The conditions that need a model."""

    def __init__(self, motion: HoopMotion, tick_s: float) -> None:
        self._bounds = Bounds(motion, tick_s)
        self._innovation = Innovation(motion, WINDOW_TICKS, RATE_TICKS)
        self._jolt = Innovation(motion, JOLT_TICKS, JOLT_RATE_TICKS, JOLT_NM)
        self._still = StandsStill(motion)
        self._t = float("-inf")

    def update(self, t: float, driver: DriverSample | None, acted: Acted) -> dict[str, int]:
        """Weights by name; `acted`: between the tick before and `t`."""
        seconds, self._t = t - self._t, t
        self._bounds.add(t, acted)
        if not 0.0 < seconds < LONGEST_GAP_S:
            self._still.reset()
            seconds = 0.0
        theta = None if driver is None else driver.theta
        judged = {"torque_without_motion": int(self._still.update(theta, acted.torque_nm, seconds))}
        if driver is not None:
            bounds = self._bounds.at(driver.t)
            outside, jolted = self._innovation.update(driver, bounds), self._jolt.update(driver, bounds)
            judged["hoop_innovation"] = JOLT_WEIGHT if jolted else int(outside)
        return judged


class EncoderChecks:
    """The conditions; what the torque must do needs the model of a hoop."""

    def __init__(self, motion: HoopMotion | None, mismatch_rad_s: float, tick_s: float) -> None:
        """`motion`: None: no model of a hoop, so that the encoder is judged by itself alone; `mismatch_rad_s`: between
        the reported speed and the angle's, from one answer to the next."""
        self._tick_s = tick_s
        self._noise, self._apart = SpeedNoise(), AngleAgainstSpeed(mismatch_rad_s, tick_s)
        self.follow(motion)
        self._driver: DriverSample | None = None

    def follow(self, motion: HoopMotion | None) -> None:
        """Another model of the hoop, from now on."""
        self._model = None if motion is None else AgainstTorque(motion, self._tick_s)
        self._apart.lag_s = 0.0 if motion is None else motion.speed_lag_s

    def update(self, t: float, driver: DriverSample | None, torque_nm: float, psi: float) -> dict[str, int]:
        """Weights by name at the tick `t`; `torque_nm`: what the last tick sent; `psi`: rad, as estimated."""
        self._driver = driver or self._driver
        if self._driver is None:
            return {}
        acts = bool(self._driver.status & STATUS_ENABLED)
        acted = Acted(torque_nm if acts else 0.0, self._driver.dtheta, psi if isfinite(psi) else 0.0)
        judged = dict(UNJUDGED) if self._model is None else self._model.update(t, driver, acted)
        if driver is not None:
            judged["speed_noiseless"] = int(self._noise.update(driver))
            judged["speed_implausible"] = int(self._apart.update(driver))
        return judged
