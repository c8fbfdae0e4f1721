"""What every effect of a library would explain of what a fit leaves: gains in log-likelihood, none of them refitted.

An effect changes the one-step map and the readings along the smoothed trajectory; whitened by the fit's own filter and
freed of the directions of all free parameters, these changes are the columns of an ordinary regression of the whitened
innovations, whose gain for any set of columns is r'Z (Z'Z)^-1 Z'r / 2 nats (score and Lagrange-multiplier tests; Rao 1948).

Rules of this file: a screen proposes, a fit decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import atan2, hypot

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from hoopd.diagnose.filtering import whitened
from hoopd.diagnose.fitting import Fit
from hoopd.diagnose.track import Track, composite_of, fitting_effects
from hoopd.physics.effects.base import Effect, EffectParameter

Array = NDArray[np.float64]

# A change tried at one value of a parameter that is not proportional may be stretched by up to this.
MOST_STRETCH = 1.5


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
    origin: Fit | None = None  # the fit about which it was screened


def members_of(effect: Effect, recordings: Sequence[str]) -> list[Member]:
    """All choices of the shape parameters' grids."""
    shapes = [p for p in effect.parameters if p.role == "shape"]
    amplitudes = [p for p in effect.parameters if p.role == "amplitude"]
    phases = [p for p in effect.parameters if p.role == "phase"]
    found = []
    for values in product(*(p.grid or (p.neutral,) for p in shapes)):
        shape = {p.name: float(v) for p, v in zip(shapes, values, strict=True)}
        found.append(Member(effect, shape, _columns(shape, amplitudes, phases, recordings)))
    return found


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

    def __init__(self, fit: Fit, effects: Sequence[Effect]) -> None:
        self.fit = fit
        self.recordings = tuple(dict.fromkeys(track.stretch.recording for track in fit.tracks))
        rows = fit.stacked()
        self._basis = orthonormal(rows[:, 1:])
        self.residual = self.projected(rows[:, :1])[:, 0]
        wanted = [e for e in effects if e.name not in fit.names and e.found_by in ("screen",)]
        self.members = [m for e in wanted for m in members_of(e, self.recordings)]
        self.vectors = self.whitened([(m.effect, column) for m in self.members for column in m.columns])

    def whitened(self, changes: Sequence[tuple[Effect, Column]]) -> Array:
        """(rows, m) whitened projected changes."""
        return self.projected(whitened_changes(self.fit, changes))

    def scores(self) -> list[Score]:
        """Best member of every effect, largest gain first."""
        best: dict[str, Score] = {}
        first = 0
        for member in self.members:
            z = self.vectors[:, first : first + len(member.columns)]
            first += len(member.columns)
            score = score_of(member, z, self.residual)
            if member.effect.name not in best or score.gain > best[member.effect.name].gain:
                best[member.effect.name] = score
        return sorted(best.values(), key=lambda one: -one.gain)

    def projected(self, x: Array) -> Array:
        """(rows, m) without the directions of the free parameters."""
        return np.asarray(x - self._basis @ (self._basis.T @ x))


def score_of(member: Member, z: Array, residual: Array) -> Score:
    """Gain of a member's columns z (rows, m) for the residual, signs obeyed."""
    signed = np.array([c.signed for c in member.columns])
    scale = np.sqrt(np.maximum(np.sum(z**2, axis=0), 1e-300))
    unit = z / scale
    gram, right = unit.T @ unit, unit.T @ residual
    weights = _weights(gram, right, signed) / scale
    weights = np.clip(weights, -np.inf, [c.most for c in member.columns])
    change = z @ weights
    gain = float(change @ residual - change @ change / 2)
    return Score(member, max(gain, 0.0), _start(member, weights), change)


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
            if np.isfinite(p.neutral) and not p.discrete:
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
    """(rows, k) basis of the directions of the free parameters that the data know."""
    size = np.sqrt(np.sum(x**2, axis=0))
    unit = x[:, size > 1e-9] / size[size > 1e-9]
    q, r = np.linalg.qr(unit)
    return np.asarray(q[:, np.abs(np.diag(r)) > 1e-7])


# ---------------------------------------------------------------------------------------------- changes


def whitened_changes(fit: Fit, changes: Sequence[tuple[Effect, Column]]) -> Array:
    """(rows, m) what changes of the model would add to the whitened residuals' explanation, not projected."""
    if not changes:
        return np.zeros((sum(len(rows) for rows in fit.rows), 0))
    out = []
    for track, columns, gains in zip(fit.tracks, fit.columns, fit.gains, strict=True):
        pairs = [change_of(track, fit, effect, column) for effect, column in changes]
        f, eps = np.stack([f for f, _ in pairs], axis=2), np.stack([e for _, e in pairs], axis=2)
        white = whitened(columns.model, gains, f, eps)
        out.append(white.reshape(-1, white.shape[2]))
    # what is added to the model is taken from the residual
    return -np.concatenate(out)


def change_of(track: Track, fit: Fit, effect: Effect, column: Column) -> tuple[Array, Array]:
    """Change of the one-step map (n-1, nz), and of the innovations (n, nc), along a reference."""
    own = track.composite
    nothing = np.zeros((len(track.z) - 1, own.nz)), np.zeros((len(track.z), len(own.channels)))
    if column.recording not in (None, track.stretch.recording):
        return nothing
    fits = fitting_effects(track.stretch.plant, (effect,))
    if not fits:
        return nothing
    with_effect = Track.of(track.stretch, track.held, composite_of(track.stretch.plant, (*own.effects, *fits)))
    values = {**track.local(fit.values), **{effect.key(k): v for k, v in column.values}}
    z, w = _filled(with_effect, values, track)
    changed, readings = with_effect.after(values, z, w), with_effect.readings(values, z, w)
    nx = own.nx
    f = np.zeros_like(nothing[0])
    f[:, :nx] = changed[:, :nx] - _base(track, fit, "after", with_effect.composite.substeps)[:, :nx]
    # innovations lose what the readings gain
    return f, _base(track, fit, "readings", 0) - readings


def _base(track: Track, fit: Fit, what: str, substeps: int) -> Array:
    """One-step map or readings without the change, with as many substeps as the change has."""
    cache = track.__dict__.setdefault("_without", {})
    key = (what, substeps, id(fit.values), float(track.z[-1, 0]))
    if key not in cache:
        cache[key] = track.after(fit.values, substeps=substeps) if what == "after" else track.readings(fit.values)
    return np.asarray(cache[key])


def _filled(with_effect: Track, values: Mapping[str, float], track: Track) -> tuple[Array, Array]:
    """The reference with the states that the effect adds: what they do along it."""
    own, new = track.composite, with_effect.composite
    w = np.zeros_like(track.w)
    if new.nz == own.nz:
        return track.z, w
    z = np.zeros((len(track.z), new.nz))
    z[:, : own.nx] = track.z[:, : own.nx]
    begin = new.beginning(z[0, : new.nx], float(track.stretch.u[0]) if len(track.stretch.u) else 0.0)
    z[:, new.nx :] = begin[new.nx :]
    # each added state is linear in itself: z+ = g z + c
    for k in range(own.nx, new.nz):
        z[:, k] = 0.0
        c = with_effect.after(values, z, w)[:, k]
        z[:, k] = 1.0
        g = with_effect.after(values, z, w)[:, k] - c
        z[0, k] = begin[k]
        for i in range(len(c)):
            z[i + 1, k] = g[i] * z[i, k] + c[i]
    return z, w
