"""What every effect of a library would explain of what a fit leaves: gains in log-likelihood, none of them refitted.

An effect changes the one-step map and the readings along the smoothed trajectory; whitened by the fit's own filter and
freed of the directions of all free parameters, these changes are the columns of an ordinary regression of the whitened
innovations, whose gain for any set of columns is r'Z (Z'Z)^-1 Z'r / 2 nats (score tests; Rao 1948).

Rules of this file: a screen proposes, a fit decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby, product
from math import atan2, hypot

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from hoopd.diagnose.search.effect_changes import changes_of
from hoopd.diagnose.search.kept_columns import KeptColumns, exact, free_of, joined, kept_columns
from hoopd.diagnose.search.processes import computed
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import whitened
from hoopd.plants.likelihood.reference_track import Track

Array = NDArray[np.float64]

# A change tried at one value of a parameter that is not proportional may be stretched by up to this.
MOST_STRETCH = 1.5
# Changes that one task whitens.
TOGETHER = 48
# A change of so many standard deviations is nothing but the growth of what a model makes unstable.
MOST_DEVIATIONS = 1e12
# A limit is tried where it cuts off these shares of the samples.
TOUCHED = (0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.12, 0.2, 0.3, 0.45, 0.6, 0.8)


@dataclass(frozen=True)
class Column:
    """One change: an effect at values of its parameters, in some recordings."""

    values: tuple[tuple[str, float], ...]  # by the effect's own names
    recording: str | None = None  # None: in all
    signed: bool = False  # only a positive multiple counts
    most: float = np.inf  # largest multiple


@dataclass(frozen=True)
class Member:
    """An effect at one choice of its shape parameters: the columns that its amplitudes and phases span."""

    effect: Effect
    shape: dict[str, float]
    columns: tuple[Column, ...]


@dataclass(frozen=True)
class Score:
    """What a member would gain, and where a fit should start."""

    member: Member
    gain: float  # nats
    start: dict[str, float]  # by the whole model's names
    vector: Array  # (rows,) the change it would make, whitened and projected
    origin: HypothesisFit | None = None  # the fit about which it was screened


def members_of(
    effect: Effect, recordings: Sequence[str], grids: Mapping[str, Sequence[float]] | None = None
) -> list[Member]:
    """All choices of the shape parameters' grids; `grids`: others, by the parameter's name."""
    grids = grids or {}
    shapes = [p for p in effect.parameters if p.role == "shape"]
    amplitudes = [p for p in effect.parameters if p.role == "amplitude"]
    phases = [p for p in effect.parameters if p.role == "phase"]
    found = []
    for values in product(*(grids.get(p.name) or p.grid or (p.neutral,) for p in shapes)):
        shape = {p.name: float(v) for p, v in zip(shapes, values, strict=True)}
        found.append(Member(effect, shape, _columns(shape, amplitudes, phases, recordings)))
    return found


def touched_grids(effect: Effect, fit: HypothesisFit) -> dict[str, list[float]]:
    """For limits: values that shares TOUCHED of the samples reach."""
    limits = {p.name: p for p in effect.parameters if p.touched is not None}
    tracks = [track for track in fit.tracks if effect.slot in track.stretch.plant.slots]
    return {name: _touched(p, fit, tracks) for name, p in limits.items()} if tracks else {}


def _touched(parameter: EffectParameter, fit: HypothesisFit, tracks: Sequence[Track]) -> list[float]:
    parts = []
    for track in tracks:
        plant, values = track.stretch.plant, track.local(fit.values)
        x, u = ca.SX.sym("x", len(plant.states)), ca.SX.sym("u", max(1, len(plant.inputs)))
        assert parameter.touched is not None
        function = ca.Function("touched", [x, u], [parameter.touched(plant.point(x, values, u))])
        demand = track.inputs(values).mean(axis=0).T
        parts.append(function(track.filtered[:-1, : len(plant.states)].T, demand).full().ravel())
    found = np.quantile(np.concatenate(parts), 1.0 - np.array(TOUCHED))
    return sorted({float(v) for v in found if parameter.low < v < parameter.high})


def _columns(
    shape: Mapping[str, float],
    amplitudes: Sequence[EffectParameter],
    phases: Sequence[EffectParameter],
    recordings: Sequence[str],
) -> tuple[Column, ...]:
    fixed = tuple(shape.items())
    if not amplitudes:
        return (Column(fixed, signed=True, most=MOST_STRETCH),)
    if phases:
        # A sin(x + phi) = a sin x + b cos x
        own = recordings if phases[0].per_recording else (None,)
        a, phi = amplitudes[0], phases[0].name
        at = ((a.name, a.neutral + a.size),)
        return tuple(Column((*fixed, *at, (phi, value)), r) for r in own for value in (0.0, np.pi / 2))
    return tuple(
        Column((*fixed, (a.name, a.neutral + a.size)), None, a.low >= a.neutral, (a.high - a.neutral) / a.size)
        for a in amplitudes
    )


class Screen:
    """The whitened changes of a library about one fit."""

    def __init__(self, fit: HypothesisFit, effects: Sequence[Effect]) -> None:
        self.fit = fit
        self.recordings = fit.recordings
        rows = fit.stacked()
        if not np.isfinite(rows).all():
            # a hypothesis without numbers (there is no such plant) leaves nothing that an effect could explain
            rows = np.zeros_like(rows)
        self._basis = orthonormal(rows[:, 1:])
        self.residual = self.projected(rows[:, :1])[:, 0]
        wanted = [e for e in effects if e.name not in fit.names and e.found_by in ("screen",)]
        self.members = [m for e in wanted for m in members_of(e, self.recordings, touched_grids(e, fit))]
        every = [(m.effect, column) for m in self.members for column in m.columns]
        parts = computed([partial(_kept_together, fit, part, self._basis) for part in _parts(every)])
        self.vectors = joined(parts, len(rows))
        self._places = {(effect.name, column): i for i, (effect, column) in enumerate(every)}

    def whitened(self, changes: Sequence[tuple[Effect, Column]]) -> Array:
        """(rows, m) whitened projected changes; those of the screen's members are there already."""
        places = [self._places.get((effect.name, column), -1) for effect, column in changes]
        if -1 not in places:
            return exact(self.vectors[:, places])
        return self.projected(whitened_changes(self.fit, changes))

    def scores(self) -> list[Score]:
        """Best member of every effect, largest gain first."""
        return sorted(best_scores(self.members, self.vectors, self.residual), key=lambda one: -one.gain)

    def projected(self, x: Array) -> Array:
        """(rows, m) without the directions of the free parameters."""
        return free_of(self._basis, x.copy())


