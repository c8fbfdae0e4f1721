"""The frequency of an effect that comes and goes with time: A sin(w t + phi), A and w common, phi by recording.

Its score at every frequency is a Fourier sum of the adjoint of its amplitude's force, coherent over a recording; the
energies of the recordings are added.

Rules of this file: names and ranges come from the effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from hoopd.diagnose.search.adjoint import Adjoint, AdjointAnswer, independent
from hoopd.diagnose.search.scan_score import Scanned, ScanPlace, scanned, usual_size
from hoopd.diagnose.search.screen import Column, Member, Score, Screen
from hoopd.plants.effects.base import Effect

Array = NDArray[np.float64]

# Frequencies in a resolution cell of 2 pi/T: half a step off the peak costs 1 % of its gain.
FREQUENCIES_A_CELL = 8
# Levels by frequency: of the model over so many cells, of the data over more, so that a line does not lift its own.
MODEL_CELLS, DATA_CELLS = 3, 31
# So many peaks are scored exactly, and the best of them refined; peaks are apart by so many cells.
MOST_PEAKS, REFINED, CELLS_APART = 6, 2, 1.5
# Frequencies that are transformed at once.
BLOCK = 64


class GainSpectrum(NamedTuple):
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
    peaks = _peaks(spectrum, _frequency(effect))
    exact = _exact(screen, effect, [one.shape[_frequency(effect)] for one in peaks])
    best = sorted(zip(exact, peaks, strict=True), key=lambda pair: -pair[0].gain)
    finer = _refined(screen, effect, [one for one, _ in best[:REFINED]], spectrum.cell / 4)
    every = finer + [one for one, _ in best[REFINED:]]
    return [scanned(one, freedom, candidates) for one in every]


def _frequency(effect: Effect) -> str:
    return next(p.name for p in effect.parameters if p.role == "shape")


def _phase(effect: Effect) -> str:
    return next(p.name for p in effect.parameters if p.role == "phase")


def _steady(effect: Effect) -> dict[str, float]:
    """The values at which A sin(w t + phi) is its amplitude: w = 0, phi = pi/2."""
    name, usual, _ = usual_size(effect)
    return {name: usual, _frequency(effect): 0.0, _phase(effect): pi / 2}


def _spectrum(answers: Sequence[AdjointAnswer], effect: Effect) -> GainSpectrum:
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
    return GainSpectrum(w, cell, gain, np.maximum(around / max(float(np.median(gain[:, 1:])), 1e-12), 1.0))


def _transform(w: Array, t: Array, x: Array) -> Array:
    """(nf, m) sums of e^(i w t) x over time, for frequencies in equal steps."""
    out = np.empty((len(w), x.shape[1]), dtype=complex)
    block = np.exp(1j * np.outer(w[:BLOCK] - w[0], t))
    for first in range(0, len(w), BLOCK):
        turned = block[: len(w) - first] * np.exp(1j * w[first] * t)
        out[first : first + BLOCK] = turned.real @ x + 1j * (turned.imag @ x)
    return out


def _peaks(s: GainSpectrum, name: str) -> list[ScanPlace]:
    """The largest local maxima against their surroundings, apart from each other."""
    height = s.gain[:, 0] / s.spread
    padded = np.concatenate([[-inf], height, [-inf]])
    tops = np.flatnonzero((height > padded[:-2]) & (height >= padded[2:]))
    chosen: list[int] = []
    for i in tops[np.argsort(-height[tops])]:
        if len(chosen) < MOST_PEAKS and all(abs(s.w[i] - s.w[j]) > CELLS_APART * s.cell for j in chosen):
            chosen.append(int(i))
    return [ScanPlace(float(s.gain[i, 0]), float(s.spread[i]), {name: float(s.w[i])}) for i in chosen]


def _exact(screen: Screen, effect: Effect, frequencies: Sequence[float]) -> list[Score]:
    """Scores at some frequencies."""
    members = [_member(screen, effect, w) for w in frequencies]
    z = screen.whitened([(effect, column) for member in members for column in member.columns])
    parts = np.split(z, max(len(members), 1), axis=1)
    return [_common(member, part, screen.residual) for member, part in zip(members, parts, strict=False)]


def _member(screen: Screen, effect: Effect, w: float) -> Member:
    """Sine and cosine for each recording."""
    name, usual, _ = usual_size(effect)
    fixed = ((_frequency(effect), w), (name, usual))
    columns = (Column((*fixed, (_phase(effect), at)), r) for r in screen.recordings for at in (0.0, pi / 2))
    return Member(effect, {_frequency(effect): w}, tuple(columns))


def _common(member: Member, z: Array, residual: Array) -> Score:
    """Score of pairs of columns (sine, cosine) by recording with one amplitude and free phases."""
    effect, turns, change = member.effect, {}, np.zeros_like(residual)
    name, usual, most = usual_size(effect)
    for i in range(0, z.shape[1], 2):
        pair = z[:, i : i + 2]
        if np.any(pair):
            a, b = np.linalg.lstsq(pair, residual, rcond=None)[0]
            phi = turns[member.columns[i].recording] = atan2(b, a)
            change = change + pair @ [np.cos(phi), np.sin(phi)]
    size = float(np.clip(float(change @ residual) / max(float(change @ change), 1e-300), 0.0, most))
    change = size * change
    start = {effect.key(k): v for k, v in member.shape.items()}
    start[effect.key(name)] = size * usual
    start.update({f"{effect.key(_phase(effect))}@{r}": phi for r, phi in turns.items()})
    return Score(member, float(change @ residual - change @ change / 2), start, change)


def _refined(screen: Screen, effect: Effect, scores: Sequence[Score], step: float) -> list[Score]:
    """Of each frequency, its neighbours and the top of the parabola through the three gains, the best."""
    frequency = _frequency(effect)
    middles = [one.member.shape[frequency] for one in scores]
    sides = _exact(screen, effect, [w + d for w in middles for d in (-step, step)])
    threes = [(low, middle, high) for low, middle, high in zip(sides[::2], scores, sides[1::2], strict=True)]
    tops = _exact(screen, effect, [w + _top(*three) * step for w, three in zip(middles, threes, strict=True)])
    return [max(*three, top, key=lambda one: one.gain) for three, top in zip(threes, tops, strict=True)]


def _top(low: Score, middle: Score, high: Score) -> float:
    """Where in -1 to 1 a parabola through three gains is largest."""
    bend = low.gain - 2 * middle.gain + high.gain
    if bend >= 0.0:
        return float(np.sign(high.gain - low.gain))
    return float(np.clip(0.5 * (low.gain - high.gain) / bend, -1.0, 1.0))
