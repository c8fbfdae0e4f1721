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
from hoopd.ident.estimation_report import estimated
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.modelchecks import check_model, check_order
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial.arx import arx
from hoopd.ident.polynomial.estimators import MAD, Estimator, least_squares
from hoopd.ident.polynomial.pem import pem
from hoopd.ident.polynomial.plr import regressed
from hoopd.ident.polynomial.regression import regressors, residuals, solve_arx
from hoopd.ident.polynomial.stable import reflected
from hoopd.ident.polynomial.structure import single, structure

Array = NDArray[np.float64]

# Largest window of the singular spectra, and the share of their directions that is signal.
WINDOW = 2000
SIGNAL = 0.75
# Outliers lie so many robust standard deviations from the strongest directions, so large a share of those that stay.
FAR, OUTLIER_SHARE, OUTLIER_TURNS = 4.0, 0.25, 20
# Two values on each coefficient of a long AR model at least.
LONG_SHARE = 4


@estimated("AR")
def ar(
    data: Data | Sequence[Data], na: int, *, ridge: float = 0.0, estimator: Estimator | None = None
) -> Polynomials:  # fmt: skip
    """Fit an AR model A y = e by least squares; inputs of the data are left aside.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; equations with a missing output are dropped.
    na : int
        Coefficients of A after the leading 1.
    ridge : float
        As in `arx`.
    estimator : callable, optional
        As in `arx`.

    Returns
    -------
    Polynomials
        The model; e has the variance `variance`.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import ar, iddata
    >>> e = np.random.default_rng(0).standard_normal(3000)
    >>> model = ar(iddata(lfilter([1.0], [1.0, -1.6, 0.8], e), dt=0.1), na=2)
    >>> model.a.round(1), round(model.variance, 1)
    (array([ 1. , -1.6,  0.8]), 1.0)
    """
    return arx(_alone(data), na, (), (), ridge=ridge, estimator=estimator)


@estimated("ARMA")
def arma(
    data: Data | Sequence[Data], na: int, nc: int, *, method: Literal["pem", "two-stage"] = "pem",
    initial_order: int = 20, estimator: Estimator = least_squares,
) -> Polynomials:  # fmt: skip
    """Fit an ARMA model A y = C e; inputs of the data are left aside.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    na, nc : int
        Coefficients of A and C after the leading 1.
    method : {"pem", "two-stage"}
        The maximum-likelihood estimate with covariance, or a regression on the innovations of a long AR model.
    initial_order : int
        Of that AR model.
    estimator : callable
        Solves the regression of "two-stage", (A, y) -> x.

    Returns
    -------
    Polynomials
        The model; e has the variance `variance`.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import arma, iddata
    >>> e = np.random.default_rng(0).standard_normal(3000)
    >>> model = arma(iddata(lfilter([1.0, 0.5], [1.0, -0.8], e), dt=0.1), na=1, nc=1)
    >>> model.a.round(1), model.c.round(1)
    (array([ 1. , -0.8]), array([1. , 0.5]))
    """
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


@estimated("ARMA by singular spectra")
def arma_ssa(
    data: Data, na: int, nc: int, *, window: int | None = None, signal: float = SIGNAL, robust: bool = False,
    estimator: Estimator = least_squares,
) -> Polynomials:  # fmt: skip
    """Fit an ARMA model A y = C e of a signal under white measurement noise, by singular spectra.

    The weakest singular directions of the signal are taken away first. The innovations come from a long AR model of a
    fifth of the window. There is no covariance.

    Parameters
    ----------
    data : Data
        One experiment without gaps.
    na, nc : int
        Coefficients of A and C after the leading 1.
    window : int, optional
        Lags; the smaller of half the samples and 2000 unless given.
    signal : float
        Share of the window's directions that stays.
    robust : bool
        Whether outliers are told from the signal and taken out first: low rank and a few large values by turns, as in
        a robust principal component analysis.
    estimator : callable
        Solves the regression, (A, y) -> x.

    Returns
    -------
    Polynomials
        The model.

    Raises
    ------
    ValueError
        A gap, or a window or share that is none.

    Notes
    -----
    Sources: Golyandina, Nekrutkin & Zhigljavsky, Analysis of Time Series Structure: SSA (2001); Candes, Li, Ma &
    Wright, J. ACM 58 (2011), on a low rank beside a few large values.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import arma_ssa, iddata
    >>> e, v = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([1.0], [1.0, -1.8, 0.9], e) + 0.5 * v
    >>> model = arma_ssa(iddata(y, dt=0.1), na=2, nc=1, window=60)
    >>> pole = np.roots(model.a)[0]  # true: 0.95 and 0.32 rad
    >>> bool(abs(abs(pole) - 0.95) < 0.03), bool(abs(abs(np.angle(pole)) - 0.32) < 0.03)
    (True, True)
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
    if robust:
        one = replace(one, y=without_outliers(one.y[:, 0], size, signal)[:, None])
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


def without_outliers(y: Array, window: int, signal: float) -> Array:
    """A series (n,) without what lies far from its strongest singular directions.

    A quarter of the directions that stay is enough to tell an outlier by: with all of them it would be kept itself.
    """
    clean = y.copy()
    for _ in range(OUTLIER_TURNS):
        rest = y - reconstructed(clean, window, OUTLIER_SHARE * signal)
        far = np.abs(rest - np.median(rest)) > FAR * np.median(np.abs(rest - np.median(rest))) / MAD
        found = np.where(far, y - rest, y)
        if np.array_equal(found, clean):
            break
        clean = found
    return clean


def driving_noise(model: Polynomials, data: Data) -> Array:
    """Give the noise that drives an AR or ARMA model, from y = C/A e, started from rest; C is made stable.

    Parameters
    ----------
    model : Polynomials
        The model.
    data : Data
        One experiment without gaps.

    Returns
    -------
    ndarray, shape (n,)
        e.

    Raises
    ------
    ValueError
        A gap.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, driving_noise, iddata
    >>> driving_noise(Polynomials(1.0, a=np.array([1.0, -0.5])), iddata([1.0, 0.5, 2.25]))
    array([1., 0., 2.])
    """
    if not data.complete:
        raise ValueError("the driving noise needs every output: cut the data at the missing samples")
    return np.asarray(lfilter(model.a, reflected(model.c), data.y[:, 0]))


def _alone(data: Data | Sequence[Data]) -> list[Data]:
    return [replace(one, u=one.u[:, :0], inputs=()) for one in experiments(data)]
