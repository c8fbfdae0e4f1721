"""ARMAX by pseudo-linear regression: the innovations of a long ARX model are regressors like the inputs.

Linear steps only, so an estimator of choice fits in; `pem.armax` is the efficient estimate of the same model.
Sources: Hannan & Rissanen, Biometrika 69 (1982); Ljung, System Identification (1999), 10.4.

Rules of this file: an equation with a missing output or innovation in it is dropped; no covariance is given, because
the regressors are estimates themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hoopd.ident.checks import check
from hoopd.ident.data import Data, experiments
from hoopd.ident.doubts import warn
from hoopd.ident.estimation_report import estimated
from hoopd.ident.loopchecks import check_feedback
from hoopd.ident.modelchecks import check_model, check_order
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial.estimators import Estimator, least_squares
from hoopd.ident.polynomial.regression import least_regression, regressors, residuals
from hoopd.ident.polynomial.stable import reflected
from hoopd.ident.polynomial.structure import Counts, Structure, single, structure

Array = NDArray[np.float64]

# Passes end when one leaves prediction errors whose squares are so much larger than the least before.
WORSE = 1.02


@estimated("pseudo-linear regression")
def plr(
    data: Data | Sequence[Data], na: int, nb: Counts, nc: int, delay: Counts = 1, *, initial_order: int = 20,
    passes: int = 1, estimator: Estimator = least_squares,
) -> Polynomials:  # fmt: skip
    """Fit an ARMAX model A y = B u + C e by pseudo-linear regression.

    y is regressed on its past, the inputs and the innovations of a long ARX model. Linear steps only, so an estimator
    of choice fits in; `armax` is the efficient estimate of the same model. There is no covariance, because the
    regressors are estimates themselves.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; equations with a missing output or innovation are dropped.
    na : int
        Coefficients of A after the leading 1.
    nb : int or tuple of int
        Coefficients of B, for all inputs or by input, from q^-delay on.
    nc : int
        Coefficients of C after the leading 1.
    delay : int or tuple of int
        Samples; 0 is a direct term.
    initial_order : int
        Of the ARX model.
    passes : int
        Above 1 it repeats with the residuals of the model just found (extended least squares). That need not converge:
        the pass with the least prediction errors counts, and a warning tells when a later one was worse.
    estimator : callable
        Solves the last regression, (A, y) -> x in the order of the names.

    Returns
    -------
    Polynomials
        The model.

    Notes
    -----
    Sources: Hannan & Rissanen, Biometrika 69 (1982); Ljung, System Identification (1999), 10.4.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import iddata, plr
    >>> u, e = np.random.default_rng(0).standard_normal((2, 3000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0, 0.5], [1.0, -0.8], 0.5 * e)
    >>> model = plr(iddata(y, u, 0.1), na=1, nb=1, nc=1)
    >>> model.a.round(1), model.b[0].round(1), model.c.round(1)
    (array([ 1. , -0.8]), array([0., 2.]), array([1. , 0.5]))
    """
    each = experiments(data)
    single(each)
    own = structure(each[0].nu, na, nb, nc, delay=delay)
    check(each, orders=replace(own.asked, parameters=own.size + initial_order, lost=own.lost + initial_order))
    model, spread = regressed(each, own, initial_order, passes, estimator)
    n = sum(one.n for one in each)
    check_model(model, n)
    check_order(replace(model, covariance=spread), n)
    for one in each:
        check_feedback(_driving(model, one), one.u, one.inputs)
    return model


def regressed(
    each: Sequence[Data], own: Structure, initial_order: int, passes: int, estimator: Estimator
) -> tuple[Polynomials, Array]:  # fmt: skip
    """The regression on innovations, with nothing checked, and its covariance if those were known, not estimated."""
    e = _long(each, own, initial_order)
    best: _Pass | None = None
    for i in range(passes):
        wide = [replace(one, u=np.column_stack([one.u, ei]), inputs=()) for one, ei in zip(each, e, strict=True)]
        a, y = regressors(wide, own.na, (*own.nb, own.nc), (*own.delay, 1))
        if len(y) <= own.size:
            raise ValueError(f"too few samples: {len(y)} equations without a missing value for {own.size} parameters")
        x = estimator(a, y)
        rest = y - a @ x
        model = own.model(x, each[0], float(rest @ rest) / (len(y) - own.size))
        if passes == 1:
            return model, model.variance * _inverse(a)
        e = [_driving(model, one) for one in each]
        last = _Pass(i + 1, model, model.variance * _inverse(a), _mean_square(e))
        best = last if best is None or last.loss < best.loss else best
        if last.loss > WORSE * best.loss:
            break
    assert best is not None
    if last.loss > WORSE * best.loss:
        warn(
            f"extended least squares does not converge: after pass {last.number} the prediction errors are "
            f"{100.0 * (np.sqrt(last.loss / best.loss) - 1.0):.0f} % larger than after pass {best.number}, whose model "
            "is given; armax finds the least"
        )
    return best.model, best.spread


@dataclass(frozen=True)
class _Pass:
    """A pass, its model, the covariance if the innovations were known, the mean square of its prediction errors."""

    number: int
    model: Polynomials
    spread: Array
    loss: float


def _inverse(a: Array) -> Array:
    return np.asarray(np.linalg.pinv(a.T @ a, rcond=1e-12, hermitian=True), dtype=float)


def _mean_square(e: Sequence[Array]) -> float:
    """Of errors that are known; infinite where they run away."""
    with np.errstate(all="ignore"):
        total = float(np.nanmean(np.square(np.concatenate(e))))
    return total if np.isfinite(total) else np.inf


def _long(each: Sequence[Data], own: Structure, order: int) -> list[Array]:
    """Innovations (n,) by a long ARX model; NaN where its lags reach before the data or a missing output."""
    model = least_regression(each, structure(own.nu, order, (order,) * own.nu, delay=own.delay), 0.0)
    out = []
    for one in each:
        rest = residuals(model, one)
        out.append(np.concatenate([np.full(one.n - len(rest), np.nan), rest]))
    return out


def _driving(model: Polynomials, data: Data) -> Array:
    """e = (A y - B u) / C from zero, with C made stable; a missing value is taken as one without error."""
    rest = residuals(model, data)
    e = lfilter([1.0], reflected(model.c), np.nan_to_num(rest))
    e[np.isnan(rest)] = np.nan
    return np.concatenate([np.zeros(data.n - len(e)), e])
