"""How good a model is on data: fit in percent, errors, information criteria, models side by side.

Rules of this file: pure numbers; NaN is a sample that was not measured and counts nowhere; sample counts are those of
the samples that count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.models import Model, Polynomials
from hoopd.ident.prediction import Start, predict, prediction_error

Array = NDArray[np.float64]


def _two(y: ArrayLike) -> Array:
    found = np.asarray(y, dtype=float)
    return found[:, None] if found.ndim == 1 else found


def sse(e: ArrayLike) -> Array:
    """(ny,) sums of squares of errors (n, ny)."""
    return np.asarray(np.nansum(_two(e) ** 2, axis=0))


def mse(e: ArrayLike) -> Array:
    """(ny,) mean squares."""
    return np.asarray(np.nanmean(_two(e) ** 2, axis=0))


def rms(e: ArrayLike) -> Array:
    """(ny,) roots of the mean squares."""
    return np.sqrt(mse(e))


def fit_percent(y: ArrayLike, yhat: ArrayLike) -> Array:
    """(ny,) 100 (1 - |y - yhat|/|y - mean y|) of each output (n, ny); NaN for an output that never changes."""
    measured, said = _two(y), _two(yhat)
    if measured.shape != said.shape:
        raise ValueError(f"measured is {measured.shape}, predicted {said.shape}")
    spread = measured - np.nanmean(measured, axis=0)
    own = np.sqrt(np.nansum(np.where(np.isfinite(said), spread, np.nan) ** 2, axis=0))
    off = np.sqrt(np.nansum((measured - said) ** 2, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(own > 0.0, 100.0 * (1.0 - off / own), np.nan))


def nrmse(y: ArrayLike, yhat: ArrayLike) -> Array:
    """(ny,) |y - yhat|/|y - mean y|."""
    return np.asarray(1.0 - fit_percent(y, yhat) / 100.0)


# ------------------------------------------------------------------------------------------- information criteria


def aic(variance: ArrayLike, samples: int, parameters: int) -> float:
    """Akaike (1974): n ln det V + 2 d; V the mean squared error, or the mean outer product (ny, ny) of the errors.

    The numbers of V are estimated too, but the same in every model: they would only add a constant, and are left out.
    """
    return samples * _log_det(variance) + 2.0 * parameters


def aicc(variance: ArrayLike, samples: int, parameters: int) -> float:
    """AIC corrected for few samples: + 2 k (k + 1)/(n - k - 1), k = d + 1 with the variance among the parameters.

    That is the exact correction of a regression with normal errors (Hurvich and Tsai, Biometrika 76, 1989; Burnham and
    Anderson, Model Selection, 2002, 2.4, count the variance too). Of several outputs the same k is taken, which asks
    for more samples than needed. Infinite where n does not exceed k + 1.
    """
    k = parameters + 1
    if samples <= k + 1:
        return np.inf
    return aic(variance, samples, parameters) + 2.0 * k * (k + 1) / (samples - k - 1)


def bic(variance: ArrayLike, samples: int, parameters: int) -> float:
    """Schwarz (1978): n ln det V + d ln n."""
    return samples * _log_det(variance) + parameters * float(np.log(samples))


def fpe(variance: ArrayLike, samples: int, parameters: int) -> float:
    """Akaike's final prediction error (1969; Ljung, 1999, 7.78): det V (1 + d/n)/(1 - d/n); infinite where d reaches n.

    The determinant of the mean, not of the sum, of the errors' outer products.
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
    """Of errors (n, ny) on the data of the fit and the number of parameters; ValueError with too few samples for them.

    A row in which one of the errors is missing counts nowhere.
    """
    errors = _two(e)
    errors = errors[np.isfinite(errors).all(axis=1)]
    n, d = len(errors), int(parameters)
    if n <= d + 1:
        raise ValueError(f"{n} samples for {d} parameters: nothing is left to judge them by")
    v = errors.T @ errors / n
    return Criteria(n, d, aic(v, n, d), aicc(v, n, d), bic(v, n, d), fpe(v, n, d))


def parameters_of(model: Model) -> int:
    """Coefficients that the data had to tell.

    Of a state space of order n with m inputs and p outputs, by whatever method: n (m + p) for the dynamics from u, n p
    for the gain K (none where K = 0) and p for every input with a direct term. That is the dimension of the manifold of
    such systems: the n^2 entries that the matrices have beyond it are the choice of basis (Hannan and Deistler, The
    Statistical Theory of Linear Systems, 1988, ch. 2; Ljung, 1999, appendix 4A). A grey box has its own parameters.
    """
    if isinstance(model, Polynomials):
        return len(model.values) or _coefficients(model)
    if len(model.values) and model.names[:1] != ("a[0,0]",):
        return len(model.values)
    direct = int(np.count_nonzero(np.any(model.d != 0.0, axis=0)))
    gain = model.ny if np.any(model.k != 0.0) else 0
    return model.nx * (model.nu + model.ny + gain) + direct * model.ny


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


def compare(
    models: Mapping[str, Model],
    validation: Data | Sequence[Data],
    horizons: Sequence[float] = (1, 10, np.inf),
    x0: Start = "estimate",
    *,
    estimation: Data | Sequence[Data] | None = None,
) -> list[Compared]:
    """Models by their fit on `validation`, which none of them was fitted to, and their criteria on `estimation`."""
    held = experiments(validation)
    fitted = [] if estimation is None else experiments(estimation)
    y = np.concatenate([one.y for one in held])
    found = []
    for name, model in models.items():
        said = {h: np.concatenate([predict(model, one, h, x0) for one in held]) for h in horizons}
        percent = {h: fit_percent(y, one) for h, one in said.items()}
        found.append(Compared(name, percent, _criteria(model, fitted, x0)))
    return found


def table(compared: Sequence[Compared]) -> str:
    """As text: a row a model; the columns say what they were taken on."""
    horizons = list(dict.fromkeys(h for one in compared for h in one.percent))
    head = ["model", *(_column(h) for h in horizons), *(f"{name} (estimation)" for name in ("AICc", "BIC", "FPE"))]
    rows = [[one.name, *(_percents(one.percent.get(h)) for h in horizons), *_numbers(one.criteria)] for one in compared]
    width = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    return "\n".join(
        "  ".join(text.ljust(w) for text, w in zip(row, width, strict=True)).rstrip() for row in (head, *rows)
    )


def _criteria(model: Model, fitted: Sequence[Data], x0: Start) -> Criteria | None:
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
