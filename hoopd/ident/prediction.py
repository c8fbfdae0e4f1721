"""Prediction-error fit: parameters and noise levels together, by the likelihood of a Kalman filter's innovations.

    min over p, q, r, x0_r of  sum_r sum_k (e^2 / S + log S) / 2  +  prior,

e and S from `innovations.py` (Ljung, System Identification, 2nd ed., 7.4; Harvey, Forecasting, Structural Time Series
Models and the Kalman Filter, 3.4; Kristensen, Madsen and Jorgensen, Automatica 40 (2004) for q as a measure of what
the model leaves out). Where the output-error fit blames every disturbance on the parameters, this one has a place for
it. The search is scipy's trust region with exact gradients and the likelihood's information matrix.

Rules of this file: numbers in, numbers out; no files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import erf, inf, log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hoopd.ident.experiments import Run
from hoopd.ident.gaussnewton import ROBUST_SIGMA
from hoopd.ident.innovations import CHANNELS, Derivatives, Innovations, InnovationsFilter, samples_of
from hoopd.ident.noise import NoiseModel, NoiseScale, noise_scale
from hoopd.ident.outputerror import Progress, Solution, free_starts
from hoopd.ident.parameters import Prior, Scale, scale_of
from hoopd.physics.plant import ExtraForce

Array = NDArray[np.float64]

# Two searches, the second in the units that the first one found; a third changes nothing.
ROUNDS = 3
MOST_STEPS = 100
# Norm of the gradient in units of one standard deviation: what is left to gain is below its square, 1e-6.
SMALL_GRADIENT = 1e-3
# What a search is told where the filter overflows: far above any likelihood.
LOST = 1e100
# A level whose removal costs less than this (log-likelihood) is not there.
NEGLIGIBLE = 1e-2


class Evaluation(NamedTuple):
    """Negative log-likelihood with prior at a point: value, exact gradient, expected information."""

    value: float
    gradient: Array  # (v,)
    information: Array  # (v, v)
    scores: list[Array]  # (n, v) of every run: the data's share of the gradient by node


@dataclass(frozen=True, kw_only=True)
class PredictionSolution(Solution):
    """`Solution` with noise. `residuals`: innovations in the channel's unit, `sigma`: their standard deviation,
    `jacobian`: derivatives of the innovations; `cost`: negative log-likelihood plus prior."""

    q: dict[str, float]  # by state, variance per second
    r: dict[str, float]  # by channel, variance of a sample
    noise_names: tuple[str, ...]  # the estimated ones
    at_floor: tuple[str, ...]  # of these, what the data show no sign of
    log_likelihood: float
    samples: int
    normalised: list[dict[str, Array]]  # innovations / sqrt(S) by run and channel: white with variance 1
    vector: Array = field(repr=False)  # (v,) search coordinates of everything
    problem: Likelihood = field(repr=False)

    @property
    def levels(self) -> dict[str, float]:
        """q and r by the names `q_<state>`, `r_<channel>`."""
        return {**{f"q_{n}": v for n, v in self.q.items()}, **{f"r_{n}": v for n, v in self.r.items()}}


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
        huber: float,
    ) -> None:
        self.runs, self.scale, self.huber = list(runs), scale, huber
        free = noise.free(runs)
        self.levels = noise.values(free)
        self.noise: NoiseScale = noise_scale(free, self.levels, noise.floors())
        self._kappa = 1.0 if huber == inf else erf(huber / sqrt(2.0))
        everything, moved = {**values, **self.levels}, (*scale.names, *free)
        kinds = {run.moving: channels_of(runs, run.moving) for run in runs}
        self.filters = {
            moving: InnovationsFilter(structure, everything, moved, channels, extra_forces, moving=moving, huber=huber)
            for moving, channels in kinds.items()
        }
        self.samples = [samples_of(run, kinds[run.moving]) for run in runs]
        self.count = int(sum(sample.seen.sum() for sample in self.samples))
        self.free_starts = [free_starts(run) for run in runs]
        self.m, self.k = len(scale.names), len(free)
        offsets = np.cumsum([self.m + self.k, *(len(one) for one in self.free_starts)])
        self.slots = [slice(int(a), int(b)) for a, b in pairwise(offsets)]
        self.size = int(offsets[-1])
        self._prior_weight, self._prior_centre = _prior(scale, priors)

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

    def innovations(self, v: Array) -> list[Innovations]:
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
        """Negative log-likelihood (Huber's loss where asked for) plus prior, without the constant log(2 pi) / 2."""
        total = self._prior_value(v)
        for found, samples in zip(self.innovations(v), self.samples, strict=True):
            seen = samples.seen.T > 0.0
            e, s = found.e[seen], found.s[seen]
            if not (np.isfinite(e).all() and np.isfinite(s).all() and (s > 0.0).all()):
                return LOST
            total += float(np.sum(self._loss(e / np.sqrt(s)) + np.log(s) / 2))
        return min(total, LOST)

    def evaluate(self, v: Array) -> Evaluation:
        """Value and derivatives at a point where the filter does not overflow."""
        value, scores = self._prior_value(v), []
        gradient, information = np.zeros(self.size), np.zeros((self.size, self.size))
        gradient[: self.m] = self._prior_weight * (v[: self.m] - self._prior_centre)
        information[range(self.m), range(self.m)] = self._prior_weight
        for found, samples, slot in zip(self.derivatives(v), self.samples, self.slots, strict=True):
            columns = [*range(self.m + self.k), *range(slot.start, slot.stop)]
            seen = samples.seen.T
            root = np.sqrt(found.s)
            normal = found.e / root
            value += float(np.sum(seen * (self._loss(normal) + np.log(found.s) / 2)))
            # d(e/sqrt S) = de/sqrt S - e dS/(2 S^1.5),   d(log S)/2 = dS/(2 S)
            by_s = found.ds / found.s[..., None] / 2
            by_e = found.de / root[..., None]
            pull = np.clip(normal, -self.huber, self.huber) / self._kappa
            each = pull[..., None] * (by_e - normal[..., None] * by_s) + by_s
            score = np.zeros((len(normal), self.size))
            score[:, columns] = (seen[..., None] * each).sum(axis=1)
            scores.append(score)
            gradient += score.sum(axis=0)
            # expected information: de de'/S + dS dS'/(2 S^2)   (Harvey 1989, 3.4.69)
            rows = np.concatenate([by_e, sqrt(2.0) * by_s])[np.concatenate([seen, seen]) > 0.0]
            information[np.ix_(columns, columns)] += rows.T @ rows
        return Evaluation(value, gradient, information, scores)

    def _loss(self, e: Array) -> Array:
        inside = np.minimum(np.abs(e), self.huber)
        # kappa makes S the variance of the good samples: E[psi(e) e] = P(|e| < c) under normal errors
        return np.asarray((inside * np.abs(e) - inside**2 / 2) / self._kappa)

    def _prior_value(self, v: Array) -> float:
        return float(self._prior_weight @ (v[: self.m] - self._prior_centre) ** 2) / 2


def channels_of(runs: Sequence[Run], moving: str) -> tuple[str, ...]:
    """Channels of the runs of one kind in the filter's order; ValueError on one that is no sample of a state."""
    found = {name for run in runs if run.moving == moving for name in run.series}
    if unknown := found - set(CHANNELS):
        raise ValueError(f"the filter takes {', '.join(CHANNELS)}, not {', '.join(sorted(unknown))}")
    return tuple(name for name in CHANNELS if name in found)


def _prior(scale: Scale, priors: Mapping[str, Prior]) -> tuple[Array, Array]:
    """1 / sigma^2 and centre (m,) on the search's scale."""
    weight, centre = np.zeros(len(scale.names)), scale.nominal.copy()
    for index, name in enumerate(scale.names):
        if name in priors:
            size = 1.0 if scale.positive[index] else abs(scale.nominal[index]) or 1.0
            weight[index], centre[index] = (size / priors[name].sigma) ** 2, priors[name].value
    return weight, scale.coordinates(centre)


# ---------------------------------------------------------------------------------------------- search


def fit_prediction_error(
    structure: str,
    values: Mapping[str, float],
    names: Sequence[str],
    runs: Sequence[Run],
    *,
    priors: Mapping[str, Prior] | None = None,
    noise: NoiseModel | None = None,
    loss: str = "linear",
    starts: Sequence[Array] | None = None,
    extra_forces: tuple[ExtraForce, ...] = (),
    progress: Progress = lambda text: None,
) -> PredictionSolution:
    """Parameters `names` (start: `values`), noise levels and the runs' initial states (start: `starts` or the runs'
    own); runs prepared with the channels theta, dtheta, psi; loss: linear or huber."""
    if loss not in ("linear", "huber"):
        raise ValueError(f"loss {loss!r}: the prediction-error fit knows linear and huber")
    priors = {name: prior for name, prior in (priors or {}).items() if name in names}
    huber = inf if loss == "linear" else ROBUST_SIGMA
    scale = scale_of(structure, names, values)
    problem = Likelihood(structure, values, runs, scale, priors, noise or NoiseModel(), extra_forces, huber)
    search = _Search(problem, progress)
    v, found = search.minimum(problem.first(starts))
    v, at_floor = _without_idle_noise(problem, v)
    return _solution(problem, v, at_floor, values, priors, search.evaluations, bool(found.success), str(found.message))


class _Search:
    """Trust-region search in units of standard deviations."""

    def __init__(self, problem: Likelihood, progress: Progress) -> None:
        self.problem, self.progress, self.evaluations = problem, progress, 0

    def minimum(self, v: Array) -> tuple[Array, Any]:
        before = inf
        for round_ in range(ROUNDS):
            v, found = self._round(v)
            self.progress(f"round {round_ + 1}: -log likelihood {found.fun:.6g} after {self.evaluations} runs")
            if before - found.fun < SMALL_GRADIENT:
                break
            before = float(found.fun)
        return v, found

    def _round(self, v: Array) -> tuple[Array, Any]:
        unit = _units(self.problem.evaluate(v).information)
        cache: dict[bytes, Evaluation] = {}

        def at(y: Array) -> Evaluation:
            key = y.tobytes()
            if key not in cache:
                cache.clear()
                cache[key] = self.problem.evaluate(v + unit * y)
                self.evaluations += 1
            return cache[key]

        def value(y: Array) -> float:
            self.evaluations += 1
            return self.problem.value(v + unit * y)

        found = minimize(
            value,
            np.zeros(len(v)),
            jac=lambda y: unit * at(y).gradient,
            hess=lambda y: unit[:, None] * at(y).information * unit,
            method="trust-exact",
            options={
                "gtol": SMALL_GRADIENT,
                "maxiter": MOST_STEPS,
                "initial_trust_radius": 10.0,
                "max_trust_radius": 1e4,
            },
        )
        return v + unit * found.x, found


def _units(information: Array) -> Array:
    """One standard deviation of each coordinate with the others held; 1 where the data say nothing."""
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(information), 1.0)))


