"""How well a fit knows its parameters: covariance under coloured residuals, intervals, what is not determined.

Rules of this file: it reads a solution, it never improves one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import fftconvolve

from hoopd.ident.normal import Z95
from hoopd.plants.fits.output_error import Solution, prior_of
from hoopd.plants.fits.robust_least_squares import loss_weight

Array = NDArray[np.float64]

# Longest memory of the residuals' autoregressive model, in samples: at 50 Hz more than a period of the rolling ball.
MOST_LAGS = 60
# Evidence against white residuals that counts: a BIC lower by 10 is very strong evidence (Kass and Raftery 1995); every
# hundredth white run of a thousand samples is a little lower by chance.
CLEARLY_COLOURED = 10.0
# An autocorrelation below this no longer counts.
TAIL = 1e-4


class Uncertainty(NamedTuple):
    """Of the fitted parameters on the search's scale (logarithms of positive ones, in units of the nominal else)."""

    covariance: Array  # (m, m)
    information: Array  # (m, m) of the data alone, as if residuals were white, starts profiled out
    memory: dict[str, int]  # order of the residuals' autoregressive model by channel; 0: white

    @property
    def correlation(self) -> Array:
        """(m, m)"""
        sd = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(sd, sd))


def uncertainty(solution: Solution, loss: str = "linear") -> Uncertainty:
    """Covariance A^-1 B A^-1, A = J'J + prior, B = J'RJ + prior with R the residuals' autocorrelation.

    J: derivatives in units of sigma with the runs' starts profiled out. R by an autoregressive model of each channel
    (order by BIC; white residuals give R = 1 and the textbook's covariance). Source: sandwich covariance, Ljung,
    System Identification (1999) 9.4; Huber (1967).
    """
    m = len(solution.names)
    lags = {name: autocorrelation(_all(solution, name, loss)) for name in solution.sigma}
    a, b = np.zeros((m, m)), np.zeros((m, m))
    for errors, jacobians in zip(solution.residuals, solution.jacobian, strict=True):
        profiled = _profiled(errors, jacobians, solution, loss)
        for name, j in profiled.items():
            a += j.T @ j
            b += j.T @ correlate(j, lags[name])
    prior = prior_information(solution)
    freedom = _freedom(solution)
    inverse = np.linalg.pinv(a + prior, hermitian=True)
    return Uncertainty(inverse @ (b * freedom + prior) @ inverse, a, {name: len(r) - 1 for name, r in lags.items()})


def _profiled(errors: dict[str, Array], jacobians: dict[str, Array], solution: Solution, loss: str) -> dict[str, Array]:
    """Derivatives by the parameters, less what the run's own start can imitate; in units of sigma."""
    m, rows = len(solution.names), []
    for name, j in jacobians.items():
        weight = np.sqrt(loss_weight(errors[name] / solution.sigma[name], loss))
        rows.append(j / solution.sigma[name] * weight[:, None])
    stacked = np.vstack(rows)
    by_p, by_start = stacked[:, :m], stacked[:, m:]
    rest = by_p - by_start @ np.linalg.lstsq(by_start, by_p, rcond=None)[0]
    cuts = np.cumsum([len(j) for j in rows])[:-1]
    return dict(zip(jacobians, np.split(rest, cuts), strict=True))


def _freedom(solution: Solution) -> float:
    """n / (n - estimated numbers): sigma was taken from the same residuals."""
    count = sum(len(e) for run in solution.residuals for e in run.values())
    estimated: int = len(solution.names) + sum(
        next(iter(j.values())).shape[1] - len(solution.names) for j in solution.jacobian
    )
    return float(count) / max(count - estimated, 1)


def prior_information(solution: Solution) -> Array:
    """(m, m) diagonal: 1 / sigma^2 of the priors on the search's scale."""
    return np.diag(prior_of(solution.scale, solution.priors)[1] ** 2)


def _all(solution: Solution, name: str, loss: str) -> list[Array]:
    """A channel's residuals of every run, as much of them as counts."""
    sigma = solution.sigma[name]
    return [np.sqrt(loss_weight(e[name] / sigma, loss)) * e[name] for e in solution.residuals if name in e]


def autocorrelation(runs: Sequence[Array]) -> Array:
    """1, r_1, ... of an autoregressive model of the residuals, until it has died away; (1,) when they are white.

    Yule-Walker over all runs, order by BIC: n log(sigma_p^2) + p log n.
    """
    n = sum(len(e) for e in runs)
    most = min(MOST_LAGS, n // 10, max(len(e) for e in runs) - 1)
    r = np.array([sum(float(e[lag:] @ e[: max(len(e) - lag, 0)]) for e in runs) for lag in range(most + 1)])
    if most < 1 or r[0] <= 0.0:
        return np.ones(1)
    r = r / r[0]
    best, coefficients = 0.0, np.zeros(0)
    for order in range(1, most + 1):
        a = solve_toeplitz(r[:order], r[1 : order + 1])
        left = max(1.0 - float(a @ r[1 : order + 1]), 1e-12)
        score = n * np.log(left) + order * np.log(n)
        if score < best:
            best, coefficients = score, a
    if best > -CLEARLY_COLOURED:
        return np.ones(1)
    return _continued(r, coefficients, max(len(e) for e in runs))


def _continued(r: Array, a: Array, most: int) -> Array:
    """r_k = sum_i a_i r_k-i beyond the model's order."""
    order = len(a)
    if order == 0:
        return np.ones(1)
    out = list(r[: order + 1])
    while len(out) < most and np.abs(out[-order:]).max() > TAIL:
        out.append(float(a @ np.array(out[-1 : -order - 1 : -1])))
    return np.array(out)


def correlate(j: Array, r: Array) -> Array:
    """R j for the symmetric Toeplitz matrix R of the autocorrelation r."""
    if len(r) == 1:
        return j
    kernel = np.concatenate([r[:0:-1], r])
    return np.asarray(fftconvolve(j, kernel[:, None], axes=0)[len(r) - 1 : len(r) - 1 + len(j)])


def intervals(solution: Solution, found: Uncertainty) -> dict[str, tuple[float, float]]:
    """95 % intervals of the parameters by name; of positive ones they are geometric and stay positive."""
    half = Z95 * np.sqrt(np.diag(found.covariance))
    low, high = solution.scale.parameters(solution.z - half), solution.scale.parameters(solution.z + half)
    return {name: (float(a), float(b)) for name, a, b in zip(solution.names, low, high, strict=True)}
