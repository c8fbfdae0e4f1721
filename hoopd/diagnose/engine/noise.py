"""Levels of the noise in readings and of the disturbances: a first guess, and those of highest likelihood.

The likelihood's gradient comes from one pass forward and one back. With r, N the adjoint of the filter and of its
covariance (Koopman and Shephard, Exact score for time series models in state space form, 1992):

    r_k-1 = L' r_k + C' S^-1 e,  N_k-1 = L' N_k L + C' S^-1 C,  L = phi (I - K C)
    by Q_k: (r_k r_k' - N_k)/2     by phi_k: r_k x_k' - N_k L P_k     by R_k: (u u' - D)/2

with the smoothed x_k, u = S^-1 e - (phi K)' r_k and D = S^-1 + (phi K)' N_k phi K.

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.engine.calls import Recursion, flat
from hoopd.diagnose.engine.filtering import Gains, Linear, Noise, gains, predicted
from hoopd.diagnose.engine.track import Track

Array = NDArray[np.float64]

# Noise levels are searched within these factors of their first guess; a disturbance slower than a second is physics.
FORCE_FACTOR, READING_FACTOR = 300.0, (0.4, 30.0)
TIMES_S = (0.03, 1.0)
# The search ends when a step gains less than this, in nats: what a fit compares is some nats.
LAST_GAIN = 0.003
MOST_STEPS, MOST_HALVINGS = 40, 8
# No level changes by more than this factor (its logarithm) in one step.
LONGEST_STEP = 2.0
DIFFERENCE, LEAST_CURVATURE = 1e-4, 1.0
# The search comes near on a part of the data: blocks of so many nodes, every so manyth of them.
BLOCK, EVERY = 150, 5
FIRST_TIME_S = 0.15
# First guess of a disturbance: so many rad/s^2 (m/s^2) on every coordinate.
FIRST_ACCELERATION = 1.0


class Criterion:
    """The likelihood of the noise levels, given one residual f (n-1, nz), eps (n, nc)."""

    def __init__(self, model: Linear, f: Array, eps: Array) -> None:
        self.model, self._f = model, f[:, :, None]
        self._eps = np.where(model.seen, eps, 0.0)[:, :, None]

    def parts(self) -> list[Criterion]:
        """Of some blocks of the nodes."""
        m, n = self.model, len(self.model.c)
        found = []
        for first in range(0, n - min(BLOCK, n) + 1, BLOCK * EVERY):
            nodes, steps = slice(first, first + BLOCK), slice(first, first + BLOCK - 1)
            model = Linear(m.a[steps], m.w[steps], m.c[nodes], m.h[steps], m.seen[nodes], m.nx, m.scatter[nodes])
            found.append(Criterion(model, self._f[steps, :, 0], self._eps[nodes, :, 0]))
        return found

    def value(self, noise: Noise) -> float:
        """Negative log-likelihood without its constant."""
        found = gains(self.model, noise)
        return self._value(found, predicted(self.model, found, self._f, self._eps)[1])

    def gradient(self, noise: Noise) -> tuple[float, Array]:
        """The value, and its derivatives by the logarithms of force, time_s and reading, one after the other."""
        found = gains(self.model, noise)
        d, e = predicted(self.model, found, self._f, self._eps)
        r, n = _adjoint(self.model, found, e)
        by_force, by_time = _by_disturbance(self.model, found, noise, d, r, n)
        by_reading = _by_reading(found, self.model.scatter * noise.reading, e, r, n)
        return self._value(found, e), -np.concatenate([by_force, by_time, by_reading])

    @staticmethod
    def _value(found: Gains, e: Array) -> float:
        return (float(np.sum((found.whiten @ e) ** 2)) + found.logdet) / 2


def _adjoint(model: Linear, found: Gains, e: Array) -> tuple[Array, Array]:
    """r (n+1, size) and N (n+1, size, size) before every node, and after the last one: zero."""
    n, size, nz = len(e), model.size, model.c.shape[2]
    lower, seen = np.tril_indices(size), np.tril_indices(nz)
    whitest = found.whiten @ model.c
    closed = np.concatenate([np.zeros((1, size, size)), found.closed[::-1]])
    more = (whitest.transpose(0, 2, 1) @ whitest)[::-1, seen[0], seen[1]]
    push = (whitest.transpose(0, 2, 1) @ (found.whiten @ e))[::-1, :, 0]
    state = _adjoint_step(size, nz)(np.zeros(len(lower[0]) + size), flat(closed), more, push)[0][::-1, :, 0]
    full = np.zeros((n + 1, size, size))
    full[:-1, lower[0], lower[1]] = full[:-1, lower[1], lower[0]] = state[:, : len(lower[0])]
    return np.concatenate([state[:, len(lower[0]) :], np.zeros((1, size))]), full


def _by_disturbance(model: Linear, found: Gains, noise: Noise, d: Array, r: Array, n: Array) -> tuple[Array, Array]:
    """Of the log-likelihood by log force and log time (nq,): by what each step adds, and by what stays of it."""
    own = slice(model.c.shape[2], None)
    decay = np.exp(-model.h[:, None] / noise.time_s)
    by_variance = (r[:, own] ** 2 - np.einsum("kii->ki", n[:, own, own])) / 2
    smooth = d[:-1, :, 0] + np.einsum("kij,kj->ki", found.before[:-1], r[:-2])
    crossed = np.einsum("kij,kji->ki", n[1:-1, own] @ found.closed, found.before[:-1, :, own])
    by_decay = r[1:-1, own] * smooth[:, own] - crossed
    variance = noise.force**2
    # the first disturbance has the variance s^2, and each step adds s^2 (1 - decay^2)
    by_force = 2 * variance * (by_variance[0] + np.sum(by_variance[1:-1] * (1 - decay**2), axis=0))
    # d decay / d log T = decay h/T
    slope = decay * model.h[:, None] / noise.time_s
    return by_force, np.sum((by_decay - 2 * variance * decay * by_variance[1:-1]) * slope, axis=0)


def _by_reading(found: Gains, level: Array, e: Array, r: Array, n: Array) -> Array:
    """Of the log-likelihood by the logarithms of the readings' levels (nc,); level (n, nc): of every reading."""
    lift = np.zeros_like(found.gain)
    lift[:-1] = found.phi @ found.gain[:-1]
    back = found.whiten.transpose(0, 2, 1)
    u = (back @ (found.whiten @ e))[:, :, 0] - np.einsum("kic,ki->kc", lift, r[1:])
    d = np.einsum("kic,kic->kc", found.whiten, found.whiten) + np.einsum("kic,kic->kc", lift, n[1:] @ lift)
    return np.asarray(np.sum(level**2 * (u**2 - d), axis=0))


