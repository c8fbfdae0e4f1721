"""Faults: what is wrong with the inputs, since when, and what follows from it.

Rules of this file: a fault is a row of `core.faulttable`; a condition says per tick how many periods it held; counts
are consecutive, never per lifetime; a latched fault stays until it is well again and the operator acknowledged it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from math import isfinite, isinf, nan, pi, tau
from typing import NamedTuple

from hoopd.core.ballresponse import BallMotion
from hoopd.core.drift import Drift, Level
from hoopd.core.encoderchecks import EncoderChecks, HoopMotion
from hoopd.core.faulttable import (
    BY_NAME,
    CAMERA_FAULTS,
    FAULTS,
    SECOND,
    SUSPENDABLE,
    SUSPENDABLE_IN_FLIGHT,
    Action,
    Fault,
)
from hoopd.core.frames import (
    ERROR_ENCODER,
    ERROR_OVERCURRENT,
    ERROR_OVERSPEED,
    ERROR_SUPPLY,
    STATUS_ENABLED,
    STATUS_FAULT,
    STATUS_LIMITED,
    STATUS_TIMEOUT,
)
from hoopd.core.limits import TORQUE_LIMIT_NM
from hoopd.core.picturechecks import PictureChecks
from hoopd.core.records import CameraSample, DriverSample, Estimate, Inputs
from hoopd.core.slow_ticks import rows_off

# Conditions of the hardware; the drive stays off while one lasts.
HARD_ERRORS = ERROR_OVERCURRENT | ERROR_ENCODER | ERROR_SUPPLY | ERROR_OVERSPEED
BOARD_CLOCK_MS = 65536


# Board and camera may take so long to be heard of first; until then they are awaited, not lost.
START_GRACE_S = 3.0
# Of the last 50 pictures. A push costs the filter five refusals until it follows; twenty are four pushes a second.
REFUSALS = 20
FASTEST_RAD_S = 200.0  # the board cannot report more
AWAY_S = 0.3  # without pictures: the camera was away
PICTURE_GAIN = 0.05  # of the newest picture in the mean time between two
LARGEST_MISMATCH_NM = 2.0 * TORQUE_LIMIT_NM  # no mismatch can be larger


@dataclass(frozen=True)
class Thresholds:
    """Numbers behind the conditions; the reasons stand beside them."""

    camera_delay_s: float = 0.04  # usual age of a sample when it arrives
    late_periods: float = 1.5  # over the usual age (one period of it is the tick's phase)
    lost_periods: float = 5.0
    torque_constant_nm_per_a: float = 0.0  # 0: unknown, current is not judged
    current_mismatch_nm: float = 0.2  # between commanded torque and current times constant
    speed_mismatch_rad_s: float = 6.0  # sixty times the noise of the reported speed
    hoop_speed_rad_s: float = 60.0  # ten turns a second
    minimum_confidence: float = 0.3  # of a detection
    # False: there is no ball in the hoop, camera and ball are not judged; only a law that needs no ball may act then.
    ball_expected: bool = True
    # Rows that are off and that the laboratory does without: arming demands it of each (`off_rows`).
    accepted_off: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse thresholds that would switch a check off by accident."""
        if not 0.0 < self.late_periods < self.lost_periods:
            raise ValueError("needs 0 < late_periods < lost_periods")
        highest = {
            "camera_delay_s": 0.2,
            "lost_periods": 25.0,  # half a second without a picture: the ball may be anywhere
            "hoop_speed_rad_s": FASTEST_RAD_S,
            "speed_mismatch_rad_s": 100.0,
            "current_mismatch_nm": LARGEST_MISMATCH_NM,
            "minimum_confidence": 1.0,
        }
        for name, high in highest.items():
            if not 0.0 < getattr(self, name) <= high:
                raise ValueError(f"{name} must be above 0 and at most {high:g}")
        if not self.torque_constant_nm_per_a >= 0.0:
            raise ValueError("torque_constant_nm_per_a must not be negative")
        if unknown := [name for name in self.accepted_off if name not in BY_NAME]:
            raise ValueError(f"accepted_off: there is no row {unknown[0]!r} in the fault table")

    def off_rows(self) -> dict[str, str]:
        """Rows that end control and are never raised with these numbers, and why."""
        reasons = dict.fromkeys(CAMERA_FAULTS if not self.ball_expected else (), "faults.ball_expected is false")
        if self.torque_constant_nm_per_a == 0.0:
            reasons["current_implausible"] = "faults.torque_constant_nm_per_a is 0"
        elif self.current_mismatch_nm >= LARGEST_MISMATCH_NM:
            reasons["current_implausible"] = f"faults.current_mismatch_nm is {self.current_mismatch_nm:g}"
        if self.hoop_speed_rad_s >= FASTEST_RAD_S:
            reasons["hoop_overspeed"] = f"faults.hoop_speed_rad_s is {self.hoop_speed_rad_s:g}"
        return {name: reason for name, reason in reasons.items() if BY_NAME[name].action >= Action.STOP}

    def not_accepted(self) -> dict[str, str]:
        """Those of `off_rows` that forbid arming; a hoop without a ball implies its own."""
        implied = () if self.ball_expected else CAMERA_FAULTS
        return {name: why for name, why in self.off_rows().items() if name not in (*self.accepted_off, *implied)}


