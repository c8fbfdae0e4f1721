"""Information criteria: how well a model does for the parameters that it spends, and how many those are.

Rules of this file: smaller is better; errors are those of the data of the fit, NaN was not measured and counts nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hoopd.ident.identified_model import FreeModel
from hoopd.ident.measures import as_columns
from hoopd.ident.model_forms import innovation_form
from hoopd.ident.models import Polynomials


def aic(variance: ArrayLike, samples: int, parameters: int) -> float:
    """Give Akaike's information criterion, n ln det V + 2 d; smaller is better.

    The numbers of V are estimated too, but the same in every model: they would only add a constant, and are left out.

    Parameters
    ----------
    variance : float or array_like, shape (ny, ny)
        V, the mean squared error, or the mean outer product of the errors.
    samples : int
        n, on which the model was fitted.
    parameters : int
        d, that were fitted.

    Returns
    -------
    float
        The criterion.

    Notes
    -----
    Source: Akaike (1974).

    Examples
    --------
    >>> from hoopd.ident import aic
    >>> aic(1.0, samples=100, parameters=3)
    6.0
    >>> aic(0.99, 100, 4) < aic(1.0, 100, 3)  # one per cent less error is not worth a parameter
    False
    """
    return samples * _log_det(variance) + 2.0 * parameters


def aicc(variance: ArrayLike, samples: int, parameters: int) -> float:
    """Give Akaike's criterion corrected for few samples: AIC + 2 k (k + 1)/(n - k - 1).

    k = d + 1 counts the variance among the parameters: that is the exact correction of a regression with normal errors.
    Of several outputs the same k is taken, which asks for more samples than needed.

    Parameters
    ----------
    variance : float or array_like, shape (ny, ny)
        V, the mean squared error, or the mean outer product of the errors.
    samples : int
        n, on which the model was fitted.
    parameters : int
        d, that were fitted.

    Returns
    -------
    float
        The criterion; infinite where n does not exceed k + 1.

    Notes
    -----
    Sources: Hurvich and Tsai, Biometrika 76, 1989; Burnham and Anderson, Model Selection, 2002, 2.4, count the variance
    too.

    Examples
    --------
    >>> from hoopd.ident import aic, aicc
    >>> round(aicc(1.0, samples=20, parameters=3) - aic(1.0, 20, 3), 3)  # 2 * 4 * 5 / 15
    2.667
    >>> aicc(1.0, samples=5, parameters=3)
    inf
    """
    k = parameters + 1
    if samples <= k + 1:
        return np.inf
    return aic(variance, samples, parameters) + 2.0 * k * (k + 1) / (samples - k - 1)


def bic(variance: ArrayLike, samples: int, parameters: int) -> float:
    """Give Schwarz's criterion, n ln det V + d ln n; smaller is better.

    Parameters
    ----------
    variance : float or array_like, shape (ny, ny)
        V, the mean squared error, or the mean outer product of the errors.
    samples : int
        n, on which the model was fitted.
    parameters : int
        d, that were fitted.

    Returns
    -------
    float
        The criterion.

    Notes
    -----
    Source: Schwarz (1978).

    Examples
    --------
    >>> from hoopd.ident import bic
    >>> round(bic(1.0, samples=100, parameters=3), 2)  # 3 ln 100
    13.82
    """
    return samples * _log_det(variance) + parameters * float(np.log(samples))


def fpe(variance: ArrayLike, samples: int, parameters: int) -> float:
    """Give Akaike's final prediction error, det V (1 + d/n)/(1 - d/n).

    The determinant of the mean, not of the sum, of the errors' outer products.

    Parameters
    ----------
    variance : float or array_like, shape (ny, ny)
        V, the mean squared error, or the mean outer product of the errors.
    samples : int
        n, on which the model was fitted.
    parameters : int
        d, that were fitted.

    Returns
    -------
    float
        What the squared error is expected to be on other data; infinite where d reaches n.

    Notes
    -----
    Source: Akaike (1969); Ljung, System Identification, 1999, 7.78.

    Examples
    --------
    >>> from hoopd.ident import fpe
    >>> fpe(2.0, samples=100, parameters=20)
    3.0
    """
    if parameters >= samples:
        return np.inf
    return float(np.exp(_log_det(variance))) * (samples + parameters) / (samples - parameters)


def _log_det(variance: ArrayLike) -> float:
    v = np.atleast_2d(np.asarray(variance, dtype=float))
    sign, value = np.linalg.slogdet(v)
    return float(value) if sign > 0.0 else -np.inf


@dataclass(frozen=True)
class Criteria:
    """Information criteria of a model with d parameters on the n samples that it was fitted to; smaller is better."""

    n: int
    d: int
    aic: float
    aicc: float
    bic: float
    fpe: float


def criteria(e: ArrayLike, parameters: int) -> Criteria:
    """Give the information criteria of a model by its errors on the data of the fit.

    Parameters
    ----------
    e : array_like, shape (n,) or (n, ny)
        Errors; a row in which one of them is missing counts nowhere.
    parameters : int
        How many were fitted.

    Returns
    -------
    Criteria
        `n` samples, `d` parameters, and `aic`, `aicc`, `bic`, `fpe`; smaller is better.

    Raises
    ------
    ValueError
        Too few samples for the parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import criteria
    >>> found = criteria(np.random.default_rng(0).standard_normal(200), parameters=4)
    >>> found.n, found.d, round(found.aic, 1), round(found.bic, 1), round(found.fpe, 2)
    (200, 4, -7.8, 5.4, 0.96)
    """
    errors = as_columns(e)
    errors = errors[np.isfinite(errors).all(axis=1)]
    n, d = len(errors), int(parameters)
    if n <= d + 1:
        raise ValueError(f"{n} samples for {d} parameters: nothing is left to judge them by")
    v = errors.T @ errors / n
    return Criteria(n, d, aic(v, n, d), aicc(v, n, d), bic(v, n, d), fpe(v, n, d))


def parameters_of(model: Any) -> int:
    """Count the coefficients of a model that the data had to tell.

    Of a state space of order n with m inputs and p outputs, by whatever method: n (m + p) for the dynamics from u, n p
    for the gain K (none where K = 0) and p for every input with a direct term. That is the dimension of the manifold of
    such systems: the n^2 entries that the matrices have beyond it are the choice of basis. A grey box has its own
    parameters.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system.

    Returns
    -------
    int
        The number of coefficients.

    Notes
    -----
    Sources: Hannan and Deistler, The Statistical Theory of Linear Systems, 1988, ch. 2; Ljung, System Identification,
    1999, appendix 4A.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import innovations, parameters_of
    >>> second = control.ss([[0.8, 0.1], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], 0.1)
    >>> parameters_of(innovations(second))  # two poles and two coefficients of the numerator
    4
    """
    if isinstance(model, Polynomials):
        return len(model.values) or _coefficients(model)
    if isinstance(model, FreeModel) or hasattr(model, "parameters"):
        return len(getattr(model, "parameters", ()))
    if rows := getattr(model, "rows", ()):
        return int(sum(parameters_of(one) for one in rows))
    own = innovation_form(model, 1.0)
    if len(own.values) and own.names[:1] != ("a[0,0]",):
        return len(own.values)
    direct = int(np.count_nonzero(np.any(own.d != 0.0, axis=0)))
    gain = own.ny if np.any(own.k != 0.0) else 0
    return own.nx * (own.nu + own.ny + gain) + direct * own.ny


def _coefficients(model: Polynomials) -> int:
    parts = (model.a, model.c, model.d, *model.f)
    return sum(len(one) - 1 for one in parts) + sum(int(np.count_nonzero(one)) for one in model.b)
