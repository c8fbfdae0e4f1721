"""Prediction errors of a polynomial model, their exact derivatives and the search for the least sum of squares.

    e = D/C [A y - sum_i B_i/F_i u_i] + P/(C F_1 ... F_nu) delta

P is the response of the predictor to its initial state: as many free numbers as the model has states, one set an
experiment (Ljung, System Identification, 1999, 3.2 and 10.3). Every derivative is a lag of a filtered signal.

Rules of this file: no data are changed, nothing is checked; C and F stay stable at every step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hoopd.ident.damped_least_squares import Damping, Ends, NormalEquations, minimise
from hoopd.ident.polynomial.stable import reflected
from hoopd.ident.polynomial.structure import Structure

Array = NDArray[np.float64]

# The search ends when the next step would be so many standard errors long (squared).
SETTLED = 1e-8
# ... or when the errors are the rounding of the output.
EXACT = 1e-28
ITERATIONS = 60
# Steps are undamped until one fails.
DAMPING = Damping(first=0.0, easier=0.1, harder=10.0, again=1e-4, most=1e9)


@dataclass(frozen=True)
class PolynomialExperiment:
    """One experiment: y (n,), u (nu, n), `seen` 1 where y counts (None: everywhere)."""

    y: Array
    u: Array
    seen: Array | None = None

    @property
    def count(self) -> int:
        """Samples that count."""
        return len(self.y) if self.seen is None else int(self.seen.sum())


@dataclass(frozen=True)
class PolynomialErrors:
    """Errors e (n,) of a stretch and what their derivatives are made of."""

    e: Array
    y1: Array  # y / C
    u1: tuple[Array, ...]  # u_i / (C F_i)
    v1: Array  # A y1 - sum B_i u1_i
    free: Array  # 1/(C F_1 ... F_nu) delta
    h: Array  # P times that
    parts: tuple[Array, ...]


@dataclass(frozen=True)
class Optimum:
    """Coefficients x, the initial responses p (experiments, states), squared errors, inverse of J'J for x, steps."""

    x: Array
    p: Array
    total: float
    inverse: Array
    steps: int
    settled: bool


def errors(own: Structure, x: Array, p: Array, stretch: PolynomialExperiment) -> PolynomialErrors:
    """Prediction errors of one stretch from coefficients x and initial response p (states,) (may be empty)."""
    n, parts = len(stretch.y), tuple(own.split(x))
    a, c, d = parts[0], parts[1 + own.nu], parts[2 + own.nu]
    f = parts[3 + own.nu :]
    y1 = _over(c, stretch.y)
    u1 = tuple(_over(np.convolve(c, f[i]), stretch.u[i]) for i in range(own.nu))
    v1 = _times(a, y1)
    for i in range(own.nu):
        v1 = v1 - _times(parts[1 + i], u1[i])
    e = _times(d, v1)
    free = h = np.zeros(0)
    if len(p):
        whole = c
        for one in f:
            whole = np.convolve(whole, one)
        impulse = np.zeros(n)
        impulse[0] = 1.0
        free = _over(whole, impulse)
        h = _times(p, free)
        e = e + h
    if stretch.seen is not None:
        e = e * stretch.seen
    return PolynomialErrors(e, y1, u1, v1, free, h, parts)


def jacobian(own: Structure, found: PolynomialErrors, stretch: PolynomialExperiment, states: int) -> Array:
    """de/d[x, p], (size + states, n): rows are lags of filtered signals."""
    n, nu = len(stretch.y), own.nu
    c, d = found.parts[1 + nu], found.parts[2 + nu]
    out = np.zeros((own.size + states, n))
    row = 0
    for letter, i, powers in own.parts():
        if not powers:
            continue
        if letter == "a":
            signal = _times(d, found.y1)
        elif letter == "b":
            signal = -_times(d, found.u1[i])
        elif letter == "c":
            signal = -_over(c, found.e if stretch.seen is None else _times(d, found.v1) + _or_zero(found.h))
        elif letter == "d":
            signal = found.v1
        else:
            own_part = _times(d, _times(found.parts[1 + i], found.u1[i]))
            signal = _over(found.parts[3 + nu + i], own_part - _or_zero(found.h))
        for k in powers:
            out[row, k:] = signal[: n - k]
            row += 1
    for k in range(states):
        out[row + k, k:] = found.free[: n - k]
    return out if stretch.seen is None else out * stretch.seen


