"""From one law's torque to the next one's without a step: what they differ by is added and dies away.

Rules of this file: pure; in the tick of the change the torque is the old one's to the bit of a sum; changes in a row
accumulate nothing, for each begins with what is wanted then, and never more than a bound.
"""

from __future__ import annotations

from math import exp, isfinite

# A quarter of the ball's swing (1.2 Hz): slow beside a tick, fast beside what the difference could do to the ball.
TIME_CONSTANT_S = 0.2
# A larger difference is a step, within the slew limit: 0.1 N m for 0.2 s turn a hoop of 1.5e-3 kg m2 by 13 rad/s if
# no law acts against it, and a law on trial may have been at the torque limit when it was taken away.
MOST_NM = 0.1
GONE_NM = 1e-6


class Bridge:
    """The torque that is added after a change."""

    def __init__(self) -> None:
        self.torque_nm = 0.0

    def begin(self, wanted_before_nm: float, wanted_now_nm: float, sent_nm: float) -> float:
        """The torque of the tick of a change; `sent_nm`: of the last tick, where the old law has none any more."""
        start = wanted_before_nm if isfinite(wanted_before_nm) else sent_nm
        difference = start - wanted_now_nm
        self.torque_nm = min(MOST_NM, max(-MOST_NM, difference)) if isfinite(difference) else 0.0
        return wanted_now_nm + self.torque_nm

    def over(self, wanted_nm: float, dt: float) -> float:
        """The torque of a later tick."""
        if self.torque_nm == 0.0:
            return wanted_nm
        self.torque_nm *= exp(-dt / TIME_CONSTANT_S)
        if abs(self.torque_nm) < GONE_NM:
            self.torque_nm = 0.0
        return wanted_nm + self.torque_nm

    def reset(self) -> None:
        """No law acts."""
        self.torque_nm = 0.0
