"""The likelihood of an extended Kalman filter's innovations over recordings, with its exact gradient and information.

    min over p, q, r, x0_r of  sum_r sum_k (e^2 / S + log S) / 2  +  prior,

e and S from `extended_filter` (Ljung, System Identification, 2nd ed., 7.4; Harvey, Forecasting, Structural Time Series
Models and the Kalman Filter, 3.4).

Rules of this file: numbers in, numbers out; one search vector, `Likelihood` knows what its coordinates mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf, sqrt
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.free_parameters import Prior, Scale
from hoopd.plants.fits.output_error import prior_of
from hoopd.plants.fits.runs import Run
from hoopd.plants.likelihood.extended_filter import Derivatives, ExtendedKalmanFilter, FilterInnovations, samples_of
from hoopd.plants.likelihood.noise_scale import NoiseLevels, noise_scale
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

# What a search is told where the filter overflows: far above any likelihood.
LOST = 1e100
# Student's distribution for data with outliers: 4 degrees of freedom bound what one sample can do and lose 5 % on
# normal errors. The scale makes S the variance of the good samples: E[e rho'(e)] = 1 under normal e.
STUDENT_FREEDOM = 4.0
STUDENT_SCALE = 1.448085819271894
# The daemon's gate, 5 sigma.
GATE = 5.0


class Loss(NamedTuple):
    """Of a normalised innovation; `freedom` inf: normal."""

    freedom: float = inf
    gate: float = inf

    def value(self, e: Array) -> Array:
        """rho(e) = e^2/2, or (f+1)/2 log(1 + k e^2/f)."""
        if self.freedom == inf:
            return e**2 / 2
        return np.asarray((self.freedom + 1) / 2 * np.log1p(STUDENT_SCALE * e**2 / self.freedom))

    def weight(self, e: Array) -> Array:
        """rho'(e)/e"""
        if self.freedom == inf:
            return np.ones_like(e)
        return np.asarray((self.freedom + 1) * STUDENT_SCALE / (self.freedom + STUDENT_SCALE * e**2))


LOSSES = {"linear": Loss(), "student": Loss(STUDENT_FREEDOM, GATE)}


class FilteredSystem(Protocol):
    """A plant with its numbers, as a fit by a filter's innovations asks for it."""

    @property
    def values(self) -> Mapping[str, float]:
        """Every parameter."""

    def composite(self, moving: str, free: Sequence[str]) -> Composite:
        """What moves in runs of a kind; `free`: the parameters that it is told."""

    def start_columns(self, moving: str) -> list[int]:
        """Where in a run's start the states of that composite stand."""

    def scale(self, names: Sequence[str]) -> Scale:
        """The search's coordinates of these parameters."""

    def free_starts(self, run: Run) -> list[int]:
        """Components of a run's start that its channels see."""


class Gradient(NamedTuple):
    """Negative log-likelihood with prior at a point."""

    value: float
    gradient: Array  # (v,) exact


class Evaluation(NamedTuple):
    """The same with what every node has to do with it."""

    value: float
    gradient: Array  # (v,) exact
    information: Array  # (v, v) expected
    scores: list[Array]  # (n, v) of every run: the data's share of the gradient by node


