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

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hoopd.diagnose.dataset import SHORTEST_S, Stretch
from hoopd.diagnose.filtering import smoothed
from hoopd.diagnose.fitting import Fit

Array = NDArray[np.float64]

# Energy is taken over windows of this length; what is nearer than this to its neighbour is one interval.
WINDOW_S = 0.5
# False alarms in 60 s of clean data, all signals of a recording together.
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


@dataclass(frozen=True)
class Interval:
    """An unusual stretch: `where` is a coordinate (a force on it) or a channel."""

    recording: str
    t0: float
    t1: float
    where: str
    kind: str  # "force", "channel"
    strength: float  # largest mean square over the usual one, as a root
    level: float  # the usual one, in the unit of the force or the channel


def intervals(fit: Fit) -> list[Interval]:
    """All candidates of all recordings, in the order of time; of overlapping ones the strongest names it."""
    found: list[Interval] = []
    for recording in dict.fromkeys(track.stretch.recording for track in fit.tracks):
        parts = [i for i, track in enumerate(fit.tracks) if track.stretch.recording == recording]
        signals = [list(signals_of(fit, i)) for i in parts]
        for k, (where, kind, _) in enumerate(signals[0]):
            pieces = [(fit.tracks[i].stretch.t, own[k][2]) for i, own in zip(parts, signals, strict=True)]
            chance = CHANCE_A_MINUTE / len(signals[0])
            level = _level(fit, parts[0], k, [x for _, x in pieces])
            found += [
                Interval(recording, t0, t1, where, kind, strength, level)
                for t0, t1, strength in unusual(pieces, chance)
            ]
    return _merged(found)


def _level(fit: Fit, index: int, k: int, values: Sequence[Array]) -> float:
    """Robust level of the k-th signal; of innovations in the channel's unit."""
    known = np.concatenate([x[np.isfinite(x)] for x in values])
    level = robust_level(known) if len(known) else 0.0
    channel = k - fit.tracks[index].composite.nq
    return level if channel < 0 else level * float(fit.noise[fit.tracks[index].stretch.recording].reading[channel])


def levels_of(fit: Fit) -> dict[tuple[str, str, str], float]:
    """Level of every signal by recording, where and kind."""
    found = {}
    for recording in dict.fromkeys(track.stretch.recording for track in fit.tracks):
        parts = [i for i, track in enumerate(fit.tracks) if track.stretch.recording == recording]
        signals = [list(signals_of(fit, i)) for i in parts]
        for k, (where, kind, _) in enumerate(signals[0]):
            found[recording, where, kind] = _level(fit, parts[0], k, [own[k][2] for own in signals])
    return found


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
        worst = _worst([one for one in intervals(found) if belongs_not(one)])
        worst = [one for one in worst if _share([*out, *worst], one.recording, total) <= MOST_SHARE]
        kept, trial = _without(current, worst, refit) if worst else (current, found)
        confirmed = _confirmed(worst, trial)
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


def _confirmed(candidates: Sequence[Interval], without: Fit) -> list[Interval]:
    """Those far beyond the level of a fit that they do not bend, with their strength against that level."""
    now = levels_of(without)
    found = []
    for one in candidates:
        level = max(now.get((one.recording, one.where, one.kind), one.level), 1e-300)
        strength = one.strength * one.level / level
        if strength >= FAR_BEYOND:
            found.append(replace(one, strength=strength))
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


def unusual(pieces: Sequence[tuple[Array, Array]], chance_a_minute: float) -> list[tuple[float, float, float]]:
    """(t0, t1, strength) of one signal in pieces (t (n,), x (n,)) of one recording."""
    known = np.concatenate([x[np.isfinite(x)] for _, x in pieces])
    if len(known) < FEWEST:
        return []
    level = max(robust_level(known), 1e-300)
    step = float(np.median(np.concatenate([np.diff(t) for t, _ in pieces])))
    width = max(3, round(WINDOW_S / step))
    needed = max(CANDIDATE**2, threshold([x / level for _, x in pieces], width, step, chance_a_minute))
    return [one for t, x in pieces for one in _found(t, x / level, width, needed)]


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


def _found(t: Array, x: Array, width: int, needed: float) -> list[tuple[float, float, float]]:
    if len(x) < width:
        return []
    energy = mean_squares(x, width)
    found = []
    for a, b in _runs(energy > GROWN_TO):
        if energy[a:b].max() > needed:
            first, last = _trimmed(x, a, b)
            found.append((float(t[first]), float(t[last]), float(np.sqrt(energy[a:b].max()))))
    return found


def _trimmed(x: Array, a: int, b: int) -> tuple[int, int]:
    """Without the half windows at both ends in which the signal itself is usual."""
    loud = np.flatnonzero(np.nan_to_num(np.abs(x[a:b])) > CLIP)
    return (a, b - 1) if len(loud) == 0 else (a + int(loud[0]), a + int(loud[-1]))


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _merged(found: list[Interval]) -> list[Interval]:
    """One for each stretch of time; the strongest signal names it."""
    kept: list[Interval] = []
    for one in sorted(found, key=lambda i: (i.recording, i.t0, i.where)):
        last = kept[-1] if kept else None
        if last is None or last.recording != one.recording or one.t0 > last.t1 + WINDOW_S:
            kept.append(one)
            continue
        strong = max(last, one, key=lambda i: i.strength)
        kept[-1] = replace(strong, t0=last.t0, t1=max(last.t1, one.t1))
    return kept
