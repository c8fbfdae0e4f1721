"""A state feedback that keeps the ball near a moving reference, from what the sensors say.

Rules of this file: numpy only, arrays (B,); it is part of the generator, not the daemon's controller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from concealed.plant import SAMPLE_S, Array

LIMIT_NM = 0.35
# Gains of the filter that follows psi and its rate: it forgets a wrong rate within about 0.1 s.
FOLLOW, FOLLOW_RATE = 0.6, 0.25


@dataclass(frozen=True)
class Law:
    """u = feed - kp (psi - reference) - kd psi' - kw theta', arrays (B,); all zero is open loop."""

    kp: Array  # N m/rad
    kd: Array  # N m s/rad
    kw: Array  # N m s/rad
    reference: Array  # rad (samples, B)


class Follower:
    """Estimate of psi and psi' of each device from samples that may be missing."""

    def __init__(self, first: Array) -> None:
        self.psi, self.dpsi = np.nan_to_num(first), np.zeros_like(first)

    def update(self, psi: Array) -> None:
        """Takes one sample (B,), NaN where there is none."""
        expected = self.psi + SAMPLE_S * self.dpsi
        miss = np.nan_to_num(psi - expected)
        self.psi, self.dpsi = expected + FOLLOW * miss, self.dpsi + FOLLOW_RATE / SAMPLE_S * miss


def torque(law: Law, feed: Array, k: int, follower: Follower, dtheta: Array) -> Array:
    """Demanded torque (B,) of sample k, N m."""
    error = follower.psi - law.reference[k]
    back = law.kp * error + law.kd * follower.dpsi + law.kw * dtheta
    return np.where(law.kp > 0, np.clip(feed - back, -LIMIT_NM, LIMIT_NM), feed)