class Likelihood:
    """The criterion over all runs as a function of one search vector (parameters, noise levels, starts)."""

    def __init__(
        self,
        system: FilteredSystem,
        names: Sequence[str],
        runs: Sequence[Run],
        noise: NoiseLevels,
        *,
        priors: Mapping[str, Prior] | None = None,
        loss: str = "linear",
    ) -> None:
        self.runs, self.scale, self.loss = list(runs), system.scale(names), LOSSES[loss]
        free = noise.free(runs)
        self.levels = noise.values(free)
        self.noise = noise_scale(free, self.levels, noise.floors())
        self.filters = {moving: self._filter(system, moving, free) for moving in {run.moving: None for run in runs}}
        self._columns = {moving: system.start_columns(moving) for moving in self.filters}
        self.samples = [samples_of(run, self.filters[run.moving].channels) for run in runs]
        self.count = int(sum(sample.seen.sum() for sample in self.samples))
        self.free_starts = [system.free_starts(run) for run in runs]
        self.m, self.k = len(self.scale.names), len(free)
        offsets = np.cumsum([self.m + self.k, *(len(one) for one in self.free_starts)])
        self.slots = [slice(int(a), int(b)) for a, b in pairwise(offsets)]
        self.size = int(offsets[-1])
        self.prior_centre, root = prior_of(self.scale, priors or {})
        self.prior_weight = root**2

    def _filter(self, system: FilteredSystem, moving: str, levels: Sequence[str]) -> ExtendedKalmanFilter:
        composite, names = system.composite(moving, self.scale.names), self.scale.names
        channels = channels_of([run for run in self.runs if run.moving == moving], composite.channels)
        values = {**composite.values, **system.values, **self.levels}
        return ExtendedKalmanFilter(composite, values, (*names, *levels), channels, gate=self.loss.gate)

    @property
    def channels(self) -> tuple[str, ...]:
        """Of the runs, in the plant's order."""
        every = sorted((one.composite.channels for one in self.filters.values()), key=len, reverse=True)
        seen = {name for run in self.runs for name in run.series}
        return tuple(name for name in dict.fromkeys(name for one in every for name in one) if name in seen)

    def first(self, starts: Sequence[Array] | None = None) -> Array:
        """Search vector of the nominal values, first noise levels and given or guessed starts."""
        begins = [run.start for run in self.runs] if starts is None else starts
        own = [np.asarray(x)[free] for x, free in zip(begins, self.free_starts, strict=True)]
        return np.concatenate([np.zeros(self.m + self.k), *own])

    def numbers(self, v: Array) -> Array:
        """Free parameters and noise levels (m + k,)."""
        return np.concatenate([self.scale.parameters(v[: self.m]), self.noise.levels(v[self.m : self.m + self.k])])

    def starts(self, v: Array) -> list[Array]:
        """Initial states of the runs."""
        out = []
        for run, free, slot in zip(self.runs, self.free_starts, self.slots, strict=True):
            out.append(run.start.copy())
            out[-1][free] = v[slot]
        return out

    def innovations(self, v: Array) -> list[FilterInnovations]:
        """By run."""
        p, parts = self.numbers(v), zip(self.runs, self.starts(v), self.samples, strict=True)
        return [
            self.filters[run.moving].run(p, start[self._columns[run.moving]], samples) for run, start, samples in parts
        ]

    def derivatives(self, v: Array) -> list[Derivatives]:
        """By run, with respect to (z, free starts of the run)."""
        p, out = self.numbers(v), []
        for run, start, samples, free in zip(self.runs, self.starts(v), self.samples, self.free_starts, strict=True):
            columns, factor = self._moved(v, run, free)
            found = self.filters[run.moving].run_with_sensitivity(p, start[self._columns[run.moving]], samples)
            out.append(Derivatives(found.e, found.s, found.de[..., columns] * factor, found.ds[..., columns] * factor))
        return out

    def _moved(self, v: Array, run: Run, free: Sequence[int]) -> tuple[list[int], Array]:
        """Which of a filter's derivatives the search has coordinates for, and the slopes of what these move."""
        m = self.m + self.k
        by_z = np.concatenate([self.scale.derivative(v[: self.m]), self.noise.derivative(v[self.m : m])])
        own = [m + self._columns[run.moving].index(i) for i in free]
        return [*range(m), *own], np.concatenate([by_z, np.ones(len(own))])

    def value(self, v: Array) -> float:
        """Negative log-likelihood (or Student's where asked for) plus prior, without the constant log(2 pi) / 2."""
        return self._value(v, self.innovations(v))

    def _value(self, v: Array, innovations: Sequence[FilterInnovations]) -> float:
        total = self.prior_value(v)
        for found, samples in zip(innovations, self.samples, strict=True):
            seen = samples.seen > 0.0
            e, s = found.e[seen], found.s[seen]
            if not (np.isfinite(e).all() and np.isfinite(s).all() and (s > 0.0).all()):
                return LOST
            total += float(np.sum(self.loss.value(e / np.sqrt(s)) + np.log(s) / 2))
        return min(total, LOST)

    def with_gradient(self, v: Array) -> Gradient:
        """Value and gradient by one pass back; where the filter overflows, a value that no search keeps."""
        innovations = self.innovations(v)
        value, gradient, p = self._value(v, innovations), np.zeros(self.size), self.numbers(v)
        if value >= LOST:
            return Gradient(LOST, gradient)
        gradient[: self.m] = self.prior_weight * (v[: self.m] - self.prior_centre)
        parts = zip(self.runs, innovations, self.samples, self.free_starts, self.slots, strict=True)
        for run, found, samples, free, slot in parts:
            columns, factor = self._moved(v, run, free)
            by = self.filters[run.moving].gradient(
                found.run, p, samples, *self._slopes(found.e, found.s, samples.seen > 0.0)
            )
            gradient[self._places(slot)] += by[columns] * factor
        return Gradient(value, gradient)

    def _slopes(self, e: Array, s: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Of one run's share of the criterion, by e and by S (n, c)."""
        root = np.sqrt(np.where(seen, s, 1.0))
        normal = np.where(seen, e, 0.0) / root
        pull = self.loss.weight(normal) * normal
        # d(e/sqrt S) = de/sqrt S - e dS/(2 S^1.5),   d(log S)/2 = dS/(2 S)
        return pull / root, np.where(seen, (1.0 - pull * normal) / root**2 / 2, 0.0)

    def _places(self, slot: slice) -> list[int]:
        """Of one run's coordinates in the search vector."""
        return [*range(self.m + self.k), *range(slot.start, slot.stop)]

    def evaluate(self, v: Array) -> Evaluation:
        """Value and derivatives by a pass forward; where the filter overflows, a value that no search keeps."""
        value, scores, z = self.prior_value(v), [], v[: self.m]
        gradient, information = np.zeros(self.size), np.zeros((self.size, self.size))
        gradient[: self.m] = self.prior_weight * (z - self.prior_centre)
        information[range(self.m), range(self.m)] = self.prior_weight
        for found, samples, slot in zip(self.derivatives(v), self.samples, self.slots, strict=True):
            columns, seen = self._places(slot), samples.seen > 0.0
            if not all(np.isfinite(part[seen]).all() for part in found) or (found.s[seen] <= 0.0).any():
                return Evaluation(LOST, np.zeros(self.size), np.eye(self.size), [])
            loss, score, rows = self._terms(found, seen)
            value += loss
            scores.append(np.zeros((len(score), self.size)))
            scores[-1][:, columns] = score
            gradient[columns] += score.sum(axis=0)
            information[np.ix_(columns, columns)] += rows.T @ rows
        return Evaluation(value, gradient, information, scores)

    def _terms(self, found: Derivatives, seen: NDArray[np.bool_]) -> tuple[float, Array, Array]:
        """Of one run: its share of the criterion, the score by node (n, w) and the rows R of its information R'R."""
        root = np.sqrt(found.s)
        normal = found.e / root
        loss = float(np.sum((self.loss.value(normal) + np.log(found.s) / 2)[seen]))
        by_e, by_s = self._slopes(found.e, found.s, seen)
        score = by_e[..., None] * found.de + by_s[..., None] * found.ds
        # expected information: de de'/S + dS dS'/(2 S^2)   (Harvey 1989, 3.4.69)
        weight = np.sqrt(self.loss.weight(normal))
        rows = [(weight / root)[..., None] * found.de, found.ds / found.s[..., None] / sqrt(2.0)]
        return loss, np.where(seen[..., None], score, 0.0).sum(axis=1), np.concatenate([one[seen] for one in rows])

    def prior_value(self, v: Array) -> float:
        """The prior's share of the criterion."""
        return float(self.prior_weight @ (v[: self.m] - self.prior_centre) ** 2) / 2


def channels_of(runs: Sequence[Run], known: Sequence[str]) -> tuple[str, ...]:
    """Channels of the runs in the plant's order; ValueError on one that the plant has not."""
    found = {name for run in runs for name in run.series}
    if unknown := found - set(known):
        raise ValueError(f"the filter takes {', '.join(known)}, not {', '.join(sorted(unknown))}")
    return tuple(name for name in known if name in found)
