"""The impulse response straight from data: least squares on lags of the inputs, plain or with a prior on its shape.

    y(t) = sum_i sum_k g_i(k) dt u_i(t - k) + v(t),   k = 0 .. n-1
g is in unit of y per unit of u and second, so that it lies on the impulse response of the continuous system.

A prior g dt ~ N(0, P) with P of a few hyperparameters (size, decay, smoothness) lets n be long: those, and the noise,
are what makes the data likeliest (empirical Bayes).
Sources: Chen, Ohlsson, Ljung, On the estimation of transfer functions, regularizations and Gaussian processes -
revisited, Automatica 48 (2012); Pillonetto, Dinuzzo, Chen, De Nicolao, Ljung, Kernel methods in system identification,
Automatica 50 (2014); Chen, Ljung, Implementation of algorithms for tuning parameters, Automatica 49 (2013).

Rules of this file: rows whose lags or output are not known are left out; memory is linear in the samples only where the
data are; one output after the other, each with all inputs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import linalg, stats

from hoopd.ident.checks import BROAD, Orders, check
from hoopd.ident.data import Data, experiments
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.kernels import KERNELS, Tuned, tuned
from hoopd.ident.loopchecks import check_record
from hoopd.ident.models import Innovations, Polynomials

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]
Lags = NDArray[np.signedinteger]
Prior = Literal["ridge", "tc", "dc", "ss"]

# Rows that are factorised at once: their regressor stays small beside the data.
BLOCK = 8192
# Condition number of the triangular factor beyond which the inputs do not tell the lags apart.
WORST = 1e10


class Triangle(NamedTuple):
    """What least squares needs of [Phi, y]: Phi = Q r, Q'y = s, the squares left over, and the rows."""

    r: Array
    s: Array
    rest: float
    rows: int


