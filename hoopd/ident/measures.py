"""How good a model is on data: fit in percent, errors, information criteria, models side by side.

Rules of this file: pure numbers; NaN is a sample that was not measured and counts nowhere; sample counts are those of
the samples that count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.model_forms import innovation_form, named_models
from hoopd.ident.models import Polynomials
from hoopd.ident.prediction import Start, predict, prediction_error

Array = NDArray[np.float64]


def _two(y: ArrayLike) -> Array:
    found = np.asarray(y, dtype=float)
    return found[:, None] if found.ndim == 1 else found


def sse(e: ArrayLike) -> Array:
    """Sum the squares of errors.

    Parameters
    ----------
    e : array_like, shape (n,) or (n, ny)
        Errors; NaN counts not.

    Returns
    -------
    ndarray, shape (ny,)
        The sum of squares of each output.

    Examples
    --------
    >>> from hoopd.ident import sse
    >>> sse([3.0, float("nan"), 4.0])
    array([25.])
    """
    return np.asarray(np.nansum(_two(e) ** 2, axis=0))


def mse(e: ArrayLike) -> Array:
    """Give the mean square of errors.

    Parameters
    ----------
    e : array_like, shape (n,) or (n, ny)
        Errors; NaN counts not.

    Returns
    -------
    ndarray, shape (ny,)
        The mean square of each output.

    Examples
    --------
    >>> from hoopd.ident import mse
    >>> mse([3.0, float("nan"), 4.0])
    array([12.5])
    """
    return np.asarray(np.nanmean(_two(e) ** 2, axis=0))


def rms(e: ArrayLike) -> Array:
    """Give the root of the mean square of errors.

    Parameters
    ----------
    e : array_like, shape (n,) or (n, ny)
        Errors; NaN counts not.

    Returns
    -------
    ndarray, shape (ny,)
        The root mean square of each output, in its unit.

    Examples
    --------
    >>> from hoopd.ident import rms
    >>> rms([3.0, -3.0, float("nan")])
    array([3.])
    """
    return np.sqrt(mse(e))


def fit_percent(y: ArrayLike, yhat: ArrayLike) -> Array:
    """Give the fit in percent, 100 (1 - |y - yhat|/|y - mean y|).

    Parameters
    ----------
    y : array_like, shape (n,) or (n, ny)
        Measured outputs; NaN counts not.
    yhat : array_like, same shape
        Predicted or simulated outputs.

    Returns
    -------
    ndarray, shape (ny,)
        100 for a model that leaves nothing, 0 for one as good as the mean, negative for a worse one; NaN for an output
        that never changes.

    Raises
    ------
    ValueError
        Shapes that differ.

    Examples
    --------
    >>> from hoopd.ident import fit_percent
    >>> y = [1.0, -1.0, 1.0, -1.0]
    >>> fit_percent(y, [0.9, -0.9, 0.9, -0.9]).round(6), fit_percent(y, [0.0] * 4)
    (array([90.]), array([0.]))
    """
    measured, said = _two(y), _two(yhat)
    if measured.shape != said.shape:
        raise ValueError(f"measured is {measured.shape}, predicted {said.shape}")
    spread = measured - np.nanmean(measured, axis=0)
    own = np.sqrt(np.nansum(np.where(np.isfinite(said), spread, np.nan) ** 2, axis=0))
    off = np.sqrt(np.nansum((measured - said) ** 2, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(own > 0.0, 100.0 * (1.0 - off / own), np.nan))


def nrmse(y: ArrayLike, yhat: ArrayLike) -> Array:
    """Give the error relative to the measured change, |y - yhat|/|y - mean y|.

    Parameters
    ----------
    y : array_like, shape (n,) or (n, ny)
        Measured outputs; NaN counts not.
    yhat : array_like, same shape
        Predicted or simulated outputs.

    Returns
    -------
    ndarray, shape (ny,)
        0 for a model that leaves nothing, 1 for one as good as the mean.

    Examples
    --------
    >>> from hoopd.ident import nrmse
    >>> nrmse([1.0, -1.0, 1.0, -1.0], [0.9, -0.9, 0.9, -0.9]).round(6)
    array([0.1])
    """
    return np.asarray(1.0 - fit_percent(y, yhat) / 100.0)


# ------------------------------------------------------------------------------------------- information criteria


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
    errors = _two(e)
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


# ------------------------------------------------------------------------------------------- models side by side


@dataclass(frozen=True)
class Compared:
    """A model's fit percent (ny,) on validation data by horizon, its criteria on the data that it was fitted to.

    Infinity is simulation. `criteria`: None without the data of the fit: a penalty for fitted parameters has no meaning
    on data that nothing was fitted to.
    """

    name: str
    percent: Mapping[float, Array]
    criteria: Criteria | None


class ModelComparison(list[Compared]):
    """Models side by side; as text, a table."""

    def __str__(self) -> str:
        return table(self)

    __repr__ = __str__


def compare(
    models: Any,
    validation: Data | Sequence[Data],
    horizons: Sequence[float] = (1, 10, np.inf),
    x0: Start = "estimate",
    *,
    estimation: Data | Sequence[Data] | None = None,
) -> ModelComparison:
    """Compare models by their fit on data that none of them was fitted to, and by criteria on the data of the fit.

    Parameters
    ----------
    models : mapping of str to any model, sequence of models, or a model
        Results of this package, python-control systems or FRDs; without names they are called as their estimators.
    validation : Data or sequence of Data
        Data that nothing was fitted to.
    horizons : sequence of int or inf
        Samples ahead; infinity is simulation.
    x0 : {"estimate", "zero"} or array_like, shape (nx,)
        The initial state.
    estimation : Data or sequence of Data, optional
        The data of the fit, for the criteria: a penalty for fitted parameters has no meaning elsewhere. Without it
        they are those that the result itself was made from; a model that knows none has no criteria.

    Returns
    -------
    ModelComparison
        A list of `Compared`, by model its `name`, its fit `percent` (ny,) by horizon and its `criteria`; it prints as
        a table.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, compare, iddata, simulate
    >>> good, bad = (Polynomials(0.1, np.array([1.0, -a]), (np.array([0.0, 1.0]),), variance=0.1) for a in (0.8, 0.6))
    >>> u = np.random.default_rng(0).standard_normal(500)
    >>> data = iddata(simulate(good, iddata(u, u, 0.1), "zero", seed=1), u, 0.1)
    >>> first, second = compare({"good": good, "bad": bad}, data, horizons=[1, np.inf])
    >>> bool(first.percent[1] > second.percent[1]), bool(first.percent[np.inf] > second.percent[np.inf])
    (True, True)
    """
    held = experiments(validation)
    fitted = [] if estimation is None else experiments(estimation)
    y = np.concatenate([one.y for one in held])
    found = ModelComparison()
    for name, model in named_models(models).items():
        with np.errstate(over="ignore", invalid="ignore"):
            said = {h: np.concatenate([predict(model, one, h, x0) for one in held]) for h in horizons}
            percent = {h: fit_percent(y, one) for h, one in said.items()}
        found.append(Compared(name, percent, _criteria(model, fitted or _own_data(model), x0)))
    return found


def table(compared: Sequence[Compared]) -> str:
    """Write compared models as text, a row a model; the columns say what they were taken on.

    Parameters
    ----------
    compared : sequence of Compared
        What `compare` gives.

    Returns
    -------
    str
        Lines of columns.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, compare, iddata, simulate, table
    >>> model = Polynomials(0.1, np.array([1.0, -0.8]), (np.array([0.0, 1.0]),))
    >>> u = np.random.default_rng(0).standard_normal(200)
    >>> data = iddata(simulate(model, iddata(u, u, 0.1), "zero"), u, 0.1)
    >>> print(table(compare({"true": model}, data, horizons=[np.inf])))
    model  fit %, simulated (validation)  AICc (estimation)  BIC (estimation)  FPE (estimation)
    true   100.0                          -                  -                 -
    """
    horizons = list(dict.fromkeys(h for one in compared for h in one.percent))
    head = ["model", *(_column(h) for h in horizons), *(f"{name} (estimation)" for name in ("AICc", "BIC", "FPE"))]
    rows = [[one.name, *(_percents(one.percent.get(h)) for h in horizons), *_numbers(one.criteria)] for one in compared]
    width = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    return "\n".join(
        "  ".join(text.ljust(w) for text, w in zip(row, width, strict=True)).rstrip() for row in (head, *rows)
    )


def _own_data(model: Any) -> list[Data]:
    report = getattr(model, "report", None)
    return [] if report is None else [one for one in report.data if isinstance(one, Data)]


def _criteria(model: Any, fitted: Sequence[Data], x0: Start) -> Criteria | None:
    if not fitted:
        return None
    e = np.concatenate([prediction_error(model, one, 1, x0) for one in fitted])
    d = parameters_of(model)
    return criteria(e, d) if int(np.isfinite(e).all(axis=1).sum()) > d + 1 else None


def _column(horizon: float) -> str:
    return f"fit %, {'simulated' if horizon == np.inf else f'{horizon:g} ahead'} (validation)"


def _percents(values: Array | None) -> str:
    return "-" if values is None else " ".join(f"{one:.1f}" for one in values)


def _numbers(found: Criteria | None) -> list[str]:
    return ["-"] * 3 if found is None else [f"{found.aicc:.1f}", f"{found.bic:.1f}", f"{found.fpe:.4g}"]
