"""Noise levels of the filter as a fit sees them: names, floors, first guesses, the way into the daemon's settings.

Rules of this file: the daemon's convention throughout: `q_<state>` is a variance per second on that state,
`r_<channel>` the variance of one sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import tau
from types import MappingProxyType

import numpy as np

from hoopd.plants.fits.runs import Run
from hoopd.plants.hoop.simulate import STATES

CHANNELS = ("theta", "dtheta", "psi")  # the daemon takes them in this order
NOISE_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "q_theta": "rad^2/s",
        "q_dtheta": "(rad/s)^2/s",
        "q_psi": "rad^2/s",
        "q_dpsi": "(rad/s)^2/s",
        "r_theta": "rad^2",
        "r_dtheta": "(rad/s)^2",
        "r_psi": "rad^2",
    }
)
# Below these a level changes nothing that could be seen in minutes of data: 1e-9 (rad/s)^2/s moves an angle by
# 1e-5 rad in a second. A tenth of a milliradian is a fortieth of the camera's noise.
FLOORS: Mapping[str, float] = MappingProxyType(
    {
        "q_theta": 1e-12,
        "q_dtheta": 1e-9,
        "q_psi": 1e-12,
        "q_dpsi": 1e-9,
        "r_theta": (tau / 4096) ** 2 / 12,  # an encoder's count, evenly spread
        "r_dtheta": 1e-8,
        "r_psi": 1e-8,
    }
)
# First guesses: wide, so that the filter follows the data and the search sees no far-away minimum.
FIRST: Mapping[str, float] = MappingProxyType(
    {
        "q_theta": 1e-8,
        "q_dtheta": 4.0,
        "q_psi": 1e-8,
        "q_dpsi": 1.0,
        "r_theta": 2 * FLOORS["r_theta"],
        "r_dtheta": 0.05**2,
        "r_psi": 0.004**2,
    }
)
# What a force nobody modelled does: it accelerates. Noise on the angles themselves is for those who ask.
USUAL_Q = ("q_dtheta", "q_dpsi")
_OF_MOTION = {
    "both": ("q_theta", "q_dtheta", "q_psi", "q_dpsi"),
    "hoop": ("q_theta", "q_dtheta"),
    "ball": ("q_psi", "q_dpsi"),
}


@dataclass(frozen=True)
class NoiseModel:
    """Which levels a fit searches for, where it begins, and what the others are."""

    estimated: tuple[str, ...] | None = None  # None: the accelerations' q and every measured channel's r
    start: Mapping[str, float] = field(default_factory=dict)  # levels by name; the rest from `FIRST`
    encoder_counts: int = 4096

    def __post_init__(self) -> None:
        """Refuse unknown names and levels below zero."""
        for name in (*(self.estimated or ()), *self.start):
            if name not in NOISE_UNITS:
                raise ValueError(f"{name}: no noise level; known: {', '.join(NOISE_UNITS)}")
        for name, value in self.start.items():
            if not (np.isfinite(value) and value >= 0.0 and (value > 0.0 or name.startswith("q_"))):
                raise ValueError(f"{name}: must be a variance, not {value}")

    def floors(self) -> dict[str, float]:
        """Lowest levels by name."""
        return {**FLOORS, "r_theta": (tau / self.encoder_counts) ** 2 / 12}

    def free(self, runs: Sequence[Run]) -> tuple[str, ...]:
        """Levels that the search moves: asked for, and felt by some run."""
        felt = {f"r_{name}" for run in runs for name in run.series} | {q for r in runs for q in _OF_MOTION[r.moving]}
        usual = (*USUAL_Q, *(f"r_{name}" for name in CHANNELS))
        return tuple(name for name in (usual if self.estimated is None else self.estimated) if name in felt)

    def values(self, free: Sequence[str]) -> dict[str, float]:
        """All levels at the start: a q that is neither searched for nor given is zero."""
        floors, out = self.floors(), {}
        for name in NOISE_UNITS:
            usual = 0.0 if name.startswith("q_") and name not in free else FIRST[name]
            level = float(self.start.get(name, usual))
            out[name] = max(level, 2.0 * floors[name]) if name in free else level
        return out


def ekf_settings(levels: Mapping[str, float], measured: Sequence[str] = CHANNELS) -> dict[str, object]:
    """Fields of the daemon's `EkfSettings` from noise levels by name: q (4,) and the r of the measured channels."""
    q = tuple(float(levels[f"q_{name}"]) for name in STATES)
    return {"q": q, **{f"r_{name}": float(levels[f"r_{name}"]) for name in measured}}
