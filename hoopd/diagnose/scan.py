"""Effects whose shape needs a search of its own: a frequency, or two times.

An effect of `found_by="scan"` is tried at thousands of values of its shape parameters: its score at each is an inner
product with the adjoint (`adjoint`), its level comes from what white noise would make of the same products. The best
few are then whitened exactly and scored as every other effect is, and refined. What is searched is read from the
parameters: a shape in rad/s with a phase is a frequency; two shapes in s called t0, t1 are a pulse in one recording;
any other scan goes through its grid.

Rules of this file: a gain says how many places were looked at; a scan proposes, a fit decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import atan2, inf, log, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from hoopd.diagnose.adjoint import Adjoint, Answer, independent, looked_at
from hoopd.diagnose.screen import Column, Member, Score, Screen, members_of, score_of
from hoopd.physics.effects.base import Effect

Array = NDArray[np.float64]

# Frequencies in a resolution cell of 2 pi/T: half a step off the peak costs 1 % of its gain.
FREQUENCIES_A_CELL = 8
# Levels by frequency: of the model over so many cells, of the data over more, so that a line does not lift its own.
MODEL_CELLS, DATA_CELLS = 3, 31
# Lengths of pulses, each longer by this ratio: a pulse of 7 % the wrong length loses 7 % of its gain.
SHORTEST_S, LONGEST_S, LENGTH_RATIO = 0.1, 3.0, 1.15
# Scored exactly, of each kind; of those, the best few are refined.
MOST_PEAKS, MOST_PULSES, REFINED = 6, 5, 2
# Two peaks are apart by as many cells; two pulses share less than this part of the time that both cover.
CELLS_APART, MOST_SHARED = 1.5, 0.5
# A pulse's edges are moved by steps of at most so long, so many times; their slopes are taken over a shorter one.
EDGE_STEP_S, EDGE_STEPS, EDGE_SLOPE_S = 0.06, 4, 0.005
ALWAYS_S = 1e6


@dataclass(frozen=True)
class Scanned(Score):
    """A score that is the best of many."""

    looked_at: float = 1.0  # as many independent candidates of chance exp(-gain) each
    spread: float = 1.0  # gains of the candidates around over those the model expects; not below 1

    @property
    def threshold_equivalent(self) -> float:
        """Nats: on a null, it exceeds x in a share exp(-x) of all cases."""
        return self.gain - log(self.looked_at)


class Place(NamedTuple):
    """A candidate before it is scored exactly."""

    gain: float
    spread: float
    shape: dict[str, float]
    recording: str | None = None


def scan(screen: Screen, effect: Effect) -> Scanned | None:
    """The best of an effect's places; None where no recording can show it."""
    return next(iter(places(screen, effect)), None)


def places(screen: Screen, effect: Effect) -> list[Scanned]:
    """The best few of an effect's places, exactly scored, best first; none for an effect that the fit has already."""
    if effect.name in screen.fit.names:
        return []
    found = _search_of(effect)(screen, effect)
    return sorted((one for one in found if one.gain > 0.0), key=lambda one: -one.gain)


def _search_of(effect: Effect) -> Callable[[Screen, Effect], list[Scanned]]:
    shapes = {p.name: p.unit for p in effect.parameters if p.role == "shape"}
    phased = any(p.role == "phase" for p in effect.parameters)
    if effect.force is not None and phased and list(shapes.values()) == ["rad/s"]:
        return _tones
    if effect.force is not None and shapes == {"t0": "s", "t1": "s"}:
        return _pulses
    return _grid


def _grid(screen: Screen, effect: Effect) -> list[Scanned]:
    members = members_of(effect, screen.recordings)
    z = screen.whitened([(effect, column) for member in members for column in member.columns])
    ends = np.cumsum([len(member.columns) for member in members])[:-1]
    scores = [score_of(m, part, screen.residual) for m, part in zip(members, np.split(z, ends, axis=1), strict=True)]
    return [
        _scanned(one, looked_at(one.gain, len(members), len(one.member.columns)))
        for one in scores if np.any(one.vector)
    ]  # fmt: skip


def _scanned(score: Score, looked: float, spread: float = 1.0) -> Scanned:
    return Scanned(score.member, score.gain, score.start, score.vector, looked, spread)


