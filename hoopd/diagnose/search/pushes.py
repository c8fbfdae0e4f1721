"""The two times of a push: a force of constant size between t0 and t1 of one recording.

Its score at any pair of times is a moving sum of the adjoint of its force.

Rules of this file: a push belongs to one recording; in the others its ends stay where they start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from hoopd.diagnose.search.adjoint import Adjoint, AdjointAnswer, independent
from hoopd.diagnose.search.scan_score import Scanned, ScanPlace, scanned, usual_size
from hoopd.diagnose.search.screen import Column, Member, Score, Screen, score_of
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.usual_sizes import time_scale
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# Lengths of pushes, each longer by this ratio: a push taken 7 % too long loses 7 % of its gain.
SHORTEST_S, LONGEST_S, LENGTH_RATIO = 0.1, 3.0, 1.15
# So many are scored exactly, and the best of them refined; two share less than this part of the time both cover.
MOST_PUSHES, REFINED, MOST_SHARED = 5, 2, 0.5
# Edges are moved by steps of at most so long, so many times; slopes by them are taken over a shorter step.
EDGE_STEP_S, EDGE_STEPS, EDGE_SLOPE_S = 0.06, 5, 0.005
# Gains of the same push, scored beside other ones, are this near.
ROUNDING_NATS = 1e-6
# A push shows in the readings of so long after it began: later ones are no more than bad last readings.
LATEST_S = 0.2
# A level below this share of the median is one of a window without readings.
LEAST_LEVEL = 1e-3
# Before and after every recording.
ALWAYS_S = 1e6


def pushes(screen: Screen, effect: Effect) -> list[Scanned]:
    """The best few; none where no recording has the effect's slot."""
    name, usual, _ = usual_size(effect)
    slower = _slower(screen)
    always = {name: usual, "t0": -ALWAYS_S * slower, "t1": ALWAYS_S * slower}
    answers = Adjoint(screen).to_effect(effect, always)
    if not answers:
        return []
    found, candidates = best_windows(
        answers, lengths(SHORTEST_S * slower, LONGEST_S * slower), MOST_PUSHES, LATEST_S * slower
    )
    members = [_member(effect, str(one.recording), one.shape) for one in found]
    best = sorted(zip(_exact(screen, members), found, strict=True), key=lambda pair: -pair[0].gain)
    placed = [_edges_moved(screen, one) for one, _ in best[:REFINED]] + [one for one, _ in best[REFINED:]]
    return [scanned(one, 1, candidates) for one in placed]


def _slower(screen: Screen) -> float:
    """Times of the motion over usual ones."""
    return min(motion_scale(track.stretch.plant) for track in screen.fit.tracks)


def lengths(shortest_s: float, longest_s: float) -> Array:
    """In equal ratios."""
    count = int(np.ceil(np.log(longest_s / shortest_s) / np.log(LENGTH_RATIO))) + 1
    return np.geomspace(shortest_s, longest_s, count)


def best_windows(
    answers: Sequence[AdjointAnswer], lengths_s: Array, most: int, latest_s: float = LATEST_S
) -> tuple[list[ScanPlace], float]:
    """The windows of largest gain, apart in place or length, and how many independent ones were looked at."""
    found: list[ScanPlace] = []
    largest = np.zeros(answers[0].slope.shape[1] - 1)
    for one in answers:
        for length in lengths_s[lengths_s < one.length_s / 2]:
            t0, t1, gain = _windows(one, float(length), latest_s)
            largest = np.maximum(largest, gain[:, 1:].max(axis=0))
            spread = max(float(np.median(gain[:, 0])) / max(float(np.median(gain[:, 1:])), 1e-12), 1.0)
            top = np.argsort(-gain[:, 0])[: 50 * most]
            found += [
                ScanPlace(float(gain[i, 0]), spread, {"t0": float(t0[i]), "t1": float(t1[i])}, one.recording)
                for i in top
            ]
    return _apart(found, most), independent(largest, 1)


