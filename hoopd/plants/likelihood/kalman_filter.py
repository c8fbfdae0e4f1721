"""The Kalman filter along a trajectory that whitens what a model leaves, and its smoother.

About a reference trajectory the model is linear in the deviation d = (z - z_ref, w): a disturbance w (a force on every
coordinate, a rate of every first-order state) is an Ornstein-Uhlenbeck process, so that

    d_k+1 = [[A, W], [0, exp(-h/T)]] d_k + (f_k, 0) + noise,     e_k = eps_k - C d_k

where f_k is what the one-step map misses of the reference and eps_k what the readings miss. Whatever else changes the
one-step map or the readings (a parameter, an effect) is one more column of (f, eps); the gains are the same for all of
them, and the whitened innovations of all columns are an ordinary least-squares problem: generalised least squares
(Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 3.4; de Jong, Diffuse Kalman filter, 1991).
Where an input is not known between its rows (`recording.input_curve`), what swings there unseen has no mean: rates come
and go from row to row, which adds to the variance of their readings, and places are displaced for good, by a jump.

Rules of this file: numbers in, numbers out; noise levels are given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.batch_calls import Recursion, flat
from hoopd.plants.likelihood.covariance import carried, elements, from_elements, readings_taken
from hoopd.plants.likelihood.linear_recursion import backward, bands_of, forward
from hoopd.plants.likelihood.whitening_blocks import FEW, WhiteningBlocks

Array = NDArray[np.float64]
# Which elements of a matrix are not zero at all nodes, row by row.
Pattern = tuple[tuple[bool, ...], ...]

# Standard deviations of the first deviation from the reference: wide against what a first idea of a state misses.
START_POSITION, START_RATE = 0.3, 5.0
# Of a first-order state, in usual sizes: one that nobody reads may be anywhere.
START_FIRST_ORDER = 1.0
# Process noise beside the disturbance, standard deviation of a rate over one step: the rounding of a linearisation.
RATE_FLOOR = 1e-5
# Of a first-order state over one step, in usual sizes: as much as that of a rate, whose usual size is ten.
FIRST_ORDER_FLOOR = 1e-6


class Lagged(NamedTuple):
    """What is behind a lag where a stretch begins: what it follows, and by how much it may be off."""

    state: int | None  # of the plant; None: the demanded torque, which is known
    deviation: float


class LinearReference(NamedTuple):
    """The linear model along a reference of n nodes; of f and eps the first column is the residual."""

    a: Array  # (n-1, nz, nz)
    w: Array  # (n-1, nz, nq)
    c: Array  # (n, nc, nz)
    h: Array  # (n-1,)
    seen: NDArray[np.bool_]  # (n, nc)
    nx: int  # how many of the nz are the plant's: positions and rates, alternating, but for `first_order`
    scatter: Array  # (n, nc) a reading's noise over its channel's level
    lagged: tuple[Lagged, ...] = ()  # the other nz
    sizes: tuple[float, ...] = ()  # usual sizes of the nx (`plants.scales`); not given: 1
    first_order: tuple[int, ...] = ()  # which of the nx are declared states of first order
    # deviations by what is not known of the inputs between their rows, of each reading (n, nc), and of the states, by
    # which each step displaces them for good (n-1, nz); None, both: all is known
    unresolved: Array | None = None
    displaced: Array | None = None

    @property
    def size(self) -> int:
        """Of the deviation with the disturbances."""
        return int(self.a.shape[1] + self.w.shape[2])

    def variance(self, reading: Array) -> Array:
        """(n, nc) of the readings, told the levels of their noise (nc,)."""
        own = (reading * self.scatter) ** 2
        return own if self.unresolved is None else own + self.unresolved**2


class LinearNoise(Protocol):
    """What disturbs a linear model and its readings, and how little is known of its first deviation."""

    @property
    def reading(self) -> Array:
        """(nc,) standard deviation of each channel, at scatter 1."""

    def start(self, model: LinearReference) -> Array:
        """(size, size) covariance of the first deviation."""

    def transition(self, model: LinearReference) -> Array:
        """(n-1, size, size) of the deviation with the states that the noise has of its own."""

    def added(self, model: LinearReference) -> Array:
        """(n-1, size, size) covariance that each step adds."""


class Noise(NamedTuple):
    """Levels of one recording: correlated disturbances (coordinates,) and readings (channels,)."""

    force: Array  # standard deviation, in the force's unit
    time_s: Array  # correlation time
    reading: Array  # standard deviation of each channel, at scatter 1

    def start(self, model: LinearReference) -> Array:
        """Wide (size, size), and disturbances as they are at any time.

        What is behind a lag is tied to what it follows. Were it free, the first sample of every stretch would cost a
        lag two nats that a delay of the same time does not pay.
        """
        nz, nx = model.a.shape[1], model.nx
        spread = np.full(nx, START_RATE)
        spread[::2] = START_POSITION
        spread[list(model.first_order)] = START_FIRST_ORDER
        spread *= np.array(model.sizes or 1.0)
        follows = np.vstack([np.eye(nx), np.zeros((nz - nx, nx))])
        for row, one in enumerate(model.lagged, start=nx):
            if one.state is not None:
                follows[row, one.state] = 1.0
        found = np.zeros((model.size, model.size))
        found[:nz, :nz] = follows * spread**2 @ follows.T
        found[range(nx, nz), range(nx, nz)] += np.square([one.deviation for one in model.lagged])
        found[nz:, nz:] = np.diag(self.force**2)
        return found

    def transition(self, model: LinearReference) -> Array:
        """[[A, W], [0, exp(-h/T)]]"""
        (steps, nz, _), size = model.a.shape, model.size
        phi = np.zeros((steps, size, size))
        phi[:, :nz, :nz], phi[:, :nz, nz:] = model.a, model.w
        phi[:, range(nz, size), range(nz, size)] = disturbance(model.h[:, None], self.force, self.time_s)[0]
        return phi

    def added(self, model: LinearReference) -> Array:
        """On the diagonal."""
        (steps, nz, _), size = model.a.shape, model.size
        found = np.zeros((steps, size, size))
        found[:, range(nz), range(nz)] = rate_floor(nz, model.nx, model.sizes, model.first_order)
        if model.displaced is not None:
            found[:, range(nz), range(nz)] += model.displaced**2
        found[:, range(nz, size), range(nz, size)] = disturbance(model.h[:, None], self.force, self.time_s)[1]
        return found


@dataclass(frozen=True)
class Gains:
    """What the filter did at every node, whatever the columns."""

    whiten: Array  # (n, nc, nc): innovations to independent unit ones; rows of what was not seen are 0
    gain: Array  # (n, size, nc)
    before: Array  # (n, size, size): covariance before the node's readings
    phi: Array  # (n-1, size, size)
    closed: Array  # (n-1, size, size): phi (I - gain C)
    logdet: float  # sum of log S over all readings
    c: Array  # (n, nc, nz) of the model

    @cached_property
    def blocks(self) -> WhiteningBlocks:
        """Many columns at once."""
        return WhiteningBlocks.of(self.closed, self.phi @ self.gain[:-1], self.whiten, self.c)

    @cached_property
    def bands(self) -> Array:
        """Of `closed`, as `chain` takes them."""
        return bands_of(self.closed)


def gains(model: LinearReference, noise: LinearNoise) -> Gains:
    """One pass of the covariance."""
    n, _, nz = model.c.shape
    size, phi, added = model.size, noise.transition(model), noise.added(model)
    dynamic, driven, seen = pattern_of(phi), pattern_of(added), pattern_of(model.c)
    lower, start = np.tril_indices(size), noise.start(model)
    after, whiten, gain = _covariance_step(dynamic, driven, seen)(
        start[lower],
        nonzeros(np.concatenate([phi, np.eye(size)[None]]), dynamic),
        nonzeros(np.concatenate([added, added[-1:]]), driven),
        nonzeros(model.c, seen),
        model.seen.astype(float),
        model.variance(noise.reading),
    )
    before = np.empty((n, size, size))
    before[0] = start
    before[1:, lower[0], lower[1]] = before[1:, lower[1], lower[0]] = after[:-1, :, 0]
    # phi (I - K C)
    closed = phi.copy()
    closed[:, :, :nz] -= phi @ (gain[:-1] @ model.c[:-1])
    logdet = -2.0 * float(np.sum(np.log(np.einsum("nii->ni", whiten)[model.seen])))
    return Gains(whiten, gain, before, phi, closed, logdet, model.c)


def predicted(model: LinearReference, found: Gains, f: Array, eps: Array) -> tuple[Array, Array]:
    """Deviations before each node's readings (n, size, m) and innovations (n, nc, m) of f (n-1, nz, m), eps (n, nc, m).

    eps is finite also where nothing was read; its value there does not matter.
    """
    n, nz = len(model.c), model.c.shape[2]
    # d_k+1 = phi (I - K C) d_k + phi K eps_k + f_k
    drive = np.zeros((n, model.size, eps.shape[2]))
    np.matmul(found.phi @ found.gain[:-1], eps[:-1], out=drive[1:])
    drive[1:, :nz] += f
    d = forward(found.bands, drive)
    return d, eps - model.c @ d[:, :nz]


def whitened(model: LinearReference, found: Gains, f: Array, eps: Array) -> Array:
    """Whitened innovations (n, nc, m) of columns f (n-1, nz, m) and eps (n, nc, m), finite also where not read."""
    if f.shape[2] >= FEW:
        return found.blocks.whitened(f, eps)
    return np.asarray(found.whiten @ predicted(model, found, f, eps)[1])


def adjoint(model: LinearReference, found: Gains, white: Array) -> Array:
    """By how much products of rows (n, nc, m) with the whitened innovations fall with each deviation (n, size, m)."""
    # r_k-1 = (phi (I - K C))' r_k + C' V' row
    source = np.zeros((len(white), model.size, white.shape[2]))
    source[:, : model.c.shape[2]] = (found.whiten @ model.c).transpose(0, 2, 1) @ white
    return backward(found.bands, source)


class SmoothedDeviation(NamedTuple):
    """Deviation and disturbance given all readings, and how the log-likelihood answers to a push at each step."""

    d: Array  # (n, size)
    push: Array  # (n-1, nz): derivative of the log-likelihood by an addition to the one-step map
    filtered: Array  # (n, size) deviation given the readings up to each node
    predicted: Array  # (n, size) and up to the one before


def smoothed(model: LinearReference, found: Gains, f: Array, eps: Array) -> SmoothedDeviation:
    """Fixed-interval smoother of one column f (n-1, nz), eps (n, nc) (Bryson and Frazier's adjoint form)."""
    nz = model.c.shape[2]
    d, e = predicted(model, found, f[:, :, None], eps[:, :, None])
    back = adjoint(model, found, found.whiten @ e)
    filtered = (d + found.gain @ e)[:, :, 0]
    return SmoothedDeviation((d + found.before @ back)[:, :, 0], back[1:, :nz, 0], filtered, d[:, :, 0])


# ---------------------------------------------------------------------------------------------- covariance


def disturbance(h: Any, force: Any, time_s: Any, exp: Callable[[Any], Any] = np.exp) -> tuple[Any, Any]:
    """Of a correlated disturbance over h seconds: the share that stays, and the variance that is added."""
    decay = exp(-h / time_s)
    return decay, force**2 * (1 - decay**2)


def rate_floor(nz: int, nx: int, sizes: tuple[float, ...] = (), first_order: tuple[int, ...] = ()) -> Array:
    """(nz,) variances that each step adds to the states of the plant, of usual sizes (nx,)."""
    found = np.zeros(nz)
    found[1:nx:2] = RATE_FLOOR**2
    found[list(first_order)] = FIRST_ORDER_FLOOR**2
    found[:nx] *= np.square(sizes or 1.0)
    return found


def pattern_of(x: Array) -> Pattern:
    """Of matrices (n, rows, columns)."""
    return tuple(tuple(bool(one) for one in row) for row in np.any(x != 0.0, axis=0))


def nonzeros(x: Array, pattern: Pattern) -> Array:
    """(n, nonzeros), column after column."""
    return flat(x)[:, np.array(pattern).T.ravel()]


def symbol(name: str, pattern: Pattern) -> ca.SX:
    """A matrix of symbols where the pattern has elements."""
    mask = np.array(pattern)
    cols, rows = np.nonzero(mask.T)
    return ca.SX.sym(name, ca.Sparsity.triplet(mask.shape[0], mask.shape[1], rows.tolist(), cols.tolist()))


@lru_cache(maxsize=32)
def _covariance_step(dynamic: Pattern, driven: Pattern, seen: Pattern) -> Recursion:
    """(lower half of P, phi, Q, C, seen, reading variances) -> lower half after, whitening, gain."""
    phi, q, c = symbol("phi", dynamic), symbol("q", driven), symbol("c", seen)
    size, nc = phi.size1(), c.size1()
    half = ca.SX.sym("p", size * (size + 1) // 2)
    present, r = ca.SX.sym("seen", nc), ca.SX.sym("r", nc)
    p, whiten, gain = _update(from_elements(half, size), c, present, r)
    out = [ca.vertcat(*elements(carried(p, phi, q))), ca.densify(whiten), ca.densify(gain)]
    return Recursion(ca.Function("covariance", [half, phi, q, c, present, r], out, {"cse": True}))


def _update(p: ca.SX, c: ca.SX, seen: ca.SX, r: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Covariance after the readings; whitening (nc, nc), gain (size, nc)."""
    (nc, nz), size = c.shape, p.size1()
    taken = readings_taken(p, c, seen, r)
    whiten, gain = ca.SX(nc, nc), ca.SX(size, nc)
    for i, (k, variance) in enumerate(zip(taken.gains, taken.variances, strict=True)):
        # the innovation of reading i after those before it: e_i - c_i (gain so far) e
        own = ca.SX(1, nc)
        own[i] = 1
        own = seen[i] * (own - ca.mtimes(c[i, :], gain[:nz, :]))
        whiten[i, :] = own / ca.sqrt(variance)
        gain = gain + ca.mtimes(k, own)
    return taken.after, whiten, gain
