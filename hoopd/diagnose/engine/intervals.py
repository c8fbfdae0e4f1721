"""When something happened that does not belong to the rest of a recording: a hand, a push, a stuck camera.

Two kinds of signals tell it: the smoothed disturbance force on every coordinate, and the whitened innovations of every
channel. Both are Gaussian with one level all the time where the model holds; the level is the robust one of this very
recording, so that what happened in a few seconds does not hide itself. An interval is where the energy of half a second
is beyond what the signal's own correlation allows by chance, and far beyond its usual level. What happened bends the
fit it was found with: the worst is taken out first, the rest is looked at again with a new fit.

Rules of this file: what is usual comes from the recording itself, no level of a device stands here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hoopd.diagnose.engine.dataset import SHORTEST_S, Stretch
from hoopd.diagnose.engine.filtering import smoothed
from hoopd.diagnose.engine.fitting import Fit

Array = NDArray[np.float64]

# Energy is taken over windows of this length; what is nearer than this to its neighbour is one interval.
WINDOW_S = 0.5
# Candidates in 60 s of clean data by the law below, all signals of a recording together; its tails are longer, ten
# times as many are met, and a candidate costs a fit: an alarm it is beyond FAR_BEYOND only.
CHANCE_A_MINUTE = 0.005
# Root of mean square over the usual one: what is less is no candidate, and what is less once it does not bend the fit
# any more belongs to the tails that disturbances and laws left out have without a hand (measured on tuning cases).
CANDIDATE, FAR_BEYOND = 2.5, 5.0
# An interval grows from where it was found to where the energy is this near to the usual one.
GROWN_TO = 3.0
# Larger values do not count for the level and its correlation, in robust standard deviations.
CLIP = 3.0
# At least so many samples before a level is known.
FEWEST = 50
# Seconds at both ends of a stretch in which the smoother knows one side only.
END_S = 0.3
# What is taken out in one round has at least this part of the strongest one's strength.
ROUND_PART = 0.5
MOST_ROUNDS = 3
# More of a recording than this is not set aside: what happens so often is how the plant behaves.
MOST_SHARE = 0.25
# Beyond what was seen of it, this much on either side goes too: its onset is below the noise.
MARGIN_S = 0.1
MAD = 1.4826


class Signal(NamedTuple):
    """How a stretch of time looks in one signal: `where` is a coordinate (a force on it) or a channel."""

    where: str
    kind: str  # "force", "channel"
    strength: float  # root of the largest mean square over the usual one
    level: float  # the usual one, in the unit of the force or the channel


@dataclass(frozen=True)
class Interval:
    """An unusual stretch of time; the signal in which it is strongest names it."""

    recording: str
    t0: float
    t1: float
    signals: tuple[Signal, ...]  # all of the recording, the strongest first

    @property
    def where(self) -> str:
        """Coordinate or channel."""
        return self.signals[0].where

    @property
    def kind(self) -> str:
        """ "force" or "channel"."""
        return self.signals[0].kind

    @property
    def strength(self) -> float:
        """Over the usual level."""
        return self.signals[0].strength


def intervals(fit: Fit) -> list[Interval]:
    """All candidates of all recordings, in the order of time."""
    found: list[Interval] = []
    for recording in dict.fromkeys(track.stretch.recording for track in fit.tracks):
        every = signals_by_name(fit, recording)
        chance = CHANCE_A_MINUTE / len(every)
        spans = merged([span for one in every.values() for span in unusual(one, chance)])
        found += [Interval(recording, *span, _strongest(fit, recording, every, span)) for span in spans]
    return found


Pieces = list[tuple[Array, Array]]


def signals_by_name(fit: Fit, recording: str) -> dict[tuple[str, str], Pieces]:
    """(where, kind) -> (t (n,), x (n,)) of each stretch of a recording."""
    found: dict[tuple[str, str], Pieces] = {}
    for index, track in enumerate(fit.tracks):
        if track.stretch.recording == recording:
            for where, kind, x in signals_of(fit, index):
                found.setdefault((where, kind), []).append((track.stretch.t, x))
    return found


def levels_of(fit: Fit, recording: str) -> dict[tuple[str, str], float]:
    """Usual level of every signal, in the unit of the force or the channel."""
    every = signals_by_name(fit, recording)
    return {name: level_of(pieces) * _unit(fit, recording, *name) for name, pieces in every.items()}


def _unit(fit: Fit, recording: str, where: str, kind: str) -> float:
    """Innovations are in standard deviations of their reading."""
    if kind == "force":
        return 1.0
    channels = next(t.composite.channels for t in fit.tracks if t.stretch.recording == recording)
    return float(fit.noise[recording].reading[channels.index(where)])


def _strongest(
    fit: Fit, recording: str, every: Mapping[tuple[str, str], Pieces], span: tuple[float, float]
) -> tuple[Signal, ...]:
    found = []
    for (where, kind), pieces in every.items():
        level = level_of(pieces)
        within = [_peak(t, x / max(level, 1e-300), *span) for t, x in pieces]
        found.append(Signal(where, kind, max(within), level * _unit(fit, recording, where, kind)))
    return tuple(sorted(found, key=lambda one: -one.strength))


def _peak(t: Array, x: Array, t0: float, t1: float) -> float:
    inside = (t >= t0) & (t <= t1)
    return float(np.sqrt(mean_squares(x, _width(t))[inside].max(initial=0.0)))


def signals_of(fit: Fit, index: int) -> Iterator[tuple[str, str, Array]]:
    """Name, kind and values (n,) of every signal of one track; NaN where nothing was read."""
    track, columns, found = fit.tracks[index], fit.columns[index], fit.gains[index]
    w = disturbance(fit, index)
    t = track.stretch.t
    inner = (t >= t[0] + END_S) & (t <= t[-1] - END_S)
    for j, q in enumerate(track.composite.plant.coordinates):
        yield q, "force", np.where(inner, w[:, j], np.nan)
    innovations = fit.rows[index][:, 0].reshape(len(track.z), -1)
    for j, channel in enumerate(track.composite.channels):
        seen = columns.model.seen[:, j] & (np.abs(found.whiten[:, j, j]) > 0.0)
        yield channel, "channel", np.where(seen & (t >= t[0] + END_S), innovations[:, j], np.nan)


def disturbance(fit: Fit, index: int) -> Array:
    """(n, nq) smoothed disturbance force along one track, in the force's unit."""
    columns, track = fit.columns[index], fit.tracks[index]
    last = smoothed(columns.model, fit.gains[index], columns.f[:, :, 0], columns.eps[:, :, 0])
    return last.d[:, track.composite.nz :]


