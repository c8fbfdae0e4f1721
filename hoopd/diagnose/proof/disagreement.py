"""Whether the recordings disagree: a number of the model that each of them would have another way, beyond chance.

A fit has one value of a parameter for all recordings. Its column is cut into one for each of them; what these explain
of the residual beyond what the fit's own parameters can has to be as surprising as a name has to. The same is asked of
constants that an effect of the library adds (a push, a wrong zero): what acts in one recording alone is no law of all.
A free disturbance takes such a push, as a large and slow one of that recording: all are asked with the disturbances of
the recording that has the least. Where the others are another spectrum's, the residual shows it, and more is needed
(`chance.colour`).

Rules of this file: linear about the fit, no other one is made; what follows from it is told elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import exp

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.chance import colour
from hoopd.diagnose.search.kept_columns import free_of
from hoopd.diagnose.search.screen import Column, orthonormal, whitened_changes
from hoopd.diagnose.search.surprise import needed_gain, surprise
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, linear_again
from hoopd.plants.likelihood.recording_parameters import plain

Array = NDArray[np.float64]

# Below this share of its squared length a direction is the fit's own.
OWN_SHARE = 1e-4
# What is so few nats behind could be what differs as well.
ALIKE_NATS = 3.0


@dataclass(frozen=True)
class Differs:
    """A number that recordings would have in different ways."""

    name: str  # a parameter of the plant or of an effect
    values: dict[str, float]  # by recording, in its unit
    gain: float  # nats
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
    found = _with_least_disturbances(found)
    rows = found.stacked()
    if not np.isfinite(rows).all():
        return None
    basis = orthonormal(rows[:, 1:])
    residual = free_of(basis, rows[:, :1].copy())[:, 0]
    shapes = [(len(track.z), len(track.composite.channels)) for track in found.tracks]
    told = [_told(one, which, basis, residual, shapes) for one in _asked(found, rows, library)]
    told = sorted((one for one in told if one.columns), key=lambda one: -one.surprise)
    if not told or told[0].surprise <= threshold:
        return None
    best = told[0]
    alike = tuple(one.asked.name for one in told[1:] if best.surprise - one.surprise < ALIKE_NATS)
    needed = needed_gain(threshold, best.columns) * best.colour
    return Differs(best.asked.name, _values(found, rows, which, best.asked), best.gain, needed, alike)


def _with_least_disturbances(found: HypothesisFit) -> HypothesisFit:
    """About the same numbers and trajectory; of each disturbance the level and time of least power at rest,
    force^2 time_s."""
    every = list(found.noise.values())
    which = np.argmin([one.force**2 * one.time_s for one in every], axis=0)
    force, time_s = (
        np.array([getattr(every[k], name)[i] for i, k in enumerate(which)]) for name in ("force", "time_s")
    )
    least = {name: one._replace(force=force, time_s=time_s) for name, one in found.noise.items()}
    return linear_again(replace(found, noise=least))


def _recording_of(found: HypothesisFit) -> NDArray[np.intp]:
    """(rows,) number of the recording."""
    numbers = {name: k for k, name in enumerate(dict.fromkeys(track.stretch.recording for track in found.tracks))}
    counts = [len(one) for one in found.rows]
    return np.repeat([numbers[track.stretch.recording] for track in found.tracks], counts)


def _asked(found: HypothesisFit, rows: Array, library: Sequence[Effect]) -> Iterator[_Asked]:
    for i, name in enumerate(found.free):
        if plain(name) == name:
            yield _Asked(name, -rows[:, 1 + i], found.values[name], 1.0)
    constants = [one for one in library if one.name not in found.names and _is_constant(one)]
    ends = [(one, Column(((p.name, p.neutral + p.size),))) for one in constants for p in one.parameters]
    columns = whitened_changes(found, ends)
    for (one, _), column in zip(ends, columns.T, strict=True):
        (p,) = one.parameters
        yield _Asked(one.key(p.name), column, p.neutral, p.size)


def _is_constant(effect: Effect) -> bool:
    """Whether it adds one number that may have either sign."""
    return len(effect.parameters) == 1 and all(
        p.role == "amplitude" and not p.discrete and p.low < p.neutral < p.high for p in effect.parameters
    )


def _parts(column: Array, which: NDArray[np.intp]) -> Array:
    """(rows, recordings - 1) the column in each recording but the first."""
    return np.stack([np.where(which == k, column, 0.0) for k in range(1, which.max() + 1)], axis=1)


def _told(
    one: _Asked, which: NDArray[np.intp], basis: Array, residual: Array, shapes: Sequence[tuple[int, int]]
) -> _Told:
    """What a number of each recording's own explains beyond one of all."""
    own = free_of(basis, np.column_stack([one.column, _parts(one.column, which)]))
    common = orthonormal(own[:, :1]) if own[:, 0] @ own[:, 0] > OWN_SHARE * (one.column @ one.column) else own[:, :0]
    parts = free_of(common, own[:, 1:].copy())
    sizes = np.sqrt(np.sum(_parts(one.column, which) ** 2, axis=0))
    if not (sizes > 0.0).all():
        return _Told(one, 0.0, 0.0, 0, 1.0)
    u, s, _ = np.linalg.svd(parts / sizes, full_matrices=False)
    u = u[:, s**2 > OWN_SHARE]
    left = residual - common @ (common.T @ residual)
    along = u.T @ left
    gain, inflated = float(along @ along) / 2.0, colour(u, left, shapes) if u.shape[1] else 1.0
    return _Told(one, gain, surprise(gain / inflated, u.shape[1]), u.shape[1], inflated)


def _values(found: HypothesisFit, rows: Array, which: NDArray[np.intp], one: _Asked) -> dict[str, float]:
    """By recording, all other numbers of the fit making the best of it."""
    others = np.array([name != one.name for name in found.free])
    each = np.stack([np.where(which == k, one.column, 0.0) for k in range(which.max() + 1)], axis=1)
    every = np.column_stack([-rows[:, 1:][:, others], each])
    size = np.sqrt(np.sum(every**2, axis=0))
    size[size == 0.0] = 1.0
    moved = np.linalg.lstsq(every / size, rows[:, 0], rcond=1e-7)[0] / size
    names = dict.fromkeys(track.stretch.recording for track in found.tracks)
    return {name: one.now + one.size * float(step) for name, step in zip(names, moved[-len(each.T) :], strict=True)}
