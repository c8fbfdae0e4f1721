"""The law of an experiment: plays a table of torques and ends at its end, or at the first breach of its limits.

Rules of this file: a table is played once, one value a tick; nothing is added to it but what was asked for (a holding
law, a centring gain); the limits are its own and narrower than those that the tick watches; a breach is never retried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, inf, isfinite, nan, pi, tau

from hoopd.core.controllers import DONE, Controller, Log, Measurement, Successor

# In the reason why a law has ended: a limit of its own was passed.
BEYOND = " beyond "


@dataclass(frozen=True)
class ExcitationLimits:
    """What an experiment may do."""

    torque_nm: float  # the sum of everything it asks for is cut to this
    hoop_speed_rad_s: float  # beyond, it ends
    ball_angle_rad: float = inf  # from the nearest bottom; beyond, it ends; infinite without a ball

    def __post_init__(self) -> None:
        """Refuse limits that limit nothing."""
        if not (0.0 < self.torque_nm < inf and 0.0 < self.hoop_speed_rad_s < inf and self.ball_angle_rad > 0.0):
            raise ValueError("limits of torque, hoop speed and ball angle must be above zero")


class Excitation:
    """Torque table with a soft start and a soft end, alone or on top of a holding law.

        u_k = w_k table_k - c dtheta + holding law,   cut to +-torque limit

    w rises from 0 to 1 over the soft start and falls over the soft end. The centring gain c keeps the hoop from
    running away; it is feedback, so that a fit of the recording must not take u for independent of the noise.
    """

    def __init__(
        self,
        table_nm: Sequence[float],
        limits: ExcitationLimits,
        *,
        soft_start_ticks: int = 0,
        soft_end_ticks: int = 0,
        centring_nm_per_rad_s: float = 0.0,
        around: Controller | None = None,
    ) -> None:
        if not table_nm or not all(map(isfinite, table_nm)):
            raise ValueError("the table needs finite torques")
        if max(map(abs, table_nm)) > limits.torque_nm:
            raise ValueError(f"the table asks for more than the limit of {limits.torque_nm:g} N m")
        if not 0.0 <= centring_nm_per_rad_s < inf:
            raise ValueError("centring must be a finite gain not below zero")
        n = len(table_nm)
        self.torques_nm = [
            value * soft_factor(k, n, soft_start_ticks, soft_end_ticks) for k, value in enumerate(table_nm)
        ]
        self.limits, self.centring_nm_per_rad_s, self.around = limits, centring_nm_per_rad_s, around
        self._k, self._added_nm, self.ended = 0, 0.0, ""

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """The next torque; zero once it has ended."""
        self.ended = self.ended or self._breach(measurement)
        if not self.ended and self._k >= len(self.torques_nm):
            self.ended = DONE
        if self.ended:
            return 0.0, {}
        held_nm = self._held(measurement)
        excited_nm = self.torques_nm[self._k]
        self._k += 1
        limit = self.limits.torque_nm
        self._added_nm = excited_nm - self._centring(measurement)
        torque = held_nm + self._added_nm
        cut = min(limit, max(-limit, torque)) if isfinite(torque) else nan  # nan: the tick cuts a law that is lost
        return cut, {"excitation_nm": excited_nm, "holding_nm": held_nm}

    def follow(self, measurement: Measurement) -> tuple[float, Log]:
        """The holding law's torque while another law drives the hoop: the table has not begun."""
        return self._held(measurement), {}

    def reset(self) -> None:
        """The table begins anew."""
        self._k, self._added_nm, self.ended = 0, 0.0, ""
        if self.around is not None:
            self.around.reset()

    def take_over(self, other: Controller) -> bool:
        """The holding law goes on where the other law stopped."""
        return self.around is None or (isinstance(self.around, Successor) and self.around.take_over(other))

    def tune(self, key: str, value: float) -> bool:
        """Nothing: the table is what the recording says it is."""
        return False

    def _held(self, measurement: Measurement) -> float:
        """The holding law's torque; it is told which part of the last torque was not its own."""
        if self.around is None:
            return 0.0
        added_nm = measurement.torque_added + self._added_nm
        return self.around.update(measurement._replace(torque_added=added_nm))[0]

    def _centring(self, measurement: Measurement) -> float:
        return self.centring_nm_per_rad_s * float(measurement.x[1]) if self.centring_nm_per_rad_s else 0.0

    def _breach(self, m: Measurement) -> str:
        """What is beyond its limit, measured or estimated; empty when nothing is."""
        if not m.ready:
            return "the estimate was lost"
        speed = _largest(float(m.x[1]), m.dtheta_measured)
        if not speed <= self.limits.hoop_speed_rad_s:
            return f"hoop speed {speed:.2f} rad/s{BEYOND}{self.limits.hoop_speed_rad_s:g}"
        angle = _largest(_wrapped(float(m.x[2])), _wrapped(m.psi_measured) if m.psi_fresh else nan)
        if not angle <= self.limits.ball_angle_rad:
            return f"ball angle {angle:.3f} rad{BEYOND}{self.limits.ball_angle_rad:g}"
        return ""


def soft_factor(k: int, samples: int, start_ticks: int, end_ticks: int) -> float:
    """Envelope at value `k` of `samples`: (1 - cos(pi r)) / 2, r = (ticks from the nearer end + 1) / (n + 1)."""
    inside = min((k + 1) / (start_ticks + 1), (samples - k) / (end_ticks + 1), 1.0)
    return 0.5 * (1.0 - cos(pi * inside))


def _largest(estimated: float, measured: float) -> float:
    """The larger magnitude; a missing measurement leaves the estimate, a lost estimate is NaN."""
    return max(abs(estimated), abs(measured)) if isfinite(measured) else abs(estimated)


def _wrapped(angle: float) -> float:
    """Angle from the nearest bottom."""
    return angle - tau * round(angle / tau) if isfinite(angle) else nan