def changed(track: Track, fit: HypothesisFit, changes: Sequence[tuple[Effect, Column]]) -> tuple[Array, Array]:
    """Changes of the one-step map (n-1, nz, m) and of the innovations (n, nc, m) of a track that they all touch."""
    n, c, first = len(track.z), track.composite, 0
    f, eps = np.zeros((n - 1, c.nz, len(changes))), np.zeros((n, len(c.channels), len(changes)))
    for _, group in groupby(changes, key=lambda one: one[0].name):
        same = list(group)
        part = slice(first, first + len(same))
        f[:, :, part], eps[:, :, part] = changes_of(track, fit).of(same[0][0], [column.values for _, column in same])
        first += len(same)
    return f, eps


def change_of(track: Track, fit: HypothesisFit, effect: Effect, column: Column) -> tuple[Array, Array]:
    """Change of the one-step map (n-1, nz), and of the innovations (n, nc), along a reference."""
    values = [column.values] if column.recording in (None, track.stretch.recording) else []
    f, eps = changes_of(track, fit).of(effect, values)
    return f.sum(axis=2), eps.sum(axis=2)


def best_scores(members: Sequence[Member], vectors: KeptColumns, residual: Array) -> list[Score]:
    """Of every effect its best member; `vectors` (rows, m): the columns of all members, one after the other."""
    squares, along = np.empty(vectors.shape[1]), np.empty(vectors.shape[1])
    for first in range(0, vectors.shape[1], TOGETHER):
        some = slice(first, first + TOGETHER)
        z = exact(vectors[:, some])
        squares[some], along[some] = np.einsum("rm,rm->m", z, z), z.T @ residual
    best: dict[str, tuple[float, Member, slice]] = {}
    first = 0
    for member in members:
        own = slice(first, first + len(member.columns))
        first = own.stop
        gram = squares[own, None]
        if len(member.columns) > 1:
            z = exact(vectors[:, own])
            gram = z.T @ z
        weights, name = _member_weights(member, gram, along[own]), member.effect.name
        gain = max(float(weights @ along[own] - weights @ gram @ weights / 2), 0.0)
        if name not in best or gain > best[name][0]:
            best[name] = gain, member, own
    return [score_of(member, exact(vectors[:, own]), residual) for _, member, own in best.values()]


def score_of(member: Member, z: Array, residual: Array) -> Score:
    """Gain of a member's columns z (rows, m) for the residual, signs obeyed."""
    weights = _member_weights(member, z.T @ z, z.T @ residual)
    change = z @ weights
    gain = float(change @ residual - change @ change / 2)
    return Score(member, max(gain, 0.0), _start(member, weights), change)


