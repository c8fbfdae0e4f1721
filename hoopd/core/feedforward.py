"""Feed-forward of named forces: from the torque that the law wants on the hoop to the torque that gives it.

Rules of this file: a pure function of state and wanted torque; equations come in as callables (as the estimator's
step); a part outside the region in which its effect was seen does nothing; the sum is bounded, and the limiter still
comes after it. Whatever a callable does, the wanted torque comes out: what fails adds nothing and says why.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import NamedTuple

from hoopd.core.records import Vector

# (x (4,), wanted torque N m, 1 or 0 for every part: it acts or not) -> torque to demand, N m.
Demand = Callable[[Vector, float, tuple[float, ...]], float]
# Index of the wanted torque among what a region bounds, after the four states.
WANTED = 4


class Bound(NamedTuple):
    """One side of a region: a state (0 to 3) or the wanted torque (`WANTED`) between two numbers."""

    place: int
    low: float
    high: float


class FeedForwardPart(NamedTuple):
    """One effect: it acts where every bound holds."""

    name: str  # slot.effect
    region: tuple[Bound, ...] = ()


def as_wanted(x: Vector, wanted_nm: float, acting: tuple[float, ...]) -> float:
    """Nothing is known that would have to be cancelled."""
    return wanted_nm


class FeedForward:
    """All parts in one call."""

    def __init__(
        self,
        parts: Sequence[FeedForwardPart] = (),
        demand: Demand = as_wanted,
        limit_nm: float = 0.0,
    ) -> None:
        """`limit_nm`: how far the demanded torque may be from the wanted one."""
        if not limit_nm >= 0.0:
            raise ValueError(f"the limit of a feed-forward must not be negative, not {limit_nm}")
        self.parts, self.limit_nm, self._demand = tuple(parts), limit_nm, demand
        self.trouble = ""  # why the last call added nothing, where it should have

    def demand(self, x: Vector, wanted_nm: float) -> float:
        """Torque to demand so that the hoop gets `wanted_nm`; the wanted one where no part is sure, and on any failure
        (`trouble` says which)."""
        self.trouble = ""
        if not self.parts:
            return wanted_nm
        try:
            added = self._torque(x, wanted_nm) - wanted_nm
        except Exception as error:  # a compiled expression, a user's own effect: the tick goes on without it
            return self._nothing(wanted_nm, f"{type(error).__name__}: {error}")
        if not isfinite(added):
            return self._nothing(wanted_nm, "the torque of the feed-forward is not a finite number")
        return wanted_nm + min(self.limit_nm, max(-self.limit_nm, added))

    def _torque(self, x: Vector, wanted_nm: float) -> float:
        values = (*x.tolist(), wanted_nm)
        acting = tuple(
            float(all(low <= values[place] <= high for place, low, high in part.region)) for part in self.parts
        )
        return float(self._demand(x, wanted_nm, acting))

    def _nothing(self, wanted_nm: float, reason: str) -> float:
        self.trouble = reason
        return wanted_nm
