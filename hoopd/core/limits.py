"""Last word on every torque: finite, within the torque limit, within the slew limit.

Rules of this file: nothing may pass without `apply`; the torque limit is exact (never exceeded by a rounding).
"""

from __future__ import annotations

from math import isfinite
from typing import Final

# What no law, experiment or configuration may ask of the drive, N m: a larger limit would only hide the anti-windup
# from the controller.
TORQUE_LIMIT_NM: Final = 0.7
# From one extreme to the other within a tick: no slew limit.
SLEW_NM_PER_TICK: Final = 2.0 * TORQUE_LIMIT_NM


class Limiter:
    """Torque and slew limit; `limited` and `refused` say what the last call did."""

    def __init__(self, torque_nm: float, slew_nm_per_tick: float) -> None:
        if not (isfinite(torque_nm) and torque_nm >= 0.0):
            raise ValueError(f"torque limit must be a number of N m not below zero, not {torque_nm}")
        if not slew_nm_per_tick > 0.0:
            raise ValueError(f"slew limit must be above zero N m per tick, not {slew_nm_per_tick}")
        self.torque_nm, self.slew_nm_per_tick = torque_nm, slew_nm_per_tick
        self.limited = self.refused = False
        self._last = 0.0

    def apply(self, wanted_nm: float) -> float:
        """Permitted torque nearest to the wanted one; zero for a wish that is not a number."""
        self.refused = not isfinite(wanted_nm)
        if self.refused:
            self._last = 0.0  # the one exception from the slew limit: a lost law is cut at once
            return 0.0
        slewed = min(self._last + self.slew_nm_per_tick, max(self._last - self.slew_nm_per_tick, wanted_nm))
        # the torque limit comes last, so that it is exact
        self._last = min(self.torque_nm, max(-self.torque_nm, slewed))
        self.limited = self._last != wanted_nm
        return self._last

    def reset(self) -> None:
        """Forget the last torque: the next one starts from zero."""
        self._last, self.limited, self.refused = 0.0, False, False
