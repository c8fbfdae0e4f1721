"""How good a model is on data: fit in percent, errors, information criteria, models side by side.

Rules of this file: pure numbers; NaN is a sample that was not measured and counts nowhere; sample counts are those of
the samples that count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data
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


@dataclass(frozen=True)
class Criteria:
    """Information criteria of a model with d parameters on n samples; smaller is better.

    Gaussian errors with free covariance: n log det S + ..., S the mean outer product of the errors.
    """

    n: int
    d: int
    aic: float  # Akaike 1974: n log det S + 2 d
    aicc: float  # Hurvich and Tsai 1989: + 2 d (d + 1)/(n - d - 1)
    bic: float  # Schwarz 1978: n log det S + d log n
    fpe: float  # Akaike 1969: det S (1 + d/n)/(1 - d/n)


def criteria(e: ArrayLike, parameters: int) -> Criteria:
    """Of errors (n, ny) and the number of parameters; ValueError with no more samples than parameters."""
    errors = _two(e)
    errors = errors[np.isfinite(errors).all(axis=1)]
    n, d = len(errors), int(parameters)
    if n <= d + 1:
        raise ValueError(f"{n} samples for {d} parameters: nothing is left to judge them by")
    determinant = float(np.linalg.det(errors.T @ errors / n))
    if determinant <= 0.0:
        return Criteria(n, d, -np.inf, -np.inf, -np.inf, 0.0)
    likelihood = n * float(np.log(determinant))
    return Criteria(
        n,
        d,
        likelihood + 2.0 * d,
        likelihood + 2.0 * d + 2.0 * d * (d + 1.0) / (n - d - 1.0),
        likelihood + d * float(np.log(n)),
        determinant * (1.0 + d / n) / (1.0 - d / n),
    )


def parameters_of(model: Model) -> int:
    """Estimated coefficients; of a state space those of a canonical form: nx (2 ny + nu) and the direct terms."""
    if len(model.values):
        return len(model.values)
    if isinstance(model, Polynomials):
        parts = (model.a, model.c, model.d, *model.f)
        return sum(len(one) - 1 for one in parts) + sum(int(np.count_nonzero(one)) for one in model.b)
    direct = int(np.count_nonzero(np.any(model.d != 0.0, axis=0)))
    return model.nx * (2 * model.ny + model.nu) + direct * model.ny


@dataclass(frozen=True)
class Compared:
    """Fit percent (ny,) of a model on data by horizon (infinity: simulation), and its criteria one step ahead."""

    name: str
    percent: Mapping[float, Array]
    criteria: Criteria | None


def compare(
    models: Mapping[str, Model], data: Data, horizons: Sequence[float] = (1, 10, np.inf), x0: Start = "estimate"
) -> list[Compared]:
    """Models on one set of data, which should not be the data that they were fitted to."""
    found = []
    for name, model in models.items():
        percent = {h: fit_percent(data.y, predict(model, data, h, x0)) for h in horizons}
        e = prediction_error(model, data, 1, x0)
        d = parameters_of(model)
        found.append(Compared(name, percent, criteria(e, d) if len(e) > d + 1 else None))
    return found
