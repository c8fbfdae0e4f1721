"""Whether the recordings disagree: a number of the model that each of them would have another way, beyond chance.

A fit has one value of a parameter for all recordings. Its column is cut into one for each of them; what these explain
of the residual beyond what the fit's own parameters can has to be as surprising as a name has to. The same is asked of
constants that an effect of the library adds (a push, a wrong zero): what acts in one recording alone is no law of all.
A free disturbance takes most of such a push, as a large and slow one of that recording: all are asked with the
disturbances of the recording that has the least. Beside its own, where a slow one is like a push, what differs has to
be beyond chance as well.

Rules of this file: linear about the fit, no other one is made; what follows from it is told elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, inf, log

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.chance import colour
from hoopd.diagnose.search.kept_columns import free_of
from hoopd.diagnose.search.screen import Column, orthonormal, whitened_changes
from hoopd.diagnose.search.surprise import needed_gain, surprise
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, linear_again
from hoopd.plants.likelihood.priors import ranges

Array = NDArray[np.float64]

# Beside the disturbances that each recording seems to have a number differs beyond one chance in a hundred, too.
OWN_NATS = log(100.0)
# Below this share of its squared length a direction is the fit's own; of the largest, a column is nothing.
OWN_SHARE = 1e-4
# What is so few nats behind could be what differs as well.
ALIKE_NATS = 3.0


@dataclass(frozen=True)
class Differs:
    """A number that recordings would have in different ways."""

    name: str  # a parameter of the plant or of an effect
    values: dict[str, float]  # by recording that knows it, in its unit
    gain: float  # nats, over what the residual's colour inflates them by
    needed: float  # nats, as of a name
    alike: tuple[str, ...]  # other numbers that could be what differs

    @property
    def probability(self) -> float:
        """That it is more than chance: even where a name would be found."""
        return 1.0 / (1.0 + exp(min(self.needed - self.gain, 50.0)))


@dataclass(frozen=True)
class _Asked:
    name: str
    column: Array  # (rows,) of all recordings
    now: float
    size: float  # of the column, in the number's unit


@dataclass(frozen=True)
class _Told:
    asked: _Asked
    gain: float
    surprise: float
    columns: int
    colour: float


def differing(found: HypothesisFit, library: Sequence[Effect], threshold: float) -> Differs | None:
    """The number that shows most that recordings disagree; None where no more than chance does, or there is but one.

    Parameters
    ----------
    found
        A fit with its whitened rows.
    library
        Effects whose constants are asked, too.
    threshold
        Surprise that a name needs, nats: as many numbers are asked as a library has names.
    """
    which = _recording_of(found)
    if which.max(initial=0) == 0 or not np.isfinite(found.stacked()).all():
        return None
    quiet = _with_least_disturbances(found)
    if not np.isfinite(quiet.stacked()).all():
        return None
    told = [one for one in _told_of(quiet, library, which) if one.surprise > threshold]
    if not told:
        return None
    own = {one.asked.name: one.surprise for one in _told_of(found, library, which)}
    bounds = ranges((*library, *found.effects), found.tracks)
    told = [one for one in told if own[one.asked.name] > OWN_NATS and _is_possible(quiet, bounds, one, which)]
    if not told:
        return None
    best, *others = sorted(told, key=lambda one: -one.surprise)
    alike = tuple(one.asked.name for one in others if best.surprise - one.surprise < ALIKE_NATS)
    needed = needed_gain(threshold, best.columns)
    return Differs(best.asked.name, _values(quiet, which, best.asked), best.gain / best.colour, needed, alike)


def _with_least_disturbances(found: HypothesisFit) -> HypothesisFit:
    """About the same numbers and trajectory; of each disturbance the level and time of least power at rest,
    force^2 time_s, of all recordings that have it."""
    names = {track.stretch.recording: track.stretch.plant.disturbed for track in found.tracks}
    every: dict[str, list[tuple[float, float]]] = {}
    for recording, own in names.items():
        noise = found.noise[recording]
        for name, force, time_s in zip(own, noise.force, noise.time_s, strict=True):
            every.setdefault(name, []).append((float(force), float(time_s)))
    least = {name: min(levels, key=lambda one: one[0] ** 2 * one[1]) for name, levels in every.items()}
    quiet = {
        recording: found.noise[recording]._replace(
            force=np.array([least[name][0] for name in own]), time_s=np.array([least[name][1] for name in own])
        )
        for recording, own in names.items()
    }
    return linear_again(replace(found, noise=quiet))


def _recording_of(found: HypothesisFit) -> NDArray[np.intp]:
    """(rows,) number of the recording."""
    numbers = {name: k for k, name in enumerate(found.recordings)}
    counts = [len(one) for one in found.rows]
    return np.repeat([numbers[track.stretch.recording] for track in found.tracks], counts)


def _asked(found: HypothesisFit, rows: Array, library: Sequence[Effect]) -> list[_Asked]:
    """Parameters of the plant, amplitudes of the fit's effects, constants of the library."""
    base = {name for track in found.tracks for name in track.stretch.plant.free}
    sizes = {e.key(p.name) for e in found.effects for p in e.parameters if p.role == "amplitude"}
    asked = [
        _Asked(name, -rows[:, 1 + i], found.values[name], 1.0)
        for i, name in enumerate(found.free)
        if name in base or name in sizes
    ]
    constants = [one for one in library if one.name not in found.names and _is_constant(one)]
    ends = [(one, Column(((p.name, p.neutral + p.size),))) for one in constants for p in one.parameters]
    for (one, _), column in zip(ends, whitened_changes(found, ends).T, strict=True):
        (p,) = one.parameters
        asked.append(_Asked(one.key(p.name), column, p.neutral, p.size))
    return asked


