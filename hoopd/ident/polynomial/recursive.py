"""ARX models that follow a plant on line: recursive least squares, one sample at a time.

    k = P phi / (lambda + phi'P phi),  coefficients += k e,  P = (P - k phi'P) / lambda
(Ljung, System Identification, 1999, 11.2). Old samples are forgotten by lambda; what keeps P from growing while
nothing happens is a bound on its trace and a dead zone, in which a sample without news changes nothing.

Rules of this file: numpy only; `update` works in arrays made once and returns a float.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from math import isfinite, nan
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from hoopd.ident.models import Polynomials

Array = NDArray[np.float64]

# P before any sample: so many times the squared size of coefficients over the noise's variance.
SURE_OF_NOTHING = 1e4


class RecursiveArx:
    """An ARX model A y = B u + e with coefficients that follow the samples: recursive least squares.

        k = P phi / (lambda + phi'P phi),  coefficients += k e,  P = (P - k phi'P) / lambda

    Parameters
    ----------
    na : int
        Coefficients of A after the leading 1.
    nb : int or sequence of int
        Coefficients of B, of one input or by input, from q^-delay on.
    delay : int or sequence of int
        Samples; 0 is a direct term.
    forgetting : float
        lambda: 1 keeps all, memory is about 1/(1 - lambda) samples.
    start : array_like, shape (na + sum nb,), optional
        Coefficients to begin with; without it zeros.
    p0 : float
        Variance of those over the variance of e.
    trace_bound : float, optional
        Bound on the trace of P; that of p0 I unless given.
    dead_zone : float
        A sample whose share of news phi'P phi / (lambda + phi'P phi) is below changes nothing.

    Attributes
    ----------
    coefficients : ndarray, shape (na + sum nb,)
        a1 ..., then b of each input.
    p : ndarray, shape (na + sum nb, na + sum nb)
        Their covariance over the variance of e.
    samples, skipped : int
        How many were taken, and how many of them were not finite.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 11.2.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import RecursiveArx
    >>> rng = np.random.default_rng(0)
    >>> model, y, before = RecursiveArx(na=1, nb=1), 0.0, 0.0
    >>> for u in rng.standard_normal(500):
    ...     y = 0.8 * y + 2.0 * before + 0.05 * rng.standard_normal()
    ...     error = model.update(y, u)
    ...     before = u
    >>> model.coefficients.round(2)
    array([-0.8,  2. ])
    """

    def __init__(
        self, na: int, nb: int | Sequence[int], delay: int | Sequence[int] = 1, *, forgetting: float = 0.99,
        start: ArrayLike | None = None, p0: float = SURE_OF_NOTHING, trace_bound: float | None = None,
        dead_zone: float = 0.0,
    ) -> None:  # fmt: skip
        """Begin with the coefficients given; the class tells of the arguments."""
        self.na, self.nb = na, (nb,) if isinstance(nb, int | np.integer) else tuple(nb)
        self.delay = (delay,) * len(self.nb) if isinstance(delay, int | np.integer) else tuple(delay)
        size = na + sum(self.nb)
        _allowed(size, self.nb, self.delay, forgetting, dead_zone)
        if not p0 > 0.0 or (trace_bound is not None and not trace_bound > 0.0):
            raise ValueError(f"p0 and trace_bound are positive, not {p0} and {trace_bound}")
        self.forgetting, self.dead_zone, self.p0 = forgetting, dead_zone, p0
        self.trace_bound = size * p0 if trace_bound is None else trace_bound
        self.coefficients = np.zeros(size) if start is None else np.array(start, dtype=float)
        if self.coefficients.shape != (size,):
            raise ValueError(f"start has {self.coefficients.size} coefficients, the model {size}")
        self.p = p0 * np.eye(size)
        self.samples = self.skipped = 0
        inputs = sum(self.nb)
        self._seen = np.zeros((inputs, inputs))  # Gram matrix of the inputs' lags in memory
        self._low, self._high = np.full(1 + len(self.nb), np.inf), np.full(1 + len(self.nb), -np.inf)
        self._held = 0  # samples until an input that was not finite has left the lags
        self._phi, self._gain, self._outer = np.zeros(size), np.zeros(size), np.zeros((size, size))
        reach = max([na, *(d + n for d, n in zip(self.delay, self.nb, strict=True))])
        # newest first, written twice, so that the last `reach` values always lie side by side
        self._reach, self._at = reach, 0
        self._past = np.zeros((1 + len(self.nb), 2 * reach))

    def __getattr__(self, name: str) -> Array:
        if name == "theta":  # what the coefficients were called
            warnings.warn("theta is now called coefficients", DeprecationWarning, stacklevel=2)
            return self.coefficients
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def update(self, y: float, u: float | Sequence[float] | Array = ()) -> float:
        """Take y(t) and u(t) (one number or one an input); the prediction error before the update.

        A y that is not finite is replaced by its prediction and changes no coefficient; the answer is NaN. An input
        that is not finite is held at its value before, and nothing is learned while it stands among the lags.
        `skipped` counts both.
        """
        self._step_back(u)
        self._regress()
        said = float(self._phi @ self.coefficients)
        known = isfinite(y)
        self._write(0, float(y) if known else said)
        if known and not self._held:
            self._correct(float(y) - said)
            self._remember()
            self.samples += 1
        else:
            self.skipped += 1
        return float(y) - said if known else nan

    def predict(self, u: float | Sequence[float] | Array = ()) -> float:
        """y(t) that `update` with this u would expect; nothing is changed (but scratch)."""
        before, kept, held = self._at, self._past.copy(), self._held
        self._step_back(u)
        self._regress()
        self._at, self._past[:], self._held = before, kept, held
        return float(self._phi @ self.coefficients)

    def reset(self, p0: float | None = None) -> None:
        """Covariance reset: forget how sure the coefficients were, and keep them."""
        self.p[:] = 0.0
        np.fill_diagonal(self.p, self.p0 if p0 is None else p0)

    def model(self, dt: float, variance: float = 0.0) -> Polynomials:
        """The model of this moment, with covariance variance P; it warns of what the samples did not tell."""
        from hoopd.ident.modelchecks import check_model
        from hoopd.ident.models import Polynomials
        from hoopd.ident.polynomial.structure import structure

        own = structure(len(self.nb), self.na, self.nb, delay=self.delay)
        parts = list(own.split(self.coefficients))
        self._check_told()
        found = Polynomials(
            dt, parts[0], tuple(parts[1 : 1 + own.nu]), variance=variance, names=own.names,
            values=self.coefficients.copy(),
            covariance=variance * self.p if variance else None,
        )  # fmt: skip
        memory = self.samples if self.forgetting == 1.0 else min(self.samples, round(1.0 / (1.0 - self.forgetting)))
        check_model(found, memory)
        return found

    def _check_told(self) -> None:
        """Warn of channels that never moved and of inputs whose lags in memory depend on each other."""
        from hoopd.ident.checks import SINGULAR
        from hoopd.ident.doubts import warn

        for i in np.flatnonzero(self._low >= self._high):
            warn(f"{f'input {i}' if i else 'the output'} is constant: it tells nothing of its coefficients")
        values = np.linalg.eigvalsh(self._seen) if len(self._seen) else np.ones(1)
        rank = int((values > SINGULAR * values[-1]).sum())
        if rank < len(values):
            warn(
                f"not persistently exciting: the inputs in memory excite order {rank} and {len(values)} is wanted; use "
                "a richer input"
            )

    def _step_back(self, u: float | Sequence[float] | Array) -> None:
        """Room for the newest values in front, and the inputs in it."""
        values = (u,) if isinstance(u, Real) or np.ndim(u) == 0 else u
        if len(values) != len(self.nb):  # type: ignore[arg-type]
            raise ValueError(f"{len(values)} inputs given, the model has {len(self.nb)}")  # type: ignore[arg-type]
        before, self._at = self._at, (self._at - 1) % self._reach
        self._held = max(self._held - 1, 0)
        for i, value in enumerate(values):  # type: ignore[arg-type]
            known = isfinite(value)
            self._write(1 + i, float(value) if known else float(self._past[1 + i, before]))
            if not known:
                self._held = self._reach

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

    def _remember(self) -> None:
        """What the check of the excitation needs; the zeros before the first sample are no part of it."""
        now = self._past[:, self._at]
        np.minimum(self._low, now, out=self._low)
        np.maximum(self._high, now, out=self._high)
        if self.samples >= self._reach:
            lags = self._phi[self.na :]
            self._seen *= self.forgetting
            self._seen += np.multiply.outer(lags, lags)

    def _correct(self, error: float) -> None:
        gain, lam = np.dot(self.p, self._phi, out=self._gain), self.forgetting
        news = float(gain @ self._phi)
        if news <= self.dead_zone * (lam + news):
            return
        np.multiply.outer(gain, gain, out=self._outer)
        self._outer *= 1.0 / (lam + news)
        self.p -= self._outer
        gain *= error / (lam + news)
        self.coefficients += gain
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
