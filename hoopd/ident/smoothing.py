"""The states of a model at every sample, from all of the data: Kalman filter forwards, Rauch, Tung and Striebel back.

x+ = a x + b u + w, y = c x + d u + v with cov [w; v] = [q s; s' r]; an innovation form has w = k e, v = e.
Where an output is measured, the part of w that v tells is taken over into the dynamics (Anderson and Moore, Optimal
Filtering, 1979, 5.5 and ch. 7; Rauch, Tung and Striebel, AIAA Journal 3, 1965).

Rules of this file: a missing output says nothing; every result has a row for each sample of the data.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data
from hoopd.ident.models import Innovations, Model
from hoopd.ident.prediction import Start, estimate_x0, free_response, matched

Array = NDArray[np.float64]

# The state at the first sample is taken as unknown by so many of the errors with which the first samples tell it.
DIFFUSE = 1e3


class Smoothed(NamedTuple):
    """States (n, nx), their covariances (n, nx, nx), and the outputs (n, ny) c x + d u that they mean."""

    states: Array
    covariances: Array
    outputs: Array


class _Noise(NamedTuple):
    q: Array
    r: Array
    s: Array


class _Step(NamedTuple):
    """Before and after the output of a sample, and the dynamics that lead on from it."""

    before: Array
    before_cov: Array
    after: Array
    after_cov: Array
    a: Array


def smooth(
    model: Model,
    data: Data,
    x0: Start = "estimate",
    p0: ArrayLike | None = None,
    *,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
) -> Smoothed:
    """Estimate the states of a model at every sample from the outputs before and after it.

    A Kalman filter runs forwards, then Rauch, Tung and Striebel's smoother back. A missing output says nothing.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system or FRD; a continuous one is sampled with held inputs.
    data : Data
        Inputs (n, nu) and outputs (n, ny).
    x0 : {"estimate", "zero"} or array_like, shape (nx,)
        The state at the first sample.
    p0 : array_like, shape (nx, nx), optional
        Its covariance. Without it a state that is given is exact, and one that is estimated counts for next to nothing.
    noise : tuple of array_like (nx, nx) and (ny, ny), optional
        q and r of a model whose process and measurement noise are unrelated, in place of its innovation form.

    Returns
    -------
    Smoothed
        `states` (n, nx), their `covariances` (n, nx, nx), and the `outputs` (n, ny) that they mean.

    Raises
    ------
    ValueError
        Neither the model nor `noise` tells the covariances, or shapes do not fit.

    Notes
    -----
    Sources: Anderson and Moore, Optimal Filtering, 1979, 5.5 and ch. 7; Rauch, Tung and Striebel, AIAA Journal 3, 1965.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import iddata, innovations, smooth
    >>> rng = np.random.default_rng(0)
    >>> walk = np.cumsum(0.1 * rng.standard_normal(300))
    >>> data = iddata(walk + rng.standard_normal(300), np.zeros(300))
    >>> model = innovations(control.ss([[1.0]], [[0.0]], [[1.0]], [[0.0]], 1.0))
    >>> states = smooth(model, data, noise=([[0.01]], [[1.0]])).states[:, 0]
    >>> float(np.std(states - walk).round(2)), float(np.std(data.y[:, 0] - walk).round(2))
    (0.18, 0.98)
    """
    own = matched(model, data)
    return _smoothed(own, data, _noise(own, noise), x0, p0)


def state_filter(
    model: Model,
    data: Data,
    x0: Start = "estimate",
    p0: ArrayLike | None = None,
    *,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
) -> Smoothed:
    """Estimate the states of a model at every sample from the outputs up to it: what a controller can know.

    The Kalman filter of `smooth`, without its way back. A missing output says nothing.

    Parameters
    ----------
    model, data, p0, noise : see `smooth`
        The same as there.
    x0 : {"zero", "estimate"} or array_like, shape (nx,)
        The state at the first sample; "estimate" takes it from the first samples, which a filter at work does not have.

    Returns
    -------
    Smoothed
        `states` (n, nx) after the output of their sample, their `covariances` (n, nx, nx), and the `outputs` (n, ny)
        that they mean.

    Raises
    ------
    ValueError
        Neither the model nor `noise` tells the covariances, or shapes do not fit.

    Notes
    -----
    Source: Anderson and Moore, Optimal Filtering, 1979, 5.5.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import iddata, innovations, smooth, state_filter
    >>> rng = np.random.default_rng(0)
    >>> walk = np.cumsum(0.1 * rng.standard_normal(300))
    >>> data = iddata(walk + rng.standard_normal(300), np.zeros(300))
    >>> model = innovations(control.ss([[1.0]], [[0.0]], [[1.0]], [[0.0]], 1.0))
    >>> errors = [f(model, data, noise=([[0.01]], [[1.0]])).states[:, 0] - walk for f in (state_filter, smooth)]
    >>> [float(np.std(one).round(2)) for one in errors]  # what comes after helps
    [0.28, 0.18]
    """
    own = matched(model, data)
    covariances = _noise(own, noise)
    start, cov = _first(own, data, covariances, x0, p0)
    states, spread = np.empty((data.n, own.nx)), np.empty((data.n, own.nx, own.nx))
    for i, (y, u) in enumerate(zip(data.y, data.u, strict=True)):
        step, start, cov = _forwards(own, covariances, start, cov, y, u)
        states[i], spread[i] = step.after, step.after_cov
    return Smoothed(states, spread, states @ own.c.T + data.u @ own.d.T)


def _smoothed(own: Innovations, data: Data, noise: _Noise, x0: Start, p0: ArrayLike | None) -> Smoothed:
    start, cov = _first(own, data, noise, x0, p0)
    steps = []
    for y, u in zip(data.y, data.u, strict=True):
        step, start, cov = _forwards(own, noise, start, cov, y, u)
        steps.append(step)
    states, covariances = np.empty((data.n, own.nx)), np.empty((data.n, own.nx, own.nx))
    for i in range(data.n - 1, -1, -1):
        one = steps[i]
        states[i], covariances[i] = one.after, one.after_cov
        if i + 1 < data.n:
            then = steps[i + 1]
            gain = np.linalg.lstsq(then.before_cov, one.a @ one.after_cov, rcond=1e-14)[0].T
            states[i] += gain @ (states[i + 1] - then.before)
            covariances[i] += gain @ (covariances[i + 1] - then.before_cov) @ gain.T
    return Smoothed(states, covariances, states @ own.c.T + data.u @ own.d.T)


def _noise(model: Innovations, given: tuple[ArrayLike, ArrayLike] | None) -> _Noise:
    if given is not None:
        q, r = (np.atleast_2d(np.asarray(one, dtype=float)) for one in given)
        if q.shape != (model.nx, model.nx) or r.shape != (model.ny, model.ny):
            raise ValueError(f"q is {q.shape} and r {r.shape}, of {model.nx} states and {model.ny} outputs")
        return _Noise(q, r, np.zeros((model.nx, model.ny)))
    if model.r is None:
        raise ValueError("the model does not know the covariance of its noise: there is nothing to weigh outputs by")
    return _Noise(model.k @ model.r @ model.k.T, model.r, model.k @ model.r)


def _first(model: Innovations, data: Data, noise: _Noise, x0: Start, p0: ArrayLike | None) -> tuple[Array, Array]:
    nx = model.nx
    if isinstance(x0, str) and x0 == "estimate":
        start = estimate_x0(model, data)
        if p0 is None:
            response = free_response(model.c, model.a - model.k @ model.c, min(data.n, 2 * nx + 2)).reshape(-1, nx)
            told = np.linalg.pinv(response.T @ response, rcond=1e-12, hermitian=True)
            return start, np.asarray(DIFFUSE * float(np.trace(noise.r)) * told, dtype=float)
    else:
        start = np.zeros(nx) if isinstance(x0, str) else np.asarray(x0, dtype=float).reshape(-1)
    cov = np.zeros((nx, nx)) if p0 is None else np.asarray(p0, dtype=float)
    if start.shape != (nx,) or cov.shape != (nx, nx):
        raise ValueError(f"the model has {nx} states: x0 has {start.size} numbers, p0 is {cov.shape}")
    return start, cov


def _forwards(
    model: Innovations, noise: _Noise, x: Array, cov: Array, y: Array, u: Array
) -> tuple[_Step, Array, Array]:
    """One sample, and the state and its covariance before the next."""
    seen = np.isfinite(y)
    c, r, s = model.c[seen], noise.r[np.ix_(seen, seen)], noise.s[:, seen]
    rest = (y - model.d @ u)[seen]
    spread = c @ cov @ c.T + r
    gain = np.linalg.lstsq(spread, c @ cov, rcond=1e-14)[0].T
    after = x + gain @ (rest - c @ x)
    after_cov = cov - gain @ spread @ gain.T
    # w = s r^-1 v + w*, w* unrelated to v, and v = y - c x - d u
    told = np.linalg.lstsq(r, s.T, rcond=1e-14)[0].T
    a, q = model.a - told @ c, noise.q - told @ s.T
    then = a @ after + model.b @ u + told @ rest
    then_cov = a @ after_cov @ a.T + q
    return _Step(x, cov, after, after_cov, a), then, 0.5 * (then_cov + then_cov.T)
