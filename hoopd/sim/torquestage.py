"""The board's torque stage: on its way to the demanded torque in small steps, off at once.

Rules of this file: time is an argument; between two steps the torque is constant, so that the log of steps is the
torque itself and not a picture of it; switching off waits for nothing.
"""

from __future__ import annotations

import math
from typing import Final

from hoopd.plants.hoop.parameters import LIMIT_NM
from hoopd.sim.torque_log import TorqueRow, TorqueSink

# The whole range from one extreme to the other in 2 ms: a tenth of a tick, and no blow to shaft and bearings.
SLEW_NM_PER_MS: Final = LIMIT_NM
# A motor driver's torque loop runs at 10 kHz: one step of at most 0.07 N m each.
TORQUE_LOOP_S: Final = 1e-4


class TorqueStage:
    """What the motor gets."""

    def __init__(self, slew_nm_per_ms: float, sink: TorqueSink | None) -> None:
        self._step_nm = slew_nm_per_ms * 1e3 * TORQUE_LOOP_S
        self._sink = sink
        self._target = 0.0
        self._t_step = -math.inf  # the newest step
        self.torque_nm = 0.0
        self.enabled = False

    def deadline(self) -> float:
        """When the next step is due; inf when the torque is where it should be."""
        return math.inf if self.torque_nm == self._target else self._t_step + TORQUE_LOOP_S

    def go(self, t: float, target_nm: float, enabled: bool, reason: str) -> None:
        """From `t` on the motor is on its way to this torque; without enable it has none."""
        self._target, self.enabled = target_nm if enabled else 0.0, enabled
        if not enabled:
            self.torque_nm = 0.0
        elif self._t_step + TORQUE_LOOP_S <= t:
            self._approach(t)
        self._tell(t, reason)

    def step(self, t: float) -> None:
        """Take the step that is due."""
        self._approach(t)
        self._tell(t, "slew")

    def _approach(self, t: float) -> None:
        missing = self._target - self.torque_nm
        near = abs(missing) <= self._step_nm
        self.torque_nm = self._target if near else self.torque_nm + math.copysign(self._step_nm, missing)
        self._t_step = t

    def _tell(self, t: float, reason: str) -> None:
        if self._sink:
            self._sink(TorqueRow(t, self.torque_nm, self.enabled, reason))
