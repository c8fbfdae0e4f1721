"""What a fit compares: stretches of recordings that are simulated from one initial state each, and what simulates them.

Rules of this file: numbers and names; nothing here knows a particular plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.fits.free_parameters import Scale
from hoopd.plants.trajectory import Trajectory

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# A run shorter than this tells nothing beyond its own initial state.
SHORTEST_ROWS = 10
# Fewer samples of a channel than these say nothing of its spread, and have no central difference.
FEWEST = 3


@dataclass(frozen=True)
class ChannelSeries:
    """One channel of a run: values and the nodes they compare with; `before`: a rate over two nodes."""

    name: str
    nodes: Index  # (k,)
    values: Array  # (k,)
    before: Index | None = None
    span_s: Array | None = None  # time between the two nodes

    def of(self, column: Array) -> Array:
        """The same from the simulated channel at all nodes (n, ...): (k, ...)."""
        if self.before is None or self.span_s is None:
            return np.asarray(column[self.nodes])
        span = self.span_s.reshape(-1, *([1] * (column.ndim - 1)))
        return np.asarray((column[self.nodes] - column[self.before]) / span)

    def until(self, last: int) -> ChannelSeries:
        """What was measured up to this node."""
        keep = self.nodes <= last
        before = None if self.before is None else self.before[keep]
        span_s = None if self.span_s is None else self.span_s[keep]
        return ChannelSeries(self.name, self.nodes[keep], self.values[keep], before, span_s)


@dataclass(frozen=True)
class Run:
    """A stretch that is simulated from one initial state."""

    recording: str
    moving: str  # which part of the plant moves; one word throughout where all of it does
    t: Array  # (n,) s
    u: Array  # (n-1,) of one input, (n-1, inputs) of several or none
    series: dict[str, ChannelSeries]
    start: Array  # (nx,) first guess of the state
    set_aside: dict[str, int]  # samples that do not count, by channel

    @property
    def samples(self) -> int:
        """Measurements that count."""
        return sum(len(series.values) for series in self.series.values())

    def beginning(self, length_s: float) -> Run:
        """The first seconds of the run."""
        last = int(np.searchsorted(self.t, self.t[0] + length_s, side="right")) - 1
        cut = {name: one.until(last) for name, one in self.series.items()}
        series = {name: one for name, one in cut.items() if len(one.values) >= FEWEST}
        return replace(self, t=self.t[: last + 1], u=self.u[:last], series=series)


class RunModel(Protocol):
    """Simulates again and again, some parameters told anew each time."""

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        """(n, columns) at the nodes t (n,) s from x0 (nx,) with inputs u held between them."""

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        """The same with exact derivatives."""


class System(Protocol):
    """A plant with its numbers, as a fit asks for it."""

    @property
    def values(self) -> Mapping[str, float]:
        """Every parameter."""

    @property
    def columns(self) -> Mapping[str, int]:
        """Which column of a model's run each channel of a series reads."""

    def model(self, moving: str, free: Sequence[str]) -> RunModel:
        """What simulates runs of a kind; `free`: the parameters that a run is told."""

    def scale(self, names: Sequence[str]) -> Scale:
        """The search's coordinates of these parameters."""

    def free_starts(self, run: Run) -> list[int]:
        """Components of the initial state that the run's channels see."""
