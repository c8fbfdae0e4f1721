"""The likelihood of the levels of the noise in readings and of the disturbances, and its slope.

The likelihood's gradient comes from one pass forward and one back. With r, N the adjoint of the filter and of its
covariance (Koopman and Shephard, Exact score for time series models in state space form, 1992):

    r_k-1 = L' r_k + C' S^-1 e,  N_k-1 = L' N_k L + C' S^-1 C,  L = phi (I - K C)
    by Q_k: (r_k r_k' - N_k)/2     by phi_k: r_k x_k' - N_k L P_k     by R_k: (u u' - D)/2

with the smoothed x_k, u = S^-1 e - (phi K)' r_k and D = S^-1 + (phi K)' N_k phi K.

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.batch_calls import Recursion, flat
from hoopd.plants.likelihood.kalman_filter import Gains, LinearReference, Noise, gains, predicted

Array = NDArray[np.float64]

# A part of the data: blocks of so many nodes, every so manyth of them.
BLOCK, EVERY = 150, 5


class Criterion:
    """The likelihood of the noise levels, given one residual f (n-1, nz), eps (n, nc)."""

    def __init__(self, model: LinearReference, f: Array, eps: Array) -> None:
        self.model, self._f = model, f[:, :, None]
        self._eps = np.where(model.seen, eps, 0.0)[:, :, None]

    def parts(self) -> list[Criterion]:
        """Of some blocks of the nodes."""
        m, n = self.model, len(self.model.c)
        found = []
        for first in range(0, n - min(BLOCK, n) + 1, BLOCK * EVERY):
            nodes, steps = slice(first, first + BLOCK), slice(first, first + BLOCK - 1)
            model = LinearReference(
                m.a[steps], m.w[steps], m.c[nodes], m.h[steps], m.seen[nodes], m.nx, m.scatter[nodes], m.lagged
            )
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


def _adjoint(model: LinearReference, found: Gains, e: Array) -> tuple[Array, Array]:
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


def _by_disturbance(
    model: LinearReference, found: Gains, noise: Noise, d: Array, r: Array, n: Array
) -> tuple[Array, Array]:
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