def _amplitude(effect: Effect) -> tuple[str, float, float]:
    """Name, usual value and the largest multiple of its distance from neutral."""
    a = next(p for p in effect.parameters if p.role == "amplitude")
    return a.name, a.neutral + a.size, (a.high - a.neutral) / a.size


# ---------------------------------------------------------------------------------------------- frequencies


class Spectrum(NamedTuple):
    """Gains by frequency, of the data and of white rows."""

    w: Array  # (nf,)
    cell: float  # rad/s, 2 pi over the longest recording
    gain: Array  # (nf, 1+draws)
    spread: Array  # (nf,) of the data


def _tones(screen: Screen, effect: Effect) -> list[Scanned]:
    answers = Adjoint(screen).to_effect(effect, _steady(effect))
    if not answers:
        return []
    spectrum, freedom = _spectrum(answers, effect), len(answers) + 1
    candidates = independent(spectrum.gain[:, 1:].max(axis=0), freedom)
    frequency, score = _frequency(effect), _tone_scorer(screen, effect)
    best = [(one, score(one.shape[frequency])) for one in _peaks(spectrum, frequency)]
    best.sort(key=lambda pair: -pair[1].gain)
    refined = [(place, _finest(score, one, frequency, spectrum.cell / 4)) for place, one in best[:REFINED]]
    return [
        _scanned(one, looked_at(one.gain, candidates, freedom), place.spread) for place, one in refined + best[REFINED:]
    ]


def _frequency(effect: Effect) -> str:
    return next(p.name for p in effect.parameters if p.role == "shape")


def _phase(effect: Effect) -> str:
    return next(p.name for p in effect.parameters if p.role == "phase")


def _steady(effect: Effect) -> dict[str, float]:
    """The values at which A sin(w t + phi) is its amplitude: w = 0, phi = pi/2."""
    name, usual, _ = _amplitude(effect)
    return {name: usual, _frequency(effect): 0.0, _phase(effect): pi / 2}


def _spectrum(answers: Sequence[Answer], effect: Effect) -> Spectrum:
    """Amplitude common, phases free: sum over r of A rho_r - A^2 J_r/2 is at most (sum rho)^2/(2 sum J)."""
    p = effect.parameter(_frequency(effect))
    cell = 2 * pi / max(one.length_s for one in answers)
    w = np.arange(p.low, p.high, cell / FREQUENCIES_A_CELL)
    rho, level = 0.0, 0.0
    for one in answers:
        # S(w) = sum of e^(i w t) e_k,  E |S|^2 = 2 J
        s = np.abs(_transform(w, one.t + one.h / 2, one.slope))
        own = np.mean(s[:, 1:] ** 2, axis=1) / 2
        rho, level = rho + s, level + uniform_filter1d(own, MODEL_CELLS * FREQUENCIES_A_CELL, mode="nearest")
    gain = np.asarray(rho**2 / np.maximum(2 * level, 1e-300)[:, None])
    around = median_filter(gain[:, 0], min(DATA_CELLS * FREQUENCIES_A_CELL, len(w)), mode="nearest")
    return Spectrum(w, cell, gain, np.maximum(around / np.median(gain[:, 1:]), 1.0))


def _transform(w: Array, t: Array, x: Array) -> Array:
    """(nf, m) sums of e^(i w t) x over time, frequency by frequency."""
    turn, step = np.exp(1j * w[0] * t), np.exp(1j * (w[1] - w[0]) * t)
    out = np.empty((len(w), x.shape[1]), dtype=complex)
    for i in range(len(w)):
        out[i] = turn.real @ x + 1j * (turn.imag @ x)
        turn = turn * step
    return out


def _peaks(s: Spectrum, name: str) -> list[Place]:
    """The largest local maxima against their surroundings, apart from each other."""
    height = s.gain[:, 0] / s.spread
    padded = np.concatenate([[-inf], height, [-inf]])
    tops = np.flatnonzero((height > padded[:-2]) & (height >= padded[2:]))
    chosen: list[int] = []
    for i in tops[np.argsort(-height[tops])]:
        if len(chosen) < MOST_PEAKS and all(abs(s.w[i] - s.w[j]) > CELLS_APART * s.cell for j in chosen):
            chosen.append(int(i))
    return [Place(float(s.gain[i, 0]), float(s.spread[i]), {name: float(s.w[i])}) for i in chosen]


