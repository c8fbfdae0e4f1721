"""When something happened that does not belong to the rest of a recording: a hand, a push, a stuck camera.

Two kinds of signals tell it: the smoothed disturbance force on every coordinate, and the whitened innovations of every
channel. Both are Gaussian with one level all the time where the model holds. An interval is where the energy of half a
second is beyond what the signal's own correlation allows by chance, and far beyond its usual level (`unusual`).

Rules of this file: it reads a fit; what is done with an interval is in `excluded_stretches`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.unusual_energy import level_of, mean_squares, merged, unusual, width_of
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import smoothed
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# Candidates in 60 s of clean data by the law of `unusual`, all signals of a recording together; its tails are longer,
# ten times as many are met, and a candidate costs a fit: an alarm it is far beyond the usual level only.
CHANCE_A_MINUTE = 0.005
# Root of mean square of innovations, over what the fitted noise allows, from which on a reading shows anything: where
# readings have no noise, all of them are within it, and what is left is of the solver.
SHOWN = 0.5
# Seconds at both ends of a stretch in which the smoother knows one side only.
END_S = 0.3


# Kind of a signal that is no energy: the plant nears the end of the mode that its equations describe.
MODE = "mode"


class UnusualSignal(NamedTuple):
    """How a stretch of time looks in one signal: `where` is a coordinate (a force on it), a channel or a mode."""

    where: str
    kind: str  # "force", "channel", MODE
    strength: float  # root of the largest mean square over the usual one
    level: float  # the usual one, in the unit of the force or the channel


@dataclass(frozen=True)
class Interval:
    """An unusual stretch of time; the signal in which it is strongest names it."""

    recording: str
    t0: float
    t1: float
    signals: tuple[UnusualSignal, ...]  # all of the recording, the strongest first

    @property
    def where(self) -> str:
        """Coordinate, channel or mode."""
        return self.signals[0].where

    @property
    def kind(self) -> str:
        """ "force", "channel" or MODE."""
        return self.signals[0].kind

    @property
    def strength(self) -> float:
        """Over the usual level."""
        return self.signals[0].strength

    @property
    def reason(self) -> str:
        """Why it is set aside."""
        if self.kind == MODE:
            return f"{self.where} nears its end ({max(self.strength, 0.0):.0%} of what holds it at rest is left)"
        return f"{self.where}: does not belong to the rest"


def intervals(fit: HypothesisFit) -> list[Interval]:
    """All candidates of all recordings, in the order of time."""
    found: list[Interval] = []
    for recording in fit.recordings:
        every = signals_by_name(fit, recording)
        chance, slower = CHANCE_A_MINUTE / len(every), _slower(fit, recording)
        spans = merged([span for one in every.values() for span in unusual(one, chance, slower)], slower)
        spans = [span for span in spans if _is_shown(every, span, slower)]
        found += [Interval(recording, *span, strongest(fit, recording, every, span)) for span in spans]
    return found


Pieces = list[tuple[Array, Array]]


def signals_by_name(fit: HypothesisFit, recording: str) -> dict[tuple[str, str], Pieces]:
    """(where, kind) -> (t (n,), x (n,)) of each stretch of a recording."""
    found: dict[tuple[str, str], Pieces] = {}
    for index, track in enumerate(fit.tracks):
        if track.stretch.recording == recording:
            for where, kind, x in signals_of(fit, index):
                found.setdefault((where, kind), []).append((track.stretch.t, x))
    return found


def levels_of(fit: HypothesisFit, recording: str) -> dict[tuple[str, str], float]:
    """Usual level of every signal, in the unit of the force or the channel."""
    every = signals_by_name(fit, recording)
    return {name: level_of(pieces) * _unit(fit, recording, *name) for name, pieces in every.items()}


def _unit(fit: HypothesisFit, recording: str, where: str, kind: str) -> float:
    """Innovations are in standard deviations of their reading."""
    if kind == "force":
        return 1.0
    channels = next(t.composite.channels for t in fit.tracks if t.stretch.recording == recording)
    return float(fit.noise[recording].reading[channels.index(where)])


def strongest(
    fit: HypothesisFit, recording: str, every: Mapping[tuple[str, str], Pieces], span: tuple[float, float]
) -> tuple[UnusualSignal, ...]:
    """How a span looks in every signal, the strongest first."""
    found, slower = [], _slower(fit, recording)
    for (where, kind), pieces in every.items():
        level = level_of(pieces)
        within = [_peak(t, x / max(level, 1e-300), *span, slower) for t, x in pieces]
        found.append(UnusualSignal(where, kind, max(within), level * _unit(fit, recording, where, kind)))
    return tuple(sorted(found, key=lambda one: -one.strength))


def _is_shown(every: Mapping[tuple[str, str], Pieces], span: tuple[float, float], slower: float) -> bool:
    """Whether any channel's innovations are beyond the noise of its readings there."""
    innovations = [pieces for (_, kind), pieces in every.items() if kind == "channel"]
    return any(_peak(t, x, *span, slower) >= SHOWN for pieces in innovations for t, x in pieces)


def _slower(fit: HypothesisFit, recording: str) -> float:
    """Times of the motion over usual ones."""
    return min(motion_scale(track.stretch.plant) for track in fit.tracks if track.stretch.recording == recording)


def _peak(t: Array, x: Array, t0: float, t1: float, slower: float) -> float:
    inside = (t >= t0) & (t <= t1)
    return float(np.sqrt(mean_squares(x, width_of(t, slower))[inside].max(initial=0.0)))


def signals_of(fit: HypothesisFit, index: int) -> Iterator[tuple[str, str, Array]]:
    """Name, kind and values (n,) of every signal of one track; NaN where nothing was read."""
    track, columns, found = fit.tracks[index], fit.columns[index], fit.gains[index]
    w = disturbance(fit, index)
    t, end = track.stretch.t, END_S * motion_scale(track.stretch.plant)
    inner = (t >= t[0] + end) & (t <= t[-1] - end)
    for j, q in enumerate(track.stretch.plant.disturbed):
        yield q, "force", np.where(inner, w[:, j], np.nan)
    innovations = fit.rows[index][:, 0].reshape(len(track.z), -1)
    for j, channel in enumerate(track.composite.channels):
        seen = columns.model.seen[:, j] & (np.abs(found.whiten[:, j, j]) > 0.0)
        yield channel, "channel", np.where(seen & (t >= t[0] + end), innovations[:, j], np.nan)


def disturbance(fit: HypothesisFit, index: int) -> Array:
    """(n, nq) smoothed disturbance force along one track, in the force's unit."""
    columns, track = fit.columns[index], fit.tracks[index]
    last = smoothed(columns.model, fit.gains[index], columns.f[:, :, 0], columns.eps[:, :, 0])
    return last.d[:, track.composite.nz :]
