"""Errors that are not white: an autoregression of theirs, and J'SJ for their covariance S without forming it.

Rules of this file: derivatives are (ny, m, n) with time along the last axis, errors (n, ny).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data
from hoopd.ident.statespace.linear import states
from hoopd.ident.statespace.ordering import autoregression

Array = NDArray[np.float64]


def autoregression_of(errors: Sequence[Array]) -> tuple[Array, Array]:
    """Coefficients (ny, lags ny) and the root of the noise of an autoregression of the errors, lags by AIC."""
    n, ny = max(len(e) for e in errors), errors[0].shape[1]
    most = max(min(30, n // (10 * ny)), 1)
    lags = autoregression([Data(e, np.zeros((len(e), 0)), 1.0) for e in errors], most).count
    past = np.vstack([np.hstack([e[lags - i : len(e) - i] for i in range(1, lags + 1)]) for e in errors])
    now = np.vstack([e[lags:] for e in errors])
    found = np.linalg.lstsq(past, now, rcond=None)[0]
    rest = now - past @ found
    covariance = rest.T @ rest / len(rest)
    return np.asarray(found.T), np.linalg.cholesky(covariance + 1e-14 * np.trace(covariance) * np.eye(ny))


def shaped(change: Array, coefficients: Array, root: Array) -> Array:
    """(m, ny n): T'J for errors T w, w white: backwards in time, g(t) = J(t) + sum_i A_i' g(t + i)."""
    ny = len(coefficients)
    size = coefficients.shape[1]
    companion = np.zeros((size, size))
    companion[:ny] = np.hstack([coefficients[:, i : i + ny].T for i in range(0, size, ny)])
    companion[ny:, :-ny] = np.eye(size - ny)
    driven = np.zeros((size, *change.shape[1:]))
    driven[:ny, :, :-1] = change[..., ::-1][..., 1:]
    start = np.zeros((size, change.shape[1]))
    start[:ny] = change[..., -1]
    g = np.tensordot(root.T, states(companion, driven, start)[:ny], 1)
    return np.asarray(g.transpose(1, 0, 2).reshape(change.shape[1], -1))
