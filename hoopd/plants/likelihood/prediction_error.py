"""Prediction-error fit: parameters and noise levels together, by the likelihood of a Kalman filter's innovations.

Where the output-error fit blames every disturbance on the parameters, this one has a place for it: q says what the
model leaves out (Kristensen, Madsen and Jorgensen, Automatica 40 (2004)).

Rules of this file: numbers in, numbers out; no files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import log, pi

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.output_error import Progress, Solution
from hoopd.plants.fits.runs import Run
from hoopd.plants.likelihood.innovation_likelihood import LOSSES, FilteredSystem, Likelihood
from hoopd.plants.likelihood.likelihood_search import Search
from hoopd.plants.likelihood.noise_scale import NoiseLevels

Array = NDArray[np.float64]

# A level whose removal costs less than this (log-likelihood) is not there.
NEGLIGIBLE = 1e-3
# Search coordinate of a level at its floor.
AT_FLOOR = -60.0


@dataclass(frozen=True, kw_only=True)
class PredictionSolution(Solution):
    """`Solution` with noise. `residuals`: innovations in the channel's unit, `sigma`: their standard deviation,
    `jacobian`: derivatives of the innovations; `cost`: negative log-likelihood plus prior."""

    q: dict[str, float]  # by state, variance per second
    r: dict[str, float]  # by channel, variance of a sample
    noise_names: tuple[str, ...]  # the estimated ones
    noise_gains: dict[str, float]  # of these: log-likelihood lost without it; below 2 it may as well not be there
    log_likelihood: float  # with its constants; of the robust loss no likelihood but comparable with itself
    samples: int
    normalised: list[dict[str, Array]]  # innovations / sqrt(S) by run and channel: white with variance 1
    vector: Array = field(repr=False)  # (v,) search coordinates of everything
    problem: Likelihood = field(repr=False)

    @property
    def at_floor(self) -> tuple[str, ...]:
        """Estimated noise levels of which the data show no sign."""
        return tuple(name for name, gain in self.noise_gains.items() if gain < NEGLIGIBLE)

    @property
    def levels(self) -> dict[str, float]:
        """q and r by the names `q_<state>`, `r_<channel>`."""
        return {**{f"q_{n}": v for n, v in self.q.items()}, **{f"r_{n}": v for n, v in self.r.items()}}


def fit_prediction_error(
    system: FilteredSystem,
    names: Sequence[str],
    runs: Sequence[Run],
    noise: NoiseLevels,
    *,
    priors: Mapping[str, Prior] | None = None,
    loss: str = "linear",
    starts: Sequence[Array] | None = None,
    progress: Progress = lambda text: None,
) -> PredictionSolution:
    """Parameters `names`, noise levels and the runs' initial states (start: `starts` or the runs' own); runs prepared
    with channels of the plant; loss: linear or student (bears outliers)."""
    if loss not in LOSSES:
        raise ValueError(f"loss {loss!r}: the prediction-error fit knows {', '.join(LOSSES)}")
    priors = {name: prior for name, prior in (priors or {}).items() if name in names}
    v, evaluations = np.zeros(0), 0
    # from far away every sample would look like an outlier: the robust search begins where the plain one ends
    for stage in dict.fromkeys(("linear", loss)):
        problem = Likelihood(system, names, runs, noise, priors=priors, loss=stage)
        search = Search(problem, progress)
        v, converged = search.minimum(v if len(v) else problem.first(starts))
        evaluations += search.evaluations
    v, gains = _without_idle_noise(problem, v)
    return _solution(problem, v, gains, system.values, priors, evaluations, converged)


def _without_idle_noise(problem: Likelihood, v: Array) -> tuple[Array, dict[str, float]]:
    """The same point with every noise level at its floor that is there for nothing; what each of them is worth."""
    best, gains = problem.value(v), {}
    for index, name in enumerate(problem.noise.names):
        lower = v.copy()
        lower[problem.m + index] = AT_FLOOR
        gains[name] = problem.value(lower) - best
        if gains[name] < NEGLIGIBLE:
            v, best = lower, best + gains[name]
    return v, gains


def _solution(
    problem: Likelihood,
    v: Array,
    gains: dict[str, float],
    values: Mapping[str, float],
    priors: Mapping[str, Prior],
    evaluations: int,
    converged: bool,
) -> PredictionSolution:
    numbers = dict(zip((*problem.scale.names, *problem.noise.names), problem.numbers(v), strict=True))
    levels = {**problem.levels, **{name: float(numbers[name]) for name in problem.noise.names}}
    residuals, normalised, jacobian = [], [], []
    for run, found, samples in zip(problem.runs, problem.derivatives(v), problem.samples, strict=True):
        parts = list(enumerate(problem.filters[run.moving].channels))
        seen = {name: samples.seen[:, i] > 0.0 for i, name in parts}
        residuals.append({name: found.e[seen[name], i] for i, name in parts if seen[name].any()})
        normalised.append({n: (found.e / np.sqrt(found.s))[seen[n], i] for i, n in parts if seen[n].any()})
        jacobian.append({name: found.de[seen[name], i] for i, name in parts if seen[name].any()})
    channels = [name for name in problem.channels if any(name in part for part in residuals)]
    value = problem.value(v)
    likelihood = -(value - problem.prior_value(v)) - problem.count * log(2 * pi) / 2
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
        noise_gains=gains,
        log_likelihood=likelihood,
        samples=problem.count,
        normalised=normalised,
        vector=v,
        problem=problem,
    )
