"""Likelihood of an innovation form through gaps, and from starts that nobody knows.

    x+ = A x + B u + K e,   y = C x + D u + e,   cov e = R;   Abar = A - K C
The errors are linear in the outputs that are missing, z, and in the state at the start: e = e0 + M z + X x0. Both are
free, and eliminated by least squares; the density of what was measured is then
    -2 log L = n log |R| + log |W'W| + min |R^-1/2 e|^2,   W = R^-1/2 [M X]
which is the Kalman filter's with a wide prior on the start, without its recursion: many short experiments do not bias
the rest (de Jong, Ann. Statist. 19, 1991), nor do gaps (Gomez, Maravall and Pena, J. Econometrics 88, 1999).
With Q = sum (Abar')^l C' R^-1 C Abar^l, s_j = Abar^(n-1-t_j) K_j what output j at t_j leaves behind at the end n:
    M_j'M_k = K_j' (Abar')^tau Q K_k - (C Abar^(tau-1) K_j)' R^-1_k - s_j' Q s_k,   tau = t_k - t_j > 0
    M_j'M_j = R^-1_jj + K_j' Q K_j - s_j' Q s_j,   X'X = Q - (Abar^n)' Q Abar^n
    M_j'X = K_j' Q Abar^(t_j+1) - (R^-1_j)' C Abar^t_j - s_j' Q Abar^n
and M'M has a band as wide as Abar forgets.

Rules of this file: NaN in an output is missing; nothing is searched for here; the predictor is stable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.models import Innovations
from hoopd.ident.statespace.linear import states

Array = NDArray[np.float64]

# Abar^l relative to 1 below which what happened l samples before is forgotten.
FORGOTTEN = 1e-9
# Of the information on a start: a stretch that is shorter than its state tells this much less, not nothing.
LEAST_INFORMATION = 1e-10


@dataclass(frozen=True)
class MeasuredStretch:
    """Outputs y (ny, n), gaps bridged, inputs u (nu, n), and which outputs are missing: channel and time, by time."""

    y: Array
    u: Array
    channel: NDArray[np.intp]
    time: NDArray[np.intp]

    @property
    def count(self) -> int:
        """Outputs that were measured."""
        return self.y.size - len(self.time)


def stretch(y: Array, u: Array) -> MeasuredStretch:
    """Of y (n, ny) with NaN where an output is missing and u (n, nu), from the first sample measured to the last."""
    known = np.isfinite(y)
    rows = np.flatnonzero(known.any(axis=1))
    y, u, known = (one[rows[0] : rows[-1] + 1] for one in (y, u, known))
    bridged, at = y.copy(), np.arange(len(y))
    for i in range(y.shape[1]):
        seen = known[:, i]
        bridged[:, i] = np.interp(at, at[seen], y[seen, i]) if seen.any() else 0.0
    time, channel = np.nonzero(np.logical_not(known))
    return MeasuredStretch(np.ascontiguousarray(bridged.T), np.ascontiguousarray(u.T), channel, time)


@dataclass(frozen=True)
class LikelihoodErrors:
    """Errors R^-1/2 e by stretch (ny, n), starts and missing outputs eliminated, and n log |R| + log |W'W| of all."""

    errors: list[Array]
    deviance: float

    def scaled(self, free: int) -> tuple[Array, float]:
        """Errors whose squares are least where the likelihood is largest, the scale of R free too, and their factor.

        -2 log L = N log(min |e|^2) + d, N the outputs measured less the free starts: so |e exp(d/(2 N))|^2 is least.
        """
        factor = float(np.exp(0.5 * self.deviance / max(free, 1)))
        return factor * np.concatenate([one.ravel() for one in self.errors]), factor