class Sent(NamedTuple):
    """What the last tick sent, as far as health needs it."""

    t: float
    torque_nm: float
    enabled_for: int  # ticks for which the drive has been asked to be on


class _Count:
    """Consecutive bad and good periods of one fault; nothing is well before it was seen to be."""

    def __init__(self, fault: Fault) -> None:
        self.fault, self.bad, self.good, self.active = fault, 0, 0, False

    def update(self, weight: int) -> None:
        if weight:
            self.bad, self.good = self.bad + weight, 0
            self.active = self.active or self.bad >= self.fault.on
        else:
            self.bad, self.good = 0, self.good + 1
            if self.active and not self.fault.latched and self.well:
                self.active = False

    @property
    def well(self) -> bool:
        return self.good >= self.fault.off


class Health:
    """Judges every tick's inputs by the table; deterministic, knows no clock."""

    def __init__(
        self,
        thresholds: Thresholds,
        period_s: float,
        levels: Mapping[str, Level] | None = None,
        ball: BallMotion | None = None,
        hoop: HoopMotion | None = None,
    ) -> None:
        """`levels`: what the filter's innovations are while the device is as the model says; `ball`, `hoop`: the
        model's."""
        self.thresholds, self.period_s = thresholds, period_s
        self._picture: CameraSample | None = None
        self._picture_s = nan  # between two pictures of the camera, on average
        self.drift = Drift(levels)
        self._left: tuple[str, Drift, _Count] | None = None  # key of the model before this one, and its drift
        self._pictures = PictureChecks(ball)
        self._encoder = EncoderChecks(hoop, thresholds.speed_mismatch_rad_s, period_s)
        self._counts = {fault.name: _Count(fault) for fault in FAULTS}
        self._active: tuple[Fault, ...] = ()
        self._driver: DriverSample | None = None
        self._asked_nm = 0.0  # the torque that was sent before the last one
        self._camera_t = float("-inf")
        self._ball = False
        self._refusals: deque[bool] = deque(maxlen=SECOND)  # of the last pictures with a ball: against the model
        self._bottom_rad = 0.0  # the bottom that the ball was nearest to when torque was last zero, in whole turns
        self._seen_enabled = False
        self._id: int | None = None
        self._overran = 0
        self._suspended: tuple[str, ...] = ()

    def suspend(self, names: Collection[str]) -> None:
        """From the next update on these rows are not judged, until it is called with others; only suspendable ones."""
        self._suspended = tuple(name for name in names if name in SUSPENDABLE | SUSPENDABLE_IN_FLIGHT)

    def update(self, inputs: Inputs, estimate: Estimate, sent: Sent) -> None:
        """Advance every count by this tick."""
        counts, suspended, news = self._counts, self._suspended, False
        for name, weight in self._conditions(inputs, estimate, sent).items():
            count = counts[name]
            if weight or count.bad or count.active:
                count.update(0 if name in suspended else weight)
                news = True
            else:  # most of them, most of the time: well for one more period
                count.good += 1
        if news:
            self._look()
        if inputs.driver is not None:
            self._driver = inputs.driver
        if inputs.camera is not None:
            self._time(inputs.camera)
        self._asked_nm = sent.torque_nm
        self._id = inputs.id

    def _time(self, picture: CameraSample) -> None:
        """Follow how often there are pictures, those that no tick took among them."""
        before, self._picture = self._picture, picture
        if before is not None and picture.frame > before.frame and picture.t > before.t:
            period_s = (picture.t - before.t) / (picture.frame - before.frame)
            if picture.t - before.t > AWAY_S:  # a camera that was away says nothing of its pace
                period_s = nan
            known = isfinite(self._picture_s)
            self._picture_s = self._picture_s + PICTURE_GAIN * (period_s - self._picture_s) if known else period_s

    @property
    def too_slow_for(self) -> dict[str, str]:
        """Rows that cannot judge at this period or with this camera, and why."""
        return rows_off(self.period_s, self._picture_s)

    def watch(self, t: float, estimate: Estimate, *, acting: bool) -> tuple[str, ...]:
        """Follow the innovations while the law acts; the channels that drift, in the tick in which that is found."""
        if not acting:
            self.drift.pause()
            return ()
        if self._counts["model_drift"].active:
            return ()
        channels = self.drift.watch(t, estimate.surprise)
        if channels:
            self.raise_now("model_drift")
        return channels

    def raise_now(self, name: str) -> None:
        """Make a fault active that was found after this tick's update (a command that is not finite)."""
        self._counts[name].update(BY_NAME[name].on)
        self._look()

    def active(self) -> tuple[Fault, ...]:
        """Active faults in table order."""
        return self._active

    def halting(self) -> tuple[str, ...]:
        """Names of the active faults that keep the law from acting, or ended it."""
        return tuple(fault.name for fault in self._active if fault.action >= Action.PAUSE)

    def action(self) -> Action:
        """The strongest action of all active faults."""
        return max((fault.action for fault in self.active()), default=Action.NOTE)

    def hindrances(self) -> tuple[str, ...]:
        """What forbids arming: faults of STOP or CUT that are not well yet, and a link or camera never seen."""
        stop = (c for c in self._counts.values() if c.fault.action >= Action.STOP)
        return tuple(c.fault.name for c in stop if not c.well)

    def arming_hindrances(self) -> tuple[str, ...]:
        """`hindrances`, and every row that is off without having been accepted."""
        off = (
            f"{name} is off ({why}): see faults.accepted_off" for name, why in self.thresholds.not_accepted().items()
        )
        return (*self.hindrances(), *off)

    def acknowledge(self) -> None:
        """The operator has seen the latched faults: those that are well go."""
        for count in self._counts.values():
            if count.active and count.well:
                count.active = False
        self._look()
        self._refusals.clear()
        self._seen_enabled = False

    def begin(self) -> None:
        """A run begins: what the innovations of the one before were is no matter of it."""
        self.drift.reset()
        self._pictures.begin()

    def follow(
        self, left: str, model: str, levels: Mapping[str, Level] | None, ball: BallMotion | None,
        hoop: HoopMotion | None,
    ) -> None:  # fmt: skip
        """Another model from now on: what was held against the device by the one that is left (`left` and `model` are
        their keys) is over, until that one comes back."""
        name, back = "model_drift", self._left
        self._left = left, self.drift, self._counts[name]
        if back is not None and model and back[0] == model:
            _, self.drift, self._counts[name] = back
            self.drift.pause()
        else:
            self.drift, self._counts[name] = Drift(levels), _Count(BY_NAME[name])
        self._look()
        self._pictures.follow(ball)
        self._encoder.follow(hoop)

    @property
    def ball_steady(self) -> bool:
        """A ball has been seen in the last ten pictures."""
        return self._counts["ball_lost"].good >= BY_NAME["ball_lost"].off

    @property
    def board_enabled(self) -> bool:
        """The newest answer says that the drive is on."""
        return self._driver is not None and bool(self._driver.status & STATUS_ENABLED)

    @property
    def board_latched(self) -> bool:
        """The newest answer tells of a time-out or a fault that waits for a clearing request."""
        return self._driver is not None and bool(self._driver.status & (STATUS_TIMEOUT | STATUS_FAULT))

    @property
    def link_seen(self) -> bool:
        """The board has answered at least once."""
        return self._driver is not None

    @property
    def hoop_speed(self) -> float:
        """Newest reported hoop speed in rad/s, 0 before the first answer."""
        return 0.0 if self._driver is None else self._driver.dtheta

    def _look(self) -> None:
        """Keep what is active, which is asked for several times a tick."""
        self._active = tuple([count.fault for count in self._counts.values() if count.active])

    def _conditions(self, inputs: Inputs, estimate: Estimate, sent: Sent) -> dict[str, int]:
        missed = 0 if self._id is None else inputs.id - self._id - 1
        late = missed + (inputs.lateness_s + inputs.execution_s > self.period_s)
        finite = all(map(isfinite, estimate.x.tolist()))
        return {
            "frame_bad": _count_bad(inputs),
            **self._link(inputs),
            "not_finite": int(not finite),
            "overrun": late,
            "overrun_repeated": late,
            "overrun_persistent": late,
            "recorder_trouble": inputs.trouble & 1,
            "telemetry_trouble": inputs.trouble >> 1 & 1,
            **self._camera(inputs, estimate, sent),
            **self._top(float(estimate.x[2]), sent),
            **self._board(inputs, sent),
            **self._encoder.update(inputs.t, inputs.driver, sent.torque_nm, float(estimate.x[2])),
        }

    def _link(self, inputs: Inputs) -> dict[str, int]:
        if not self.link_seen and inputs.driver is None and inputs.t < START_GRACE_S:
            return {}
        return {"link_lost": int(inputs.driver is None or inputs.link.lost)}

    def _camera(self, inputs: Inputs, estimate: Estimate, sent: Sent) -> dict[str, int]:
        limits = self.thresholds
        if not limits.ball_expected:
            return dict.fromkeys(CAMERA_FAULTS, 0)
        pictures = self._pictures.update(inputs, sent.torque_nm)
        if inputs.camera is None and isinf(self._camera_t) and inputs.t < START_GRACE_S:
            return {}
        if inputs.camera is not None:
            self._camera_t = inputs.camera.t
            good = isfinite(inputs.camera.psi) and inputs.camera.confidence >= limits.minimum_confidence
            self._ball = good and estimate.psi_accepted
            if good and isfinite(estimate.innovation_psi):  # a picture too old to judge says nothing
                self._refusals.append(not estimate.psi_accepted)
        over = inputs.t - self._camera_t - limits.camera_delay_s - self.period_s
        lost = over > limits.lost_periods * self.period_s or inputs.camera_stalled
        missing = not self._ball
        return {
            "camera_late": int(over > limits.late_periods * self.period_s),
            "camera_lost": int(lost),
            "ball_missing": int(missing),
            "ball_lost": int(missing),
            "ball_implausible": int(self._refusals.count(True) >= REFUSALS),
            **pictures,
        }

    def _top(self, psi: float, sent: Sent) -> dict[str, int]:
        """Without torque a hand may carry the ball round, and a maneuver leaves it at another bottom."""
        if not (self.thresholds.ball_expected and isfinite(psi)):
            return {}
        if sent.torque_nm == 0.0 or "ball_runaway" in self._suspended:
            self._bottom_rad = tau * round(psi / tau)
        return {"ball_runaway": int(abs(psi - self._bottom_rad) > pi)}

    def _board(self, inputs: Inputs, sent: Sent) -> dict[str, int]:
        driver = inputs.driver
        if sent.enabled_for == 0:
            self._seen_enabled = False
        if driver is None:
            return {}
        enabled = bool(driver.status & STATUS_ENABLED)
        lost_drive = self._seen_enabled and not enabled
        latched = bool(driver.status & STATUS_TIMEOUT)
        # An answer to a request older than the last one tells of the time before the drive was asked for.
        self._seen_enabled = self._seen_enabled or (enabled and sent.enabled_for > 1)
        return {
            "board_fault": int(bool(driver.status & STATUS_FAULT or driver.errors & HARD_ERRORS)),
            "board_timeout": int(latched and lost_drive),
            "board_reset": int(self._clock_jumped(driver) or (lost_drive and not latched)),
            "board_refuses": int(sent.enabled_for > 0 and not enabled),
            "current_implausible": int(self._current_off(driver, sent)),
            "hoop_overspeed": int(abs(driver.dtheta) > self.thresholds.hoop_speed_rad_s),
        }

    def _clock_jumped(self, driver: DriverSample) -> bool:
        """The board's clock and ours disagree by more than 50 ms over one answer (both count milliseconds)."""
        if self._driver is None:
            return False
        board_ms = (driver.board_ms - self._driver.board_ms) % BOARD_CLOCK_MS
        host_ms = 1e3 * (driver.t - self._driver.t) % BOARD_CLOCK_MS
        apart = abs(board_ms - host_ms)
        return min(apart, BOARD_CLOCK_MS - apart) > 50.0

    def _current_off(self, driver: DriverSample, sent: Sent) -> bool:
        constant = self.thresholds.torque_constant_nm_per_a
        if constant == 0.0 or sent.enabled_for < 3 or driver.status & STATUS_LIMITED:
            return False
        # The sample is of the instant at which the board begins to leave the torque that it had (its slew limit).
        torque = constant * driver.current
        low, high = sorted((self._asked_nm, sent.torque_nm))
        return max(low - torque, torque - high) > self.thresholds.current_mismatch_nm


def _count_bad(inputs: Inputs) -> int:
    link = inputs.link
    return link.bad_crc + link.implausible + link.unexpected_seq + (link.garbage_bytes > 0)