def _tone_scorer(screen: Screen, effect: Effect) -> Callable[[float], Score]:
    name, usual, most = _amplitude(effect)
    frequency, phase = _frequency(effect), _phase(effect)

    def score(w: float) -> Score:
        fixed = ((frequency, w), (name, usual))
        columns = tuple(Column((*fixed, (phase, at)), r) for r in screen.recordings for at in (0.0, pi / 2))
        member = Member(effect, {frequency: w}, columns)
        return _common(member, screen.whitened([(effect, c) for c in columns]), screen.residual, most)

    return score


def _common(member: Member, z: Array, residual: Array, most: float) -> Score:
    """Score of pairs of columns (sine, cosine) by recording with one amplitude and free phases."""
    effect, turns, change = member.effect, {}, np.zeros_like(residual)
    for i in range(0, z.shape[1], 2):
        pair = z[:, i : i + 2]
        if np.any(pair):
            a, b = np.linalg.lstsq(pair, residual, rcond=None)[0]
            phi = turns[member.columns[i].recording] = atan2(b, a)
            change = change + pair @ [np.cos(phi), np.sin(phi)]
    size = float(np.clip(change @ residual / max(change @ change, 1e-300), 0.0, most))
    change = size * change
    name, usual, _ = _amplitude(effect)
    start = {effect.key(k): v for k, v in member.shape.items()}
    start[effect.key(name)] = size * usual
    start.update({f"{effect.key(_phase(effect))}@{r}": phi for r, phi in turns.items()})
    return Score(member, float(change @ residual - change @ change / 2), start, change)


def _finest(score: Callable[[float], Score], middle: Score, frequency: str, step: float) -> Score:
    """The best of a frequency, its neighbours and the top of the parabola through the three gains."""
    w = middle.member.shape[frequency]
    low, high = score(w - step), score(w + step)
    bend = low.gain - 2 * middle.gain + high.gain
    tried = [middle, low, high]
    if bend < 0.0:
        tried.append(score(w + float(np.clip(0.5 * (low.gain - high.gain) / bend, -1.0, 1.0)) * step))
    return max(tried, key=lambda one: one.gain)


# ---------------------------------------------------------------------------------------------- pulses


def _pulses(screen: Screen, effect: Effect) -> list[Scanned]:
    name, usual, _ = _amplitude(effect)
    always = {name: usual, "t0": -ALWAYS_S, "t1": ALWAYS_S}
    answers = Adjoint(screen).to_effect(effect, always)
    if not answers:
        return []
    found, candidates = best_windows(answers, lengths(SHORTEST_S, LONGEST_S), MOST_PULSES)
    scored = [(one, pulse_score(screen, effect, str(one.recording), one.shape)) for one in found]
    scored.sort(key=lambda pair: -pair[1].gain)
    refined = [(place, _edges_moved(screen, one)) for place, one in scored[:REFINED]]
    return [
        _scanned(one, looked_at(one.gain, candidates, 1), place.spread) for place, one in refined + scored[REFINED:]
    ]


def lengths(shortest_s: float, longest_s: float) -> Array:
    """In equal ratios."""
    count = int(np.ceil(np.log(longest_s / shortest_s) / np.log(LENGTH_RATIO))) + 1
    return np.geomspace(shortest_s, longest_s, count)


def best_windows(answers: Sequence[Answer], lengths_s: Array, most: int) -> tuple[list[Place], float]:
    """The windows of largest gain, apart in place or length, and how many independent ones were looked at."""
    found: list[Place] = []
    largest = np.zeros(answers[0].slope.shape[1] - 1)
    for one in answers:
        for length in lengths_s[lengths_s < one.length_s / 2]:
            t0, t1, gain = _windows(one, float(length))
            largest = np.maximum(largest, gain[:, 1:].max(axis=0))
            spread = max(float(np.median(gain[:, 0]) / np.median(gain[:, 1:])), 1.0)
            top = np.argsort(-gain[:, 0])[: 50 * most]
            found += [
                Place(float(gain[i, 0]), spread, {"t0": float(t0[i]), "t1": float(t1[i])}, one.recording) for i in top
            ]
    return _apart(found, most), independent(largest, 1)