def _is_constant(effect: Effect) -> bool:
    """Whether it adds one number that may have either sign."""
    return len(effect.parameters) == 1 and all(
        p.role == "amplitude" and not p.discrete and p.low < p.neutral < p.high for p in effect.parameters
    )


def _parts(column: Array, which: NDArray[np.intp]) -> tuple[list[int], Array]:
    """Recordings that know the number, and its column (rows, recordings) in each of them."""
    each = np.stack([np.where(which == k, column, 0.0) for k in range(which.max() + 1)], axis=1)
    squares = np.sum(each**2, axis=0)
    known = [int(k) for k in np.flatnonzero(squares > OWN_SHARE * squares.max(initial=0.0))]
    return known, each[:, known]


def _told_of(found: HypothesisFit, library: Sequence[Effect], which: NDArray[np.intp]) -> list[_Told]:
    """What a number of each recording's own explains beyond one of all, with the noise levels of a fit."""
    rows = found.stacked()
    basis = orthonormal(rows[:, 1:])
    residual = free_of(basis, rows[:, :1].copy())[:, 0]
    shapes = [(len(track.z), len(track.composite.channels)) for track in found.tracks]
    return [_told(one, which, basis, residual, shapes) for one in _asked(found, rows, library)]


def _told(
    one: _Asked, which: NDArray[np.intp], basis: Array, residual: Array, shapes: Sequence[tuple[int, int]]
) -> _Told:
    known, each = _parts(one.column, which)
    if len(known) < 2:
        return _Told(one, 0.0, 0.0, 0, 1.0)
    own = free_of(basis, np.column_stack([one.column, each[:, 1:]]))
    common = orthonormal(own[:, :1]) if own[:, 0] @ own[:, 0] > OWN_SHARE * (one.column @ one.column) else own[:, :0]
    parts = free_of(common, own[:, 1:].copy())
    u, s, _ = np.linalg.svd(parts / np.sqrt(np.sum(each[:, 1:] ** 2, axis=0)), full_matrices=False)
    u = u[:, s**2 > OWN_SHARE]
    left = residual - common @ (common.T @ residual)
    along = u.T @ left
    gain, inflated = float(along @ along) / 2.0, colour(u, left, shapes) if u.shape[1] else 1.0
    return _Told(one, gain, surprise(gain / inflated, u.shape[1]), u.shape[1], inflated)


def _values(found: HypothesisFit, which: NDArray[np.intp], one: _Asked) -> dict[str, float]:
    """By recording that knows it, all other numbers of the fit making the best of it."""
    rows, (known, each) = found.stacked(), _parts(one.column, which)
    others = np.array([name != one.name for name in found.free], dtype=bool)
    every = np.column_stack([-rows[:, 1:][:, others], each])
    size = np.sqrt(np.sum(every**2, axis=0))
    size[size == 0.0] = 1.0
    moved = np.linalg.lstsq(every / size, rows[:, 0], rcond=1e-7)[0] / size
    names = found.recordings
    return {names[k]: one.now + one.size * float(step) for k, step in zip(known, moved[-len(known) :], strict=True)}


def _is_possible(
    found: HypothesisFit, bounds: Mapping[str, tuple[float, float]], told: _Told, which: NDArray[np.intp]
) -> bool:
    """Whether there can be such numbers: a mass below zero is another law's."""
    low, high = bounds.get(told.asked.name, (-inf, inf))
    return all(low <= value <= high for value in _values(found, which, told.asked).values())
