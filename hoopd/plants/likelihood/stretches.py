"""Recordings as the search sees them: nodes, held torques and readings, for any declared plant.

Rules of this file: nothing is judged here; what was not measured is NaN, and a stretch never crosses a gap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.usual_sizes import time_scale
from hoopd.plants.held_input import mean_torque
from hoopd.plants.plant_with_effects import BACK_STEPS, LONGEST_STEP_S
from hoopd.plants.scales import motion_scale
from hoopd.recording.input_curve import unresolved_in_parts

Array = NDArray[np.float64]

# A stretch shorter than this, and than half the readings of a recording, says nothing beyond its own start.
SHORTEST_S = 0.5
# Fewer readings than this are no recording to judge a model by; fewer do where a second has not so many.
FEWEST_READINGS, LEAST_READINGS = 50, 15
# Rows further apart than so many steps of a plant are no recording of it.
RAREST = 20.0
# Usual samples between two nodes, of a plant that is sampled often.
MOST_SAMPLES = 20.0
# Period of the loop that moves a drive's torque (docs/reference/board.md).
LOOP_S = 1e-4
# Samples of the local parabola that gives a first idea of positions and rates.
PARABOLA = 7


@dataclass(frozen=True)
class Stretch:
    """A piece without gaps, of one recording."""

    recording: str
    plant: Plant
    t: Array  # (n,) s from the recording's start, steps of at most `longest_node_s`
    u: Array  # (n-1,) the first input, held between the nodes
    y: Array  # (n, channels) readings in the plant's order, NaN: none
    # (n, channels) a reading's noise over its channel's level; not given: 1
    scatter: Array = field(default_factory=lambda: np.zeros((0, 0)))
    others: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (n-1, inputs - 1); not given: there are none
    # (n, channels) readings with those that are left out because the last one tells the same; not given: there are none
    every: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (n-1, inputs, 2) what the rows leave open of each input (`recording.input_curve`); not given: nothing
    unresolved: Array = field(default_factory=lambda: np.zeros((0, 0, 2)))
    slew: float = inf  # how fast the drive lets the first input change, in its unit per s

    def __post_init__(self) -> None:
        if len(self.others) != len(self.u):
            object.__setattr__(self, "others", np.zeros((len(self.u), 0)))
        if len(self.unresolved) != len(self.u):
            object.__setattr__(self, "unresolved", np.zeros((len(self.u), 1 + self.others.shape[1], 2)))
        if self.scatter.shape != self.y.shape:
            object.__setattr__(self, "scatter", np.ones(self.y.shape))
        if self.every.shape != self.y.shape:
            object.__setattr__(self, "every", self.y)

    @cached_property
    def h(self) -> Array:
        """(n-1,) s"""
        return np.diff(self.t)

    @property
    def inputs(self) -> Array:
        """(n-1, inputs) all of them."""
        return np.column_stack([self.u, self.others])

    @property
    def samples(self) -> int:
        """Readings that count."""
        return int(np.isfinite(self.y).sum())

    def seconds(self, first_s: float, last_s: float) -> Stretch:
        """The nodes within these times."""
        a, b = np.searchsorted(self.t, [first_s - 1e-9, last_s + 1e-9])
        held, u, others = slice(a, max(b - 1, a)), self.u, self.others
        u, others, unresolved, nodes = u[held], others[held], self.unresolved[held], slice(a, b)
        y, scatter, every = self.y[nodes], self.scatter[nodes], self.every[nodes]
        return replace(
            self, u=u, others=others, t=self.t[nodes], y=y, scatter=scatter, every=every, unresolved=unresolved
        )

    def unevenly_sampled(self, channel: str, jitter_s: float, sigma: float) -> Stretch:
        """The same with a channel whose instants are uneven: s^2 = sigma^2 + (jitter rate)^2."""
        column = list(self.plant.channels).index(channel)
        if not jitter_s > 0.0 or np.isfinite(self.y[:, column]).sum() < PARABOLA:
            return self
        rate = _parabolas(self.t, self.y[:, column])[1]
        scatter = self.scatter.copy()
        scatter[:, column] = np.sqrt(1.0 + (jitter_s * rate / sigma) ** 2)
        return replace(self, scatter=scatter)

    def without(self, rows: NDArray[np.bool_], channels: Sequence[str] | None = None) -> Stretch:
        """The same with some readings set aside."""
        y, every = self.y.copy(), self.every.copy()
        for channel in channels or self.plant.channels:
            column = list(self.plant.channels).index(channel)
            y[rows, column] = every[rows, column] = np.nan
        return replace(self, y=y, every=every)


def is_long_enough(stretch: Stretch) -> bool:
    """Whether it says anything beyond its own start."""
    plant = stretch.plant
    shortest = min(SHORTEST_S * motion_scale(plant), fewest_readings(plant) // 2 * plant.time_scale_s)
    return len(stretch.t) > 1 and bool(stretch.t[-1] - stretch.t[0] >= shortest)


def fewest_readings(plant: Plant) -> int:
    """Fewer readings than these are no recording to judge a model by: those of a second, where samples are rare."""
    return min(FEWEST_READINGS, max(LEAST_READINGS, round(1.0 / plant.time_scale_s)))


def stretch_of(
    recording: str,
    plant: Plant,
    t: Array,
    u: Array,
    readings: Mapping[str, tuple[NDArray[np.int_], Array]],
    unresolved: Array | None = None,
) -> Stretch:
    """From nodes t (n,), inputs held between them (n-1,) or (n-1, inputs), (nodes, values) of every channel, and what
    is not known of the inputs (n-1, inputs, 2)."""
    cut = _cut(t, longest_node_s(plant))
    where = np.searchsorted(cut, t)
    y = np.full((len(cut), len(plant.channels)), np.nan)
    for column, channel in enumerate(plant.channels):
        if channel in readings:
            nodes, values = readings[channel]
            y[where[nodes], column] = values
    before = np.clip(np.searchsorted(t, cut[:-1], side="right") - 1, 0, len(u) - 1)
    held = u[before]
    first, others = (held, np.zeros((len(held), 0))) if held.ndim == 1 else (held[:, 0], held[:, 1:])
    open_inputs = np.zeros((0, 0, 2))
    if unresolved is not None:
        open_inputs = unresolved_in_parts(unresolved[before], np.diff(cut) / np.diff(t)[before])
    return Stretch(recording, plant, cut, first, y, others=others, unresolved=open_inputs)


def longest_node_s(plant: Plant) -> float:
    """From node to node: as the motion is slow, but no more than so many usual samples, nor less than one."""
    sample = time_scale(plant)
    return LONGEST_STEP_S * max(sample, min(motion_scale(plant), MOST_SAMPLES * sample))


def read_too_rarely(t: Array, plant: Plant) -> str:
    """Why rows at these times (n,) s are no recording of a plant, which would have to be followed over a hundred steps
    from one to the next; empty where they may be one."""
    apart, step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0, longest_node_s(plant)
    if apart <= RAREST * step:
        return ""
    return (
        f"rows are {apart:.3g} s apart, and {plant.name} is followed in steps of {step:.3g} s: are the times in "
        "seconds (--columns t=NAME:ms)? A plant that is as slow says so (sample_time_s)"
    )


def _cut(t: Array, longest_s: float) -> Array:
    """Nodes added where two are further apart than a step may be."""
    pieces = np.maximum(1, np.ceil(np.diff(t) / longest_s - 1e-6)).astype(int)
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(t[:-1], t[1:], pieces, strict=True)]
    return np.concatenate([*parts, t[-1:]])


# ---------------------------------------------------------------------------------------------- held torques


class Held:
    """The inputs held between the nodes of a stretch, in the parts of its steps and on the way to its readings.

    What says torque is the first input's, which alone may be late; `others` (n-1, inputs - 1) act at once.
    """

    def __init__(self, t: Array, u: Array, others: Array | None = None, slew: float = inf) -> None:
        self.t, self.u = t, u
        self.others = np.zeros((len(u), 0)) if others is None else others
        self._begins = _begins(t, u, slew)

    @classmethod
    def of(cls, stretch: Stretch) -> Held:
        """Of all inputs of a stretch."""
        return cls(stretch.t, stretch.u, stretch.others, stretch.slew)

    def inputs(self, count: int, delay: float = 0.0) -> Array:
        """(count, n-1, inputs) what `substeps` says of every input."""
        others = np.broadcast_to(self.others, (count, *self.others.shape))
        return np.concatenate([self.substeps(count, delay)[:, :, None], others], axis=2)

    def inputs_back(self, late: Sequence[float], delay: float = 0.0) -> Array:
        """(BACK_STEPS inputs, channels, n) what `back` says of every input, side by side in each step."""
        every = [self.back(late, delay), *(Held(self.t, one).back(late) for one in self.others.T)]
        return np.stack(every, axis=1).reshape(-1, *every[0].shape[1:])

    def at(self, when: Array) -> Array:
        """Just after these instants."""
        return self.u[np.clip(np.searchsorted(self._begins, when + 1e-12, side="right") - 1, 0, len(self.u) - 1)]

    def substeps(self, count: int, delay: float = 0.0) -> Array:
        """(count, n-1) mean torque in each part of each step, `delay` seconds late."""
        if delay == 0.0 and self._begins is self.t:
            return np.tile(self.u, (count, 1))  # a part lies within its hold
        edges = self.t[:-1, None] + np.diff(self.t)[:, None] * np.arange(count + 1) / count
        return mean_torque(edges, self._begins, self.u, delay).T

    def substeps_by_delay(self, count: int, delay: float) -> Array:
        """Derivative of `substeps` by the delay."""
        h = np.diff(self.t)
        starts = self.t[:-1] + np.arange(count)[:, None] * h / count - delay
        length = np.broadcast_to(np.maximum(h / count, 1e-9), starts.shape)
        slope: Array = -(self.at(starts + length) - self.at(starts)) / length
        return slope

    def back(self, late: Sequence[float], delay: float = 0.0) -> Array:
        """(BACK_STEPS, channels, n) mean torque on the way to `late` seconds ago, youngest first."""
        ways = {d: self._way(d, delay) for d in set(late)}
        return np.stack([ways[d] for d in late], axis=1)

    def _way(self, late: float, delay: float) -> Array:
        """(BACK_STEPS, n) of one channel; of a way of no length the torque at its end."""
        if late == delay == 0.0:
            return np.broadcast_to(np.append(self.u, self.u[-1:]), (BACK_STEPS, len(self.t)))
        steps = BACK_STEPS if late > 0.0 else 1
        edges = self.t[:, None] - np.arange(steps, -1, -1) * late / steps
        found = mean_torque(edges, self._begins, self.u, delay).T[::-1]
        return np.broadcast_to(found, (BACK_STEPS, len(self.t)))


def _begins(t: Array, u: Array, slew: float) -> Array:
    """When a held input begins to act (n,): a drive that takes steps or a ramp to it is as late as half the ramp.

    The board's torque loop takes the first step at once and the last one a period before a ramp would end.
    """
    ramp_s = np.abs(np.diff(u)) / slew
    late = np.minimum(np.maximum(ramp_s - LOOP_S, 0.0), np.diff(t)[1:]) / 2.0
    if not late.any():
        return t
    begins = t.copy()
    begins[1:-1] += late
    return begins


# ---------------------------------------------------------------------------------------------- first idea


def first_states(stretch: Stretch) -> Array:
    """(n, nx) positions, rates and what stores hold by local parabolas through the readings; no model. A store that no
    channel reads as it is begins empty."""
    plant, t = stretch.plant, stretch.t
    x = np.zeros((len(t), len(plant.states)))
    for i, q in enumerate(plant.coordinates):
        column = _reading(stretch, q)
        if column is not None:
            x[:, 2 * i], x[:, 2 * i + 1] = _parabolas(t, column)
            continue
        rate = _reading(stretch, f"d{q}")
        if rate is not None:
            x[:, 2 * i + 1] = _parabolas(t, rate)[0]
            x[:, 2 * i] = np.concatenate([[0.0], np.cumsum(x[:-1, 2 * i + 1] * np.diff(t))])
    for i, name in enumerate(plant.first_order, start=2 * len(plant.coordinates)):
        column = _reading(stretch, name)
        if column is not None:
            seen = np.flatnonzero(np.isfinite(column))
            x[:, i] = _parabolas(t, column)[0]
            # before the first reading and after the last a parabola leads anywhere
            x[: seen[0], i], x[seen[-1] + 1 :, i] = x[seen[0], i], x[seen[-1], i]
    return x


def _reading(stretch: Stretch, state: str) -> Array | None:
    for column, read in enumerate(stretch.plant.states_read):
        if read == state and np.isfinite(stretch.every[:, column]).sum() >= PARABOLA:
            return stretch.every[:, column]
    return None


def _parabolas(t: Array, y: Array) -> tuple[Array, Array]:
    """Value and slope at every node of the parabola through the nearest samples."""
    seen = np.isfinite(y)
    ts, ys = t[seen], y[seen]
    first = np.clip(np.searchsorted(ts, t) - PARABOLA // 2, 0, len(ts) - PARABOLA)
    rows = first[:, None] + np.arange(PARABOLA)
    dt = ts[rows] - t[:, None]
    basis = np.stack([np.ones_like(dt), dt, dt**2], axis=-1)
    normal = np.einsum("nki,nkj->nij", basis, basis)
    right = np.einsum("nki,nk->ni", basis, ys[rows])
    found = np.linalg.solve(normal, right[..., None])[..., 0]
    return found[:, 0], found[:, 1]
