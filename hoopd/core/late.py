"""The filter behind a drive that acts late and sensors that are late or wrong by a known amount.

A reading is given to the filter at the time at which it was true, and corrected first. A torque is given to it when
it arrives at the hoop; those that are still on their way carry the estimate on to where this tick's torque will act.

Rules of this file: pure; the filter itself knows nothing of this.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

from hoopd.core.estimator import LONGEST_STEP_S, DelayedEkf, Step, ahead_of
from hoopd.core.records import CameraSample, DriverSample, Estimate, Vector

# (theta, dtheta, psi) as read -> as they are; a value that does not concern it stays.
Correct = Callable[[float, float, float], tuple[float, float, float]]


class Delays(NamedTuple):
    """How much later than they should things happen, in s."""

    torque_s: float = 0.0
    camera_s: float = 0.0
    encoder_s: float = 0.0


class LateEstimator:
    """`DelayedEkf` with known delays and readings' errors; the same interface."""

    def __init__(self, inner: DelayedEkf, step: Step, delays: Delays, correct: Correct | None = None) -> None:
        self.inner, self.delays = inner, delays
        self._stepped, self._correct = ahead_of(step), correct
        self.reset()

    def reset(self) -> None:
        """Nothing was measured, no torque is on its way."""
        self.inner.reset()
        self._coming: deque[tuple[float, float]] = deque()  # when it arrives, N m
        self._acting = 0.0
        self._since = 0.0

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
        """As `DelayedEkf.update`."""
        self._send(torque_previous, t_applied)
        self._arrive(t)
        seen = (self._hoop(driver), self._picture(camera))
        estimate = self.inner.update(
            t, self._acting, self._since, *seen, held=held, unmodelled=unmodelled, may_fly=may_fly
        )
        return estimate._replace(ahead=self._ahead(t, estimate.x)) if self.delays.torque_s > 0.0 else estimate

    # ------------------------------------------------------------------------------------------ torque

    def _send(self, torque_nm: float, t_applied: float) -> None:
        self._coming.append((t_applied + self.delays.torque_s, torque_nm if isfinite(torque_nm) else 0.0))

    def _arrive(self, t: float) -> None:
        """What has arrived by `t`; of two within one tick the younger one counts."""
        while self._coming and (self._coming[0][0] <= t or self.delays.torque_s == 0.0):
            self._since, self._acting = self._coming.popleft()

    def _ahead(self, t: float, x: Vector) -> Vector:
        """The state when a torque that is sent now arrives."""
        end, torque = t + self.delays.torque_s, self._acting
        for arrival, coming in (*self._coming, (end, 0.0)):
            until = min(max(arrival, t), end)
            while until - t > 0.0:
                h = min(until - t, LONGEST_STEP_S)
                x = self._stepped(x, torque, h)
                t += h
            torque = coming
        return x

    # ------------------------------------------------------------------------------------------ readings

    def _hoop(self, driver: DriverSample | None) -> DriverSample | None:
        if driver is None:
            return None
        theta, dtheta, _ = self._corrected(driver.theta, driver.dtheta, 0.0)
        return driver._replace(t=driver.t - self.delays.encoder_s, theta=theta, dtheta=dtheta)

    def _picture(self, camera: CameraSample | None) -> CameraSample | None:
        if camera is None:
            return None
        _, _, psi = self._corrected(0.0, 0.0, camera.psi)
        _, _, direction = self._corrected(0.0, 0.0, camera.direction)
        return camera._replace(t=camera.t - self.delays.camera_s, psi=psi, direction=direction)

    def _corrected(self, theta: float, dtheta: float, psi: float) -> tuple[float, float, float]:
        return (theta, dtheta, psi) if self._correct is None else self._correct(theta, dtheta, psi)
