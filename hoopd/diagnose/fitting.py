"""Parameters, noise levels and trajectory of one hypothesis (the base and a set of effects) from all recordings.

Gauss-Newton on the innovations' likelihood: the model is linear about the smoothed trajectory, parameters and
trajectory are moved together, the noise levels of every recording are those of highest profile likelihood.

Rules of this file: numbers in, numbers out; a hypothesis is judged elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hoopd.diagnose.dataset import Stretch
from hoopd.diagnose.filtering import Criterion, Gains, Noise, gains, smoothed
from hoopd.diagnose.track import Columns, Track
from hoopd.physics.effects.base import Effect

Array = NDArray[np.float64]

# Gauss-Newton ends when no parameter moves by more than this share of its standard error.
SETTLED = 0.1
FIRST_STEPS, MOST_STEPS, LAST_STEPS = 3, 8, 2
# Noise levels are searched within these factors of their first guess; a disturbance slower than a second is physics.
FORCE_FACTOR, READING_FACTOR = 300.0, (0.4, 30.0)
TIMES_S = (0.03, 1.0)
FIRST_TIME_S = 0.15
# First guess of a disturbance: so many rad/s^2 (m/s^2) on every coordinate.
FIRST_ACCELERATION = 1.0
# Prior of a base parameter: this many times its nominal size, so that data without information leave it there.
PRIOR_SIZE = 3.0


@dataclass
class Fit:
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

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(effect.name for effect in self.effects)

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
    like: Fit | None = None,
    free: Sequence[str] | None = None,
    tune_noise: bool = True,
    move: bool = True,
) -> Fit:
    """The hypothesis fitted from `values`; `like`: a fit of the same stretches whose trajectory is taken over;
    `move=False`: the free parameters stay where they are, trajectory and noise are fitted."""
    tracks = [Track(one, effects) for one in stretches]
    if like is not None:
        tracks = [new.like(old) for new, old in zip(tracks, like.tracks, strict=True)]
    start = {name: value for track in tracks for name, value in track.composite.values.items()}
    free = free_names(tracks, values) if free is None else tuple(free)
    alone = {e.key(p.name) for e in effects for p in e.parameters if p.per_recording and p.role == "shape"}
    shared = {name.split("@")[0]: value for name, value in values.items() if name.split("@")[0] not in alone}
    start.update({name: shared[name.split("@")[0]] for name in (*start, *free) if name.split("@")[0] in shared})
    # what belongs to one recording stays there, fitted or not
    start.update({name: value for name, value in values.items() if name.split("@")[0] in start})
    found = Fit(tuple(effects), start, tuple(free), tracks, dict(noise or first_noise(tracks, start)))
    _linearise(found)
    if not move:
        for _ in range(LAST_STEPS):
            _settle(found)
            tuned_noise(found)
        return found
    if tune_noise:
        # levels are tuned on the residual of fitted parameters, so that these come first
        _search(found, FIRST_STEPS)
        tuned_noise(found)
    _search(found, MOST_STEPS)
    if tune_noise:
        tuned_noise(found)
        _search(found, LAST_STEPS)
    return found


def free_names(tracks: Sequence[Track], values: Mapping[str, float]) -> tuple[str, ...]:
    """Base parameters that any of the plants leaves free, then those of the effects."""
    base = dict.fromkeys(name for track in tracks for name in track.stretch.plant.free)
    extra = dict.fromkeys(name for track in tracks for name in _effect_names(track, values))
    return (*base, *extra)


def _known(names: Sequence[str], tracks: Sequence[Track], values: Mapping[str, float]) -> tuple[str, ...]:
    """Without the shapes of a recording (a pulse's times) that `values` does not give: it has none."""
    shapes = {
        e.key(p.name) for t in tracks for e in t.composite.effects for p in e.parameters
        if p.per_recording and p.role == "shape"
    }  # fmt: skip
    return tuple(n for n in names if n.split("@")[0] not in shapes or n in values)


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


def _search(found: Fit, most: int) -> None:
    for _ in range(most):
        delta = _solution(found)
        size = np.sqrt(np.maximum(np.diag(found.covariance), 1e-300))
        before = dict(found.values)
        found.values = _moved(found, delta)
        _move_references(found, np.array([found.values[n] - before[n] for n in found.free]))
        _linearise(found)
        found.steps += 1
        if np.max(np.abs(delta) / size, initial=0.0) < SETTLED:
            break
    _solution(found)


def _settle(found: Fit) -> None:
    """Only the trajectories move."""
    for _ in range(LAST_STEPS):
        _solution(found)
        _move_references(found, np.zeros(len(found.free)))
        _linearise(found)
    rows = found.stacked()
    found.criterion = float(rows[:, 0] @ rows[:, 0] + sum(gain.logdet for gain in found.gains)) / 2


def _moved(found: Fit, delta: Array) -> dict[str, float]:
    """Values after a step, effects within their ranges."""
    values = dict(found.values)
    ranges = {e.key(p.name): (p.low, p.high) for e in found.effects for p in e.parameters if p.role != "phase"}
    for name, step in zip(found.free, delta, strict=True):
        low, high = ranges.get(name.split("@")[0], (-np.inf, np.inf))
        values[name] = float(np.clip(values[name] + step, low, high))
    return values


def _linearise(found: Fit) -> None:
    found.columns = [track.columns(found.values, found.free) for track in found.tracks]
    _whiten(found)


def _whiten(found: Fit) -> None:
    pairs = list(zip(found.tracks, found.columns, strict=True))
    found.gains = [gains(columns.model, found.noise[track.stretch.recording]) for track, columns in pairs]
    found.rows = [track.whitened(columns, gain) for (track, columns), gain in zip(pairs, found.gains, strict=True)]


def _solution(found: Fit) -> Array:
    """Step of the free parameters; sets covariance and criterion."""
    rows = found.stacked()
    r, x = rows[:, 0], -rows[:, 1:]
    weight, centre = _prior(found)
    information = x.T @ x + np.diag(weight)
    right = x.T @ r + weight * centre
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    covariance = np.linalg.pinv(information * np.outer(scale, scale), rcond=1e-12, hermitian=True) * np.outer(
        scale, scale
    )
    delta = covariance @ right
    found.covariance = covariance
    logdet = sum(gain.logdet for gain in found.gains)
    found.criterion = float(r @ r - right @ delta + logdet) / 2
    return np.asarray(delta)


def _prior(found: Fit) -> tuple[Array, Array]:
    """Weights (m,) and distance to the centre (m,): wide about the declared values; of an effect its range."""
    weight, centre = np.zeros(len(found.free)), np.zeros(len(found.free))
    declared = {name: value for track in found.tracks for name, value in track.stretch.plant.values.items()}
    widths = {e.key(p.name): p.high - p.low for e in found.effects for p in e.parameters}
    for i, name in enumerate(found.free):
        middle = declared.get(name, 0.0)
        width = PRIOR_SIZE * max(abs(middle), 0.3)
        if (plain := name.split("@")[0]) in widths:
            width, middle = widths[plain], found.values[name]
        weight[i], centre[i] = 1.0 / width**2, middle - found.values[name]
    return weight, centre


def _move_references(found: Fit, delta: Array) -> None:
    """Trajectories smoothed under the new parameters, to first order."""
    for track, columns, gain in zip(found.tracks, found.columns, found.gains, strict=True):
        f = columns.f[:, :, 0] + columns.f[:, :, 1:] @ delta
        eps = columns.eps[:, :, 0] + columns.eps[:, :, 1:] @ delta
        d = smoothed(columns.model, gain, f, eps).d
        track.z = track.z + d[:, : track.composite.nz]
        track.w = d[:, track.composite.nz :]


# ---------------------------------------------------------------------------------------------- noise


def first_noise(tracks: Sequence[Track], values: Mapping[str, float]) -> dict[str, Noise]:
    """By recording: readings from their roughness, disturbances of a usual size."""
    found = {}
    for track in tracks:
        if track.stretch.recording not in found:
            same = [t.stretch for t in tracks if t.stretch.recording == track.stretch.recording]
            reading = np.array([roughness([s.y[:, i] for s in same]) for i in range(same[0].y.shape[1])])
            force = FIRST_ACCELERATION / _mobility(track, values)
            found[track.stretch.recording] = Noise(force, np.full(len(force), FIRST_TIME_S), reading)
    return found


def _mobility(track: Track, values: Mapping[str, float]) -> Array:
    """(nq,) acceleration per force at the first node, by the one-step map: dq' = M^-1 f h."""
    c = track.columns(values, ()).model
    return np.array([abs(c.w[0, 2 * i + 1, i]) / c.h[0] for i in range(c.w.shape[2])])


def roughness(parts: Sequence[Array]) -> float:
    """Standard deviation of a reading's noise without a model: fourth differences, whose variance is 70 sigma^2.

    Not below the spread 1/sqrt(12) of the smallest step between two values, which is a sensor's count.
    """
    seen = [part[np.isfinite(part)] for part in parts]
    fourth = np.concatenate([np.diff(part, 4) for part in seen if len(part) > 4] or [np.zeros(1)])
    steps = np.concatenate([np.abs(np.diff(part)) for part in seen if len(part) > 1] or [np.zeros(1)])
    count = float(np.min(steps[steps > 1e-9], initial=np.inf))
    spread = float(1.4826 * np.median(np.abs(fourth)) / np.sqrt(70.0))
    least = count / np.sqrt(12.0) if np.isfinite(count) and np.mean(steps < 1e-9) > 0.02 else 1e-9
    return max(spread, least, 1e-9)


def tuned_noise(found: Fit) -> None:
    """Noise levels of highest profile likelihood, recording by recording."""
    first = first_noise(found.tracks, found.values)
    for recording in dict.fromkeys(track.stretch.recording for track in found.tracks):
        parts = [i for i, track in enumerate(found.tracks) if track.stretch.recording == recording]
        criteria = [_criterion(found.columns[i]) for i in parts]
        found.noise[recording] = _tuned(criteria, found.noise[recording], first[recording])
    _whiten(found)


def _criterion(columns: Columns) -> Criterion:
    return Criterion(columns.model, columns.f[:, :, 0], columns.eps[:, :, 0])


def _tuned(criteria: Sequence[Criterion], start: Noise, first: Noise) -> Noise:
    nq, nc = len(start.force), len(start.reading)
    low = np.concatenate([first.force / FORCE_FACTOR, np.full(nq, TIMES_S[0]), first.reading * READING_FACTOR[0]])
    high = np.concatenate([first.force * FORCE_FACTOR, np.full(nq, TIMES_S[1]), first.reading * READING_FACTOR[1]])

    def split(v: Array) -> Noise:
        levels = np.exp(v)
        return Noise(levels[:nq], levels[nq : 2 * nq], levels[2 * nq :])

    def value(v: Array) -> float:
        total = sum(one.value(split(v)) for one in criteria)
        return total if np.isfinite(total) else 1e12

    begin = np.clip(np.log(np.concatenate(start)), np.log(low), np.log(high))
    bounds = list(zip(np.log(low), np.log(high), strict=True))
    options = {"maxiter": 15, "ftol": 1e-6, "eps": 1e-3}
    best = minimize(value, begin, method="L-BFGS-B", bounds=bounds, options=options)
    assert nc == len(split(best.x).reading)
    return split(best.x)