def search(
    own: Structure,
    each: Sequence[PolynomialExperiment],
    start: Array,
    *,
    free_start: bool,
    iterations: int = ITERATIONS,
) -> Optimum:
    """Least squares of the errors of all stretches from a start; C and F are reflected into the circle at each step."""
    states = own.states if free_start else 0
    count = sum(one.count for one in each)
    ends = Ends(
        iterations, gain=0.0, promise=SETTLED / count, exact=EXACT * sum(float(one.y @ one.y) for one in each),
        stuck=SETTLED / count,
    )  # fmt: skip

    def at(x: Array, p: Array) -> _Point:
        found = _all(own, x, p, each)
        total = _total(found)
        return _Point(x, p, found, total if np.isfinite(total) else np.inf)

    def moved(point: _Point, step: Array) -> _Point:
        return at(stable(own, point.x + step[: own.size]), point.p + step[own.size :].reshape(point.p.shape))

    def linearised(point: _Point) -> NormalEquations:
        return NormalEquations(*_normal(own, point.found, each, states))

    first = at(stable(own, start), np.zeros((len(each), states)))
    if not np.isfinite(first.cost):
        return Optimum(first.x, first.p, first.cost, np.full((own.size, own.size), np.nan), 0, False)
    best = minimise(first, linearised, moved, DAMPING, ends)
    hessian, _ = _normal(own, best.point.found, each, states)
    inverse = _inverse(hessian)[: own.size, : own.size]
    return Optimum(best.point.x, best.point.p, best.point.cost, inverse, best.steps, best.converged)


@dataclass(frozen=True)
class _Point:
    """Coefficients, initial responses, errors of all stretches and their squares."""

    x: Array
    p: Array
    found: list[PolynomialErrors]
    cost: float


def stable(own: Structure, x: Array) -> Array:
    """The coefficients with C and every F reflected into the unit circle."""
    if own.nc == 0 and not any(own.nf):
        return x
    out, start = x, 0
    for (letter, _, powers), full in zip(own.parts(), own.split(x), strict=True):
        if letter in "cf" and powers:
            inside = reflected(full)
            if inside is not full:
                out = out.copy() if out is x else out
                out[start : start + len(powers)] = inside[1:]
        start += len(powers)
    return out


def _all(own: Structure, x: Array, p: Array, each: Sequence[PolynomialExperiment]) -> list[PolynomialErrors]:
    with np.errstate(over="ignore", invalid="ignore"):
        return [errors(own, x, one_p, one) for one_p, one in zip(p, each, strict=True)]


def _total(found: Sequence[PolynomialErrors]) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        return sum(float(one.e @ one.e) for one in found)


def _normal(
    own: Structure, found: Sequence[PolynomialErrors], each: Sequence[PolynomialExperiment], states: int
) -> tuple[Array, Array]:
    """J'J and J'e of all stretches; each has its own initial response."""
    m = own.size
    hessian = np.zeros((m + len(each) * states,) * 2)
    slope = np.zeros(len(hessian))
    for i, (one, stretch) in enumerate(zip(found, each, strict=True)):
        j = jacobian(own, one, stretch, states)
        gram, right = j @ j.T, j @ one.e
        at = slice(m + i * states, m + (i + 1) * states)
        hessian[:m, :m] += gram[:m, :m]
        hessian[:m, at], hessian[at, :m], hessian[at, at] = gram[:m, m:], gram[m:, :m], gram[m:, m:]
        slope[:m] += right[:m]
        slope[at] = right[m:]
    return hessian, slope


def _inverse(hessian: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    m = hessian / np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(m, rcond=1e-14, hermitian=True) / np.outer(scale, scale))


def _over(denominator: Array, signal: Array) -> Array:
    return signal if len(denominator) == 1 else np.asarray(lfilter(ONE, denominator, signal))


def _times(numerator: Array, signal: Array) -> Array:
    if len(numerator) == 1:
        return signal if numerator[0] == 1.0 else numerator[0] * signal
    return np.convolve(signal, numerator)[: len(signal)]


def _or_zero(h: Array) -> Array | float:
    return h if len(h) else 0.0


ONE = np.ones(1)
