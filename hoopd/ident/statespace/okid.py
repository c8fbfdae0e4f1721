"""Markov parameters of several inputs and outputs by an observer (OKID: Juang et al., J. Guidance 16, 1993).

y(t) = sum_i Ybar_i v(t - i) with v = [u; y] and l lags is a linear regression; the parameters of the system follow by
Y_k = Ybar_k(u) + sum_i Ybar_i(y) Y_(k - i). The observer's poles are at zero where l (ny) >= nx, without noise exactly.

Rules of this file: missing outputs drop the rows that need them; several experiments share one regression.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.checks import Orders, check
from hoopd.ident.data import Data, experiments
from hoopd.ident.loopchecks import check_record

Array = NDArray[np.float64]

# Rows that exist at a time.
CHUNK = 16384


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
    triangle, complete = _triangle(each, lags, lags if drop is None else drop)
    width = triangle.shape[1] - each[0].ny
    if complete < width:
        raise ValueError(f"{complete} complete rows for {width} parameters of each output: fewer lags or more data")
    nu, m = each[0].nu, each[0].nu + each[0].ny
    extra = _penalty(width, nu, m, ridge, curvature)
    observer = _least(np.vstack([triangle, np.hstack([extra, np.zeros((len(extra), each[0].ny))])]), width)
    return _system(observer, nu, lags if count is None else count)


def _triangle(each: Sequence[Data], lags: int, drop: int) -> tuple[Array, int]:
    """The triangular factor of all complete rows [u(t), v(t-1), ..., v(t-l), y(t)], and how many they are."""
    r: Array | None = None
    count = 0
    for one in each:
        for rows in _rows(one, lags, drop):
            r = linalg.qr(rows if r is None else np.vstack([r, rows]), mode="r", check_finite=False)[0]
            r = r[: rows.shape[1]]
            count += len(rows)
    if r is None:
        raise ValueError("no row is complete: fewer lags or more data")
    return np.asarray(r), count


def _rows(one: Data, lags: int, drop: int) -> Iterator[Array]:
    """`CHUNK` rows at a time, those with a gap left out."""
    v = np.hstack([one.u, one.y])
    padded = np.vstack([np.zeros((lags, v.shape[1])), v])
    for first in range(drop, one.n, CHUNK):
        last = min(first + CHUNK, one.n)
        past = (padded[lags - i + first : lags - i + last] for i in range(1, lags + 1))
        rows = np.hstack([one.u[first:last], *past, one.y[first:last]])
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows):
            yield rows


def _penalty(width: int, nu: int, m: int, ridge: float, curvature: float) -> Array:
    """Rows whose squares are the penalties; the direct term is not bent."""
    rows = [np.sqrt(ridge) * np.eye(width)] if ridge > 0.0 else []
    lags = (width - nu) // m
    if curvature > 0.0 and lags > 2:
        bend = np.kron(np.diff(np.eye(lags), n=2, axis=0), np.eye(m))
        rows.append(np.sqrt(curvature) * np.hstack([np.zeros((len(bend), nu)), bend]))
    return np.vstack(rows) if rows else np.zeros((0, width))


def _least(rows: Array, width: int) -> Array:
    """The solution of least length of the first `width` columns for the others."""
    r = linalg.qr(rows, mode="r", check_finite=False)[0][: rows.shape[1]]
    return np.asarray(linalg.lstsq(r[:, :width], r[:, width:], cond=1e-12)[0].T)


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