def likelihood_errors(
    model: Innovations, data: Sequence[MeasuredStretch], *, free_start: bool = True
) -> LikelihoodErrors:
    """Errors of a model over stretches, each from a free start or from rest; the predictor must be stable."""
    known = _Predictor.of(model, max(one.y.shape[1] for one in data))
    errors: list[Array] = [np.zeros((0, 0))] * len(data)
    deviance = 0.0
    for places in _alike(data):
        if len(data[places[0]].time):
            found, level = _with_gaps(known, data[places[0]], free_start)
            errors[places[0]] = found
        else:
            several, level = _whole(known, [data[i] for i in places], free_start)
            for i, one in zip(places, several, strict=True):
                errors[i] = one
        deviance += level
    return LikelihoodErrors(errors, deviance + known.level * sum(one.y.shape[1] for one in data))


def _alike(data: Sequence[MeasuredStretch]) -> list[list[int]]:
    """Places of whole stretches of one length together; one with gaps stands alone."""
    groups: dict[int, list[int]] = {}
    out = []
    for i, one in enumerate(data):
        if len(one.time):
            out.append([i])
        else:
            groups.setdefault(one.y.shape[1], []).append(i)
    return [*out, *groups.values()]


@dataclass(frozen=True)
class _Predictor:
    """The model, R^-1/2 and log |R|, Abar, its powers from 0 until it has forgotten, and Q."""

    model: Innovations
    root: Array
    level: float
    inner: Array
    powers: Array
    q: Array

    @classmethod
    def of(cls, model: Innovations, longest: int) -> _Predictor:
        r = np.eye(model.ny) if model.r is None else model.r
        root = np.linalg.inv(np.linalg.cholesky(r))
        inner = model.a - model.k @ model.c
        seen = root @ model.c
        q = linalg.solve_discrete_lyapunov(inner.T, seen.T @ seen) if model.nx else np.zeros((0, 0))
        return cls(model, root, float(np.linalg.slogdet(r)[1]), inner, _powers(inner, longest), np.asarray(q))

    def power(self, exponent: int) -> Array:
        """Abar^exponent."""
        if exponent < len(self.powers):
            return np.asarray(self.powers[exponent])
        return np.zeros_like(self.inner)

    def errors(self, y: Array, u: Array, x0: Array | None = None) -> Array:
        """R^-1/2 e (ny, ..., n) of outputs (ny, ..., n) and inputs (nu, ..., n) from x0 (nx, ...) or rest."""
        m = self.model
        driven = np.tensordot(m.b - m.k @ m.d, u, 1) + np.tensordot(m.k, y, 1)
        e = y - np.tensordot(m.c, states(self.inner, driven, x0), 1) - np.tensordot(m.d, u, 1)
        return np.tensordot(self.root, e, 1)

    def answers(self, e: Array) -> Array:
        """M'e for an unknown at every output and time, (ny, n): the errors' filter backwards in time."""
        v = (self.root.T @ e)[:, ::-1]
        x = states(self.inner.T, self.model.c.T @ v)
        return np.asarray((v - self.model.k.T @ x)[:, ::-1])


def _powers(inner: Array, longest: int) -> Array:
    """Abar^0, Abar^1, ... until they are forgotten, or as many as the longest stretch has samples."""
    out, power = [np.eye(len(inner))], np.eye(len(inner))
    while len(out) <= longest:
        power = inner @ power
        out.append(power)
        if np.abs(power).max(initial=0.0) < FORGOTTEN:
            break
    return np.array(out)


def _whole(known: _Predictor, data: Sequence[MeasuredStretch], free_start: bool) -> tuple[list[Array], float]:
    """Whole stretches of one length: their starts share their information."""
    y, u = (np.stack([getattr(one, x) for one in data], axis=1) for x in ("y", "u"))
    e = known.errors(y, u)
    if not free_start or not known.model.nx:
        return [e[:, i] for i in range(len(data))], 0.0
    n = y.shape[-1]
    x = _responses(known, n)
    information = _information(known, n)
    x0 = np.linalg.solve(information, np.tensordot(x, e, ([0, 2], [0, 2])))
    e = e - np.tensordot(x, x0, ([1], [0])).transpose(0, 2, 1)
    return [e[:, i] for i in range(len(data))], len(data) * float(np.linalg.slogdet(information)[1])


