"""An ARX model whose coefficients are affine in scheduling signals.

    A(q, p) y = B(q, p) u + e,   a_k(p) = a_k,0 + a_k,1 p_1 + ...,   p of the same sample as y
It is a linear regression (Bamieh & Giarre, Int. J. Robust and Nonlinear Control 12, 2002).

Rules of this file: one output; the scheduling signal is known; an equation with a missing output is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.models import Polynomials, standard_errors
from hoopd.ident.polynomial.structure import single
from hoopd.ident.schedule import schedule_of, with_one

Array = NDArray[np.float64]

# Condition of the regressors beyond which they are not independent.
DEPENDENT = 1e10


@dataclass(frozen=True)
class LpvArx:
    """An ARX model of scheduled coefficients: values and covariance in the order of `names`.

    `a` (na, 1 + np) and `b` (nu, lags, 1 + np): constant part first, then what multiplies each scheduling signal.
    """

    a: Array
    b: Array
    delay: int
    dt: float
    names: tuple[str, ...]
    values: Array
    covariance: Array
    variance: float
    report: EstimationReport | None = field(default=None, compare=False)

    def deviations(self) -> dict[str, float]:
        """Standard errors by name."""
        return standard_errors(self.names, self.covariance)

    def frozen(self, p: ArrayLike) -> Polynomials:
        """The `Polynomials` that it is while the scheduling signals stay at p (np,)."""
        at = with_one(np.atleast_1d(np.asarray(p, dtype=float))[None])[0]
        b = tuple(np.concatenate([np.zeros(self.delay), one @ at]) for one in self.b)
        return Polynomials(self.dt, a=np.concatenate([[1.0], self.a @ at]), b=b, variance=self.variance)

    def predict(self, data: Data, p: ArrayLike) -> Array:
        """Outputs (n, 1) one sample ahead; NaN before the longest lag."""
        rows, first = _regressors(data, schedule_of(p, data.n), len(self.a), self.b.shape[1], self.delay)
        return np.concatenate([np.full(first, np.nan), rows @ self.values])[:, None]

    def simulate(self, data: Data, p: ArrayLike) -> Array:
        """Outputs (n, 1) from the inputs alone, the first ones (as many as the longest lag) as measured."""
        at, na, lags = with_one(schedule_of(p, data.n)), len(self.a), self.b.shape[1]
        first = max(na, self.delay + lags - 1)
        y = np.nan_to_num(data.y[:, 0].copy())
        with np.errstate(over="ignore", invalid="ignore"):
            for t in range(first, data.n):
                past = y[t - na : t][::-1]
                late = data.u[t - self.delay - lags + 1 : t - self.delay + 1][::-1]
                y[t] = np.einsum("ks,s,k->", self.b.reshape(-1, at.shape[1]), at[t], late.T.reshape(-1)) - (
                    self.a @ at[t] @ past
                )
        return y[:, None]


@estimated("scheduled ARX")
def lpv_arx(data: Data, p: ArrayLike, na: int, nb: int, delay: int = 1) -> LpvArx:
    """Fit an ARX model whose coefficients are affine in scheduling signals.

    Parameters
    ----------
    data : Data
        One experiment of one output.
    p : array_like, shape (n,) or (n, np)
        Scheduling signals, one row a sample; those of sample t stand in the coefficients of y(t).
    na : int
        Coefficients of A after the leading 1.
    nb : int
        Coefficients of B, of every input, from q^-delay on.
    delay : int
        Samples; 0 is a direct term.

    Returns
    -------
    LpvArx
        Coefficients with their covariance; `frozen(p)` is the model at one place of the schedule.

    Raises
    ------
    ValueError
        Signals that do not fit, and too few equations or a schedule that does not move.

    Notes
    -----
    Source: Bamieh & Giarre, Int. J. Robust and Nonlinear Control 12, 2002.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, lpv_arx
    >>> rng = np.random.default_rng(0)
    >>> u, e, p = rng.standard_normal(1000), 0.05 * rng.standard_normal(1000), np.sin(0.01 * np.arange(1000))
    >>> y = np.zeros(1000)
    >>> for t in range(1, 1000):  # a pole at 0.7 + 0.2 p
    ...     y[t] = (0.7 + 0.2 * p[t]) * y[t - 1] + u[t - 1] + e[t]
    >>> model = lpv_arx(iddata(y, u), p, na=1, nb=1)
    >>> model.a.round(2), model.frozen([1.0]).a.round(2)
    (array([[-0.7, -0.2]]), array([ 1. , -0.9]))
    """
    single([data])
    schedule = schedule_of(p, data.n)
    rows, first = _regressors(data, schedule, na, nb, delay)
    seen = np.isfinite(rows).all(axis=1) & np.isfinite(data.y[first:, 0])
    rows, y = rows[seen], data.y[first:, 0][seen]
    size, parts = rows.shape[1], schedule.shape[1] + 1
    if len(rows) <= size:
        raise ValueError(f"too few samples: {len(rows)} equations for {size} coefficients")
    scale = np.linalg.norm(rows, axis=0)
    if not scale.all() or np.linalg.cond(rows / scale) > DEPENDENT:
        raise ValueError("the schedule does not move, or the input excites too little: coefficients are not determined")
    x = np.linalg.lstsq(rows / scale, y, rcond=None)[0] / scale
    rest = y - rows @ x
    variance = float(rest @ rest) / (len(y) - size)
    covariance = variance * np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    a, b = x[: na * parts].reshape(na, parts), x[na * parts :].reshape(data.nu, nb, parts)
    return LpvArx(a, b, delay, data.dt, _arx_names(na, nb, data.nu, delay, parts), x, covariance, variance)


def _arx_names(na: int, nb: int, nu: int, delay: int, parts: int) -> tuple[str, ...]:
    """a1, a1*p1, ..., b1, b1*p1, of several inputs b1(2)."""
    plain = [f"a{k + 1}" for k in range(na)]
    plain += [f"b{k + delay}" + (f"({i + 1})" if nu > 1 else "") for i in range(nu) for k in range(nb)]
    return tuple(name + (f"*p{s}" if s else "") for name in plain for s in range(parts))


def _regressors(data: Data, schedule: Array, na: int, nb: int, delay: int) -> tuple[Array, int]:
    """Rows (n - first, size): the lags, each times 1 and every scheduling signal; the first sample that has all."""
    if na < 0 or nb < 1 or delay < 0:
        raise ValueError(f"orders and delay are from 0 on and nb from 1, not {na}, {nb}, {delay}")
    first, at = max(na, delay + nb - 1), with_one(schedule)
    if data.n <= first:
        raise ValueError(f"too few samples: {data.n} for lags of {first}")
    lags = [-data.y[first - k : data.n - k, 0] for k in range(1, na + 1)]
    lags += [data.u[first - k : data.n - k, i] for i in range(data.nu) for k in range(delay, delay + nb)]
    plain = np.column_stack(lags)
    return np.asarray((plain[:, :, None] * at[first:, None, :]).reshape(len(plain), -1)), first