@lru_cache(maxsize=16)
def _adjoint_step(size: int, nz: int) -> Recursion:
    """(lower half of N, r), closed, lower half of C' S^-1 C, C' S^-1 e, from node to node backwards."""
    count, inner = size * (size + 1) // 2, nz * (nz + 1) // 2
    state, closed = ca.SX.sym("state", count + size), ca.SX.sym("closed", size, size)
    more, push = ca.SX.sym("more", inner), ca.SX.sym("push", nz)
    n, r = ca.densify(_symmetric(state[:count], size)), state[count:]
    added = ca.diagcat(_symmetric(more, nz), ca.SX(size - nz, size - nz))
    n = ca.mtimes(ca.mtimes(closed.T, n), closed) + added
    r = ca.mtimes(closed.T, r) + ca.vertcat(push, ca.SX(size - nz, 1))
    order = [n[i, j] for i in range(size) for j in range(i + 1)]
    step = ca.Function("adjoint", [state, closed, more, push], [ca.densify(ca.vertcat(*order, r))], {"cse": True})
    return Recursion(step)


def _symmetric(half: ca.SX, size: int) -> ca.SX:
    """From the lower half, row by row."""
    return ca.triu2symm(ca.SX(ca.Sparsity.upper(size), half))


# ---------------------------------------------------------------------------------------------- search


def tuned(criteria: Sequence[Criterion], start: Noise, first: Noise, *, near: bool = False) -> Noise:
    """Levels of highest likelihood for all criteria together, from `start`, within the bounds about a first guess.

    `near`: the start is close to them already; otherwise a part of the data brings it there.
    """
    nq = len(start.force)
    low = np.log([*first.force / FORCE_FACTOR, *[TIMES_S[0]] * nq, *first.reading * READING_FACTOR[0]])
    high = np.log([*first.force * FORCE_FACTOR, *[TIMES_S[1]] * nq, *first.reading * READING_FACTOR[1]])
    parts = [part for one in criteria for part in one.parts()]
    share = sum(len(one.model.c) for one in parts) / sum(len(one.model.c) for one in criteria)
    begin = np.clip(np.log(np.concatenate(start)), low, high)
    curvature = _curvature(parts, begin)
    if not near:
        begin, curvature = _lowest(parts, begin, curvature, (low, high))
        curvature = _curvature(parts, begin)
    best, _ = _lowest(criteria, begin, curvature / share, (low, high))
    return _levels(best, nq)


