"""How well a prediction-error fit knows its numbers, and whether its innovations are as white as it believes.

Rules of this file: it reads a solution, it never improves one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from hoopd.ident.normal import Z95
from hoopd.plants.fits.uncertainty import Uncertainty
from hoopd.plants.likelihood.innovation_likelihood import Evaluation, Likelihood
from hoopd.plants.likelihood.likelihood_search import units
from hoopd.plants.likelihood.prediction_error import PredictionSolution

Array = NDArray[np.float64]

# Step of the differences of the exact gradient, in standard deviations: far above rounding (1e-9), and the likelihood
# is no parabola to better than a thousandth anyway.
HESSIAN_STEP = 1e-3
LAGS = 20
# Innovations less white than this make the sandwich the covariance that is given.
WHITE_P = 0.01


class Whiteness(NamedTuple):
    """Normalised innovations of one channel: white with variance 1 if the model and its noise are right."""

    samples: int
    mean_square: float  # 1
    lag1: float  # 0: autocorrelation of neighbours
    ljung_box: float  # chi-square with LAGS degrees of freedom
    p_value: float  # of so large a value under white noise


class PredictionUncertainty(NamedTuple):
    """Covariances on the search's scale and 95 % intervals of the noise levels."""

    parameters: Uncertainty  # what `uncertainty.intervals` takes; the sandwich where innovations are not white
    model_based: Array  # (m, m) inverse of the likelihood's second derivatives
    sandwich: Array  # (m, m)
    noise: dict[str, tuple[float, float]]  # levels at their floor have (floor, nan)
    whiteness: dict[str, Whiteness]  # by channel


def prediction_uncertainty(solution: PredictionSolution) -> PredictionUncertainty:
    """Covariance H^-1 and H^-1 B H^-1, H the second derivatives of the criterion with starts and noise levels in
    them, B the scores' long-run covariance (Bartlett weights; Newey and West 1987). Source: Ljung (1999) 9.4, 9.5."""
    problem, v = solution.problem, solution.vector
    m, names = problem.m, problem.noise.names
    fixed = [m + names.index(name) for name in solution.at_floor]
    kept = np.setdiff1d(np.arange(problem.size), fixed)
    here = problem.evaluate(v)
    unit = units(here.information)
    inverse = _inverse(hessian(problem, v, unit), unit[:, None] * here.information * unit, kept, unit)
    outer = _long_run(here, problem.size)
    outer[range(m), range(m)] += problem.prior_weight
    robust = inverse @ outer @ inverse
    white = {name: whiteness([run[name] for run in solution.normalised if name in run]) for name in solution.sigma}
    coloured = any(one.p_value < WHITE_P for one in white.values())
    covariance = (robust if coloured else inverse)[:m, :m]
    information = here.information[:m, :m] - np.diag(problem.prior_weight)
    memory = {name: LAGS if one.p_value < WHITE_P else 0 for name, one in white.items()}
    sd = np.sqrt(np.diag(robust if coloured else inverse))
    noise = {name: _level_interval(solution, m + i, name, float(sd[m + i])) for i, name in enumerate(names)}
    found = Uncertainty(covariance, information, memory)
    return PredictionUncertainty(found, inverse[:m, :m], robust[:m, :m], noise, white)


def whiteness(runs: Sequence[Array]) -> Whiteness:
    """Ljung-Box test over runs: Q = n (n + 2) sum_k r_k^2 / (n - k)   (Ljung and Box 1978).

    Innovations have no mean under the model, so that none is taken off, as the residuals' test of `ident` does.
    """
    n = sum(len(e) for e in runs)
    r = np.array([sum(float(e[k:] @ e[: max(len(e) - k, 0)]) for e in runs) for k in range(LAGS + 1)])
    square, r = r[0] / n, r / r[0]
    q = n * (n + 2) * float(np.sum(r[1:] ** 2 / (n - np.arange(1, LAGS + 1))))
    return Whiteness(n, float(square), float(r[1]), q, float(chdtrc(LAGS, q)))


def hessian(problem: Likelihood, v: Array, unit: Array) -> Array:
    """Second derivatives (v, v) per `unit` by differences of the exact gradient."""
    here, rows = problem.with_gradient(v).gradient, []
    for index in range(len(v)):
        step = np.zeros(len(v))
        step[index] = HESSIAN_STEP * unit[index]
        after = problem.with_gradient(v + step).gradient
        rows.append(unit * (after - here) / HESSIAN_STEP)
    return np.asarray(rows + np.transpose(rows)) / 2


def _inverse(curvature: Array, information: Array, kept: NDArray[np.int64], unit: Array) -> Array:
    """Covariance of the coordinates `kept`, zero elsewhere; the expected information stands in for no minimum."""
    square = np.ix_(kept, kept)
    used = curvature[square]
    if np.linalg.eigvalsh(used)[0] <= 0.0:
        used = information[square]
    out = np.zeros_like(curvature)
    out[square] = np.linalg.pinv(used, hermitian=True)
    return np.asarray(unit[:, None] * out * unit)


def _long_run(here: Evaluation, size: int) -> Array:
    """Sum over lags of the scores' autocovariance."""
    out = np.zeros((size, size))
    for score in here.scores:
        lags = round(2 * len(score) ** (1 / 3))
        out += score.T @ score
        for lag in range(1, lags + 1):
            part = score[lag:].T @ score[:-lag]
            out += (1 - lag / (lags + 1)) * (part + part.T)
    return out


def _level_interval(solution: PredictionSolution, index: int, name: str, sd: float) -> tuple[float, float]:
    problem, level = solution.problem, solution.levels[name]
    floor = float(problem.noise.floor[index - problem.m])
    if name in solution.at_floor:
        return floor, float("nan")
    # the search's coordinate is log(level - floor)
    factor = float(np.exp(min(Z95 * sd, 50.0)))
    return floor + (level - floor) / factor, floor + (level - floor) * factor
