"""The Kalman filter along a trajectory that whitens what a model leaves, and its smoother.

About a reference trajectory the model is linear in the deviation d = (z - z_ref, w): a disturbance force w on every
coordinate is an Ornstein-Uhlenbeck process, so that

    d_k+1 = [[A, W], [0, exp(-h/T)]] d_k + (f_k, 0) + noise,     e_k = eps_k - C d_k

where f_k is what the one-step map misses of the reference and eps_k what the readings miss. Whatever else changes the
one-step map or the readings (a parameter, an effect) is one more column of (f, eps); the gains are the same for all of
them, and the whitened innovations of all columns are an ordinary least-squares problem: generalised least squares
(Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 3.4; de Jong, The diffuse Kalman filter, 1991).

Rules of this file: numbers in, numbers out; noise levels are given.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Standard deviations of the first deviation from the reference: wide against what a first idea of a state misses.
START_POSITION, START_RATE = 0.3, 5.0
# Process noise beside the disturbance, standard deviation of a rate over one step: the rounding of a linearisation.
RATE_FLOOR = 1e-5
UNSEEN = 1e30


class Noise(NamedTuple):
    """Levels of one recording: disturbances (coordinates,) and readings (channels,)."""

    force: Array  # standard deviation, in the force's unit
    time_s: Array  # correlation time
    reading: Array  # standard deviation of each channel


class Linear(NamedTuple):
    """The linear model along a reference, n nodes; columns of f and eps: the residual first, then what may change it."""

    a: Array  # (n-1, nz, nz)
    w: Array  # (n-1, nz, nq)
    c: Array  # (n, nc, nz)
    h: Array  # (n-1,)
    seen: NDArray[np.bool_]  # (n, nc)
    nx: int  # how many of the nz are positions and rates, alternating

    @property
    def size(self) -> int:
        """Of the deviation with the disturbances."""
        return self.a.shape[1] + self.w.shape[2]


class Gains(NamedTuple):
    """What the filter did at every node, whatever the columns."""

    whiten: Array  # (n, nc, nc): innovations to independent unit ones; rows of what was not seen are 0
    gain: Array  # (n, size, nc)
    before: Array  # (n, size, size): covariance before the node's readings
    phi: Array  # (n-1, size, size)
    logdet: float  # sum of log S over all readings


def gains(model: Linear, noise: Noise) -> Gains:
    """One pass of the covariance."""
    n, nc, nz = model.c.shape
    nq, size = model.w.shape[2], model.size
    f = _covariance_pass(nz, nq, nc, model.nx).mapaccum(n)
    out = f(ca.DM(_start(model, noise)), *_per_node(model), np.repeat(_levels(noise)[:, None], n, axis=1))
    whiten = _columns(out[1], n, nc, nc)
    gain = _columns(out[2], n, size, nc)
    before = _columns(out[3], n, size, size)
    decay = np.exp(-model.h[:, None] / noise.time_s)
    phi = np.zeros((n - 1, size, size))
    phi[:, :nz, :nz], phi[:, :nz, nz:] = model.a, model.w
    phi[:, range(nz, size), range(nz, size)] = decay
    return Gains(whiten, gain, before, phi, float(out[4].full().sum()))


def whitened(model: Linear, found: Gains, f: Array, eps: Array) -> Array:
    """Whitened innovations (n, nc, m) of columns f (n-1, nz, m) and eps (n, nc, m)."""
    n, nc, m = eps.shape
    nz, d = f.shape[1], np.zeros((model.size, m))
    out = np.empty((n, nc, m))
    eps = np.where(model.seen[:, :, None], eps, 0.0)
    for k in range(n):
        e = eps[k] - model.c[k] @ d[:nz]
        out[k] = found.whiten[k] @ e
        if k < n - 1:
            d = found.phi[k] @ (d + found.gain[k] @ e)
            d[:nz] += f[k]
    return out


class Smoothed(NamedTuple):
    """Deviation and disturbance given all readings, and how the log-likelihood answers to a push at each step."""

    d: Array  # (n, size)
    push: Array  # (n-1, nz): derivative of the log-likelihood by an addition to the one-step map


def smoothed(model: Linear, found: Gains, f: Array, eps: Array) -> Smoothed:
    """Fixed-interval smoother of one column f (n-1, nz), eps (n, nc) (Bryson and Frazier's adjoint form)."""
    n, _, nz = model.c.shape
    size, d = model.size, np.zeros(model.size)
    eps = np.where(model.seen, eps, 0.0)
    before, e = np.empty((n, size)), np.empty_like(eps)
    for k in range(n):
        before[k] = d
        e[k] = eps[k] - model.c[k] @ d[:nz]
        if k < n - 1:
            d = found.phi[k] @ (d + found.gain[k] @ e[k])
            d[:nz] += f[k]
    out, push, adjoint = np.empty((n, size)), np.empty((n - 1, nz)), np.zeros(size)
    whitest = np.einsum("nij,nj->ni", found.whiten, e)
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            push[k] = -adjoint[:nz]
            adjoint = found.phi[k].T @ adjoint
        # l~ = -C' S^-1 e + (I - K C)' l
        adjoint = adjoint.copy()
        inner = found.gain[k].T @ adjoint + found.whiten[k].T @ whitest[k]
        adjoint[:nz] -= model.c[k].T @ inner
        out[k] = before[k] - found.before[k] @ adjoint
    return Smoothed(out, push)


class Criterion:
    """The likelihood of the noise levels, given one residual f (n-1, nz), eps (n, nc)."""

    def __init__(self, model: Linear, f: Array, eps: Array) -> None:
        self.model = model
        n, nc, nz = model.c.shape
        self._pass = _likelihood_pass(nz, model.w.shape[2], nc, model.nx).mapaccum(n)
        eps = np.where(model.seen, eps, 0.0)
        f = np.concatenate([f, np.zeros((1, nz))])
        self._fixed, self._n = [*_per_node(model), ca.DM(f.T), ca.DM(eps.T)], n

    def value(self, noise: Noise) -> float:
        """Negative log-likelihood without its constant."""
        first = np.concatenate([_start(self.model, noise), np.zeros(self.model.size + 1)])
        levels = np.repeat(_levels(noise)[:, None], self._n, axis=1)
        return float(self._pass(first, *self._fixed, levels)[-1, -1]) / 2


# ---------------------------------------------------------------------------------------------- CasADi


def _rows(x: Array) -> Array:
    """(n, r, c) as (r c, n), column-major per node: how CasADi takes a matrix a step."""
    return np.ascontiguousarray(x.transpose(2, 1, 0).reshape(-1, len(x)))


def _columns(out: ca.DM, n: int, rows: int, cols: int) -> Array:
    return np.asarray(out.full()).T.reshape(n, cols, rows).transpose(0, 2, 1)


def _per_node(model: Linear) -> list[ca.DM]:
    """A, W, h of the step that follows the node (none after the last), C and what was seen there."""
    size = model.a.shape[1]
    a = np.concatenate([model.a, np.eye(size)[None]])
    w = np.concatenate([model.w, np.zeros((1, *model.w.shape[1:]))])
    h = np.append(model.h, 0.0)[None]
    return [ca.DM(one) for one in (_rows(a), _rows(w), h, _rows(model.c), model.seen.T.astype(float))]


def _levels(noise: Noise) -> Array:
    return np.concatenate([noise.force, noise.time_s, noise.reading])


def _start(model: Linear, noise: Noise) -> Array:
    """Covariance of the first deviation, as a column."""
    nz = model.a.shape[1]
    spread = np.full(nz, START_RATE)
    spread[: model.nx : 2] = START_POSITION
    return np.diag(np.concatenate([spread, noise.force]) ** 2).ravel()


def _symbols(nz: int, nq: int, nc: int) -> dict[str, ca.SX]:
    shapes = {"a": (nz, nz), "w": (nz, nq), "h": (1, 1), "c": (nc, nz), "seen": (nc, 1), "s": (2 * nq + nc, 1)}
    return {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}


def _update(p: ca.SX, s: dict[str, ca.SX], nq: int, nc: int) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Covariance after the readings, taken one after the other; whitening (nc, nc), gain (size, nc), log det."""
    size, nz = p.size1(), s["c"].size2()
    whiten, gain, logdet = ca.SX.zeros(nc, nc), ca.SX.zeros(size, nc), ca.SX(0)
    for i in range(nc):
        row = ca.horzcat(s["c"][i, :], ca.SX.zeros(1, size - nz))
        pc = ca.mtimes(p, row.T)
        var = ca.mtimes(row, pc) + s["s"][2 * nq + i] ** 2
        # the innovation of reading i after those before it: e_i - c_i (gain so far) e
        own = ca.SX.zeros(1, nc)
        own[i] = 1
        own = s["seen"][i] * (own - ca.mtimes(row, gain))
        whiten[i, :] = own / ca.sqrt(var)
        k = s["seen"][i] * pc / var
        gain = gain + ca.mtimes(k, own)
        p = p - ca.mtimes(k, pc.T)
        logdet += s["seen"][i] * ca.log(var)
    return p, whiten, gain, logdet


def _predict(p: ca.SX, s: dict[str, ca.SX], nq: int, nx: int) -> tuple[ca.SX, ca.SX]:
    nz, size = s["a"].size1(), p.size1()
    decay = ca.exp(-s["h"] / s["s"][nq : 2 * nq])
    phi = ca.vertcat(ca.horzcat(s["a"], s["w"]), ca.horzcat(ca.SX.zeros(nq, nz), ca.diag(decay)))
    floor = [RATE_FLOOR**2 if i < nx and i % 2 else 0.0 for i in range(nz)]
    q = ca.diag(ca.vertcat(ca.DM(floor), s["s"][:nq] ** 2 * (1 - decay**2)))
    half = ca.mtimes(phi, p)
    # the lower half is computed, the upper one is the same
    lower = ca.tril(
        ca.vertcat(
            *(ca.horzcat(*(ca.dot(half[i, :], phi[j, :]) if j <= i else 0 for j in range(size))) for i in range(size))
        )
    )
    return ca.tril2symm(lower) + q, phi


@lru_cache(maxsize=16)
def _covariance_pass(nz: int, nq: int, nc: int, nx: int) -> ca.Function:
    size, s = nz + nq, _symbols(nz, nq, nc)
    vec = ca.SX.sym("p", size * size)
    before = ca.reshape(vec, size, size)
    p, whiten, gain, logdet = _update(before, s, nq, nc)
    after, _ = _predict(p, s, nq, nx)
    out = [ca.vec(after), ca.vec(whiten), ca.vec(gain), ca.vec(before), logdet]
    ins = [vec, *(ca.vec(s[k]) for k in ("a", "w", "h", "c", "seen", "s"))]
    return ca.Function("covariance", ins, out, {"cse": True})


@lru_cache(maxsize=16)
def _likelihood_pass(nz: int, nq: int, nc: int, nx: int) -> ca.Function:
    """State: covariance, deviation, sum of e^2/S + log S."""
    size, s = nz + nq, _symbols(nz, nq, nc)
    first = ca.SX.sym("state", size * size + size + 1)
    f, eps = ca.SX.sym("f", nz), ca.SX.sym("eps", nc)
    before, d = ca.reshape(first[: size * size], size, size), first[size * size : -1]
    p, whiten, gain, logdet = _update(before, s, nq, nc)
    e = eps - ca.mtimes(s["c"], d[:nz])
    after, phi = _predict(p, s, nq, nx)
    d = ca.mtimes(phi, d + ca.mtimes(gain, e)) + ca.vertcat(f, ca.SX.zeros(nq))
    last = ca.vertcat(ca.vec(after), d, first[-1] + logdet + ca.sumsqr(ca.mtimes(whiten, e)))
    ins = [first, *(ca.vec(s[k]) for k in ("a", "w", "h", "c", "seen")), f, eps, s["s"]]
    return ca.Function("likelihood", ins, [last], {"cse": True})
