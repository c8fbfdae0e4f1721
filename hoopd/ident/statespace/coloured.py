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
from hoopd.ident.statespace.sensitivities import paired

Array = NDArray[np.float64]


def autoregression_of(errors: Sequence[Array]) -> tuple[Array, Array]:
    """Coefficients (ny, lags ny) and the root (ny, ny) of the noise of an autoregression of errors, lags by AIC."""
    n, ny = max(len(e) for e in errors), errors[0].shape[1]
    most = max(min(30, n // (10 * ny)), 1)
    lags = autoregression([Data(e, np.zeros((len(e), 0)), 1.0) for e in errors], most).count
    past = np.vstack([np.hstack([e[lags - i : len(e) - i] for i in range(1, lags + 1)]) for e in errors])
    now = np.vstack([e[lags:] for e in errors])
    found = np.linalg.lstsq(past, now, rcond=None)[0]
    rest = now - past @ found
    covariance = rest.T @ rest / len(rest)
    return np.asarray(found.T), np.linalg.cholesky(covariance + 1e-14 * np.trace(covariance) * np.eye(ny))


def together(errors: Sequence[Array], known: Sequence[NDArray[np.bool_]]) -> tuple[Array, Array]:
    """The same of white errors (ny, n), zero where they are not known: no lags, and the root of their covariance."""
    values, vectors = np.linalg.eigh(paired(errors, known))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.zeros((len(root), 0)), np.asarray(root @ vectors.T)


def gradient_covariance(changes: Sequence[Array], noise: tuple[Array, Array]) -> Array:
    """J'SJ (m, m) of the derivatives of all experiments, S the covariance of errors that `noise` describes."""
    scores = [shaped(change, *noise) for change in changes]
    return np.asarray(sum(score @ score.T for score in scores))


def shaped(change: Array, coefficients: Array, root: Array) -> Array:
    """(m, ny n): T'J for errors T w, w white: backwards in time, g(t) = J(t) + sum_i A_i' g(t + i)."""
    ny, size = coefficients.shape
    if not size:
        return np.asarray(np.tensordot(root.T, change, 1).transpose(1, 0, 2).reshape(change.shape[1], -1))
    companion = np.zeros((size, size))
    companion[:ny] = np.hstack([coefficients[:, i : i + ny].T for i in range(0, size, ny)])
    companion[ny:, :-ny] = np.eye(size - ny)
    driven = np.zeros((size, *change.shape[1:]))
    driven[:ny, :, :-1] = change[..., ::-1][..., 1:]
    start = np.zeros((size, change.shape[1]))
    start[:ny] = change[..., -1]
    g = np.tensordot(root.T, states(companion, driven, start)[:ny], 1)
    return np.asarray(g.transpose(1, 0, 2).reshape(change.shape[1], -1))
