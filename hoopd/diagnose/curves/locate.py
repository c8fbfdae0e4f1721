"""Where a mismatch sits: evidence by slot, the channel that shows it, what it depends on.

The evidence of a slot is the surprise of the best curve or law that could sit there: a curve is a free force, torque
map or sensor error over one variable, so that no name is needed to find a place.

Rules of this file: it ranks what `unknown.survey` measured and fits nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.screen import CurveScore
from hoopd.diagnose.curves.unknown import Survey
from hoopd.diagnose.engine.fitting import Fit
from hoopd.diagnose.search.naming import surprise_of

Array = NDArray[np.float64]

# A further variable is named when its best curve has at least this part of the best one's surprise.
VARIABLE_PART = 0.7
# Lags of the innovations' correlation: 0.4 s at 50 Hz.
LAGS = 20


class Whiteness(NamedTuple):
    """Innovations of one channel against what the model expects: 1 and 0."""

    mean_square: float  # of normalised innovations
    correlation: float  # (Q - lags) / sqrt(2 lags) of Ljung and Box


class Level(NamedTuple):
    """Disturbance that a fit needs on a coordinate."""

    force: float  # in the force's unit, standard deviation, mean over recordings
    time_s: float


@dataclass(frozen=True)
class Located:
    """Where, in which channel, on what it depends; `slot` is None when nothing is beyond chance."""

    slot: str | None
    channel: str | None
    depends_on: tuple[str, ...]
    evidence: dict[str, float]  # nats by slot
    whiteness: dict[str, Whiteness] = field(default_factory=dict)
    forces: dict[str, Level] = field(default_factory=dict)  # by coordinate


def locate(found: Survey) -> Located:
    """From a survey beside the re-fitted base."""
    every = sorted(_explanations(found), key=lambda one: (-one.surprise, one.slot))
    evidence: dict[str, float] = dict.fromkeys(found.fit.tracks[0].stretch.plant.slots, 0.0)
    for one in every:
        evidence[one.slot] = max(evidence.get(one.slot, 0.0), one.surprise)
    beside = whiteness(found.fit), levels(found.fit)
    if not every or every[0].surprise <= found.threshold:
        return Located(None, None, (), evidence, *beside)
    best = every[0]
    shares = found.screen.shares(best.vector)
    depends = best.depends_on or variables_of(found.curves, best.slot)[:1]
    return Located(best.slot, max(shares, key=lambda c: shares[c]), depends, evidence, *beside)


class _Explanation(NamedTuple):
    slot: str
    surprise: float
    depends_on: tuple[str, ...]
    vector: Array


def _explanations(found: Survey) -> Iterator[_Explanation]:
    stretches = [track.stretch for track in found.fit.tracks]
    for score in found.named:
        effect, size = score.member.effect, surprise_of(score, score.gain, stretches)
        yield _Explanation(effect.slot, size, effect.depends_on, score.vector)
    for curve in found.curves:
        yield _Explanation(curve.curve.slot, curve.surprise, curve.curve.depends_on, curve.vector)


def variables_of(curves: Sequence[CurveScore], slot: str) -> tuple[str, ...]:
    """What a slot's curves depend on, the likeliest first, as long as it is near the best."""
    own = [one for one in curves if one.curve.slot == slot]
    best = max((one.surprise for one in own), default=0.0)
    near = [one for one in own if one.surprise >= VARIABLE_PART * best]
    return tuple(dict.fromkeys(name for one in near for name in one.curve.depends_on))


def levels(fit: Fit) -> dict[str, Level]:
    """Disturbance by coordinate, mean over the recordings that have it."""
    found: dict[str, list[tuple[float, float]]] = {}
    for track in fit.tracks:
        noise = fit.noise[track.stretch.recording]
        for q, force, time_s in zip(track.stretch.plant.coordinates, noise.force, noise.time_s, strict=True):
            found.setdefault(q, []).append((float(force), float(time_s)))
    return {q: Level(*map(float, np.mean(each, axis=0))) for q, each in found.items()}


def whiteness(fit: Fit) -> dict[str, Whiteness]:
    """Of every channel, all recordings together."""
    parts: dict[str, list[Array]] = {}
    for track, rows in zip(fit.tracks, fit.rows, strict=True):
        innovations = rows[:, 0].reshape(len(track.z), -1)
        seen = np.isfinite(track.stretch.y)
        for j, channel in enumerate(track.composite.channels):
            parts.setdefault(channel, []).append(innovations[seen[:, j], j])
    return {channel: _whiteness(each) for channel, each in parts.items() if sum(map(len, each)) > LAGS}


def _whiteness(parts: Sequence[Array]) -> Whiteness:
    energy, n = sum(float(x @ x) for x in parts), sum(map(len, parts))
    # Q = n (n+2) sum rho_k^2 / (n-k)
    rho = [sum(float(x[k:] @ x[:-k]) for x in parts if len(x) > k) / max(energy, 1e-300) for k in range(1, LAGS + 1)]
    q = n * (n + 2) * sum(r**2 / (n - k) for k, r in enumerate(rho, start=1))
    return Whiteness(energy / n, float((q - LAGS) / np.sqrt(2 * LAGS)))
