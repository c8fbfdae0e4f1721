"""The whitened columns of mechanisms about one fit, hundreds in a call.

A mechanism's variable, and what it remembers of it, follow the smoothed trajectory. Its force at points inside the
steps goes through the model's own derivatives and the fit's own filter like every change (`effect_changes`); what both
make of a place where mechanisms act is one matrix for each block of nodes (`whitening_blocks`), the same for all of
them, so that a column costs no more than its own values.

Rules of this file: columns only; laws come from the grammar.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from hoopd.diagnose.search.effect_changes import GAUSS, Inside, at_nodes, changes_of
from hoopd.plants.effects.base import Point
from hoopd.plants.effects.grammar.axes import Axis
from hoopd.plants.effects.grammar.mechanism import READING, Mechanism
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import Gains
from hoopd.plants.likelihood.recording_parameters import values_of
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.whitening_blocks import BLOCK

Array = NDArray[np.float64]

# Parts of a step in which a force is sampled, two points in each.
PARTS = 2
# How a column is put in: the reading's error at the nodes, a force at the points inside the steps, or one at the nodes
# that is a straight line between them.
ERRORS, POINTS, LINES = "errors", "points", "lines"


@dataclass(frozen=True)
class MechanismChoice:
    """A mechanism at constants of its grid."""

    mechanism: Mechanism
    constants: dict[str, float]
    phases: int = 1  # two where it has a phase
    parts: int = 1  # recordings, where each has a phase of its own
    means: int = 0  # one where what has a phase has a mean, which all recordings share

    @property
    def columns(self) -> int:
        """Of all recordings."""
        return self.phases * self.parts + self.means

    @property
    def in_one(self) -> int:
        """Columns that a recording sees."""
        return self.phases + self.means

    def within(self, part: int) -> NDArray[np.intp]:
        """Which of its columns one of the recordings sees."""
        own = part * self.phases + np.arange(self.phases)
        return np.append(own, np.full(self.means, self.phases * self.parts))


class ColumnPlace(NamedTuple):
    """Where and how columns are put in: equal for all that share a matrix."""

    form: str
    on: tuple[tuple[str, float], ...]


def place_of(mechanism: Mechanism) -> ColumnPlace:
    """Of a mechanism."""
    if mechanism.site.acts == READING:
        form = ERRORS
    else:
        is_line = mechanism.memory is not None and not (mechanism.memory.held or mechanism.factor or mechanism.dry)
        form = LINES if is_line else POINTS
    return ColumnPlace(form, tuple(mechanism.site.on.items()))


class FollowedTrack:
    """A track with what mechanisms read along it, and what places make of what is put in."""

    def __init__(self, track: Track, fit: HypothesisFit, gains: Gains) -> None:
        self.track = track
        self._blocks = gains.blocks
        self._nodes = at_nodes(track, fit)
        inside = changes_of(track, fit).inside(PARTS)
        self._points = _point_of(track, fit, inside)
        # (points,) how far each is into its step
        self._share, self._inside = (np.arange(PARTS)[:, None] + GAUSS).ravel() / PARTS, inside
        self._by: dict[ColumnPlace, Array] = {}
        self._read: dict[tuple[Any, bool], Array] = {}
        self._remembered: dict[tuple[Any, ...], Array] = {}

    def nodes(self, axis: Axis) -> Array:
        """(n,) a variable at the nodes."""
        found = self._along(axis, nodes=True)
        return np.broadcast_to(found, (len(self.track.z),))

    def _along(self, axis: Axis, *, nodes: bool) -> Array:
        key = axis.of, nodes
        if key not in self._read:
            self._read[key] = np.asarray(axis.of(self._nodes if nodes else self._points), dtype=float)
        return self._read[key]

    def way(self, axis: Axis) -> Array:
        """(n,) what a memory of the axis goes by, at the nodes."""
        if axis.way is None:
            return self.nodes(axis)
        return np.broadcast_to(np.asarray(axis.way(self._nodes), dtype=float), (len(self.track.z),))

    def rows(self, place: ColumnPlace, choices: Sequence[MechanismChoice]) -> Array:
        """(m, n nc) whitened columns of choices that act at one place, choice after choice and phase after phase, each
        a row."""
        if place not in self._by:
            self._by[place] = np.ascontiguousarray(self._matrix(place).transpose(0, 2, 1))
        by, count = self._by[place], len(self._blocks.begin)
        own = {ERRORS: BLOCK, POINTS: BLOCK * len(self._share), LINES: BLOCK}[place.form]
        # of a line, the last node of a block is the next one's first
        inputs = np.zeros((sum(one.in_one for one in choices), count * own + 1))
        first = 0
        for one in choices:
            for values in self._values(one, place.form):
                inputs[first, : values.size] = values.ravel()
                first += 1
        step, wide = inputs.strides
        shape, strides = (count, len(inputs), by.shape[1]), (own * wide, step, wide)
        return self._blocks.rows(as_strided(inputs, shape, strides, writeable=False), by)

    def _values(self, one: MechanismChoice, form: str) -> list[Array]:
        """Of each of a choice's columns at the points inside the steps (n-1, points), or at the nodes (n,)."""
        mechanism, nodes = one.mechanism, form != POINTS
        axis, t = mechanism.axis, self.track.stretch.t
        if mechanism.memory is not None:
            law = self._memory(mechanism, one.constants)
            onward = 0.0 if mechanism.memory.held else np.diff(law)[:, None]
            laws = [law if nodes else law[:-1, None] + self._share * onward]
        else:
            v = self._along(axis, nodes=nodes)
            own = values_of(self.track.stretch.recording, one.constants)
            at = [{**own, "phi": phi} for phi in (0.0, np.pi / 2)] if one.phases == 2 else [own]
            laws = [mechanism.screened(v, t, constants) for constants in at]
            laws += [np.ones_like(laws[0])] * one.means
        if mechanism.factor is not None:
            laws = [law * self._along(mechanism.factor, nodes=nodes) for law in laws]
        if mechanism.dry is not None:
            laws = [law * mechanism.side_of(self._along(mechanism.dry, nodes=nodes)) for law in laws]
        n = len(self.track.z)
        shape = (n,) if nodes else (n - 1, len(self._share))
        return [np.broadcast_to(mechanism.sign * law, shape) for law in laws]

    def _memory(self, mechanism: Mechanism, constants: Mapping[str, float]) -> Array:
        """(n,) what is remembered at the nodes: the same wherever it acts."""
        axis, memory = mechanism.axis, mechanism.memory
        assert memory is not None
        key = axis.of, axis.way, memory.name, mechanism.dry is None, *constants.items()
        if key not in self._remembered:
            t = self.track.stretch.t
            self._remembered[key] = mechanism.along(self.nodes(axis), self.way(axis), t, constants)
        return self._remembered[key]

    # ------------------------------------------------------------------------------------------ what places do

    def _matrix(self, place: ColumnPlace) -> Array:
        """(blocks, B nc + size, k) what is put in at a place does to the residual and to the deviation."""
        # what is added to the model is taken from the residual, and innovations lose what the readings gain
        if place.form == ERRORS:
            channels = self.track.composite.channels
            weights = np.array([dict(place.on).get(name, 0.0) for name in channels])
            return np.asarray(self._blocks.reading @ weights)
        count, push = len(self._blocks.begin), self._pushed(place)
        if place.form == POINTS:
            found = -self._blocks.step.transpose(0, 2, 1, 3) @ push
            return np.ascontiguousarray(found.transpose(0, 2, 1, 3)).reshape(count, found.shape[2], -1)
        early, late = push @ (1.0 - self._share), push @ self._share
        out = np.zeros((count, self._blocks.step.shape[1], BLOCK + 1))
        for j in range(BLOCK):
            out[:, :, j] -= (self._blocks.step[:, :, j] @ early[:, j, :, None])[:, :, 0]
            out[:, :, j + 1] -= (self._blocks.step[:, :, j] @ late[:, j, :, None])[:, :, 0]
        return out

    def _pushed(self, place: ColumnPlace) -> Array:
        """(blocks, B, nz, points) one-step map by the place's force, or by the first input, at each point."""
        plant, push, pull = self.track.stretch.plant, self._inside.push, self._inside.pull
        found = np.zeros((len(self._blocks.begin) * BLOCK, *pull.shape[1:]))
        for name, weight in place.on:
            if name in plant.disturbed:
                found[: len(push)] += weight * push[:, :, plant.disturbed.index(name)]
            elif plant.inputs and name == plant.inputs[0].name:
                found[: len(pull)] += weight * pull
        return found.reshape(-1, BLOCK, *found.shape[1:])


def _point_of(track: Track, fit: HypothesisFit, inside: Inside) -> Point:
    """Everything a variable may read at the points inside the steps, arrays (n-1, points)."""
    u = inside.u if len(track.stretch.plant.inputs) > 1 else inside.u[0]
    return track.stretch.plant.point(np.moveaxis(inside.x, 2, 0), track.local(fit.values), u, inside.t)
