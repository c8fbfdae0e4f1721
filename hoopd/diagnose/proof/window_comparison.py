"""A stretch cut into windows that is simulated from starts, and how far its readings are off.

Each channel's error counts over its spread; an angle that has a measured rate beside it counts by its slope.

Rules of this file: it simulates and compares; nothing is searched here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.fit_tables import spread_of
from hoopd.diagnose.proof.simulation import Simulated, Simulator, Windows, bounded, windows_of
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.recording_parameters import names_of, values_of
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.scales import state_scales

Array = NDArray[np.float64]

# Starts stay near what the smoother says, within these shares of usual sizes: of a place or a store, of a rate.
START_SPREAD = (0.1, 2.0)


@dataclass
class Part:
    """One stretch on its way: windows, simulator, starts (nx, b)."""

    stretch: Stretch
    windows: Windows
    simulator: Simulator
    start: Array
    anchor: Array
    weight: Array  # (nc,) one over a channel's |y - mean y|
    names: dict[str, str]  # free parameter -> its name in this stretch

    def local(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of this stretch, those of the composite where none are given."""
        return {**self.simulator.composite.values, **values_of(self.stretch.recording, values)}


def part_of(
    stretch: Stretch,
    reference: Array,
    effects: Sequence[Effect],
    weight: Array,
    free: Sequence[str],
    length: float | None,
) -> Part:
    """From a smoother's states (nodes, nx or more); `length`: of the windows, s."""
    windows = windows_of(stretch, length)
    simulator = Simulator(windows, effects)
    nx = simulator.composite.nx
    wide = np.zeros((len(reference), nx))
    known = min(nx, reference.shape[1])
    wide[:, :known] = reference[:, :known]
    start = wide[windows.first].T.copy()
    names = {n: own for n, own in names_of(stretch.recording, free).items() if own in simulator.composite.names}
    return Part(stretch, windows, simulator, start, start.copy(), weight, names)


def start_spread(part: Part) -> Array:
    """(nx, 1)"""
    moves = [START_SPREAD[i % 2] for i in range(2 * part.simulator.composite.nq)]
    others = [START_SPREAD[0]] * (len(part.start) - len(moves))
    return np.array([*moves, *others])[:, None] * usual_sizes(part)


def usual_sizes(part: Part) -> Array:
    """(nx, 1) of the starts."""
    return state_scales(part.simulator.composite.plant)[:, None]


def node_states(part: Part, values: Mapping[str, float]) -> Array:
    """(nodes, nx) what the windows had at every node of the stretch."""
    states = part.simulator.run(part.local(values), part.start[:, :, None])[..., 0]
    nx, w = len(part.start), part.windows
    out = np.empty((len(part.stretch.t), nx))
    for b, (first, count) in enumerate(zip(w.first, w.count, strict=True)):
        out[first : first + count] = states[:count, :nx, b]
    return out


def simulated(part: Part, values: Mapping[str, float]) -> Simulated:
    local = part.local(values)
    states = part.simulator.run(local, part.start[:, :, None])
    return Simulated(part.windows, part.start, part.simulator.readings(local, states)[..., 0], states[..., 0])


# ---------------------------------------------------------------------------------------------- compared


def channel_weights(stretches: Sequence[Stretch]) -> list[Array]:
    """(nc,) of each stretch: one over |y - mean y| of the channel in its recording; 0 for a channel without a vote.

    An angle that has a measured rate beside it counts by its slope, and the measured rate itself is not asked.
    """
    return [
        np.array([_weight([one for one in stretches if one.recording == s.recording], c) for c in s.plant.channels])
        for s in stretches
    ]


def _weight(same: Sequence[Stretch], channel: str) -> float:
    plant = same[0].plant
    if _asked_by_its_angle(plant, channel):
        return 0.0
    column = list(plant.channels).index(channel)
    parts = [_signal(one.t, one.y[:, column], _turns(plant, channel)) for one in same]
    seen = np.concatenate([part[np.isfinite(part)] for part in parts])
    spread = spread_of(seen)
    return 1.0 / spread if spread > 0.0 else 0.0


def _turns(plant: Plant, channel: str) -> bool:
    return f"d{plant.state_of(channel)}" in plant.states_read


def _asked_by_its_angle(plant: Plant, channel: str) -> bool:
    state = plant.state_of(channel)
    return state.startswith("d") and state[1:] in plant.states_read


def _signal(t: Array, y: Array, turns: bool) -> Array:
    """What is compared of (n, ...): the reading, or its slope between the neighbours."""
    if not turns:
        return y
    out = np.full_like(y, np.nan)
    span = (t[2:] - t[:-2]).reshape(-1, *([1] * (y.ndim - 1)))
    out[1:-1] = (y[2:] - y[:-2]) / span
    return out


def errors(part: Part, y: Array) -> Array:
    """(n, nc, b) weighted; 0 where nothing was measured."""
    return errors_of(part.windows, part.weight, y)


def errors_of(windows: Windows, weight: Array, y: Array) -> Array:
    """The same of windows alone."""
    shown = bounded(y, windows.sizes)
    return np.asarray(np.nan_to_num(_compared(windows, weight, windows.y) - _compared(windows, weight, shown)))


def _compared(w: Windows, weight: Array, y: Array) -> Array:
    """Weighted signals of (n, nc, b)."""
    nodes = np.minimum(w.first + np.arange(w.length)[:, None], len(w.stretch.t) - 1)
    plant = w.stretch.plant
    seen = np.isfinite(w.y)
    out = np.full(y.shape, np.nan)
    for column, channel in enumerate(plant.channels):
        if weight[column] == 0.0:
            continue
        one = np.where(seen[:, column], y[:, column], np.nan)
        if _turns(plant, channel):
            span = w.stretch.t[nodes[2:]] - w.stretch.t[nodes[:-2]]
            slope = np.full(one.shape, np.nan)
            slope[1:-1] = (one[2:] - one[:-2]) / np.maximum(span, 1e-9)
            one = slope
        out[:, column] = weight[column] * one
    return out