def _without_idle_noise(problem: Likelihood, v: Array) -> tuple[Array, tuple[str, ...]]:
    """The same point with every noise level at its floor that can be there for nothing, and their names."""
    best, idle = problem.value(v), []
    for index, name in enumerate(problem.noise.names):
        lower = v.copy()
        lower[problem.m + index] = -60.0
        value = problem.value(lower)
        if value < best + NEGLIGIBLE:
            v, best = lower, min(value, best)
            idle.append(name)
    return v, tuple(idle)


def _solution(
    problem: Likelihood,
    v: Array,
    at_floor: tuple[str, ...],
    values: Mapping[str, float],
    priors: Mapping[str, Prior],
    evaluations: int,
    converged: bool,
    message: str,
) -> PredictionSolution:
    numbers = dict(zip((*problem.scale.names, *problem.noise.names), problem.numbers(v), strict=True))
    levels = {**problem.levels, **{name: float(numbers[name]) for name in problem.noise.names}}
    residuals, normalised, jacobian = [], [], []
    for run, found, samples in zip(problem.runs, problem.derivatives(v), problem.samples, strict=True):
        parts = list(enumerate(problem.filters[run.moving].channels))
        seen = {name: samples.seen[i] > 0.0 for i, name in parts}
        residuals.append({name: found.e[seen[name], i] for i, name in parts if seen[name].any()})
        normalised.append({n: (found.e / np.sqrt(found.s))[seen[n], i] for i, n in parts if seen[n].any()})
        jacobian.append({name: found.de[seen[name], i] for i, name in parts if seen[name].any()})
    channels = [name for name in CHANNELS if any(name in part for part in residuals)]
    value = problem.value(v)
    likelihood = -(value - problem._prior_value(v)) - problem.count * log(2 * pi) / 2
    return PredictionSolution(
        names=problem.scale.names,
        values={**values, **{name: float(numbers[name]) for name in problem.scale.names}},
        scale=problem.scale,
        z=v[: problem.m],
        starts=problem.starts(v),
        sigma={n: float(np.std(np.concatenate([p[n] for p in residuals if n in p]))) for n in channels},
        residuals=residuals,
        jacobian=jacobian,
        cost=value,
        steps=evaluations,
        converged=converged,
        priors=priors,
        q={name[2:]: level for name, level in levels.items() if name.startswith("q_")},
        r={name: levels[f"r_{name}"] for name in channels},
        noise_names=problem.noise.names,
        at_floor=at_floor,
        log_likelihood=likelihood,
        samples=problem.count,
        normalised=normalised,
        vector=v,
        problem=problem,
    )
