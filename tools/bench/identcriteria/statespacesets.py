"""Systems and data sets of the state-space criteria, made here from their description.

Rules of this file: a seed gives the same data; noise levels are shares of the clean output's standard deviation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.linear import states

Array = NDArray[np.float64]


def pair(radius: float, angle: float) -> Array:
    """A 2 x 2 block with the poles radius exp(+-i angle)."""
    c, s = radius * np.cos(angle), radius * np.sin(angle)
    return np.array([[c, s], [-s, c]])


def mimo4() -> Innovations:
    """2 inputs, 3 outputs, poles 0.95 at +-0.25 rad and 0.85 at +-0.9 rad, no direct term."""
    a = np.zeros((4, 4))
    a[:2, :2], a[2:, 2:] = pair(0.95, 0.25), pair(0.85, 0.9)
    b = np.array([[1.0, 0.3], [0.0, 0.6], [0.8, -0.5], [-0.4, 1.0]])
    c = np.array([[1.0, 0.0, 0.5, 0.2], [0.3, 1.0, 0.0, -0.6], [-0.5, 0.4, 1.0, 0.3]])
    return Innovations(a, b, c, np.zeros((3, 2)), np.zeros((4, 3)), 1.0)


def mimo4k_gain() -> Array:
    """A Kalman gain for the same system, the predictor well inside the circle."""
    return np.array([[0.3, 0.1, -0.2], [-0.1, 0.3, 0.1], [0.1, -0.2, 0.2], [0.0, -0.1, 0.1]])


def made(model: Innovations, u: Array, e: Array, x0: Array | None = None) -> Data:
    """Data of an innovation form driven by u (n, nu) and e (n, ny)."""
    x = states(model.a, model.b @ u.T + model.k @ e.T, x0)
    return iddata((model.c @ x).T + u @ model.d.T + e, u, model.dt)


def mimo_set(seed: int, n: int = 5000, *, gain: bool = False, share: float = 0.1) -> tuple[Data, Data, Innovations]:
    """Estimation and validation halves of mimo4 (output noise) or mimo4k (noise through K too), and the truth."""
    rng = np.random.default_rng(seed)
    model = mimo4()
    u = rng.standard_normal((2 * n, 2))
    clean = made(model, u, np.zeros((2 * n, 3))).y
    e = share * clean.std(axis=0) * rng.standard_normal((2 * n, 3))
    if gain:
        k = mimo4k_gain()
        model = Innovations(model.a, model.b, model.c, model.d, k, 1.0, r=np.diag(e.var(axis=0)))
    both = made(model, u, e)
    return both[:n], both, model


def fit_percent(y: Array, said: Array) -> float:
    """100 (1 - |y - yhat| / |y - mean|), mean over outputs."""
    off, spread = np.linalg.norm(y - said, axis=0), np.linalg.norm(y - y.mean(axis=0), axis=0)
    return float(np.mean(100.0 * (1.0 - off / spread)))


def responses(model: Innovations, w: Array) -> NDArray[np.complex128]:
    """(nw, ny, nu) from u to y at w rad a sample."""
    z = np.exp(1j * w)[:, None, None] * np.eye(model.nx)
    return np.asarray(
        model.c @ np.linalg.solve(z - model.a, np.broadcast_to(model.b, (len(w), *model.b.shape))) + model.d
    )
