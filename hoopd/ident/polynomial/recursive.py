"""ARX models that follow a plant on line: recursive least squares, one sample at a time.

    k = P phi / (lambda + phi'P phi),  theta += k e,  P = (P - k phi'P) / lambda
(Ljung, System Identification, 1999, 11.2). Old samples are forgotten by lambda; what keeps P from growing while
nothing happens is a bound on its trace and a dead zone, in which a sample without news changes nothing.

Rules of this file: numpy only; `update` works in arrays made once and returns a float.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from hoopd.ident.models import Polynomials

Array = NDArray[np.float64]

# P before any sample: so many times the squared size of coefficients over the noise's variance.
SURE_OF_NOTHING = 1e4


class RecursiveArx:
    """A y = B u + e with coefficients that follow the samples.

    `theta` (na + sum nb,) holds a1 ..., then b of each input; `p` their covariance over the variance of e.
    """

    def __init__(
        self, na: int, nb: int | Sequence[int], delay: int | Sequence[int] = 1, *, forgetting: float = 0.99,
        start: ArrayLike | None = None, p0: float = SURE_OF_NOTHING, trace_bound: float | None = None,
        dead_zone: float = 0.0,
    ) -> None:  # fmt: skip
        """`forgetting` lambda: 1 keeps all, memory is about 1/(1 - lambda) samples. `trace_bound`: of P (default that
        of p0 I). `dead_zone`: a sample whose share of news phi'P phi / (lambda + phi'P phi) is below changes nothing.
        """
        self.na, self.nb = na, (nb,) if isinstance(nb, int) else tuple(nb)
        self.delay = (delay,) * len(self.nb) if isinstance(delay, int) else tuple(delay)
        size = na + sum(self.nb)
        _allowed(size, self.nb, self.delay, forgetting, dead_zone)
        self.forgetting, self.dead_zone, self.p0 = forgetting, dead_zone, p0
        self.trace_bound = size * p0 if trace_bound is None else trace_bound
        self.theta = np.zeros(size) if start is None else np.array(start, dtype=float)
        if self.theta.shape != (size,):
            raise ValueError(f"start has {self.theta.size} coefficients, the model {size}")
        self.p = p0 * np.eye(size)
        self.samples = 0
        self._phi, self._gain, self._outer = np.zeros(size), np.zeros(size), np.zeros((size, size))
        reach = max([na, *(d + n for d, n in zip(self.delay, self.nb, strict=True))])
        # newest first, written twice, so that the last `reach` values always lie side by side
        self._reach, self._at = reach, 0
        self._past = np.zeros((1 + len(self.nb), 2 * reach))

    def update(self, y: float, u: float | Sequence[float] | Array = ()) -> float:
        """Take y(t) and u(t) (one number or one an input); the prediction error before the update.

        A y that is NaN is replaced by its prediction and changes no coefficient; the answer is NaN.
        """
        self._step_back(u)
        self._regress()
        said = float(self._phi @ self.theta)
        missing = isnan(y)
        self._write(0, said if missing else y)
        error = y - said
        if not missing:
            self._correct(error)
            self.samples += 1
        return error

    def predict(self, u: float | Sequence[float] | Array = ()) -> float:
        """y(t) that `update` with this u would expect; nothing is changed (but scratch)."""
        before, kept = self._at, self._past.copy()
        self._step_back(u)
        self._regress()
        self._at, self._past[:] = before, kept
        return float(self._phi @ self.theta)

    def reset(self, p0: float | None = None) -> None:
        """Covariance reset: forget how sure the coefficients were, and keep them."""
        self.p[:] = 0.0
        np.fill_diagonal(self.p, self.p0 if p0 is None else p0)

    def model(self, dt: float, variance: float = 0.0) -> Polynomials:
        """The model of this moment, with covariance variance P."""
        from hoopd.ident.models import Polynomials
        from hoopd.ident.polynomial.structure import structure

        own = structure(len(self.nb), self.na, self.nb, delay=self.delay)
        parts = list(own.split(self.theta))
        return Polynomials(
            dt, parts[0], tuple(parts[1 : 1 + own.nu]), variance=variance, names=own.names, values=self.theta.copy(),
            covariance=variance * self.p if variance else None,
        )  # fmt: skip

    def _step_back(self, u: float | Sequence[float] | Array) -> None:
        """Room for the newest values in front, and the inputs in it."""
        self._at = (self._at - 1) % self._reach
        values = (u,) if isinstance(u, (int, float)) else u
        if len(values) != len(self.nb):
            raise ValueError(f"{len(values)} inputs given, the model has {len(self.nb)}")
        for i, value in enumerate(values):
            self._write(1 + i, float(value))

    def _write(self, row: int, value: float) -> None:
        self._past[row, self._at] = self._past[row, self._at + self._reach] = value

    def _regress(self) -> None:
        """phi = [-y(t-1) ..., u(t-d) ...]; y(t) is not written yet."""
        at, phi = self._at, self._phi
        np.negative(self._past[0, at + 1 : at + 1 + self.na], out=phi[: self.na])
        start = self.na
        for i, (d, n) in enumerate(zip(self.delay, self.nb, strict=True)):
            phi[start : start + n] = self._past[1 + i, at + d : at + d + n]
            start += n

    def _correct(self, error: float) -> None:
        gain, lam = np.dot(self.p, self._phi, out=self._gain), self.forgetting
        news = float(gain @ self._phi)
        if news <= self.dead_zone * (lam + news):
            return
        np.multiply.outer(gain, gain, out=self._outer)
        self._outer *= 1.0 / (lam + news)
        self.p -= self._outer
        gain *= error / (lam + news)
        self.theta += gain
        self.p *= 1.0 / lam
        trace = float(self.p.trace())
        if trace > self.trace_bound:
            self.p *= self.trace_bound / trace


def _allowed(size: int, nb: Sequence[int], delay: Sequence[int], forgetting: float, dead_zone: float) -> None:
    if size < 1 or min([*nb, *delay], default=0) < 0 or len(nb) != len(delay):
        raise ValueError("orders and delays are not negative, one of each an input, and at least one coefficient")
    if not 0.0 < forgetting <= 1.0:
        raise ValueError(f"forgetting is above 0 and at most 1, not {forgetting}")
    if not 0.0 <= dead_zone < 1.0:
        raise ValueError(f"dead_zone is a share from 0 to below 1, not {dead_zone}")
