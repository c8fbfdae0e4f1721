"""Predictor-based subspace identification (PBSID-opt): right in a closed loop too.

A long vector ARX model, whose errors no feedback biases, gives the Markov parameters C Abar^(i-1) [B - K D, K] of the
predictor; with them the observability matrix times the state of every sample is known, a singular value decomposition
gives the states, and two regressions the matrices (Chiuso, IEEE Trans. Automat. Control 52, 2007).

Rules of this file: nothing runs across a gap or two experiments; the past is as long as the predictor remembers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hoopd.ident.checks import Orders, check
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.estimation_report import chosen, estimated
from hoopd.ident.modelchecks import check_model
from hoopd.ident.models import Innovations
from hoopd.ident.simulationcheck import check_simulation
from hoopd.ident.statespace.ordering import autoregression, joined

Array = NDArray[np.float64]

# Lags that are looked at for the past, and rows for each unknown of the long model.
LEAST_PAST, MOST_PAST, SHARE = 10, 40, 4


@estimated("predictor-based subspace (PBSID-opt)")
def pbsid(
    data: Data | Sequence[Data], order: int, *, past: int | None = None, future: int | None = None, direct: bool = False
) -> Innovations:  # fmt: skip
    """Identify a state-space model by the states of a long predictor: right in a closed loop too.

    The other subspace methods take the future inputs for independent of the noise, which feedback makes them not.
    `direct` wants a delay in the loop: an input that answers the output of its own sample looks like a direct term.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; of missing outputs only windows without gaps are used.
    order : int
        States.
    past : int, optional
        Lags of the long model; twice those of the autoregression of least AIC, 10 at least, unless given.
    future : int, optional
        Block rows of the observability matrix, at most `past`; enough for twice the order unless given.
    direct : bool
        Whether D is estimated.

    Returns
    -------
    Innovations
        The model with the covariance `r` of its innovations and the `singular_values`.

    Raises
    ------
    ValueError
        Too few samples, and orders that do not fit into past and future.

    Notes
    -----
    Source: Chiuso, IEEE Trans. Automat. Control 52, 2007.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, pbsid
    >>> r, e = np.random.default_rng(0).standard_normal((2, 4000))
    >>> x, u, y = 0.0, np.zeros(4000), np.zeros(4000)
    >>> for k in range(4000):  # a law around a pole at 0.9
    ...     y[k] = x + e[k]
    ...     u[k] = r[k] - 0.4 * y[k - 1]
    ...     x = 0.9 * x + u[k] + 0.3 * e[k]
    >>> pbsid(iddata(y, u), order=1).a.round(1)
    array([[0.9]])
    """
    each = experiments(data)
    check(each, orders=Orders(order, 2 * order))
    parts = [part for one in each for part in runs(one)]
    nu, ny = each[0].nu, each[0].ny
    p = past if past is not None else _past(parts, order)
    f = future if future is not None else min(p, max(-(-2 * order // ny), 2))
    if not 1 <= f <= p or order < 1 or f * ny < order:
        raise ValueError(f"order {order} does not fit into {f} block rows of future and a past of {p} samples")
    parts = [part for part in parts if part.n > p + 1]
    size = p * (nu + ny) + nu * direct
    if sum(part.n - p for part in parts) < SHARE * size:
        raise ValueError(f"too few samples: a past of {p} samples wants {SHARE * size} without a gap")
    behind, u, y = (np.concatenate(rows) for rows in zip(*(_rows(part, p) for part in parts), strict=True))
    lengths = [part.n - p for part in parts]
    long = _least(np.hstack([behind, u]) if direct else behind, y)
    states, values = _states(behind, long[: p * (nu + ny)].T.reshape(ny, p, nu + ny), f, order)
    model = replace(_matrices(states, u, y, lengths, direct), singular_values=values)
    model = replace(model, dt=each[0].dt, inputs=each[0].inputs, outputs=each[0].outputs)
    check_model(model, sum(one.n for one in each))
    check_simulation(model, each)
    return model


def _past(parts: Sequence[Data], order: int) -> int:
    longest, channels = max(part.n for part in parts), parts[0].nu + parts[0].ny
    most = max(min(MOST_PAST, longest // (3 * SHARE * channels)), order + 1)
    found = int(
        np.clip(2 * autoregression(parts, max(most // 2, 1)).count, min(max(2 * order + 2, LEAST_PAST), most), most)
    )
    chosen(f"a past of {found} samples: twice the lags of the autoregression of least AIC")
    return found


def _rows(part: Data, p: int) -> tuple[Array, Array, Array]:
    """z(t-p), ..., z(t-1) of every sample after the first p; u(t), y(t)."""
    windows = sliding_window_view(joined(part)[:-1], p, axis=0).transpose(0, 2, 1)
    return windows.reshape(len(windows), -1), part.u[p:], part.y[p:]


def _least(rows: Array, target: Array) -> Array:
    """Least squares with columns of one length."""
    size = np.linalg.norm(rows, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(rows / size, target, rcond=1e-12)[0] / size[:, None])


def _states(behind: Array, markov: Array, f: int, order: int) -> tuple[Array, Array]:
    """States (rows, order) and singular values; markov (ny, p, m) with the oldest lag first.

    Block row k of the observability matrix times the state is the long model, its past moved on by k samples.
    """
    ny, p, m = markov.shape
    wide = np.zeros((f, ny, p, m))
    for k in range(f):
        wide[k, :, k:] = markov[:, : p - k]
    # the state's part of y(t + k): what lies k samples further back counts C Abar^(k + i - 1)
    seen = behind @ wide.reshape(f * ny, p * m).T
    left, values, _ = np.linalg.svd(seen, full_matrices=False)
    return left[:, :order] * np.sqrt(len(behind)), values


def _matrices(x: Array, u: Array, y: Array, lengths: Sequence[int], direct: bool) -> Innovations:
    """C, D from the outputs, then A, B, K from the states that follow, within each stretch."""
    nx, nu = x.shape[1], u.shape[1]
    found = _least(np.hstack([x, u]) if direct else x, y).T
    c, d = found[:, :nx], found[:, nx:] if direct else np.zeros((y.shape[1], nu))
    e = y - x @ c.T - u @ d.T
    ends = np.cumsum(lengths)
    inside = np.ones(len(x), dtype=bool)
    inside[ends - 1] = False
    now = np.flatnonzero(inside)
    step = _least(np.hstack([x, u, e])[now], x[now + 1]).T
    a, b, k = step[:, :nx], step[:, nx : nx + nu], step[:, nx + nu :]
    return Innovations(a, b, c, d, k, 1.0, r=e.T @ e / len(e), x0=None)