def _levels(v: Array, nq: int) -> Noise:
    levels = np.exp(v)
    return Noise(levels[:nq], levels[nq : 2 * nq], levels[2 * nq :])


def _total(criteria: Sequence[Criterion], v: Array) -> tuple[float, Array]:
    """Value and gradient at the logarithms v of all levels."""
    each = [one.gradient(_levels(v, one.model.w.shape[2])) for one in criteria]
    value = sum(value for value, _ in each)
    return (value if np.isfinite(value) else np.inf), np.sum([slope for _, slope in each], axis=0)


def _curvature(criteria: Sequence[Criterion], v: Array) -> Array:
    """Second derivatives by differences of the gradient, made positive."""
    here = _total(criteria, v)[1]
    rows = np.array([_total(criteria, v + step)[1] - here for step in DIFFERENCE * np.eye(len(v))]) / DIFFERENCE
    size, axes = np.linalg.eigh((rows + rows.T) / 2)
    size = np.maximum(np.abs(size), LEAST_CURVATURE)
    return np.asarray(axes * size @ axes.T)


def _lowest(
    criteria: Sequence[Criterion], v: Array, curvature: Array, bounds: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Quasi-Newton (BFGS) steps within bounds: where the total is lowest, and its curvature there."""
    value, slope = _total(criteria, v)
    for _ in range(MOST_STEPS):
        step = _step(v, slope, curvature, bounds)
        if -slope @ step / 2 < LAST_GAIN:
            break
        for _ in range(MOST_HALVINGS):
            new_value, new_slope = _total(criteria, v + step)
            if new_value < value:
                break
            step = step / 2
        else:
            break
        curvature = _updated(curvature, step, new_slope - slope)
        v, value, slope = v + step, new_value, new_slope
    return v, curvature


def _step(v: Array, slope: Array, curvature: Array, bounds: tuple[Array, Array]) -> Array:
    """Newton's step of what is not held by a bound, no longer than LONGEST_STEP."""
    low, high = bounds
    free = ~(((v <= low) & (slope > 0)) | ((v >= high) & (slope < 0)))
    step = np.zeros_like(v)
    step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
    step *= min(1.0, LONGEST_STEP / max(float(np.max(np.abs(step))), 1e-300))
    return np.asarray(np.clip(v + step, low, high) - v)


def _updated(b: Array, s: Array, y: Array) -> Array:
    """BFGS; b stays as it is where the curvature along the step is not positive."""
    bs = b @ s
    if s @ y <= 1e-3 * (s @ bs):
        return b
    return np.asarray(b - np.outer(bs, bs) / (s @ bs) + np.outer(y, y) / (s @ y))


# ---------------------------------------------------------------------------------------------- first guess


def first_noise(tracks: Sequence[Track], values: Mapping[str, float]) -> dict[str, Noise]:
    """By recording: readings from their roughness, disturbances of a usual size."""
    found = {}
    for track in tracks:
        if track.stretch.recording not in found:
            same = [t.stretch for t in tracks if t.stretch.recording == track.stretch.recording]
            reading = np.array(
                [
                    roughness([s.y[:, i] for s in same], [s.scatter[:, i] for s in same])
                    for i in range(same[0].y.shape[1])
                ]
            )
            force = FIRST_ACCELERATION / track.mobility(values)
            found[track.stretch.recording] = Noise(force, np.full(len(force), FIRST_TIME_S), reading)
    return found


def roughness(parts: Sequence[Array], scatter: Sequence[Array] | None = None) -> float:
    """Standard deviation of a reading's noise without a model: fourth differences, whose variance is 70 sigma^2.

    scatter: of every reading, the noise over the level that is asked for; 1 without it.

    Not below the spread 1/sqrt(12) of the smallest step between two values, which is a sensor's count.
    """
    seen = [part[np.isfinite(part)] for part in parts]
    over = [np.ones(len(part)) for part in parts] if scatter is None else scatter
    wide = [one[np.isfinite(part)] for part, one in zip(parts, over, strict=True)]
    each = [np.diff(part, 4) / one[2:-2] for part, one in zip(seen, wide, strict=True) if len(part) > 4]
    fourth = np.concatenate(each or [np.zeros(1)])
    steps = np.concatenate([np.abs(np.diff(part)) for part in seen if len(part) > 1] or [np.zeros(1)])
    count = float(np.min(steps[steps > 1e-9], initial=np.inf))
    spread = float(1.4826 * np.median(np.abs(fourth)) / np.sqrt(70.0))
    least = count / np.sqrt(12.0) if np.isfinite(count) and np.mean(steps < 1e-9) > 0.02 else 1e-9
    return max(spread, least, 1e-9)
