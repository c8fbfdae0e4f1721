"""How far two explanations lie apart on given data, in nats.

    D(i, j) = min_w |v_i - Z_j w|^2 / 2

v_i is the whitened change that a fitted effect makes, Z_j the changes that a rival may make (its amplitudes and phases,
of admissible sign), both freed of all directions of the free parameters: the log-likelihood ratio that is expected
between the two when the first is true and both are re-fitted (T-optimality; Atkinson and Fedorov 1975).

Rules of this file: geometry only; what follows from it stands in `not_excluded` and `next_experiment`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.screen import (
    MOST_STRETCH,
    Column,
    Member,
    Score,
    best_scores,
    members_of,
    orthonormal,
    touched_grids,
    whitened_changes,
)
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import Noise, gains
from hoopd.plants.likelihood.reference_track import Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """Whitened changes along some tracks, not yet projected: they may be stacked on those of other tracks."""

    base: Array  # (rows, m) of the free parameters
    effect: Array  # (rows,) of the fitted effect
    rivals: tuple[tuple[Member, Array], ...]  # (rows, k) of every choice of a rival's shape


def linear(
    tracks: Sequence[Track],
    effects: Sequence[Effect],
    values: Mapping[str, float],
    free: Sequence[str],
    noise: Mapping[str, Noise],
) -> HypothesisFit:
    """The model linear and whitened along references as they are; nothing is fitted."""
    columns = [track.columns(values, free) for track in tracks]
    pairs = list(zip(tracks, columns, strict=True))
    found = [gains(one.model, noise[track.stretch.recording]) for track, one in pairs]
    rows = [track.whitened(one, gain) for (track, one), gain in zip(pairs, found, strict=True)]
    return HypothesisFit(tuple(effects), dict(values), tuple(free), list(tracks), dict(noise), columns, found, rows)


def without_effect(
    final: HypothesisFit, effect: Effect, ablated: HypothesisFit, free: Sequence[str] = ()
) -> HypothesisFit:
    """The final fit's parameters, noise and trajectories in a model without one effect; `ablated`: the fit without it.

    `free`: names beyond those of the ablated fit.
    """
    own = {name: value for name, value in final.values.items() if not name.startswith(f"{effect.name}.")}
    tracks = [_moved(old, new) for old, new in zip(ablated.tracks, final.tracks, strict=True)]
    return linear(tracks, ablated.effects, {**ablated.values, **own}, (*ablated.free, *free), final.noise)


def _moved(track: Track, to: Track) -> Track:
    """A track's model along another reference; states that only one of the two has stay."""
    found = Track.of(track.stretch, track.held, track.composite)
    found.moved(track.z, track.w.copy(), track.filtered, track.predicted)
    return found.like(to)


def rows_of(about: HypothesisFit, effect: Effect, values: Mapping[str, float], members: Sequence[Member]) -> Rows:
    """Changes by an effect at `values` (names of the whole model) and by rivals, beside a fit that has none of them."""
    own = own_columns(about, effect, values)
    changes = [(effect, column) for column in own] + [(m.effect, column) for m in members for column in m.columns]
    white = whitened_changes(about, changes)
    ends = len(own) + np.cumsum([0, *(len(member.columns) for member in members)])
    parts = [white[:, a:b] for a, b in pairwise(ends)]
    base = -np.concatenate([rows[:, 1:] for rows in about.rows])
    return Rows(base, white[:, : len(own)].sum(axis=1), tuple(zip(members, parts, strict=True)))


def condensed(rows: Rows) -> Rows:
    """Other rows with the same products of all columns, no more of them than there are columns: for what is stacked on
    them many times over."""
    every = np.concatenate([rows.base, rows.effect[:, None], *(z for _, z in rows.rivals)], axis=1)
    if len(every) <= every.shape[1]:
        return rows
    few = np.asarray(np.linalg.qr(every, mode="r"))
    ends = rows.base.shape[1] + 1 + np.cumsum([0, *(z.shape[1] for _, z in rows.rivals)])
    members = [member for member, _ in rows.rivals]
    rivals = tuple((member, few[:, a:b]) for member, (a, b) in zip(members, pairwise(ends), strict=True))
    return Rows(few[:, : ends[0] - 1], few[:, ends[0] - 1], rivals)


