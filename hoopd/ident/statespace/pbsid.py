"""Predictor-based subspace identification (PBSID-opt): right in a closed loop too.

A long vector ARX model, whose errors no feedback biases, gives the Markov parameters C Abar^(i-1) [B - K D, K] of the
predictor; with them the observability matrix times the state of every sample is known, a singular value decomposition
gives the states, and two regressions the matrices (Chiuso, IEEE Trans. Automat. Control 52, 2007).
With w = [z(t-p); ...; z(t)], z = [u; y], the windows' triangular factor L holds all of it: every signal is a row S L,
its products with another those of the samples.

Rules of this file: nothing runs across a gap or two experiments; the past is as long as the predictor remembers; only
the factor is used, never the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import Orders, check
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.estimation_report import chosen, estimated
from hoopd.ident.modelchecks import check_model
from hoopd.ident.models import Innovations
from hoopd.ident.simulationcheck import check_simulation
from hoopd.ident.statespace import windows
from hoopd.ident.statespace.ordering import autoregression, joined

Array = NDArray[np.float64]

# Lags that are looked at for the past, and rows for each unknown of the long model.
LEAST_PAST, MOST_PAST, SHARE = 10, 40, 4
# Of the largest singular value: a state that the data do not show is rounding.
LEAST_SHARE = 1e-12


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
    pieces = [joined(part) for part in parts if part.n > p + 1]
    size, count = p * (nu + ny) + nu * direct, windows.count(pieces, p + 1)
    if count < SHARE * size:
        raise ValueError(f"too few samples: a past of {p} samples wants {SHARE * size} without a gap")
    low = windows.factor(pieces, p + 1, np.arange((p + 1) * (nu + ny), dtype=int))
    rows = _WindowRows(low.reshape(p + 1, nu + ny, -1), nu, count)
    model = _matrices(rows, *_states(rows, _long_model(rows, direct), f, order), direct)
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


@dataclass(frozen=True)
class _WindowRows:
    """Signals as rows of the factor (p + 1, nu + ny, width): their products are those of `count` windows."""

    low: Array
    nu: int
    count: int

    @property
    def past(self) -> Array:
        """z(t-p), ..., z(t-1)."""
        return self._stacked(self.low[:-1])

    @property
    def next_past(self) -> Array:
        """z(t-p+1), ..., z(t)."""
        return self._stacked(self.low[1:])

    @property
    def u(self) -> Array:
        """u(t)."""
        return np.asarray(self.low[-1, : self.nu])

    @property
    def y(self) -> Array:
        """y(t)."""
        return np.asarray(self.low[-1, self.nu :])

    def _stacked(self, part: Array) -> Array:
        return np.asarray(part.reshape(-1, self.low.shape[2]))


def _least(rows: Array, target: Array) -> Array:
    """M of target = M rows by least squares, with rows of one length."""
    size = np.linalg.norm(rows, axis=1)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq((rows / size[:, None]).T, target.T, rcond=1e-12)[0].T / size)


def _long_model(rows: _WindowRows, direct: bool) -> Array:
    """Coefficients (ny, p, nu + ny) of the past in the long model, the oldest lag first."""
    past = rows.past
    found = _least(np.vstack([past, rows.u]) if direct else past, rows.y)
    p, channels, _ = rows.low.shape
    return found[:, : len(past)].reshape(len(found), p - 1, channels)


def _states(rows: _WindowRows, markov: Array, f: int, order: int) -> tuple[Array, Array]:
    """T (order, p (nu + ny)) of the states T [z(t-p); ...; z(t-1)], and the singular values.

    Block row k of the observability matrix times the state is the long model, its past moved on by k samples.
    """
    ny, p, channels = markov.shape
    wide = np.zeros((f, ny, p, channels))
    for k in range(f):
        wide[k, :, k:] = markov[:, : p - k]
    # the state's part of y(t + k): what lies k samples further back counts C Abar^(k + i - 1)
    seen = wide.reshape(f * ny, p * channels)
    left, values, _ = np.linalg.svd(seen @ rows.past, full_matrices=False)
    # of variance 1
    scale = np.sqrt(rows.count) / np.maximum(values[:order], LEAST_SHARE * values[0] + np.finfo(float).tiny)
    return scale[:, None] * (left[:, :order].T @ seen), values


def _matrices(rows: _WindowRows, states: Array, values: Array, direct: bool) -> Innovations:
    """C, D from the outputs, then A, B, K from the states that follow."""
    x, u, y = states @ rows.past, rows.u, rows.y
    nx, nu = len(x), len(u)
    found = _least(np.vstack([x, u]) if direct else x, y)
    c, d = found[:, :nx], found[:, nx:] if direct else np.zeros((len(y), nu))
    e = y - c @ x - d @ u
    step = _least(np.vstack([x, u, e]), states @ rows.next_past)
    a, b, k = step[:, :nx], step[:, nx : nx + nu], step[:, nx + nu :]
    return Innovations(a, b, c, d, k, 1.0, r=e @ e.T / rows.count, x0=None, singular_values=values)
