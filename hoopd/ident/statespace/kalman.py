"""The Kalman gain of a model from its noise covariances.

Rules of this file: a gain that is handed out makes the predictor stable.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.statespace.linear import radius

Array = NDArray[np.float64]

# Of the output's noise: below this share of it, a covariance is rounding (data without noise).
FLOOR = 1e-10


def gain(a: Array, c: Array, q: Array, r: Array, s: Array) -> tuple[Array, Array]:
    """K (nx, ny) of x+ = a x + K e and cov(e), for covariances q of w, r of v, s between them.

    From the Riccati equation P = a P a' + q - (a P c' + s)(c P c' + r)^-1 (...)' (Anderson & Moore, 1979). Where that
    has no stabilising solution, s r^-1; where that predictor is unstable too, the gain without s, then that of next to
    no process noise, and at last zero.
    """
    lift = FLOOR * (np.trace(r) + np.trace(c @ q @ c.T)) / len(r) + 1e-300
    whole = r + lift * np.eye(len(r))
    found = _riccati(a, c, q, whole, s)
    if found is not None:
        return found
    direct = np.asarray(np.linalg.lstsq(whole, s.T, rcond=None)[0].T, dtype=float)
    if radius(a - direct @ c) < 1.0:
        return direct, r
    for process in (q, lift * np.eye(len(q))):
        found = _riccati(a, c, process, whole, np.zeros_like(s))
        if found is not None:
            return found
    return np.zeros((len(a), len(c))), r


def _riccati(a: Array, c: Array, q: Array, r: Array, s: Array) -> tuple[Array, Array] | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", linalg.LinAlgWarning)
            p = linalg.solve_discrete_are(a.T, c.T, q, r, s=s)
    except (linalg.LinAlgError, ValueError):
        return None
    innovation = c @ p @ c.T + r
    k = linalg.solve(innovation, (a @ p @ c.T + s).T, assume_a="sym").T
    return (k, innovation) if np.isfinite(k).all() and radius(a - k @ c) < 1.0 else None
