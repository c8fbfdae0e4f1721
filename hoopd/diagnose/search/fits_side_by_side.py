"""Effects that are tried beside one fit, each in a process of its own.

A fit has effects, plants and functions, which no pipe takes; what comes back through one is its numbers, from which the
model is made linear again: the same bits.

Rules of this file: nothing is decided; `candidates` says how an effect is tried.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.candidates import Judge, Tried
from hoopd.diagnose.search.processes import computed
from hoopd.diagnose.search.screen import Score
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, linear_again
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.reference_track import Track

Array = NDArray[np.float64]


class _Range(NamedTuple):
    """Of a parameter, which a fit may have widened."""

    low: float
    high: float
    usual: tuple[float, float] | None  # before it was widened


@dataclass(frozen=True)
class _Numbers:
    """Of a tried effect and the fit with it."""

    ranges: tuple[_Range, ...]  # of the effect's parameters
    values: dict[str, float]
    free: tuple[str, ...]
    noise: dict[str, Noise]
    curvatures: dict[str, Array]
    references: tuple[tuple[Array, Array, Array, Array], ...]  # z, w, filtered, predicted of each track
    covariance: Array
    criterion: float
    steps: int
    most_worse: float
    gain: float
    surprise: float


class _Answer:
    """A tried effect; through a pipe go its numbers."""

    def __init__(self, tried: Tried) -> None:
        self.tried = tried

    def __reduce__(self) -> tuple[Callable[[_Numbers], _Numbers], tuple[_Numbers]]:
        return _as_they_are, (_numbers(self.tried),)


def tried_all(judge: Judge, before: HypothesisFit, scores: Sequence[Score]) -> list[Tried]:
    """Each proposed effect fitted together with everything that was there, in the order of the scores."""
    for score in scores:
        judge.settings.progress(f"fitting {score.member.effect.name}")
    answers = computed([partial(_answered, judge, before, score) for score in scores])
    found = [
        one.tried if isinstance(one, _Answer) else _restored(judge, before, score, one)
        for score, one in zip(scores, answers, strict=True)
    ]
    return judge.of_effects(before, found)


def _answered(judge: Judge, before: HypothesisFit, score: Score) -> _Answer | _Numbers:
    found = judge.fitted(before, score)
    # what a start was held to holds no later fit
    found.fit.most_force = {}
    return _Answer(found)


def _as_they_are(numbers: _Numbers) -> _Numbers:
    return numbers


def _numbers(tried: Tried) -> _Numbers:
    found = tried.fit
    return _Numbers(
        _ranges(tried.effect), found.values, found.free, found.noise, found.curvatures,
        tuple((one.z, one.w, one.filtered, one.predicted) for one in found.tracks),
        found.covariance, found.criterion, found.steps, found.most_worse, tried.gain, tried.surprise,
    )  # fmt: skip


def _restored(judge: Judge, before: HypothesisFit, score: Score, numbers: _Numbers) -> Tried:
    effect = _in_ranges(score.member.effect, numbers.ranges)
    effects = (*before.effects, effect)
    tracks = [Track(stretch, effects) for stretch in judge.train]
    for track, reference in zip(tracks, numbers.references, strict=True):
        track.moved(*reference)
    found = HypothesisFit(
        effects, numbers.values, numbers.free, tracks, numbers.noise,
        covariance=numbers.covariance, criterion=numbers.criterion, steps=numbers.steps, curvatures=numbers.curvatures,
        most_worse=numbers.most_worse,
    )  # fmt: skip
    return Tried(effect, linear_again(found), numbers.gain, numbers.surprise, score)


def _ranges(effect: Effect) -> tuple[_Range, ...]:
    return tuple(_Range(p.low, p.high, p.usual) for p in effect.parameters)


def _in_ranges(effect: Effect, ranges: Sequence[_Range]) -> Effect:
    """The effect with these ranges; itself where they are its own."""
    if _ranges(effect) == tuple(ranges):
        return effect
    wider = (replace(p, **one._asdict()) for p, one in zip(effect.parameters, ranges, strict=True))
    return replace(effect, parameters=tuple(wider))
