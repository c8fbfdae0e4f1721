"""Priors of impulse responses that decay and are smooth, and the hyperparameters that make data likeliest.

    ridge  P_ij = c,  i = j            tc  P_ij = c l^max(i,j)
    dc     P_ij = c l^((i+j)/2) r^|i-j|
    ss     P_ij = c (l^(i+j+max(i,j))/2 - l^(3 max(i,j))/6)
Lags count from 1 here, so that the first one has a prior like the rest. Sources: see impulse.py.

Rules of this file: kernels are analytic functions of their hyperparameters, so a complex step gives derivatives to the
last digit; the likelihood is worked out on the triangular factor, whatever the number of samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

Array = NDArray[np.float64]
Kernel = Callable[[Any, Any], Any]

# The decay of the slowest response worth the name: time constant of 10,000 samples; that of the fastest: one sample
# leaves a hundredth.
DECAY = (0.01, 0.9999)
# A correlation nearer to 1 leaves one shape only, and intervals of next to nothing around it.
SMOOTH = (-0.99, 0.99)
# Size and noise beside what the data show, as natural logarithms.
SIZE = (-23.0, 23.0)
# Smallest noise beside the power of the output: rounding.
NOISE = 1e-20
STARTS = (0.6, 0.9, 0.98)
COMPLEX_STEP = 1e-30


class TriangularRows(Protocol):
    """The triangular factor of the rows (impulse.Triangle)."""

    @property
    def r(self) -> Array: ...
    @property
    def s(self) -> Array: ...
    @property
    def rest(self) -> float: ...
    @property
    def rows(self) -> int: ...


class Tuned(NamedTuple):
    """The prior P (m, m) of g dt, the noise, the hyperparameters by name and the log likelihood of the data in nats."""

    p: Array
    variance: float
    values: dict[str, float]
    log_likelihood: float


def ridge(k: Any, h: Any) -> Any:
    """Independent values of one size; no hyperparameter but that."""
    return np.eye(len(k)) + 0.0 * sum(h)


def tc(k: Any, h: Any) -> Any:
    """Tuned and correlated; h = (decay,)."""
    return h[0] ** np.maximum.outer(k, k)


def dc(k: Any, h: Any) -> Any:
    """Diagonal and correlated; h = (decay, correlation of neighbours)."""
    return h[0] ** (np.add.outer(k, k) / 2.0) * h[1] ** np.abs(np.subtract.outer(k, k))


def ss(k: Any, h: Any) -> Any:
    """Stable spline of second order; h = (decay,)."""
    larger = np.maximum.outer(k, k)
    return h[0] ** (np.add.outer(k, k) + larger) / 2.0 - h[0] ** (3 * larger) / 6.0


class KernelShape(NamedTuple):
    """A kernel of size one, and names, bounds and starts of its hyperparameters."""

    kernel: Kernel
    names: tuple[str, ...]
    bounds: tuple[tuple[float, float], ...]
    starts: tuple[tuple[float, ...], ...]


KERNELS: Mapping[str, KernelShape] = MappingProxyType(
    {
        "ridge": KernelShape(ridge, (), (), ((),)),
        "tc": KernelShape(tc, ("decay",), (DECAY,), tuple((one,) for one in STARTS)),
        "dc": KernelShape(dc, ("decay", "correlation"), (DECAY, SMOOTH), tuple((one, 0.9) for one in STARTS)),
        "ss": KernelShape(ss, ("decay",), (DECAY,), tuple((one,) for one in STARTS)),
    }
)


def tuned(given: TriangularRows, nu: int, lags: NDArray[np.signedinteger], name: str) -> Tuned:
    """The hyperparameters of each input and the noise that make the data likeliest, from the best of a few starts."""
    problem = _Problem(given, nu, lags, KERNELS[name])
    best = min(
        (
            optimize.minimize(problem.cost, start, jac=True, method="L-BFGS-B", bounds=problem.bounds)
            for start in problem.starts()
        ),
        key=lambda one: float(one.fun),
    )
    return problem.tuned(best.x)


class _Problem:
    """-2 log p(y | h) = s'S^-1 s + log det S + rest/v + (N - m) log v + N log 2 pi, S = R P R' + v I."""

    def __init__(self, given: TriangularRows, nu: int, lags: NDArray[np.signedinteger], shape: KernelShape) -> None:
        self.given, self.nu, self.shape = given, nu, shape
        self.k = np.asarray(lags, dtype=float) - lags[0] + 1.0
        self.power = max((given.rest + float(given.s @ given.s)) / max(given.rows, 1), np.finfo(float).tiny)
        gain = np.sum(given.r**2) / max(given.rows, 1)
        # the size that explains the whole output, as if all inputs shared in it alike
        self.size = self.power / max(gain, np.finfo(float).tiny) * len(self.k)
        one = (SIZE, *shape.bounds)
        self.bounds = [*(one * nu), (np.log(NOISE), 1.0)]

    def starts(self) -> list[Array]:
        """Each input's (log size, shape), then the log noise, both beside what the data show."""
        left = max(self.given.rest / max(self.given.rows - len(self.given.s), 1) / self.power, 1e-8)
        noise = min(np.log(left), 0.0) if self.given.rows > len(self.given.s) else np.log(0.1)
        return [np.array([*((0.0, *one) * self.nu), noise]) for one in self.shape.starts]

    def cost(self, x: Array) -> tuple[float, Array]:
        """-2 log likelihood without its constant, and the gradient."""
        r, s, size = self.given.r, self.given.s, len(self.k)
        v = self.power * np.exp(x[-1])
        parts = [self._prior(one) for one in self._each(x)]
        covariance = v * np.eye(len(s))
        for i, (p, _) in enumerate(parts):
            own = r[:, i * size : (i + 1) * size]
            covariance += own @ p @ own.T
        factor = linalg.cho_factor(covariance, lower=True)
        inverse = linalg.cho_solve(factor, np.eye(len(s)))
        z, spare = inverse @ s, self.given.rows - len(s)
        value = s @ z + 2.0 * np.sum(np.log(np.diag(factor[0]))) + self.given.rest / v + spare * np.log(v)
        # d cost / dS = S^-1 - z z'
        slope = inverse - np.outer(z, z)
        gradient = []
        for i, (_, changes) in enumerate(parts):
            own = r[:, i * size : (i + 1) * size]
            towards = own.T @ slope @ own
            gradient += [float(np.sum(towards * change)) for change in changes]
        by_noise = v * (np.trace(slope) - self.given.rest / v**2 + spare / v)
        return float(value), np.array([*gradient, float(by_noise)])

    def tuned(self, x: Array) -> Tuned:
        """The prior at x."""
        blocks = [self._prior(one)[0] for one in self._each(x)]
        names = [
            f"{name}{i + 1 if self.nu > 1 else ''}" for i in range(self.nu) for name in ("size", *self.shape.names)
        ]
        values = x[:-1].copy()
        values[:: 1 + len(self.shape.names)] = self.size * np.exp(values[:: 1 + len(self.shape.names)])
        likelihood = -0.5 * (self.cost(x)[0] + self.given.rows * np.log(2.0 * np.pi))
        return Tuned(
            linalg.block_diag(*blocks), float(self.power * np.exp(x[-1])),
            dict(zip(names, values.tolist(), strict=True)), float(likelihood),
        )  # fmt: skip

    def _each(self, x: Array) -> Array:
        return x[:-1].reshape(self.nu, -1)

    def _prior(self, h: Array) -> tuple[Array, list[Array]]:
        """P of one input, and its derivatives by log size and shape."""
        scale = self.size * np.exp(h[0])
        p = scale * np.asarray(self.shape.kernel(self.k, h[1:]), dtype=float)
        changes = [p]
        for i in range(1, len(h)):
            moved = h[1:].astype(complex)
            moved[i - 1] += 1j * COMPLEX_STEP
            changes.append(scale * np.imag(self.shape.kernel(self.k, moved)) / COMPLEX_STEP)
        return p, changes