# ---------------------------------------------------------------------------------------------- taken out


def set_aside(
    stretches: Sequence[Stretch],
    refit: Callable[[Sequence[Stretch]], Fit],
    first: Fit | None = None,
    belongs_not: Callable[[Interval], bool] = lambda one: True,
) -> tuple[list[Stretch], list[Interval], Fit]:
    """Stretches without what does not belong to them (of what is unusual), what that was, and the fit of the rest."""
    found, current = refit(stretches) if first is None else first, list(stretches)
    out: list[Interval] = []
    total = {name: _seconds([s for s in stretches if s.recording == name]) for name in {s.recording for s in stretches}}
    for _ in range(MOST_ROUNDS):
        worst = _worst([one for one in intervals(found) if _may_not_belong(one, belongs_not)])
        worst = [one for one in worst if _share([*out, *worst], one.recording, total) <= MOST_SHARE]
        kept, trial = _without(current, worst, refit) if worst else (current, found)
        confirmed = [one for one in _confirmed(worst, trial) if belongs_not(one)]
        if not confirmed:
            break
        if len(confirmed) < len(worst):
            kept, trial = _without(current, confirmed, refit)
        current, found, out = kept, trial, [*out, *confirmed]
    return current, sorted(out, key=lambda one: (one.recording, one.t0)), found


def _without(
    stretches: Sequence[Stretch], out: Sequence[Interval], refit: Callable[[Sequence[Stretch]], Fit]
) -> tuple[list[Stretch], Fit]:
    kept = [piece for one in stretches for piece in _cut(one, out)]
    return kept, refit(kept)


def _may_not_belong(one: Interval, belongs_not: Callable[[Interval], bool]) -> bool:
    """Whether any of the signals in which it shows would say so."""
    named = [replace(one, signals=(signal,)) for signal in one.signals if signal.strength >= CANDIDATE]
    return any(belongs_not(each) for each in named)


def _confirmed(candidates: Sequence[Interval], without: Fit) -> list[Interval]:
    """Those far beyond the level of a fit that they do not bend, as they look against that level."""
    found = []
    for one in candidates:
        now = levels_of(without, one.recording)
        signals = [
            s._replace(strength=s.strength * s.level / max(level, 1e-300), level=level)
            for s in one.signals
            if (level := now.get((s.where, s.kind), s.level)) > 0.0
        ]
        again = replace(one, signals=tuple(sorted(signals, key=lambda s: -s.strength)))
        if again.strength >= FAR_BEYOND:
            found.append(again)
    return found


def _worst(found: Sequence[Interval]) -> list[Interval]:
    most = max((one.strength for one in found), default=0.0)
    return [one for one in found if one.strength >= ROUND_PART * most]


def _share(out: Sequence[Interval], recording: str, total: Mapping[str, float]) -> float:
    return sum(one.t1 - one.t0 for one in out if one.recording == recording) / max(total[recording], 1e-9)


