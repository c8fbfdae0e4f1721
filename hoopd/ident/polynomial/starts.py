"""First coefficients for the search: linear steps that need no guess.

A long ARX model gives the innovations and the output without noise; then every polynomial is a linear regression
(Hannan & Rissanen, Biometrika 69, 1982; Steiglitz & McBride, IEEE Trans. Automat. Control 10, 1965; Zhu,
Multivariable System Identification, 2001, chapter 6).

Rules of this file: complete stretches in, coefficients out; nothing is random; C and F come out stable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hoopd.ident.damped_least_squares import solved
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.polynomial.gaussnewton import PolynomialExperiment, stable
from hoopd.ident.polynomial.stable import radius, reflected
from hoopd.ident.polynomial.structure import Structure

Array = NDArray[np.float64]

# Lags of the long model; it takes no more than a tenth of the samples.
LONG = 20
SHARE = 10
# Steiglitz-McBride has settled after so many passes where it settles at all.
PASSES = 4
# Passes of generalised least squares.
GLS_PASSES = 5


@dataclass(frozen=True)
class LongModel:
    """Innovations e and noise-free output s by input, of each stretch; the largest pole before it was made stable."""

    e: list[Array]
    s: list[list[Array]]
    radius: float


def starts(own: Structure, each: Sequence[PolynomialExperiment], whole: LongModel | None = None) -> list[Array]:
    """Candidates, the most likely one first."""
    whole = long_model(own, each) if whole is None else whole
    found = []
    if own.na or not own.nu:
        found.append(_from_innovations(own, each, whole))
    if own.nu and (any(own.nf) or own.nd or not found):
        found.append(_from_simulation(own, each, whole))
    if own.na and own.nd:
        found.append(_generalised(own, each))
    return [stable(own, one) for one in found]


def long_model(own: Structure, each: Sequence[PolynomialExperiment], lags: int | None = None) -> LongModel:
    """A long ARX model of complete stretches; a long FIR model where outputs are missing."""
    shortest = max(len(one.y) for one in each)
    order = max([own.na + own.nd, *own.nb, *own.nf, own.nc, 1]) + 1
    m = lags or max(min(LONG, shortest // (SHARE * (1 + own.nu))), order)
    holes = any(one.seen is not None for one in each)
    ranges = [range(d, d + (3 * m if holes else m)) for d in own.delay]
    if holes:
        x = _masked_fir(each, ranges)
        a, b = np.ones(1), _split(x, ranges)
    else:
        x = _regress([(one.y, [(-one.y, range(1, m + 1)), *zip(one.u, ranges, strict=True)]) for one in each])
        a, b = np.concatenate([[1.0], x[:m]]), _split(x[m:], ranges)
    steady = reflected(a)
    clean = [[_filtered(bi, steady, ui) for bi, ui in zip(b, one.u, strict=True)] for one in each]
    return LongModel([_innovations(a, b, one) for one in each], clean, radius(a))


def _from_innovations(own: Structure, each: Sequence[PolynomialExperiment], whole: LongModel) -> Array:
    """A, B, C by regression on the innovations; D from what is left; F = 1."""
    equations = []
    for one, e in zip(each, whole.e, strict=True):
        parts = [(-one.y, range(1, own.na + 1)), *zip(one.u, own.lags, strict=True), (e, range(1, own.nc + 1))]
        equations.append((one.y - e, parts))
    x = _regress(equations)
    n = own.na + sum(own.nb)
    noise = np.zeros(own.nc + own.nd)
    noise[: own.nc] = x[n:]
    if own.nd:
        noise[own.nc :] = _noise(own, [_rest(own, one, x[:n]) for one in each], whole, ar_only=True)
    return np.concatenate([x[:n], noise, np.zeros(sum(own.nf))])


def _from_simulation(own: Structure, each: Sequence[PolynomialExperiment], whole: LongModel) -> Array:
    """Dynamics from the noise-free output, then C and D from what they leave."""
    if own.na and not any(own.nf):
        x = _regress([
            (np.sum(s, axis=0), [(-np.sum(s, axis=0), range(1, own.na + 1)), *zip(one.u, own.lags, strict=True)])
            for one, s in zip(each, whole.s, strict=True)
        ])  # fmt: skip
        rest, f = [_rest(own, one, x) for one in each], []
    else:
        pairs = [_fraction(own, i, each, whole) for i in range(own.nu)]
        x, f = np.concatenate([np.zeros(own.na), *(b for b, _ in pairs)]), [one for _, one in pairs]
        rest = [_output_error(own, one, pairs) for one in each]
    return np.concatenate([x, _noise(own, rest, whole), *f])


def _fraction(own: Structure, i: int, each: Sequence[PolynomialExperiment], whole: LongModel) -> tuple[Array, Array]:
    """B_i and F_i by Steiglitz-McBride passes on the noise-free part of input i."""
    n, lags = own.nf[i], own.lags[i]
    f, best, least = np.ones(1), (np.zeros(len(lags)), np.zeros(n)), np.inf
    for _ in range(PASSES if n else 1):
        equations = []
        for one, s in zip(each, whole.s, strict=True):
            y, u = _filtered(np.ones(1), f, s[i]), _filtered(np.ones(1), f, one.u[i])
            equations.append((y, [(-y, range(1, n + 1)), (u, lags)]))
        x = _regress(equations)
        f = reflected(np.concatenate([[1.0], x[:n]]))
        b = np.concatenate([np.zeros(lags.start), x[n:]])
        left = sum(
            float(np.square(s[i] - _filtered(b, f, one.u[i])).sum()) for one, s in zip(each, whole.s, strict=True)
        )
        if left < least:
            best, least = (x[n:], f[1:]), left
    return best


def _generalised(own: Structure, each: Sequence[PolynomialExperiment]) -> Array:
    """A, B and D by turns: regression of filtered data, then D from the residual (Soderstrom, Automatica 10, 1974)."""
    d = np.ones(1)
    x, tail = np.zeros(own.na + sum(own.nb)), np.zeros(own.nd)
    for _ in range(GLS_PASSES):
        equations = []
        for one in each:
            y, u = _times(d, one.y), [_times(d, ui) for ui in one.u]
            equations.append((y, [(-y, range(1, own.na + 1)), *zip(u, own.lags, strict=True)]))
        x = _regress(equations)
        tail = _regress([(v, [(-v, range(1, own.nd + 1))]) for v in (_rest(own, one, x) for one in each)])
        d = np.concatenate([[1.0], tail])
    return np.concatenate([x, np.zeros(own.nc), tail, np.zeros(sum(own.nf))])


def _noise(own: Structure, rest: Sequence[Array], whole: LongModel, ar_only: bool = False) -> Array:
    """C and D of D v = C e by regression on the innovations."""
    nc = 0 if ar_only else own.nc
    if nc + own.nd == 0:
        return np.zeros(0)
    x = _regress([
        (v - e if nc else v, [(-v, range(1, own.nd + 1)), (e, range(1, nc + 1))])
        for v, e in zip(rest, whole.e, strict=True)
    ])  # fmt: skip
    return x if ar_only else np.concatenate([x[own.nd :], x[: own.nd]])


def _rest(own: Structure, one: PolynomialExperiment, x: Array) -> Array:
    """A y - B u from the coefficients of A and B."""
    out = _times(np.concatenate([[1.0], x[: own.na]]), one.y)
    for b, u in zip(_split(x[own.na :], own.lags), one.u, strict=True):
        out = out - _times(b, u)
    return out


def _output_error(own: Structure, one: PolynomialExperiment, pairs: Sequence[tuple[Array, Array]]) -> Array:
    out = one.y
    for (b, f), u, lag in zip(pairs, one.u, own.lags, strict=True):
        out = out - _filtered(np.concatenate([np.zeros(lag.start), b]), np.concatenate([[1.0], f]), u)
    return out


Equation = tuple[Array, list[tuple[Array, range]]]


def _regress(equations: Sequence[Equation]) -> Array:
    """Least squares of target = sum of lagged signals, over stretches."""
    gram: Array | None = None
    for target, parts in equations:
        used = [(np.ascontiguousarray(signal), lags) for signal, lags in parts if lags]
        first = max((lags[-1] for _, lags in used), default=0)
        if len(target) <= first:
            continue
        own = lagged_gram(
            [np.ascontiguousarray(target), *(s for s, _ in used)], [range(1), *(r for _, r in used)], first
        )
        gram = own if gram is None else gram + own
    if gram is None:
        raise ValueError("too few samples: no stretch is as long as the longest lag")
    return _least(gram[1:, 1:], gram[1:, 0])


def _least(m: Array, right: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(m), 1e-300))
    return solved(m / np.outer(scale, scale), right / scale) / scale


def _masked_fir(each: Sequence[PolynomialExperiment], ranges: Sequence[range]) -> Array:
    rows, targets = [], []
    for one in each:
        seen = np.ones(len(one.y), dtype=bool) if one.seen is None else one.seen > 0.0
        first = max(lag[-1] for lag in ranges)
        t = first + np.flatnonzero(seen[first:])
        rows.append(np.column_stack([u[t - k] for u, lag in zip(one.u, ranges, strict=True) for k in lag]))
        targets.append(one.y[t])
    return np.asarray(np.linalg.lstsq(np.concatenate(rows), np.concatenate(targets), rcond=None)[0])


def _split(x: Array, ranges: Sequence[range]) -> list[Array]:
    """Full numerators from coefficients at these lags."""
    out, start = [], 0
    for lag in ranges:
        out.append(np.concatenate([np.zeros(lag.start), x[start : start + len(lag)]]))
        start += len(lag)
    return out


def _innovations(a: Array, b: Sequence[Array], one: PolynomialExperiment) -> Array:
    """A y - B u, zero where the lags reach before the data."""
    out = _times(a, one.y)
    for bi, u in zip(b, one.u, strict=True):
        out = out - _times(bi, u)
    out[: max([len(a), *(len(bi) for bi in b)]) - 1] = 0.0
    return out


def _filtered(b: Array, a: Array, signal: Array) -> Array:
    if len(b) == 0:
        return np.zeros(len(signal))
    return _times(b, signal) if len(a) == 1 else np.asarray(lfilter(b, a, signal))


def _times(b: Array, signal: Array) -> Array:
    return np.convolve(signal, b)[: len(signal)] if len(b) else np.zeros(len(signal))
