"""One step of the covariance of a Kalman filter, as expressions: the readings of a node, then the way to the next one.

    S_i = c_i P c_i' + r_i,  k_i = P c_i' / S_i,  P -= k_i c_i P     for every reading of the node, one after the other
    P+  = phi P phi' + Q

What phi and Q are is the noise model's: a disturbance with states of its own (`kalman_filter.Noise`), or densities on
the states (`density`). Source: Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 3.2.

Rules of this file: expressions only; every filter of this folder takes its covariance from here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca

# Weights of white process noise at the beginning, the middle and the end of a step. Simpson's rule is exact for a
# double integrator; the daemon's filter adds all of it at the end.
DENSITY_RULES = {"density": (1 / 6, 4 / 6, 1 / 6), "daemon": (0.0, 0.0, 1.0)}


class ReadingsTaken(NamedTuple):
    """A covariance after a node's readings, and what each of them did to the state."""

    after: ca.SX  # (size, size)
    gains: list[ca.SX]  # (size, 1) of each reading, in turn
    variances: list[ca.SX]  # of each reading's error, those before it taken


def readings_taken(p: ca.SX, c: ca.SX, seen: ca.SX, r: ca.SX) -> ReadingsTaken:
    """Take the readings y = c x + noise of variances r (nc,), those with seen = 1."""
    (nc, nz), size = c.shape, p.size1()
    found = ReadingsTaken(p, [], [])
    for i in range(nc):
        row = ca.horzcat(c[i, :], ca.SX(1, size - nz))
        pc = ca.densify(ca.mtimes(p, row.T))
        variance = ca.mtimes(row, pc) + r[i]
        gain = seen[i] * pc / variance
        p = whole(ca.tril(p - ca.mtimes(gain, pc.T)))
        found = ReadingsTaken(p, [*found.gains, gain], [*found.variances, variance])
    return found


def corrected(
    taken: ReadingsTaken, c: ca.SX, error: ca.SX, pull: Callable[[ca.SX, ca.SX], ca.SX] = lambda e, s: e
) -> tuple[ca.SX, list[ca.SX]]:
    """What the readings move the state by (size, 1), and the innovation of each of them, those before it taken.

    error: (nc,) what they miss of the state before them; pull: of an innovation and its variance, what counts of it.
    """
    moved, e = ca.SX(taken.after.size1(), 1), []
    for i, (gain, s) in enumerate(zip(taken.gains, taken.variances, strict=True)):
        e.append(error[i] - ca.mtimes(c[i, :], moved[: c.size2()]))
        moved += gain * pull(e[i], s)
    return moved, e


def carried(p: ca.SX, phi: ca.SX, q: ca.SX) -> ca.SX:
    """Covariance one step later."""
    return whole(ca.tril(ca.mtimes(ca.mtimes(phi, p), phi.T) + q))


def density(f: ca.SX, h: ca.SX, q: ca.SX, rule: str = "density") -> ca.SX:
    """What white noise of q (nz,) a second on every state adds over a step of h seconds and transition f."""
    begin, middle, end = DENSITY_RULES[rule]
    # the second half of the step carries the noise of its middle: F_half = (1 + F) / 2 + O(h^2)
    half, q = (ca.SX.eye(f.size1()) + f) / 2, ca.diag(q)
    return begin * h * (f @ q @ f.T) + middle * h * (half @ q @ half.T) + end * h * q


def whole(lower: ca.SX) -> ca.SX:
    """The symmetric matrix of a lower half."""
    return ca.densify(ca.tril2symm(lower))


def from_elements(elements: ca.SX, size: int) -> ca.SX:
    """The symmetric matrix of the elements of its lower half, row by row (as `numpy.tril_indices` lists them)."""
    # CasADi lists an upper half column by column: the same order
    return whole(ca.SX(ca.Sparsity.upper(size), elements).T)


def elements(p: ca.SX) -> list[ca.SX]:
    """Of the lower half, row by row."""
    return [p[i, j] for i in range(p.size1()) for j in range(i + 1)]