def _responses(known: _Predictor, n: int) -> Array:
    """X (ny, nx, n) of the errors to a start: -R^-1/2 C Abar^t."""
    out = np.zeros((known.model.ny, known.model.nx, n))
    length = min(n, len(known.powers))
    out[:, :, :length] = -np.tensordot(known.root @ known.model.c, known.powers[:length], ([1], [1])).transpose(0, 2, 1)
    return out


def _information(known: _Predictor, n: int) -> Array:
    """X'X, lifted a little."""
    last = known.power(n)
    found = known.q - last.T @ known.q @ last
    lift = LEAST_INFORMATION * np.trace(found) / max(len(found), 1) + 1e-300
    return np.asarray(found + lift * np.eye(len(found)))


def _with_gaps(known: _Predictor, data: MeasuredStretch, free_start: bool) -> tuple[Array, float]:
    """A stretch with missing outputs."""
    e0 = known.errors(data.y, data.u)
    n, nx = data.y.shape[1], known.model.nx * free_start
    right = known.answers(e0)[data.channel, data.time]
    low = linalg.cholesky_banded(_band(known, data, n), lower=True)
    deviance = 2.0 * float(np.log(low[0]).sum())
    x0 = None
    if nx:
        x = _responses(known, n)
        across = _across(known, data, n)
        inside = linalg.cho_solve_banded((low, True), np.column_stack([across, right]))
        information = _information(known, n) - across.T @ inside[:, :nx]
        start = np.tensordot(x, e0, ([0, 2], [0, 1])) - across.T @ inside[:, nx]
        x0 = -np.linalg.solve(information, start)
        z = -(inside[:, nx] + inside[:, :nx] @ x0)
        deviance += float(np.linalg.slogdet(information)[1])
    else:
        z = -linalg.cho_solve_banded((low, True), right)
    y = data.y.copy()
    y[data.channel, data.time] += z
    return known.errors(y, data.u, x0), deviance


def _band(known: _Predictor, data: MeasuredStretch, n: int) -> Array:
    """M'M in LAPACK's lower band storage."""
    precision = known.root.T @ known.root
    k, t, a = known.model.k, data.time, data.channel
    reach = len(known.powers)
    width = int((np.searchsorted(t, t + reach) - np.arange(len(t))).max())
    # what an output leaves behind at the end of the stretch
    left = np.zeros((len(t), known.model.nx))
    near = n - 1 - t < reach
    left[near] = np.einsum("jab,bj->ja", known.powers[n - 1 - t[near]], k[:, a[near]])
    ahead = left @ known.q
    moments = _moments(known, precision)
    band = np.zeros((width, len(t)))
    for i in range(width):
        j = np.arange(len(t) - i)
        tau = t[j + i] - t[j]
        inside = tau < len(moments)
        band[i, j[inside]] = moments[tau[inside], a[j[inside]], a[j[inside] + i]]
        band[i, j] -= np.einsum("ja,ja->j", ahead[j], left[j + i])
    return band


def _moments(known: _Predictor, precision: Array) -> Array:
    """M_j'M_k by tau (reach, ny, ny) far from the end."""
    k, c = known.model.k, known.model.c
    powers = known.powers
    # (Abar^tau K)' Q K less (C Abar^(tau-1) K)' R^-1
    out = np.einsum("tab,bj,ac->tjc", powers, k, known.q @ k, optimize=True)
    out[0] += precision
    out[1:] -= np.einsum("tab,bj,ac->tjc", powers[:-1], k, c.T @ precision, optimize=True)
    return np.asarray(out)


def _across(known: _Predictor, data: MeasuredStretch, n: int) -> Array:
    """M'X (gaps, nx)."""
    precision = known.root.T @ known.root
    k, c, t, a = known.model.k, known.model.c, data.time, data.channel
    out = np.zeros((len(t), known.model.nx))
    near = t + 1 < len(known.powers)
    seen = known.powers[t[near]]
    first = (k.T @ known.q @ known.inner - precision @ c)[a[near]]
    out[near] = np.einsum("ja,jab->jb", first, seen)
    last = known.power(n)
    if last.any():
        late = np.stack([known.power(int(n - 1 - one)) @ k[:, j] for one, j in zip(t, a, strict=True)])
        out -= late @ known.q @ last
    return out