def _seconds(stretches: Sequence[Stretch]) -> float:
    return float(sum(one.t[-1] - one.t[0] for one in stretches))


def _cut(stretch: Stretch, out: Sequence[Interval]) -> list[Stretch]:
    pieces = [stretch]
    for one in out:
        if one.recording == stretch.recording:
            # what is unusual right from the start has been so before
            begin = one.t0 - MARGIN_S if one.t0 > stretch.t[0] + 2 * END_S else -np.inf
            ends = (-np.inf, begin), (one.t1 + MARGIN_S, np.inf)
            pieces = [piece.seconds(*end) for piece in pieces for end in ends]
    return [piece for piece in pieces if len(piece.t) > 1 and piece.t[-1] - piece.t[0] >= SHORTEST_S]


# ---------------------------------------------------------------------------------------------- one signal


def unusual(pieces: Sequence[tuple[Array, Array]], chance_a_minute: float) -> list[tuple[float, float]]:
    """(t0, t1) of one signal in pieces (t (n,), x (n,)) of one recording."""
    level = level_of(pieces)
    if level <= 0.0:
        return []
    step = float(np.median(np.concatenate([np.diff(t) for t, _ in pieces])))
    width = _width(pieces[0][0])
    needed = max(CANDIDATE**2, threshold([x / level for _, x in pieces], width, step, chance_a_minute))
    return [one for t, x in pieces for one in _found(t, x / level, width, needed)]


def _width(t: Array) -> int:
    """Samples of a window."""
    return max(3, round(WINDOW_S / float(np.median(np.diff(t)))))


def level_of(pieces: Sequence[tuple[Array, Array]]) -> float:
    """Robust level of a signal in pieces; 0 when there is too little of it."""
    known = np.concatenate([x[np.isfinite(x)] for _, x in pieces])
    return robust_level(known) if len(known) >= FEWEST else 0.0


def robust_level(x: Array) -> float:
    """Standard deviation of what is not far out (n,)."""
    return float(MAD * np.median(np.abs(x)))


def threshold(pieces: Sequence[Array], width: int, step: float, chance_a_minute: float) -> float:
    """Mean square of a window that chance exceeds so seldom: chi2 with as many degrees as the correlation leaves."""
    rho = correlation(pieces, width)
    # var(mean of x^2) = 2/width^2 sum (width - |k|) rho_k^2 = 2/nu
    lags = np.arange(1, width)
    nu = width**2 / (width + 2.0 * np.sum((width - lags) * rho**2))
    # neighbouring windows overlap: in effect so many are tried
    tries = 60.0 / step / width * 4.0
    return float(chi2.isf(chance_a_minute / tries, nu) / nu)


def correlation(pieces: Sequence[Array], width: int) -> Array:
    """(width-1,) autocorrelation of a signal of robust level 1 at lags 1, 2, ..., its far values clipped."""
    clipped = [np.clip(np.nan_to_num(x), -CLIP, CLIP) for x in pieces]
    energy = sum(float(x @ x) for x in clipped)
    return np.array([sum(float(x[:-k] @ x[k:]) for x in clipped) / max(energy, 1e-300) for k in range(1, width)])


def mean_squares(x: Array, width: int) -> Array:
    """(n,) mean of x^2 over what is known of the window around each sample; 0 where that is less than a third."""
    known = np.isfinite(x)
    kernel = np.ones(width)
    count = np.convolve(known.astype(float), kernel, "same")[: len(x)]
    total = np.convolve(np.where(known, x, 0.0) ** 2, kernel, "same")[: len(x)]
    return np.where(count >= width / 3, total / np.maximum(count, 1.0), 0.0)


def _found(t: Array, x: Array, width: int, needed: float) -> list[tuple[float, float]]:
    if len(x) < width:
        return []
    energy, found = mean_squares(x, width), []
    for a, b in _runs(energy > GROWN_TO):
        if energy[a:b].max() > needed:
            first, last = _trimmed(x, a, b)
            found.append((float(t[first]), float(t[last])))
    return found


def _trimmed(x: Array, a: int, b: int) -> tuple[int, int]:
    """Without the half windows at both ends in which the signal itself is usual."""
    loud = np.flatnonzero(np.nan_to_num(np.abs(x[a:b])) > CLIP)
    return (a, b - 1) if len(loud) == 0 else (a + int(loud[0]), a + int(loud[-1]))


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def merged(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Spans nearer than a window are one."""
    kept: list[tuple[float, float]] = []
    for t0, t1 in sorted(spans):
        if kept and t0 <= kept[-1][1] + WINDOW_S:
            kept[-1] = (kept[-1][0], max(kept[-1][1], t1))
        else:
            kept.append((t0, t1))
    return kept