def rows_beside(
    about: HypothesisFit,
    effect: Effect,
    values: Mapping[str, float],
    rivals: Sequence[Effect],
    recordings: Sequence[str],
) -> Rows:
    """The same for all shapes of rivals, and for each rival at the size at which it comes nearest.

    A friction that sticks is not proportional to its level: a rival is compared at its own size, not at a usual one.
    `recordings`: all that the rows will be stacked over; each may have a phase of its own.
    """
    members = [member for rival in rivals for member in members_of(rival, recordings, touched_grids(rival, about))]
    rows = rows_of(about, effect, values, members)
    best = _best([rows], *_known([rows])).values()
    more = rows_of(about, effect, values, [_at(one) for one in best if not _has_phase(one.member.effect)])
    return replace(rows, rivals=(*rows.rivals, *more.rivals))


def _has_phase(effect: Effect) -> bool:
    return any(p.role == "phase" for p in effect.parameters)


def _at(score: Score) -> Member:
    """A rival at the size that its score starts from, a column for each amplitude as ever."""
    effect, start = score.member.effect, score.start
    amplitudes = [p for p in effect.parameters if p.role == "amplitude"]
    shape = {p.name: start.get(effect.key(p.name), p.neutral) for p in effect.parameters if p.role == "shape"}
    fixed = tuple(shape.items())
    if not amplitudes:
        return Member(effect, shape, (Column(fixed, signed=True, most=MOST_STRETCH),))
    sizes = [start.get(effect.key(a.name), a.neutral) for a in amplitudes]
    found = [value if value != a.neutral else a.neutral + a.size for a, value in zip(amplitudes, sizes, strict=True)]
    columns = [Column((*fixed, (a.name, v)), signed=a.low >= a.neutral) for a, v in zip(amplitudes, found, strict=True)]
    return Member(effect, shape, tuple(columns))


def own_columns(about: HypothesisFit, effect: Effect, values: Mapping[str, float]) -> list[Column]:
    """An effect as fitted, recording by recording."""
    return [Column(tuple(values_in(effect, values, name).items()), name) for name in about.recordings]


def values_in(effect: Effect, values: Mapping[str, float], recording: str) -> dict[str, float]:
    """An effect's parameters by its own names, as they are in one recording."""
    return {
        p.name: values.get(f"{effect.key(p.name)}@{recording}", values.get(effect.key(p.name), p.neutral))
        for p in effect.parameters
    }


def nats_apart(parts: Sequence[Rows]) -> dict[str, float]:
    """Expected nats between the effect and each rival, the nearest choice of its shape, over all parts together."""
    known, v = _known(parts)
    return {name: max(float(v @ v) / 2.0 - one.gain, 0.0) for name, one in _best(parts, known, v).items()}


def nats_seen(parts: Sequence[Rows]) -> float:
    """Expected nats of the effect itself over the base, re-fitted to all parts together."""
    _, v = _known(parts)
    return float(v @ v) / 2.0


def _best(parts: Sequence[Rows], known: Array, v: Array) -> dict[str, Score]:
    """Of every rival the choice that explains most of the effect's change v."""
    if not parts[0].rivals:
        return {}
    z = _freed(known, np.concatenate([np.concatenate([z for _, z in part.rivals], axis=1) for part in parts]))
    return {one.member.effect.name: one for one in best_scores([member for member, _ in parts[0].rivals], z, v)}


def _known(parts: Sequence[Rows]) -> tuple[Array, Array]:
    """Basis of the free parameters, and the effect's change without it."""
    known = orthonormal(np.concatenate([part.base for part in parts]))
    return known, _freed(known, np.concatenate([part.effect for part in parts])[:, None])[:, 0]


def _freed(known: Array, x: Array) -> Array:
    return np.asarray(x - known @ (known.T @ x))
