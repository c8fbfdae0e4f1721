"""The estimate of a hoop without a ball: what the board measured.

Rules of this file: no model and no filter, so that nothing is believed of a ball that is not there.
"""

from __future__ import annotations

from math import isfinite, nan

import numpy as np

from hoopd.core.records import CameraSample, DriverSample, Estimate


class HoopOnly:
    """Angle and speed of the hoop as last measured; the ball's states are zero."""

    def __init__(self) -> None:
        self.reset()

    def update(
        self,
        t: float,
        torque_previous: float,
        t_applied: float,
        driver: DriverSample | None,
        camera: CameraSample | None,
        *,
        held: bool,
        unmodelled: float = 0.0,
        may_fly: bool = False,
    ) -> Estimate:
        """Ready from the first answer of the board on."""
        if driver is not None and isfinite(driver.theta) and isfinite(driver.dtheta):
            self._hoop, self._seen = (driver.theta, driver.dtheta), True
        return Estimate(np.array([*self._hoop, 0.0, 0.0]), self._seen, nan, nan, False, nan)

    def reset(self) -> None:
        """Nothing was measured yet."""
        self._hoop, self._seen = (0.0, 0.0), False
