"""What every mechanism of the grammar would explain of what a fit leaves: some thousand columns, none of them refitted.

A mechanism's variable, and what it remembers of it, follow the smoothed trajectory: the memory is a further axis, on a
grid of its constants. Its force at points inside the steps goes through the model's own derivatives and the fit's own
filter like every change (`screen`), in blocks, and only what a score needs is kept. What white noise would make of the
same columns is drawn beside them, so that the largest of thousands has its own level.

Rules of this file: it proposes, a fit decides; laws come from the grammar.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import atan2, hypot

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.chance import EULER, Null, colour, independent
from hoopd.diagnose.search.effect_changes import GAUSS, Inside, at_nodes, changes_of
from hoopd.diagnose.search.screen import orthonormal
from hoopd.diagnose.search.surprise import log_chances, surprise
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.effects.grammar.mechanism import READING, Mechanism
from hoopd.plants.effects.grammar.mechanisms import code_nats
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import whitened
from hoopd.plants.likelihood.reference_track import Track

Array = NDArray[np.float64]

# Parts of a step in which a force is sampled, two points in each.
PARTS = 2
# Columns that are whitened at once.
AT_ONCE = 256
DRAWS, DRAW_SEED = 64, 17
# Of a direction's squared length, what must be its own, not the free parameters'.
OWN_SHARE = 0.01
# The residual's colour is asked for the best so many only.
COLOURED = 40


@dataclass(frozen=True)
class ProposedMechanism:
    """A mechanism at its best constants beside a fit."""

    mechanism: Mechanism
    constants: dict[str, float]
    gain: float  # nats
    columns: int
    looked_at: int  # choices of its constants
    surprise: float  # nats, told the colour of the residual and how much was looked at; its cost is not taken off
    start: dict[str, float]  # by the whole model's names
    vector: Array  # (rows,) the change it would make, whitened and projected

    @property
    def effect(self) -> Effect:
        """As an effect."""
        return self.mechanism.effect


@dataclass(frozen=True)
class _Choice:
    mechanism: Mechanism
    constants: dict[str, float]
    columns: int


class MechanismScreen:
    """The whitened changes of a grammar about one fit, reduced to scores."""

    def __init__(self, fit: HypothesisFit, wanted: Sequence[Mechanism]) -> None:
        self.fit = fit
        rows = fit.stacked()
        self._basis = orthonormal(rows[:, 1:])
        self.residual = self._projected(rows[:, :1])[:, 0]
        self._tracks = [_Followed(track, fit) for track in fit.tracks]
        self._choices = [one for mechanism in wanted for one in self._tried(mechanism)]
        self.cost = code_nats(len(wanted))
        self._score()

    # ------------------------------------------------------------------------------------------ what is tried

    def _tried(self, mechanism: Mechanism) -> Iterator[_Choice]:
        own = [one for one in self._tracks if mechanism.effect.fits(one.track.stretch.plant)]
        if not own:
            return
        v = np.concatenate([one.nodes(mechanism.axis.of) for one in own])
        if not np.all(np.isfinite(v)) or np.ptp(v) <= 1e-9 * max(float(np.abs(v).max()), 1e-300):
            return
        way = v if mechanism.axis.way is None else np.concatenate([one.nodes(mechanism.axis.way) for one in own])
        t = _joined_times(own)
        phased = mechanism.shape is not None and mechanism.shape.phased
        for constants in mechanism.grid(v if mechanism.memory is None else way, t):
            yield _Choice(mechanism, constants, 2 if phased else 1)

    # ------------------------------------------------------------------------------------------ scores

    def _score(self) -> None:
        noise = np.random.default_rng(DRAW_SEED).standard_normal((len(self.residual), DRAWS))
        beside = np.column_stack([self.residual, self._projected(noise)])
        self._gains = np.zeros(len(self._choices))
        best = np.zeros(DRAWS)
        first = 0
        while first < len(self._choices):
            block = self._block(first)
            raw, ranges = self._raw(block)
            along, shared, size = raw.T @ beside, raw.T @ self._basis, np.einsum("ij,ij->j", raw, raw)
            for count in {one.columns for one in block}:
                mine = [i for i, one in enumerate(block) if one.columns == count]
                at = np.array([ranges[i].start for i in mine])[:, None] + np.arange(count)
                gram = np.einsum("kin,kjn->kij", shared[at], -shared[at])
                gram[:, range(count), range(count)] += size[at]
                if count == 2:
                    both = np.einsum("ij,ij->j", raw[:, at[:, 0]], raw[:, at[:, 1]])
                    gram[:, 0, 1] += both
                    gram[:, 1, 0] += both
                gains = _gains(gram, size[at], along[at])
                self._gains[[first + i for i in mine]] = gains[:, 0]
                best = np.minimum(best, log_chances(gains[:, 1:].max(axis=0), count))
            first += len(block)
        self.null = Null(max(1.0, float(np.exp(-np.mean(best) - EULER))))

    def _block(self, first: int) -> list[_Choice]:
        found: list[_Choice] = []
        columns = 0
        for one in self._choices[first:]:
            columns += one.columns
            if found and columns > AT_ONCE:
                break
            found.append(one)
        return found

    def _raw(self, block: Sequence[_Choice]) -> tuple[Array, list[slice]]:
        """(rows, m) whitened columns of some choices, and which are whose."""
        ends = np.cumsum([one.columns for one in block])
        ranges = [slice(int(end) - one.columns, int(end)) for one, end in zip(block, ends, strict=True)]
        parts = []
        for own, columns, gains in zip(self._tracks, self.fit.columns, self.fit.gains, strict=True):
            f, eps = own.changes(block, ranges, int(ends[-1]))
            white = whitened(columns.model, gains, f, eps)
            # what is added to the model is taken from the residual
            parts.append(-white.reshape(-1, white.shape[2]))
        return np.concatenate(parts), ranges

    def _projected(self, x: Array) -> Array:
        return np.asarray(x - self._basis @ (self._basis.T @ x))

    def proposals(self, least: float = 0.0) -> list[ProposedMechanism]:
        """The best of each mechanism, most surprising first; those above `least` nats of gain."""
        order: dict[str, int] = {}
        counts: dict[str, int] = {}
        for i in np.argsort(-self._gains, kind="stable"):
            name = self._choices[i].mechanism.name
            counts[name] = counts.get(name, 0) + 1
            if self._gains[i] > least:
                order.setdefault(name, int(i))
        chosen = [*order.values()][:COLOURED]
        found = [self._proposal(i, counts[self._choices[i].mechanism.name]) for i in chosen]
        return sorted(found, key=lambda one: -(one.surprise - one.effect.cost_nats))

    def _proposal(self, index: int, looked_at: int) -> ProposedMechanism:
        choice = self._choices[index]
        raw, _ = self._raw([choice])
        z = self._projected(raw)
        size, values, vectors = independent(z, np.sqrt(np.sum(raw**2, axis=0)), OWN_SHARE)
        basis = vectors / np.sqrt(np.maximum(values, 1e-300)) / size[:, None]
        unit = z @ basis
        weights = basis @ (unit.T @ self.residual)
        gain = float(self._gains[index])
        shapes = [(len(t.z), len(t.composite.channels)) for t in self.fit.tracks]
        inflated = colour(unit, self.residual, shapes) if unit.shape[1] else 1.0
        beyond = surprise(gain / inflated, choice.columns, looked_at)
        return ProposedMechanism(
            choice.mechanism, choice.constants, gain, choice.columns, looked_at, beyond, _start(choice, weights),
            z @ weights,
        )  # fmt: skip


def _gains(gram: Array, square: Array, along: Array) -> Array:
    """(k, 1+draws) of columns with these products among themselves (k, m, m), freed of the free parameters' part, their
    squared lengths before (k, m) and their products with the rows (k, m, 1+draws)."""
    size = np.sqrt(np.maximum(square, 1e-24))
    values, vectors = np.linalg.eigh(gram / size[:, :, None] / size[:, None, :])
    kept = values > OWN_SHARE
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    turned = np.swapaxes(vectors, 1, 2) @ (along / size[:, :, None])
    return np.asarray(np.sum(inverse[:, :, None] * turned**2, axis=1) / 2.0)


def _start(choice: _Choice, weights: Array) -> dict[str, float]:
    effect = choice.mechanism.effect
    found = {effect.key(name): value for name, value in choice.constants.items()}
    if choice.columns == 2:
        return found | {
            effect.key("A"): hypot(*weights),
            effect.key("phi"): atan2(float(weights[1]), float(weights[0])),
        }
    a = effect.parameter("A")
    return found | {effect.key("A"): float(np.clip(weights[0], a.low, a.high))}


def _joined_times(own: Sequence[_Followed]) -> Array:
    """Times that run on from stretch to stretch, from zero; grids of constants ask for differences only."""
    parts, end = [], 0.0
    for one in own:
        t = one.track.stretch.t
        parts.append(end + t - t[0])
        end = float(parts[-1][-1])
    return np.concatenate(parts)


class _Followed:
    """A track with what mechanisms read along it."""

    def __init__(self, track: Track, fit: HypothesisFit) -> None:
        self.track, self.fit = track, fit
        self._nodes = at_nodes(track, fit)
        inside = changes_of(track, fit).inside(PARTS)
        self._points = _point_of(track, fit, inside)
        # (n-1, points) how far each point is into its step
        share = (np.arange(PARTS)[:, None] + GAUSS).ravel() / PARTS
        self._share, self._push = share[None, :], inside.push

    def nodes(self, of: object) -> Array:
        """(n,) a variable at the nodes."""
        found = of(self._nodes)  # type: ignore[operator]
        return np.broadcast_to(np.asarray(found, dtype=float), (len(self.track.z),))

    def _values(self, one: _Choice) -> list[Array]:
        """Of each of a choice's columns at the points inside the steps (n-1, points), or at the nodes (n,)."""
        mechanism, reading = one.mechanism, one.mechanism.site.acts == READING
        where = self._nodes if reading else self._points
        if mechanism.memory is not None:
            v = self.nodes(mechanism.axis.of)
            way = v if mechanism.axis.way is None else self.nodes(mechanism.axis.way)
            law = mechanism.along(v, way, self.track.stretch.t, one.constants)
            laws = [law if reading else law[:-1, None] + self._share * np.diff(law)[:, None]]
        else:
            v = np.asarray(mechanism.axis.of(where), dtype=float)
            at = [{**one.constants, "phi": phi} for phi in (0.0, np.pi / 2)] if one.columns == 2 else [one.constants]
            laws = [mechanism.along(v, v, self.track.stretch.t, constants) for constants in at]
        if mechanism.factor is not None:
            factor = np.asarray(mechanism.factor.of(where), dtype=float)
            laws = [law * factor for law in laws]
        if mechanism.dry is not None:
            laws = [law * np.sign(np.asarray(mechanism.dry.of(where), dtype=float)) for law in laws]
        return [mechanism.sign * law for law in laws]

    def changes(self, block: Sequence[_Choice], ranges: Sequence[slice], count: int) -> tuple[Array, Array]:
        """Changes of the one-step map (n-1, nz, m) and of the innovations (n, nc, m)."""
        c, n = self.track.composite, len(self.track.z)
        f, eps = np.zeros((n - 1, c.nz, count)), np.zeros((n, len(c.channels), count))
        pushed: dict[int, list[tuple[int, float, Array]]] = {}
        for one, columns in zip(block, ranges, strict=True):
            if not one.mechanism.effect.fits(self.track.stretch.plant):
                continue
            for column, value in zip(range(columns.start, columns.stop), self._values(one), strict=True):
                for name, weight in one.mechanism.site.on.items():
                    if one.mechanism.site.acts == READING:
                        if name in c.channels:
                            # innovations lose what the readings gain
                            eps[:, c.channels.index(name), column] -= weight * value
                    elif name in self.track.stretch.plant.disturbed:
                        place = self.track.stretch.plant.disturbed.index(name)
                        pushed.setdefault(place, []).append((column, weight, value))
        for q, parts in pushed.items():
            forces = np.stack([weight * np.broadcast_to(value, self._push.shape[::3]) for _, weight, value in parts], 2)
            f[:, :, [column for column, _, _ in parts]] += self._push[:, :, q] @ forces
        return f, eps


def _point_of(track: Track, fit: HypothesisFit, inside: Inside) -> Point:
    """Everything a variable may read at the points inside the steps, arrays (n-1, points)."""
    u = inside.u if len(track.stretch.plant.inputs) > 1 else inside.u[0]
    return track.stretch.plant.point(np.moveaxis(inside.x, 2, 0), track.local(fit.values), u, inside.t)