def _windows(one: AdjointAnswer, length: float, latest_s: float) -> tuple[Array, Array, Array]:
    """Starts and ends (n,) of all windows of this length, and their gains (n, 1+draws)."""
    total = np.concatenate([np.zeros((1, one.slope.shape[1])), np.cumsum(one.slope, axis=0)])
    edges = np.append(one.t, one.t[-1] + one.h[-1])
    first = np.arange(np.searchsorted(edges, edges[-1] - max(length, latest_s)) + 1)
    # the edge nearest to the end of the window
    last = np.searchsorted(edges, edges[first] + length - float(np.median(one.h)) / 2)
    first, last = first[last < len(edges)], last[last < len(edges)]
    s = total[last] - total[first]
    level = np.mean(s[:, 1:] ** 2, axis=1)
    level = uniform_filter1d(level, 2 * (max(int(last[0] - first[0]), 1) // 2) + 1, mode="nearest")
    level = np.maximum(level, LEAST_LEVEL * np.median(level))
    # gain = s^2/(2 J)
    return edges[first], edges[last], s**2 / np.maximum(2 * level, 1e-300)[:, None]


def _apart(found: Sequence[ScanPlace], most: int) -> list[ScanPlace]:
    chosen: list[ScanPlace] = []
    for one in sorted(found, key=lambda place: -place.gain / place.spread):
        if len(chosen) < most and all(_shared(one, other) < MOST_SHARED for other in chosen):
            chosen.append(one)
    return chosen


def _shared(a: ScanPlace, b: ScanPlace) -> float:
    """Time in both windows over the time in either."""
    if a.recording != b.recording:
        return 0.0
    both = min(a.shape["t1"], b.shape["t1"]) - max(a.shape["t0"], b.shape["t0"])
    either = max(a.shape["t1"], b.shape["t1"]) - min(a.shape["t0"], b.shape["t0"])
    return max(both, 0.0) / max(either, 1e-9)


def _member(effect: Effect, recording: str, shape: dict[str, float]) -> Member:
    a = next(p for p in effect.parameters if p.role == "amplitude")
    name, usual, most = usual_size(effect)
    column = Column((*shape.items(), (name, usual)), recording, a.low >= a.neutral, most)
    return Member(effect, shape, (column,))


def _exact(screen: Screen, members: Sequence[Member]) -> list[Score]:
    z = _whitened(screen, members)
    return [_placed(screen, score_of(one, z[:, i : i + 1], screen.residual)) for i, one in enumerate(members)]


def _whitened(screen: Screen, members: Sequence[Member]) -> Array:
    return screen.whitened([(one.effect, one.columns[0]) for one in members])


def _placed(screen: Screen, score: Score) -> Score:
    """With the times of every recording in place of the common ones; neutral where there is no push."""
    effect, own = score.member.effect, score.member.columns[0].recording
    start = {k: v for k, v in score.start.items() if k.rsplit(".", 1)[1] not in score.member.shape}
    for name, value in score.member.shape.items():
        for r in screen.recordings:
            start[f"{effect.key(name)}@{r}"] = value if r == own else effect.parameter(name).neutral
    return replace(score, start=start)


def _edges_moved(screen: Screen, best: Score) -> Score:
    """Gauss-Newton on both edges: r = a z + a d0 dz/dt0 + a d1 dz/dt1."""
    effect, recording, shape = best.member.effect, str(best.member.columns[0].recording), best.member.shape
    later = EDGE_SLOPE_S * time_scale(screen.fit.tracks[0].stretch.plant)
    for _ in range(EDGE_STEPS):
        varied = [{**shape, name: shape[name] + later} for name in ("t0", "t1")]
        members = [_member(effect, recording, one) for one in (shape, *varied)]
        z = _whitened(screen, members)
        score = _placed(screen, score_of(members[0], z[:, :1], screen.residual))
        if score.gain < best.gain - ROUNDING_NATS:
            break
        best, shape = score, _moved(shape, z, screen.residual, later)
    return best


def _moved(shape: Mapping[str, float], z: Array, residual: Array, later: float) -> dict[str, float]:
    """Times after a step; z (rows, 3): the push, and the same with either edge `later` seconds later."""
    slopes = np.column_stack([z[:, 0], (z[:, 1:] - z[:, :1]) / later])
    most = EDGE_STEP_S / EDGE_SLOPE_S * later
    a, *moves = np.linalg.lstsq(slopes, residual, rcond=None)[0]
    d0, d1 = (float(np.clip(move / a, -most, most)) if a else 0.0 for move in moves)
    t0 = max(shape["t0"] + d0, 0.0)
    return {"t0": t0, "t1": max(shape["t1"] + d1, t0 + later)}