def _member_weights(member: Member, gram: Array, along: Array) -> Array:
    """(m,) of columns with these products with each other (m, m) and with the residual (m,), signs obeyed."""
    signed = np.array([c.signed for c in member.columns])
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    weights = _weights(gram / scale / scale[:, None], along / scale, signed) / scale
    return np.clip(weights, -np.inf, [c.most for c in member.columns])


def _weights(gram: Array, right: Array, signed: NDArray[np.bool_]) -> Array:
    """Least squares with some weights not negative."""
    m = len(right)
    gram = gram + 1e-9 * np.eye(m)
    if not signed.any():
        return np.asarray(np.linalg.solve(gram, right))
    root = np.linalg.cholesky(gram).T
    target = np.linalg.solve(root.T, right)
    # a free weight is the difference of two that are not negative
    both = np.concatenate([root, -root[:, ~signed]], axis=1)
    found, _ = nnls(both, target)
    weights = found[:m].copy()
    weights[~signed] -= found[m:]
    return np.asarray(weights)


def _start(member: Member, weights: Array) -> dict[str, float]:
    """Parameters of a whole model that the weights mean."""
    effect, start = member.effect, {member.effect.key(k): v for k, v in member.shape.items()}
    amplitudes = [p for p in effect.parameters if p.role == "amplitude"]
    phases = [p for p in effect.parameters if p.role == "phase"]
    if not amplitudes:
        for p in effect.parameters:
            # a limit that is neutral beyond its range is not approached in a straight line
            if p.low <= p.neutral <= p.high and not p.discrete:
                start[effect.key(p.name)] = p.neutral + weights[0] * (member.shape[p.name] - p.neutral)
        return start
    if not phases:
        for a, weight in zip(amplitudes, weights, strict=True):
            start[effect.key(a.name)] = float(np.clip(a.neutral + a.size * weight, a.low, a.high))
        return start
    pairs = [(c.recording, weights[2 * i], weights[2 * i + 1]) for i, c in enumerate(member.columns[::2])]
    sizes = [hypot(a, b) for _, a, b in pairs]
    start[effect.key(amplitudes[0].name)] = amplitudes[0].size * float(np.mean(sizes))
    for recording, a, b in pairs:
        start[effect.key(phases[0].name) + (f"@{recording}" if recording else "")] = atan2(b, a)
    return start


def orthonormal(x: Array) -> Array:
    """(rows, k) basis of the directions of the free parameters that the data know, in whatever units these are."""
    size = np.sqrt(np.sum(x**2, axis=0))
    unit: Array = x[:, size > 0.0] / size[size > 0.0]
    if not unit.shape[1]:
        return unit
    u, s, _ = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(u[:, s > 1e-7])


def whitened_changes(fit: HypothesisFit, changes: Sequence[tuple[Effect, Column]]) -> Array:
    """(rows, m) what changes of the model would add to the whitened residuals' explanation, not projected."""
    parts = computed([partial(_whitened_together, fit, part) for part in _parts(changes)])
    return np.concatenate(parts, axis=1) if parts else np.zeros((sum(len(rows) for rows in fit.rows), 0))


def _parts(changes: Sequence[tuple[Effect, Column]]) -> list[list[tuple[Effect, Column]]]:
    """Changes of whole effects, TOGETHER or a few more in each part."""
    found: list[list[tuple[Effect, Column]]] = []
    for _, group in groupby(changes, key=lambda one: one[0].name):
        if not found or len(found[-1]) >= TOGETHER:
            found.append([])
        found[-1] += group
    return found


def _kept_together(fit: HypothesisFit, changes: Sequence[tuple[Effect, Column]], basis: Array) -> KeptColumns:
    return kept_columns(free_of(basis, _whitened_together(fit, changes)))


def _whitened_together(fit: HypothesisFit, changes: Sequence[tuple[Effect, Column]]) -> Array:
    out = np.zeros((sum(len(rows) for rows in fit.rows), len(changes)))
    first = 0
    for track, columns, gains in zip(fit.tracks, fit.columns, fit.gains, strict=True):
        mine = [i for i, (_, column) in enumerate(changes) if column.recording in (None, track.stretch.recording)]
        f, eps = changed(track, fit, [changes[i] for i in mine])
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is left out below
            white = whitened(columns.model, gains, f, eps)
        rows = white.shape[0] * white.shape[1]
        # what is added to the model is taken from the residual
        out[first : first + rows, mine] = -white.reshape(rows, -1)
        first += rows
    return meaningful(out)


def meaningful(columns: Array) -> Array:
    """Whitened columns (rows, m), zero those that lead where the model has no numbers or that grow past any meaning."""
    high, low = columns.max(axis=0, initial=0.0), columns.min(axis=0, initial=0.0)
    columns[:, ~((high < MOST_DEVIATIONS) & (low > -MOST_DEVIATIONS))] = 0.0
    return columns
