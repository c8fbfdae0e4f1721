"""The likelihood of a Kalman filter's innovations over recordings, with its exact gradient and its information.

    min over p, q, r, x0_r of  sum_r sum_k (e^2 / S + log S) / 2  +  prior,

e and S from `innovations.py` (Ljung, System Identification, 2nd ed., 7.4; Harvey, Forecasting, Structural Time Series
Models and the Kalman Filter, 3.4).

Rules of this file: numbers in, numbers out; one search vector, `Likelihood` knows what its coordinates mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.free_parameters import Prior, Scale
from hoopd.plants.fits.output_error import prior_of
from hoopd.plants.fits.runs import Run
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.filter_noise import NoiseModel, NoiseScale, noise_scale
from hoopd.plants.hoop.innovations import CHANNELS, Derivatives, FilterInnovations, InnovationsFilter, samples_of
from hoopd.plants.hoop.output_error import free_starts

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


class Evaluation(NamedTuple):
    """Negative log-likelihood with prior at a point: value, exact gradient, expected information."""

    value: float
    gradient: Array  # (v,)
    information: Array  # (v, v)
    scores: list[Array]  # (n, v) of every run: the data's share of the gradient by node


class Likelihood:
    """The criterion over all runs as a function of one search vector (parameters, noise levels, starts)."""

    def __init__(
        self,
        structure: str,
        values: Mapping[str, float],
        runs: Sequence[Run],
        scale: Scale,
        priors: Mapping[str, Prior],
        noise: NoiseModel,
        extra_forces: tuple[ExtraForce, ...],
        loss: str = "linear",
    ) -> None:
        self.runs, self.scale, self.loss = list(runs), scale, LOSSES[loss]
        free = noise.free(runs)
        self.levels = noise.values(free)
        self.noise: NoiseScale = noise_scale(free, self.levels, noise.floors())
        everything, moved = {**values, **self.levels}, (*scale.names, *free)
        kinds = {run.moving: channels_of(runs, run.moving) for run in runs}
        self.filters = {
            moving: InnovationsFilter(
                structure, everything, moved, channels, extra_forces, moving=moving, gate=self.loss.gate
            )
            for moving, channels in kinds.items()
        }
        self.samples = [samples_of(run, kinds[run.moving]) for run in runs]
        self.count = int(sum(sample.seen.sum() for sample in self.samples))
        self.free_starts = [free_starts(run) for run in runs]
        self.m, self.k = len(scale.names), len(free)
        offsets = np.cumsum([self.m + self.k, *(len(one) for one in self.free_starts)])
        self.slots = [slice(int(a), int(b)) for a, b in pairwise(offsets)]
        self.size = int(offsets[-1])
        self.prior_centre, root = prior_of(scale, priors)
        self.prior_weight = root**2

    def first(self, starts: Sequence[Array] | None = None) -> Array:
        """Search vector of the nominal values, first noise levels and given or guessed starts."""
        begins = [run.start for run in self.runs] if starts is None else starts
        own = [np.asarray(x)[free] for x, free in zip(begins, self.free_starts, strict=True)]
        return np.concatenate([np.zeros(self.m + self.k), *own])

    def numbers(self, v: Array) -> Array:
        """Free parameters and noise levels (m + k,)."""
        return np.concatenate([self.scale.parameters(v[: self.m]), self.noise.levels(v[self.m : self.m + self.k])])

    def starts(self, v: Array) -> list[Array]:
        """Initial states (4,) of the runs."""
        out = []
        for run, free, slot in zip(self.runs, self.free_starts, self.slots, strict=True):
            out.append(run.start.copy())
            out[-1][free] = v[slot]
        return out

    def innovations(self, v: Array) -> list[FilterInnovations]:
        """By run."""
        p, parts = self.numbers(v), zip(self.runs, self.starts(v), self.samples, strict=True)
        return [self.filters[run.moving].run(p, start, samples) for run, start, samples in parts]

    def derivatives(self, v: Array) -> list[Derivatives]:
        """By run, with respect to (z, free starts of the run)."""
        p, z, m = self.numbers(v), v[: self.m], self.m + self.k
        by_z = np.concatenate([self.scale.derivative(z), self.noise.derivative(v[self.m : m])])
        out = []
        for run, start, samples, free in zip(self.runs, self.starts(v), self.samples, self.free_starts, strict=True):
            found = self.filters[run.moving].run_with_sensitivity(p, start, samples)
            columns, factor = [*range(m), *(m + i for i in free)], np.concatenate([by_z, np.ones(len(free))])
            out.append(Derivatives(found.e, found.s, found.de[..., columns] * factor, found.ds[..., columns] * factor))
        return out

    def value(self, v: Array) -> float:
        """Negative log-likelihood (or Student's where asked for) plus prior, without the constant log(2 pi) / 2."""
        total = self.prior_value(v)
        for found, samples in zip(self.innovations(v), self.samples, strict=True):
            seen = samples.seen.T > 0.0
            e, s = found.e[seen], found.s[seen]
            if not (np.isfinite(e).all() and np.isfinite(s).all() and (s > 0.0).all()):
                return LOST
            total += float(np.sum(self.loss.value(e / np.sqrt(s)) + np.log(s) / 2))
        return min(total, LOST)

    def evaluate(self, v: Array) -> Evaluation:
        """Value and derivatives; where the filter overflows, a value that no search keeps."""
        value, scores, z = self.prior_value(v), [], v[: self.m]
        gradient, information = np.zeros(self.size), np.zeros((self.size, self.size))
        gradient[: self.m] = self.prior_weight * (z - self.prior_centre)
        information[range(self.m), range(self.m)] = self.prior_weight
        for found, samples, slot in zip(self.derivatives(v), self.samples, self.slots, strict=True):
            columns = [*range(self.m + self.k), *range(slot.start, slot.stop)]
            seen = samples.seen.T > 0.0
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
        # d(e/sqrt S) = de/sqrt S - e dS/(2 S^1.5),   d(log S)/2 = dS/(2 S)
        by_s = found.ds / found.s[..., None] / 2
        by_e = found.de / root[..., None]
        weight = self.loss.weight(normal)[..., None]
        each = weight * normal[..., None] * (by_e - normal[..., None] * by_s) + by_s
        # expected information: de de'/S + dS dS'/(2 S^2)   (Harvey 1989, 3.4.69)
        rows = np.concatenate([(np.sqrt(weight) * by_e)[seen], sqrt(2.0) * by_s[seen]])
        return loss, np.where(seen[..., None], each, 0.0).sum(axis=1), rows

    def prior_value(self, v: Array) -> float:
        """The prior's share of the criterion."""
        return float(self.prior_weight @ (v[: self.m] - self.prior_centre) ** 2) / 2


def channels_of(runs: Sequence[Run], moving: str) -> tuple[str, ...]:
    """Channels of the runs of one kind in the filter's order; ValueError on one that is no sample of a state."""
    found = {name for run in runs if run.moving == moving for name in run.series}
    if unknown := found - set(CHANNELS):
        raise ValueError(f"the filter takes {', '.join(CHANNELS)}, not {', '.join(sorted(unknown))}")
    return tuple(name for name in CHANNELS if name in found)