def _windows(one: Answer, length: float) -> tuple[Array, Array, Array]:
    """Starts and ends (n,) of all windows of this length, and their gains (n, 1+draws)."""
    total = np.concatenate([np.zeros((1, one.slope.shape[1])), np.cumsum(one.slope, axis=0)])
    edges = np.append(one.t, one.t[-1] + one.h[-1])
    first = np.arange(np.searchsorted(edges, edges[-1] - length) + 1)
    # the edge nearest to the end of the window
    last = np.searchsorted(edges, edges[first] + length - float(np.median(one.h)) / 2)
    first, last = first[last < len(edges)], last[last < len(edges)]
    s = total[last] - total[first]
    level = np.mean(s[:, 1:] ** 2, axis=1)
    level = uniform_filter1d(level, 2 * (max(int(last[0] - first[0]), 1) // 2) + 1, mode="nearest")
    level = np.maximum(level, 1e-3 * np.median(level))
    # gain = s^2/(2 J)
    return edges[first], edges[last], s**2 / np.maximum(2 * level, 1e-300)[:, None]


def _apart(found: Sequence[Place], most: int) -> list[Place]:
    chosen: list[Place] = []
    for one in sorted(found, key=lambda place: -place.gain / place.spread):
        if len(chosen) < most and all(_shared(one, other) < MOST_SHARED for other in chosen):
            chosen.append(one)
    return chosen


def _shared(a: Place, b: Place) -> float:
    """Time in both windows over the time in either."""
    if a.recording != b.recording:
        return 0.0
    both = min(a.shape["t1"], b.shape["t1"]) - max(a.shape["t0"], b.shape["t0"])
    either = max(a.shape["t1"], b.shape["t1"]) - min(a.shape["t0"], b.shape["t0"])
    return max(both, 0.0) / max(either, 1e-9)


def _column(effect: Effect, recording: str, shape: dict[str, float]) -> Column:
    a = next(p for p in effect.parameters if p.role == "amplitude")
    name, usual, most = _amplitude(effect)
    return Column((*shape.items(), (name, usual)), recording, a.low >= a.neutral, most)


def pulse_score(screen: Screen, effect: Effect, recording: str, shape: dict[str, float]) -> Score:
    """Exact score of a pulse in one recording; in the others its ends are where they start, so that there is none."""
    member = Member(effect, shape, (_column(effect, recording, shape),))
    z = screen.whitened([(effect, member.columns[0])])
    return _placed(screen, score_of(member, z, screen.residual))


def _placed(screen: Screen, score: Score) -> Score:
    """With the times of every recording in place of the common ones."""
    effect, own = score.member.effect, score.member.columns[0].recording
    start = {k: v for k, v in score.start.items() if k.rsplit(".", 1)[1] not in score.member.shape}
    for name, value in score.member.shape.items():
        for r in screen.recordings:
            start[f"{effect.key(name)}@{r}"] = value if r == own else effect.parameter(name).neutral
    return replace(score, start=start)


def _edges_moved(screen: Screen, score: Score) -> Score:
    """Gauss-Newton on both edges: r = a z + a d0 dz/dt0 + a d1 dz/dt1."""
    effect, recording = score.member.effect, str(score.member.columns[0].recording)
    for _ in range(EDGE_STEPS):
        shape = score.member.shape
        varied = [{**shape, name: shape[name] + EDGE_SLOPE_S} for name in ("t0", "t1")]
        z = screen.whitened([(effect, _column(effect, recording, one)) for one in (shape, *varied)])
        z[:, 1:] = (z[:, 1:] - z[:, :1]) / EDGE_SLOPE_S
        a, *moves = np.linalg.lstsq(z, screen.residual, rcond=None)[0]
        if a == 0.0:
            break
        d0, d1 = (float(np.clip(move / a, -EDGE_STEP_S, EDGE_STEP_S)) for move in moves)
        moved = {"t0": max(shape["t0"] + d0, 0.0), "t1": max(shape["t1"] + d1, shape["t0"] + d0 + EDGE_SLOPE_S)}
        other = pulse_score(screen, effect, recording, moved)
        if other.gain <= score.gain:
            break
        score = other
    return score
