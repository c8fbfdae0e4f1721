"""What the board cuts by itself beside silence: a hoop that turns too fast, a current that no torque needs.

Rules of this file: pure; the board's own sensors are all that it knows, never what the host says; a cut is an error bit
that stays until the host clears it, and that nobody can clear while its condition lasts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from hoopd.core.frames import ERROR_OVERCURRENT, ERROR_OVERSPEED

# The rim then moves at 10 m/s and the hoop carries 7.6 J; the fastest recorded motion is 39 rad/s, the daemon itself
# gives up at 60. From rest the largest torque takes a quarter of a second to come here.
OVERSPEED_RAD_S: Final = 100.0
# A hoop that still turns is not energised again by whoever sent it there: the host clears below a tenth of the limit.
REST_SHARE: Final = 0.1
# The largest torque needs 1.9 A at 0.37 N m/A; a third more is no torque of this motor but a short circuit, a winding
# that is gone or a wrong constant.
CURRENT_LIMIT_A: Final = 2.5
# A look at the sensors every millisecond while the hoop is fast, and the torque is off within one of the limit.
LOOK_S: Final = 1e-3
# While it is slow, one a tick will do: from half the limit no torque reaches all of it in that time (9 rad/s at most).
SLOW_LOOK_S: Final = 0.02
FAST_SHARE: Final = 0.5


@dataclass(frozen=True)
class Guards:
    """The limits; infinite ones are off."""

    overspeed_rad_s: float = OVERSPEED_RAD_S
    current_limit_a: float = CURRENT_LIMIT_A

    def begun(self, speed: float, current: float) -> int:
        """Error bits of what is beyond its limit."""
        over_speed = ERROR_OVERSPEED if not abs(speed) <= self.overspeed_rad_s else 0
        return over_speed | (ERROR_OVERCURRENT if not abs(current) <= self.current_limit_a else 0)

    def lasting(self, speed: float, current: float) -> int:
        """Error bits that cannot be cleared yet."""
        over_speed = ERROR_OVERSPEED if not abs(speed) <= REST_SHARE * self.overspeed_rad_s else 0
        return over_speed | (ERROR_OVERCURRENT if not abs(current) <= self.current_limit_a else 0)

    def pause_s(self, speed: float) -> float:
        """Seconds until the next look at the sensors, at most."""
        return LOOK_S if abs(speed) > FAST_SHARE * self.overspeed_rad_s else SLOW_LOOK_S
