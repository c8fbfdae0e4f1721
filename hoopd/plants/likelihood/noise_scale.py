"""Noise levels of a filter as a search sees them: which are free, and the way from its coordinates to them.

Rules of this file: names and numbers; a level never falls below its floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.runs import Run

Array = NDArray[np.float64]


class NoiseLevels(Protocol):
    """Which noise levels (`q_<state>`, `r_<channel>`) a fit searches for, and what they are at the beginning."""

    def free(self, runs: Sequence[Run]) -> tuple[str, ...]:
        """Those that the search moves."""

    def values(self, free: Sequence[str]) -> dict[str, float]:
        """All of them at the start."""

    def floors(self) -> dict[str, float]:
        """The lowest ones."""


@dataclass(frozen=True)
class NoiseScale:
    """From the search's coordinates to levels: floor + (first - floor) e^z."""

    names: tuple[str, ...]
    floor: Array  # (k,)
    above: Array  # (k,) first guess less the floor

    def levels(self, z: Array) -> Array:
        """Levels (k,), never at or below the floor."""
        return self.floor + self.derivative(z)

    def derivative(self, z: Array) -> Array:
        """d level / dz (k,)."""
        return np.asarray(self.above * np.exp(np.clip(z, -60.0, 30.0)))


def noise_scale(names: Sequence[str], values: Mapping[str, float], floors: Mapping[str, float]) -> NoiseScale:
    """Scale around first guesses."""
    floor = np.array([floors[name] for name in names])
    return NoiseScale(tuple(names), floor, np.array([values[name] for name in names]) - floor)
