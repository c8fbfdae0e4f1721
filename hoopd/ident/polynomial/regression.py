"""The linear regression behind every ARX model, over one or several experiments.

It is solved from the Gram matrix of the lagged signals, which needs no matrix of regressors (memory linear in the
samples), and by orthogonal triangles over chunks of rows where that matrix is ill-conditioned or outputs are missing
(Ljung, System Identification, 1999, 10.1).

Rules of this file: an equation with a missing output in it is dropped; nothing runs across two experiments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import DEPENDENT, check_regressors
from hoopd.ident.data import Data, experiments
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial.structure import Counts, Structure, structure

Array = NDArray[np.float64]

# Below this reciprocal condition the Gram matrix loses more than ten digits: triangles instead.
WELL_CONDITIONED = 1e-6
# A sum of squared residuals below this share of the outputs' is a difference of nearly equal numbers.
RESOLVED = 1e-8
# Rows of regressors that exist at a time.
CHUNK = 32768


def regressors(data: Data | Sequence[Data], na: int, nb: Counts = (), delay: Counts = 1) -> tuple[Array, Array]:
    """Give the linear regression y = A x behind an ARX model.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    na : int
        Lags of the output.
    nb : int or tuple of int
        Lags of the inputs, for all or by input.
    delay : int or tuple of int
        First lag of the inputs.

    Returns
    -------
    a : ndarray, shape (rows, na + sum nb)
        Columns -y(t-1) ..., then the inputs' lags, by input; rows of all experiments under each other, without those in
        which an output is missing.
    y : ndarray, shape (rows,)
        The outputs.

    Examples
    --------
    >>> from hoopd.ident import iddata, regressors
    >>> a, y = regressors(iddata([1.0, 2.0, 3.0], [7.0, 8.0, 9.0]), na=1, nb=1)
    >>> a, y
    (array([[-1.,  7.],
           [-2.,  8.]]), array([2., 3.]))
    """
    each = experiments(data)
    own = structure(each[0].nu, na, nb, delay=delay)
    parts = [part for one in each for part in _chunks(one, own)] or [np.zeros((0, own.size + 1))]
    z = np.concatenate(parts)
    return z[:, 1:], z[:, 0]


def residuals(model: Polynomials, data: Data) -> Array:
    """A y - sum B u (n - longest lag,), NaN where an output in it is missing; the errors of an ARX or AR model."""
    first = max([len(model.a) - 1, *(len(one) - 1 for one in model.b)])
    out = np.convolve(data.y[:, 0], model.a)[first : data.n]
    for i, one in enumerate(model.b):
        out = out - np.convolve(data.u[:, i], one)[first : data.n]
    return np.asarray(out)


def solve_arx(each: Sequence[Data], own: Structure, ridge: float = 0.0) -> tuple[Array, Array, float]:
    """Coefficients, inverse of their Gram matrix and sum of squared residuals, with nothing checked.

    For the methods that start from an ARX model; complete data.
    """
    gram, _ = gram_of(each, own)
    m = gram[1:, 1:] + ridge * np.eye(own.size)
    inverse = np.asarray(np.linalg.pinv(m, rcond=1e-13, hermitian=True), dtype=float)
    x = inverse @ gram[1:, 0]
    return x, inverse, float(gram[0, 0] - 2.0 * x @ gram[1:, 0] + x @ gram[1:, 1:] @ x)


def least_regression(each: Sequence[Data], own: Structure, ridge: float) -> Polynomials:
    """The model of least |y - Phi x|^2 + ridge |x|^2 with its covariance; regressors that depend are a warning."""
    if ridge < 0.0:
        raise ValueError(f"ridge must not be negative, it is {ridge}")
    if all(_whole(one) for one in each):
        gram, rows = gram_of(each, own)
        if _conditioned(gram[1:, 1:] + ridge * np.eye(own.size)):
            return _from_gram(gram, rows, each, own, ridge)
    return _from_triangle(each, own, ridge)


def gram_of(each: Sequence[Data], own: Structure) -> tuple[Array, int]:
    """Gram matrix of [y(t), regressors] over all experiments and the number of equations; for code of this room."""
    gram, rows = np.zeros((own.size + 1, own.size + 1)), 0
    for one in each:
        if _whole(one) and one.n > own.lost:
            gram += _shifted(one, own)
            rows += one.n - own.lost
        elif not _whole(one):
            for part in _chunks(one, own):
                gram += part.T @ part
                rows += len(part)
    return gram, rows


def _shifted(data: Data, own: Structure) -> Array:
    signals = [np.ascontiguousarray(data.y[:, 0]), *(np.ascontiguousarray(column) for column in data.u.T)]
    signs = np.concatenate([[1.0], -np.ones(own.na), np.ones(sum(own.nb))])
    return lagged_gram(signals, [range(own.na + 1), *own.lags], own.lost) * np.outer(signs, signs)


def _whole(data: Data) -> bool:
    return data.complete and bool(np.isfinite(data.u).all())


def _conditioned(gram: Array) -> bool:
    scale = np.sqrt(np.diag(gram))
    if not (scale > 0.0).all():
        return False
    values = np.linalg.eigvalsh(gram / np.outer(scale, scale))
    return bool(values[0] > WELL_CONDITIONED * values[-1])


def _from_gram(gram: Array, rows: int, each: Sequence[Data], own: Structure, ridge: float) -> Polynomials:
    inner, right = gram[1:, 1:], gram[1:, 0]
    inverse = np.linalg.inv(inner + ridge * np.eye(own.size))
    x = inverse @ right
    total = float(gram[0, 0] - 2.0 * x @ right + x @ inner @ x)
    if total < RESOLVED * gram[0, 0]:
        model = own.model(x, each[0])
        total = sum(float(np.square(residuals(model, one)).sum()) for one in each)
    variance = total / max(rows - own.size, 1)
    return own.model(x, each[0], variance, variance * inverse @ inner @ inverse)


def _from_triangle(each: Sequence[Data], own: Structure, ridge: float) -> Polynomials:
    r, rows = np.zeros((0, own.size + 1)), 0
    for one in each:
        for part in _chunks(one, own):
            r = np.asarray(np.linalg.qr(np.vstack([r, part]), mode="r"))
            rows += len(part)
    if rows <= own.size:
        raise ValueError(f"too few samples: {rows} equations without a missing output for {own.size} parameters")
    r, right = r[:, 1:], r[:, 0]
    scale = np.sqrt((r**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    if ridge == 0.0:
        check_regressors(r, own.names)
        inverse = np.linalg.pinv(r / scale, rcond=DEPENDENT) / scale[:, None]
    else:
        inverse = np.linalg.pinv(np.vstack([r, np.sqrt(ridge) * np.eye(own.size)]))[:, : len(r)]
    x = inverse @ right
    variance = float(np.square(right - r @ x).sum()) / max(rows - own.size, 1)
    return own.model(x, each[0], variance, variance * inverse @ inverse.T)


def _chunks(data: Data, own: Structure) -> Iterator[Array]:
    """[y(t), regressors] of rows without a missing value, `CHUNK` rows at a time."""
    y = data.y[:, 0]
    for start in range(own.lost, data.n, CHUNK):
        t = np.arange(start, min(start + CHUNK, data.n))
        columns = [y[t], *(-y[t - k] for k in range(1, own.na + 1))]
        columns += [data.u[t - k, i] for i, lag in enumerate(own.lags) for k in lag]
        z = np.column_stack(columns)
        yield z[np.isfinite(z).all(axis=1)]
