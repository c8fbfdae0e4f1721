"""The frequency of an effect that comes and goes with time: A sin(w t + phi), A and w common, phi by recording.

Its score at every frequency is a Fourier sum of the adjoint of its amplitude's force, coherent over a recording; the
energies of the recordings are added.

Rules of this file: names and ranges come from the effect.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from hoopd.diagnose.adjoint import Adjoint, Answer, independent, looked_at
from hoopd.diagnose.scanned import Place, Scanned, scanned, usual_size
from hoopd.diagnose.screen import Column, Member, Score, Screen
from hoopd.physics.effects.base import Effect

Array = NDArray[np.float64]

# Frequencies in a resolution cell of 2 pi/T: half a step off the peak costs 1 % of its gain.
FREQUENCIES_A_CELL = 8
# Levels by frequency: of the model over so many cells, of the data over more, so that a line does not lift its own.
MODEL_CELLS, DATA_CELLS = 3, 31
# So many peaks are scored exactly, and the best of them refined; peaks are apart by so many cells.
MOST_PEAKS, REFINED, CELLS_APART = 6, 2, 1.5


class Spectrum(NamedTuple):
    """Gains by frequency, of the data and of white rows."""

    w: Array  # (nf,)
    cell: float  # rad/s, 2 pi over the longest recording
    gain: Array  # (nf, 1+draws)
    spread: Array  # (nf,) of the data


def tones(screen: Screen, effect: Effect) -> list[Scanned]:
    """The best few frequencies; none where no recording has the effect's slot."""
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
        scanned(one, looked_at(one.gain, candidates, freedom), place.spread) for place, one in refined + best[REFINED:]
    ]


def _frequency(effect: Effect) -> str:
    return next(p.name for p in effect.parameters if p.role == "shape")


def _phase(effect: Effect) -> str:
    return next(p.name for p in effect.parameters if p.role == "phase")


def _steady(effect: Effect) -> dict[str, float]:
    """The values at which A sin(w t + phi) is its amplitude: w = 0, phi = pi/2."""
    name, usual, _ = usual_size(effect)
    return {name: usual, _frequency(effect): 0.0, _phase(effect): pi / 2}


def _spectrum(answers: Sequence[Answer], effect: Effect) -> Spectrum:
    """Amplitude common, phases free: sum over r of A rho_r - A^2 J_r/2 is at most (sum rho)^2/(2 sum J)."""
    p = effect.parameter(_frequency(effect))
    cell = 2 * pi / max(one.length_s for one in answers)
    w = np.arange(p.low, p.high, cell / FREQUENCIES_A_CELL)
    rho, level = np.zeros((len(w), answers[0].slope.shape[1])), np.zeros(len(w))
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
    name, usual, most = usual_size(effect)
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
    size = float(np.clip(float(change @ residual) / max(float(change @ change), 1e-300), 0.0, most))
    change = size * change
    name, usual, _ = usual_size(effect)
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
