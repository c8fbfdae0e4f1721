"""Markov parameters of several inputs and outputs by an observer (OKID: Juang et al., J. Guidance 16, 1993).

y(t) = sum_i Ybar_i v(t - i) with v = [u; y] and l lags is a linear regression; the parameters of the system follow by
Y_k = Ybar_k(u) + sum_i Ybar_i(y) Y_(k - i). The observer's poles are at zero where l (ny) >= nx, without noise exactly.

Rules of this file: missing outputs drop the rows that need them; several experiments share one regression.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.checks import Orders, check
from hoopd.ident.data import Data, experiments
from hoopd.ident.loopchecks import check_record

Array = NDArray[np.float64]


def okid(
    data: Data | Sequence[Data], lags: int, *, count: int | None = None, drop: int | None = None, ridge: float = 0.0,
    curvature: float = 0.0,
) -> Array:  # fmt: skip
    """Estimate the Markov parameters of several inputs and outputs by an observer.

    y(t) = sum_i Ybar_i v(t - i) with v = [u; y] and l lags is a linear regression; the parameters of the system follow
    by Y_k = Ybar_k(u) + sum_i Ybar_i(y) Y_(k - i). The observer's poles are at zero where l (ny) >= nx, without noise
    exactly.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments, which share one regression; missing outputs drop the rows that need them.
    lags : int
        l, of the observer.
    count : int, optional
        Markov parameters beside D; as many as lags unless given.
    drop : int, optional
        First rows left out, all `lags` unless given; less counts samples before the start as zero: only where the
        experiment began at rest.
    ridge : float
        Adds ridge |Ybar|^2 to the squared errors.
    curvature : float
        Adds curvature times the squared second differences of Ybar over the lags.

    Returns
    -------
    ndarray, shape (count + 1, ny, nu)
        D, C B, C A B, ...

    Raises
    ------
    ValueError
        Too few complete rows; what makes the answer doubtful is an `IdentificationWarning`.

    Notes
    -----
    Source: Juang et al., J. Guidance 16, 1993.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import iddata, okid
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 1.0], [1.0, -0.5], u) + 0.01 * e
    >>> okid(iddata(y, u), lags=5)[:, 0, 0].round(2)
    array([0.  , 1.  , 0.5 , 0.25, 0.13, 0.06])
    """
    each = experiments(data)
    if lags < 1:
        raise ValueError(f"lags must be at least 1, not {lags}")
    check(each, orders=Orders(0, lags))
    check_record(each)
    pairs = [_regression(one, lags, lags if drop is None else drop) for one in each]
    x, y = np.vstack([a for a, _ in pairs]), np.vstack([b for _, b in pairs])
    if len(x) < x.shape[1]:
        raise ValueError(f"{len(x)} complete rows for {x.shape[1]} parameters of each output: fewer lags or more data")
    nu, m = each[0].nu, each[0].nu + each[0].ny
    extra = _penalty(x.shape[1], nu, m, ridge, curvature)
    observer = _least(np.vstack([x, extra]), np.vstack([y, np.zeros((len(extra), y.shape[1]))]))
    return _system(observer, nu, lags if count is None else count)


def _regression(one: Data, lags: int, drop: int) -> tuple[Array, Array]:
    """Rows [u(t), v(t-1), ..., v(t-l)] and y(t), those with a gap left out."""
    v = np.hstack([one.u, one.y])
    padded = np.vstack([np.zeros((lags, v.shape[1])), v])
    n = one.n
    x = np.hstack([one.u, *(padded[lags - i : lags - i + n] for i in range(1, lags + 1))])
    whole = np.isfinite(x).all(axis=1) & np.isfinite(one.y).all(axis=1)
    whole[:drop] = False
    return x[whole], one.y[whole]


def _penalty(width: int, nu: int, m: int, ridge: float, curvature: float) -> Array:
    """Rows whose squares are the penalties; the direct term is not bent."""
    rows = [np.sqrt(ridge) * np.eye(width)] if ridge > 0.0 else []
    lags = (width - nu) // m
    if curvature > 0.0 and lags > 2:
        bend = np.kron(np.diff(np.eye(lags), n=2, axis=0), np.eye(m))
        rows.append(np.sqrt(curvature) * np.hstack([np.zeros((len(bend), nu)), bend]))
    return np.vstack(rows) if rows else np.zeros((0, width))


def _least(x: Array, y: Array) -> Array:
    """The solution of least length; the rows are first brought to a triangle."""
    r = linalg.qr(np.hstack([x, y]), mode="r", check_finite=False)[0][: x.shape[1] + y.shape[1]]
    return np.asarray(linalg.lstsq(r[:, : x.shape[1]], r[:, x.shape[1] :], cond=1e-12)[0].T)


def _system(observer: Array, nu: int, count: int) -> Array:
    ny = len(observer)
    m, lags = nu + ny, (observer.shape[1] - nu) // (nu + ny)
    blocks = observer[:, nu:].reshape(ny, lags, m).transpose(1, 0, 2)
    out = np.zeros((count + 1, ny, nu))
    out[0] = observer[:, :nu]
    for k in range(1, count + 1):
        if k <= lags:
            out[k] = blocks[k - 1][:, :nu]
        for i in range(1, min(k, lags) + 1):
            out[k] += blocks[i - 1][:, nu:] @ out[k - i]
    return out