@dataclass(frozen=True, repr=False)
class Impulse(IdentifiedModel):
    """Impulse responses g (n, ny, nu) at t (n,) s with their covariance by output (ny, n nu, n nu), inputs outermost.

    `variance` (ny,) of the disturbance; `priors` by output where there was one: its hyperparameters.
    """

    t: Array
    g: Array
    covariance: Array
    variance: Array
    dt: float
    priors: tuple[Tuned, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def state_space(self) -> Innovations:
        """The finite impulse responses as an output-error model: its states are the last n - 1 inputs."""
        n, ny, nu = self.g.shape
        taps = self.g * self.dt
        a, b = np.eye((n - 1) * nu, k=-nu), np.eye((n - 1) * nu, nu)
        c = np.hstack([*taps[1:]]) if n > 1 else np.zeros((ny, 0))
        return Innovations(
            a, b, c, taps[0], np.zeros(((n - 1) * nu, ny)), self.dt, r=np.diag(self.variance),
            inputs=self.inputs, outputs=self.outputs,
        )  # fmt: skip

    @property
    def system(self) -> ct.StateSpace:
        """From u to y."""
        return self.state_space.system

    @property
    def parameters(self) -> dict[str, float]:
        """The responses by name: g[k] of one input and output, g[k] (u -> y) of several."""
        return dict(zip(self._names(), self.g.transpose(1, 2, 0).reshape(-1).tolist(), strict=True))

    def deviations(self) -> dict[str, float]:
        """Standard errors of the responses by name."""
        return dict(zip(self._names(), self.deviation.transpose(1, 2, 0).reshape(-1).tolist(), strict=True))

    def _names(self) -> list[str]:
        n, ny, nu = self.g.shape
        pairs = [f" ({u} -> {y})" if ny * nu > 1 else "" for y in self.outputs for u in self.inputs]
        return [f"g[{k}]{pair}" for pair in pairs for k in range(n)]

    @property
    def deviation(self) -> Array:
        """Standard errors (n, ny, nu)."""
        n, ny, nu = self.g.shape
        return np.asarray(np.sqrt(np.einsum("imm->im", self.covariance)).reshape(ny, nu, n).transpose(2, 0, 1))

    def band(self, level: float = 0.95) -> Array:
        """Half width (n, ny, nu) of the interval around each estimate that holds with probability `level`."""
        return np.asarray(stats.norm.ppf(0.5 + 0.5 * level) * self.deviation)

    def step(self) -> Array:
        """Step responses (n, ny, nu), the sums of g dt."""
        return np.cumsum(self.g, axis=0) * self.dt

    def model(self, output: int = 0) -> Polynomials:
        """The finite impulse response of one output as a model, with the covariance of its coefficients."""
        n, _, nu = self.g.shape
        taps = self.g[:, output, :].T * self.dt
        names = tuple(f"b{i + 1}[{k}]" for i in range(nu) for k in range(n))
        return Polynomials(
            self.dt, b=tuple(taps), f=(np.ones(1),) * nu, variance=float(self.variance[output]), names=names,
            values=taps.reshape(-1), covariance=self.covariance[output] * self.dt**2,
            inputs=self.inputs, output=self.outputs[output],
        )  # fmt: skip


@estimated("impulse response")
def impulseest(
    data: Data | Sequence[Data], n: int = 50, prior: Prior | None = None, *, ridge: float = 0.0, direct: bool = True
) -> Impulse:
    """Estimate the impulse responses over n lags from every input to every output.

        y(t) = sum_i sum_k g_i(k) dt u_i(t - k) + v(t),   k = 0 .. n-1
    g is in unit of y per unit of u and second, so that it lies on the impulse response of the continuous system. A
    prior g dt ~ N(0, P) of a few hyperparameters lets n be long: those, and the noise, are what makes the data
    likeliest.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    n : int
        Lags.
    prior : {"ridge", "tc", "dc", "ss"}, optional
        Size only, decay, decay and correlation, or smoothness, tuned to the data; its intervals take the
        hyperparameters for known, so they are somewhat narrow. Without it plain least squares.
    ridge : float
        Weight on the sum of squares of g dt, without a prior; the covariance is that of the estimate, no bias in it.
    direct : bool
        Whether the response has a value at lag 0.

    Returns
    -------
    Impulse
        `g` (n, ny, nu) at `t` (n,) s with its `covariance`, the `variance` (ny,) of the disturbance, and the `priors`.

    Raises
    ------
    ValueError
        Too few samples, inputs that do not tell the lags apart (a prior does without), no input.

    Notes
    -----
    Sources: Chen, Ohlsson, Ljung, Automatica 48 (2012); Pillonetto, Dinuzzo, Chen, De Nicolao, Ljung, Automatica 50
    (2014); Chen, Ljung, Automatica 49 (2013).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, impulseest
    >>> rng = np.random.default_rng(0)
    >>> u, truth = rng.standard_normal(600), 0.5 ** np.arange(10)
    >>> y = np.convolve(u, truth)[:600] + 0.1 * rng.standard_normal(600)
    >>> found = impulseest(iddata(y, u, dt=1.0), n=10)
    >>> found.g[:4, 0, 0].round(2), bool(np.all(np.abs(found.g[:, 0, 0] - truth) < 0.02))
    (array([1.  , 0.51, 0.25, 0.13]), True)
    """
    each = experiments(data)
    if prior is not None and (prior not in KERNELS or ridge):
        raise ValueError(f"prior is one of {', '.join(KERNELS)}, without a weight beside it, not {prior!r}")
    if each[0].nu == 0 or n < 1 + (not direct):
        raise ValueError("an impulse response wants an input and at least one lag")
    check(each, orders=Orders(0, min(n, BROAD)))
    check_record(each)
    lags = np.arange(0 if direct else 1, n)
    found = [_estimated(_triangle(each, i, lags), each[0].nu, lags, prior, ridge) for i in range(each[0].ny)]
    shape, dt = (each[0].ny, each[0].nu, n), each[0].dt
    g, covariance = np.zeros(shape), np.zeros((shape[0], shape[1] * n, shape[1] * n))
    where = (np.arange(shape[1])[:, None] * n + lags).reshape(-1)
    for i, one in enumerate(found):
        g[i].reshape(-1)[where] = one.coefficients / dt
        covariance[i][np.ix_(where, where)] = one.covariance / dt**2
    return Impulse(
        dt * np.arange(n, dtype=float), g.transpose(2, 0, 1), covariance, np.array([one.variance for one in found]), dt,
        tuple(one.prior for one in found if one.prior), each[0].inputs, each[0].outputs,
    )  # fmt: skip


# ---------------------------------------------------------------------------------------------- inside


class _Found(NamedTuple):
    coefficients: Array
    covariance: Array
    variance: float
    prior: Tuned | None


def _estimated(given: Triangle, nu: int, lags: Lags, prior: str | None, ridge: float) -> _Found:
    m = len(given.s)
    if prior is None:
        return _least_squares(given, m, ridge)
    found = tuned(given, nu, lags, prior)
    # posterior of coefficients: mean P R'S^-1 s, covariance P - P R'S^-1 R P, with S = R P R' + variance I
    gain = linalg.cho_solve(
        linalg.cho_factor(given.r @ found.p @ given.r.T + found.variance * np.eye(m)), given.r @ found.p
    ).T
    return _Found(gain @ given.s, found.p - gain @ given.r @ found.p, found.variance, found)


def _least_squares(given: Triangle, m: int, ridge: float) -> _Found:
    if given.rows <= m:
        raise ValueError(f"{given.rows} whole rows for {m} lags: take fewer lags, or a prior")
    singular = np.linalg.svd(given.r, compute_uv=False)
    if ridge == 0.0 and not singular[-1] * WORST > singular[0]:
        raise ValueError(f"the inputs do not excite {m} lags (rank {int(np.sum(singular * WORST > singular[0]))}): "
                         "take fewer, or a prior")  # fmt: skip
    information = given.r.T @ given.r
    inverse = np.linalg.inv(information + ridge * np.eye(m))
    coefficients = inverse @ given.r.T @ given.s if ridge else linalg.solve_triangular(given.r, given.s)
    misfit = given.rest + float(np.sum((given.s - given.r @ coefficients) ** 2))
    variance = misfit / (given.rows - float(np.trace(inverse @ information)))
    return _Found(coefficients, variance * inverse @ information @ inverse, variance, None)


def _triangle(each: list[Data], output: int, lags: Lags) -> Triangle:
    """The triangular factor of all rows, block after block."""
    kept, rows = np.zeros((0, each[0].nu * len(lags) + 1)), 0
    for block in _blocks(each, output, lags):
        rows += len(block)
        kept = np.asarray(np.linalg.qr(np.vstack([kept, block]), mode="r"))
    m = kept.shape[1] - 1
    full = np.zeros((m + 1, m + 1))
    full[: min(len(kept), m + 1)] = kept[: m + 1]
    return Triangle(full[:m, :m], full[:m, m], float(full[m, m] ** 2), rows)


def _blocks(each: list[Data], output: int, lags: Lags) -> Iterator[Array]:
    """Rows [u_1(t - k) .. u_nu(t - k), y(t)] of which everything is known."""
    reach = int(lags[-1])
    for data in each:
        for first in range(reach, data.n, BLOCK):
            last = min(first + BLOCK, data.n)
            window = sliding_window_view(data.u[first - reach : last], reach + 1, axis=0)[:, :, reach - lags]
            y = data.y[first:last, output]
            block = np.hstack([window.reshape(last - first, -1), y[:, None]])
            yield block[np.isfinite(y)]
