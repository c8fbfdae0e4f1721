"""Models of a signal without inputs: AR by least squares, ARMA by two regressions, by singular spectra, by PEM.

Rules of this file: inputs of the data are left aside; e has the variance `model.variance`, the leading coefficients
are one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter, oaconvolve

from hoopd.ident.checks import check
from hoopd.ident.data import Data, experiments
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.modelchecks import check_model, check_order
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial.arx import arx
from hoopd.ident.polynomial.estimators import Estimator, least_squares
from hoopd.ident.polynomial.pem import pem
from hoopd.ident.polynomial.plr import regressed
from hoopd.ident.polynomial.regression import regressors, residuals, solve_arx
from hoopd.ident.polynomial.stable import reflected
from hoopd.ident.polynomial.structure import single, structure

Array = NDArray[np.float64]

# Largest window of the singular spectra, and the share of their directions that is signal.
WINDOW = 2000
SIGNAL = 0.75
# Two values on each coefficient of a long AR model at least.
LONG_SHARE = 4


def ar(
    data: Data | Sequence[Data], na: int, *, ridge: float = 0.0, estimator: Estimator | None = None
) -> Polynomials:  # fmt: skip
    """A y = e by least squares; `ridge` and `estimator` as in `arx`. Missing outputs: their equations are dropped."""
    return arx(_alone(data), na, (), (), ridge=ridge, estimator=estimator)


def arma(
    data: Data | Sequence[Data], na: int, nc: int, *, method: Literal["pem", "two-stage"] = "pem",
    initial_order: int = 20, estimator: Estimator = least_squares,
) -> Polynomials:  # fmt: skip
    """A y = C e: "pem" is the maximum-likelihood estimate with covariance, "two-stage" regresses on AR innovations."""
    each = _alone(data)
    single(each)
    own = structure(0, na, (), nc, delay=())
    if method == "pem":
        return pem(each, own)
    if method != "two-stage":
        raise ValueError(f'method is "pem" or "two-stage", not {method!r}')
    check(each, orders=replace(own.asked, parameters=own.size + initial_order, lost=own.lost + initial_order))
    model, spread = regressed(each, own, initial_order, 1, estimator)
    n = sum(one.n for one in each)
    check_model(model, n)
    check_order(replace(model, covariance=spread), n)
    return model


def arma_ssa(
    data: Data, na: int, nc: int, *, window: int | None = None, signal: float = SIGNAL,
    estimator: Estimator = least_squares,
) -> Polynomials:  # fmt: skip
    """A y = C e of a signal under white measurement noise: its weakest singular directions are taken away first.

    `window` lags (the smaller of half the samples and 2000), of whose directions the share `signal` stays. The
    innovations come from a long AR model of a fifth of the window. Complete data; no covariance. Source: Golyandina,
    Nekrutkin & Zhigljavsky, Analysis of Time Series Structure: SSA (2001).
    """
    one = _alone(data)[0]
    single([one])
    if not one.complete:
        raise ValueError(
            "singular spectra need every output: cut the data at the missing samples (hoopd.ident.data.runs)"
        )
    size = min(one.n // 2, WINDOW) if window is None else int(window)
    if not (2 <= size <= one.n // 2 and 0.0 < signal <= 1.0):
        raise ValueError("window is 2 samples to half of the data, signal a share above 0")
    long = min(max(size // 5, na + nc), one.n // LONG_SHARE)
    own = structure(0, na, (), nc, delay=())
    check(one, orders=replace(own.asked, parameters=own.size + long, lost=own.lost + long))
    smooth = reconstructed(one.y[:, 0], size, signal)[:, None]
    driven = replace(one, y=smooth, u=_innovations(one, long), inputs=("e",))
    a, y = regressors(driven, na, nc, 1)
    x = estimator(a, y)
    model = own.model(x, one, float(np.square(y - a @ x).sum()) / (len(y) - own.size))
    check_model(model, one.n)
    return model


def _innovations(data: Data, order: int) -> Array:
    """e (n, 1) of a long AR model, NaN where its lags reach before the data."""
    rest = residuals(_solved(data, order), data)
    return np.concatenate([np.full(data.n - len(rest), np.nan), rest])[:, None]


def _solved(data: Data, order: int) -> Polynomials:
    """AR model of one complete experiment with nothing checked."""
    own = structure(0, order, (), delay=())
    return own.model(solve_arx([data], own)[0], data)


def reconstructed(y: Array, window: int, signal: float) -> Array:
    """A series (n,) without its weakest singular directions; memory linear in n.

    Hankelisation of the trajectory matrix on direction v is the series filtered by v and by v reversed, over the
    number of windows that hold each sample.
    """
    n = len(y)
    _, vectors = np.linalg.eigh(lagged_gram([y], [range(window)], window - 1))
    weak = vectors[:, : round((1.0 - signal) * window)]
    noise = np.zeros(n)
    for v in weak.T:
        # lagged_gram counts backwards: v[k] belongs to y(t - k)
        noise += oaconvolve(oaconvolve(y, v, "valid"), v[::-1])
    held = np.minimum(np.minimum(np.arange(1, n + 1), n - np.arange(n)), min(window, n - window + 1))
    return np.asarray(y - noise / held)


def driving_noise(model: Polynomials, data: Data) -> Array:
    """e (n,) of an AR or ARMA model from y = C/A e, started from rest; C is made stable. Complete data."""
    if not data.complete:
        raise ValueError("the driving noise needs every output: cut the data at the missing samples")
    return np.asarray(lfilter(model.a, reflected(model.c), data.y[:, 0]))


def _alone(data: Data | Sequence[Data]) -> list[Data]:
    return [replace(one, u=one.u[:, :0], inputs=()) for one in experiments(data)]
