"""Parameters, noise levels and trajectory of one hypothesis (the base and a set of effects) from all recordings.

Gauss-Newton on the innovations' likelihood: the model is linear about the smoothed trajectory, parameters and
trajectory are moved together, the noise levels of every recording are those of highest profile likelihood.

Rules of this file: numbers in, numbers out; a hypothesis is judged elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.kalman_filter import Gains, Noise, gains, smoothed
from hoopd.plants.likelihood.noise_levels import Criterion
from hoopd.plants.likelihood.noise_tuning import first_noise, quiet_readings, tuned
from hoopd.plants.likelihood.priors import inverse, leaving, prior, ranges
from hoopd.plants.likelihood.recording_parameters import plain
from hoopd.plants.likelihood.reference_track import Columns, Track
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# Gauss-Newton ends when no parameter moves by more than this share of its standard error.
SETTLED = 0.1
FIRST_STEPS, MOST_STEPS, LAST_STEPS = 3, 8, 2
# A disturbance's level that has fallen to less than this share in a turn was not found yet (nearly none acts on a
# simulated device): levels and parameters are moved once more, so often at most.
FALLEN, MOST_TURNS = 0.5, 4
# A step that leads where the model has no finite numbers (a negative inertia), or to where the data are less likely by
# so many nats, is halved so often: along a direction that the data hardly know it goes far, and the model bends.
WORSE_NATS, MOST_HALVINGS = 100.0, 6
# Sums of squares of larger numbers may be beyond all numbers.
LARGEST = 1e100
# A search that has led away is made again, and ends where it was likeliest but for so many nats; so does every one
# that begins with its trajectory, so that the two are compared as they were made.
LED_AWAY_NATS = 0.5


@dataclass
class HypothesisFit:
    """A hypothesis with its numbers; rows are whitened readings."""

    effects: tuple[Effect, ...]
    values: dict[str, float]
    free: tuple[str, ...]
    tracks: list[Track]
    noise: dict[str, Noise]
    columns: list[Columns] = field(default_factory=list)
    gains: list[Gains] = field(default_factory=list)
    rows: list[Array] = field(default_factory=list)  # (n nc, 1+m) by track: residual, then the free parameters
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    criterion: float = np.inf  # negative log-likelihood, free parameters fitted
    steps: int = 0
    widths: dict[str, float] = field(default_factory=dict)  # halves of 95 % intervals, once they were asked for
    curvatures: dict[str, Array] = field(default_factory=dict)  # of the noise levels, by recording (`noise_tuning`)
    most_force: Mapping[str, Array] = field(default_factory=dict)  # by recording, disturbances (nq,) that it is held to
    most_worse: float = np.inf  # nats by which a search may end less likely than it was on its way

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(effect.name for effect in self.effects)

    @property
    def recordings(self) -> tuple[str, ...]:
        """Names, in the order of the tracks."""
        return tuple(dict.fromkeys(track.stretch.recording for track in self.tracks))

    def stacked(self) -> Array:
        """All rows."""
        return np.concatenate(self.rows)

    def deviation(self, name: str) -> float:
        """Standard error of a free parameter."""
        i = self.free.index(name)
        return float(np.sqrt(max(self.covariance[i, i], 0.0)))


def fit(
    stretches: Sequence[Stretch],
    effects: Sequence[Effect],
    values: Mapping[str, float],
    *,
    noise: Mapping[str, Noise] | None = None,
    like: HypothesisFit | None = None,
    free: Sequence[str] | None = None,
    tune_noise: bool = True,
    move: bool = True,
    most_force: Mapping[str, Array] | None = None,
) -> HypothesisFit:
    """The hypothesis fitted from `values`; `like`: a fit of the same stretches whose trajectory is taken over;
    `move=False`: the free parameters stay where they are, trajectory and noise are fitted; `most_force`: by recording,
    disturbances (nq,) that are not to be exceeded (those of `like`)."""
    tracks = [Track(one, effects) for one in stretches]
    if like is not None:
        tracks = [new.like(old) for new, old in zip(tracks, like.tracks, strict=True)]
    start = {name: value for track in tracks for name, value in track.composite.values.items()}
    free = free_names(tracks, values) if free is None else tuple(free)
    alone = {e.key(p.name) for e in effects for p in e.parameters if p.per_recording and p.role == "shape"}
    shared = {plain(name): value for name, value in values.items() if plain(name) not in alone}
    start.update({name: shared[plain(name)] for name in (*start, *free) if plain(name) in shared})
    # what belongs to one recording stays there, fitted or not
    start.update({name: value for name, value in values.items() if plain(name) in start})
    found = HypothesisFit(tuple(effects), start, tuple(free), tracks, dict(noise or first_noise(tracks, start)))
    found.most_force = dict(most_force or (like.most_force if like is not None else {}))
    if like is not None:
        found.curvatures, found.most_worse = dict(like.curvatures), like.most_worse
        for new, old in zip(tracks, like.tracks, strict=True):
            new.lead_added(start, old.composite.plant.states)
    else:
        for track in tracks:
            track.lead_added(start, track.stretch.plant.states)
    _linearise(found)
    if not _is_finite(found.rows):
        # where it starts there is no such plant: the least likely of all hypotheses
        found.covariance = np.zeros((len(found.free), len(found.free)))
        return found
    if not move:
        for step in range(LAST_STEPS):
            _settle(found)
            if not _is_finite(found.rows):
                found.criterion = np.inf
                break
            tuned_noise(found, near=step > 0)
        return found
    begin = _kept(found)
    near, least = noise is not None, _value(begin)
    end = _searched(found, tune_noise=tune_noise, near=near)
    if end.criterion > least:
        # where the model bends (a friction turns round between two readings) every step may have led away
        end = _searched(replace(_kept(begin), most_worse=LED_AWAY_NATS), tune_noise=tune_noise, near=near)
    if end.criterion <= least:
        return end
    # no fit ends less likely than it began
    _solution(begin)
    begin.criterion = _value(begin)
    return begin


def _searched(found: HypothesisFit, *, tune_noise: bool, near: bool) -> HypothesisFit:
    """Parameters, trajectory and levels moved in turns; `near`: the levels are almost right already."""
    if tune_noise:
        # levels are tuned on the residual of fitted parameters, so that these come first
        _search(found, FIRST_STEPS)
        tuned_noise(found, near=near)
    _search(found, MOST_STEPS)
    for _ in range(MOST_TURNS if tune_noise else 0):
        before = _kept(found)
        tuned_noise(found, near=True)
        _search(found, LAST_STEPS)
        if before.criterion < found.criterion:
            # where the model bends (a friction turns round between two readings) a step may lead away again
            return before
        if not any((found.noise[name].force < FALLEN * old.force).any() for name, old in before.noise.items()):
            break
    return found


def _kept(found: HypothesisFit) -> HypothesisFit:
    """The fit as it is now, whatever is done with it afterwards."""
    tracks = [copy(track) for track in found.tracks]
    curvatures = dict(found.curvatures)
    return replace(found, values=dict(found.values), tracks=tracks, noise=dict(found.noise), curvatures=curvatures)


def free_names(tracks: Sequence[Track], values: Mapping[str, float]) -> tuple[str, ...]:
    """Base parameters that any of the plants leaves free, then those of the effects."""
    base = dict.fromkeys(name for track in tracks for name in track.stretch.plant.free)
    extra = dict.fromkeys(name for track in tracks for name in _effect_names(track, values))
    return (*base, *extra)


def _effect_names(track: Track, values: Mapping[str, float]) -> list[str]:
    """Of the effects' parameters that are searched continuously; what belongs to a recording carries its name.

    A shape that belongs to a recording (the times of a push) and is neutral there stays so: nothing happened in it.
    """
    own = f"@{track.stretch.recording}"
    every = [(e, p) for e in track.composite.effects for p in e.parameters if not p.discrete]
    return [
        e.key(p.name) + (own if p.per_recording else "")
        for e, p in every
        if not (p.per_recording and p.role == "shape" and values.get(e.key(p.name) + own, p.neutral) == p.neutral)
    ]


def _search(found: HypothesisFit, most: int) -> None:
    value = least = _value(found)
    best = _place(found)
    for _ in range(most):
        delta = _solution(found)
        size = np.sqrt(np.maximum(np.diag(found.covariance), 1e-300))
        if not _stepped(found, delta):
            break
        found.steps += 1
        value = _value(found)
        if value < least:
            least, best = value, _place(found)
        if np.max(np.abs(delta) / size, initial=0.0) < SETTLED:
            break
    if value > least + found.most_worse:
        _put_back(found, best)
    _solution(found)


class _Place(NamedTuple):
    """Where a search is."""

    values: dict[str, float]
    columns: list[Columns]
    gains: list[Gains]
    rows: list[Array]
    references: list[tuple[Array, ...]]


def _place(found: HypothesisFit) -> _Place:
    references: list[tuple[Array, ...]] = [(one.z, one.w, one.filtered, one.predicted) for one in found.tracks]
    return _Place(dict(found.values), found.columns, found.gains, found.rows, references)


def _put_back(found: HypothesisFit, place: _Place) -> None:
    found.values, found.columns, found.gains, found.rows = dict(place.values), place.columns, place.gains, place.rows
    for track, reference in zip(found.tracks, place.references, strict=True):
        track.moved(*reference)


def _stepped(found: HypothesisFit, delta: Array) -> bool:
    """One step, of parameters and trajectory, halved as long as it makes the fit clearly worse; False when it always
    does: all is as before."""
    worst, before = _value(found) + WORSE_NATS, _place(found)
    for halved in range(1 + MOST_HALVINGS):
        share = 0.5**halved
        found.values = _moved(found, share * delta)
        # the whole way of the trajectory, and then this share of it
        _move_references(found, np.array([found.values[n] - before.values[n] for n in found.free]) / share)
        if halved:
            _draw_back(found.tracks, before.references, share)
        found.columns = _columns(found)
        if _is_finite([part for one in found.columns for part in (one.f, one.eps, one.model.a, one.model.c)]):
            with np.errstate(all="ignore"):  # a step too far may leave all numbers: it is not taken
                _whiten(found)
            if _is_finite(found.rows) and _value(found) <= worst:
                return True
        _put_back(found, before)
    return False


def _draw_back(tracks: Sequence[Track], references: Sequence[tuple[Array, ...]], share: float) -> None:
    """This share of the way from the references to where the tracks are."""
    for track, before in zip(tracks, references, strict=True):
        now = (track.z, track.w, track.filtered, track.predicted)
        track.moved(*(old + share * (new - old) for old, new in zip(before, now, strict=True)))


def _value(found: HypothesisFit) -> float:
    """Negative log-likelihood and prior where the fit is, nothing moved."""
    weight, centre = prior(found.effects, found.tracks, found.free, found.values)
    total = sum(float(rows[:, 0] @ rows[:, 0]) for rows in found.rows) + sum(gain.logdet for gain in found.gains)
    return float(total + weight @ centre**2) / 2


def _is_finite(arrays: Sequence[Array]) -> bool:
    return all(bool((np.abs(one) < LARGEST).all()) for one in arrays)


def _settle(found: HypothesisFit) -> None:
    """Only the trajectories move."""
    for _ in range(LAST_STEPS):
        _solution(found)
        _move_references(found, np.zeros(len(found.free)))
        _linearise(found)
    rows = found.stacked()
    found.criterion = float(rows[:, 0] @ rows[:, 0] + sum(gain.logdet for gain in found.gains)) / 2


def _moved(found: HypothesisFit, delta: Array) -> dict[str, float]:
    """Values after a step, within their ranges."""
    values = dict(found.values)
    bounds = ranges(found.effects, found.tracks)
    for name, step in zip(found.free, delta, strict=True):
        low, high = bounds.get(plain(name), (-np.inf, np.inf))
        values[name] = float(np.clip(values[name] + step, low, high))
    return values


def linear_again(found: HypothesisFit) -> HypothesisFit:
    """A fit of which only numbers and references are there, with its linear model and whitened rows."""
    _linearise(found)
    return found


def _linearise(found: HypothesisFit) -> None:
    found.columns = _columns(found)
    _whiten(found)


def _columns(found: HypothesisFit) -> list[Columns]:
    return [track.columns(found.values, found.free) for track in found.tracks]


def _whiten(found: HypothesisFit) -> None:
    pairs = list(zip(found.tracks, found.columns, strict=True))
    found.gains = [gains(columns.model, found.noise[track.stretch.recording]) for track, columns in pairs]
    found.rows = [track.whitened(columns, gain) for (track, columns), gain in zip(pairs, found.gains, strict=True)]


def _solution(found: HypothesisFit) -> Array:
    """Step of the free parameters; sets covariance and criterion."""
    rows = found.stacked()
    r, x = rows[:, 0], -rows[:, 1:]
    weight, centre = prior(found.effects, found.tracks, found.free, found.values)
    information = x.T @ x + np.diag(weight)
    right = x.T @ r + weight * centre
    found.covariance = inverse(information)
    delta = found.covariance @ right
    held = np.zeros(len(delta), dtype=bool)
    # a parameter on the end of its range that wants to leave it stays, and the others make the best of it
    bounds = ranges(found.effects, found.tracks)
    while (leave := leaving(found.free, found.values, bounds, delta) & ~held).any():
        held |= leave
        delta = np.zeros(len(right))
        delta[~held] = inverse(information[np.ix_(~held, ~held)]) @ right[~held]
    logdet = sum(gain.logdet for gain in found.gains)
    found.criterion = float(r @ r - right @ delta + logdet) / 2
    return np.asarray(delta)


def _move_references(found: HypothesisFit, delta: Array) -> None:
    """Trajectories smoothed under the new parameters, to first order."""
    for track, columns, gain in zip(found.tracks, found.columns, found.gains, strict=True):
        f = columns.f[:, :, 0] + columns.f[:, :, 1:] @ delta
        eps = columns.eps[:, :, 0] + columns.eps[:, :, 1:] @ delta
        track.follow(smoothed(columns.model, gain, f, eps))


def tuned_noise(found: HypothesisFit, *, near: bool = False) -> None:
    """Noise levels of highest profile likelihood, recording by recording; `near`: they are almost those already."""
    first = first_noise(found.tracks, found.values)
    for recording in found.recordings:
        parts = [
            one for one, track in zip(found.columns, found.tracks, strict=True) if track.stretch.recording == recording
        ]
        stretches = [track.stretch for track in found.tracks if track.stretch.recording == recording]
        slower = min(motion_scale(one.plant) for one in stretches)
        criteria = [Criterion(one.model, one.f[:, :, 0], one.eps[:, :, 0]) for one in parts]
        found.noise[recording], found.curvatures[recording] = tuned(
            criteria, found.noise[recording], first[recording],
            near=near, slower=slower, curvature=found.curvatures.get(recording),
            most=found.most_force.get(recording), quiet=quiet_readings(stretches),
        )  # fmt: skip
    _whiten(found)
