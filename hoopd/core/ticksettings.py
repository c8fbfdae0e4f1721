"""Numbers of the tick, and the ranges within which a loop of this kind can be kept.

Rules of this file: checked when made; nothing decides here.
"""

from __future__ import annotations

from dataclasses import dataclass

from hoopd.core.limits import TORQUE_LIMIT_NM


@dataclass(frozen=True)
class TickSettings:
    """Numbers of the tick."""

    period_s: float = 0.02
    wire_s: float = 8 * 10 / 115200  # a request's time on the wire
    reference_limit_rad: float = 0.5  # larger angles leave the region where the linear design holds
    brake_nm_per_rad_s: float = 0.01  # hoop inertia 1.5e-3 kg m2: a time constant of 0.15 s
    brake_limit_nm: float = 0.1
    stopped_rad_s: float = 0.5
    stopping_s: float = 1.0  # then off, at rest or not

    def __post_init__(self) -> None:
        """Refuse a period that no camera or board of this kind can keep, and a stop that does not end."""
        ranges = {
            "period_s": (0.005, 0.1),
            "wire_s": (0.0, 0.02),
            "reference_limit_rad": (0.0, 1.5),  # the ball leaves the track near a quarter turn
            "brake_nm_per_rad_s": (0.0, 0.1),  # above, one tick of delay turns the brake into an oscillator
            "brake_limit_nm": (0.0, TORQUE_LIMIT_NM),
            "stopped_rad_s": (0.0, 60.0),
            "stopping_s": (0.0, 10.0),
        }
        for name, (low, high) in ranges.items():
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} must be between {low:g} and {high:g}")
