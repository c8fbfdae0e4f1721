"""The innovations of an extended Kalman filter over a run, and their exact derivatives by parameters and noise.

    x_k|k-1 = f(x_k-1, u, h),  P_k|k-1 = F P F' + integral F Q F' dt,   e = y - x_i,  S = P_ii + r,
    x += P_i e / S,  P -= P_i P_i' / S   for every sample of the node, one after the other

in the daemon's convention: q is a variance per second on each state, r a variance of each sensor. One step of it is
one CasADi expression and the derivatives are carried along with it: forward, so that a run gives the information matrix
and the score of every node too (1000 nodes, 16 unknowns: 80 ms; the reverse gradient alone takes 0.7 of that).

Rules of this file: numbers in, numbers out; no search and no belief here. One object belongs to one thread.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.runs import Run
from hoopd.plants.hoop.equations import ExtraForce, rate, runge_kutta
from hoopd.plants.hoop.fit_data import STATES

Array = NDArray[np.float64]

CHANNELS = ("theta", "dtheta", "psi")  # the daemon takes them in this order
STATE_NAMES = ("theta", "dtheta", "psi", "dpsi")
ACTIVE = {"both": (0, 1, 2, 3), "hoop": (0, 1), "ball": (2, 3)}
# One Runge-Kutta step covers up to the tick: at full speed it misses psi by 4.5e-7 rad (test of step-halving of the
# plant), a thousand times below every sensor's noise, and a second one doubles the time of a fit.
STEP_S = 0.020
# Weights of the process noise at the beginning, the middle and the end of a step. Simpson's rule is exact for a double
# integrator; the daemon's filter adds all of it at the end.
NOISE_RULES = {"density": (1 / 6, 4 / 6, 1 / 6), "daemon": (0.0, 0.0, 1.0)}


class Samples(NamedTuple):
    """A run on its nodes: column k is the way to node k and what was measured there."""

    u: Array  # (1, n) N m
    h: Array  # (1, n) s, 0 for the first node
    y: Array  # (c, n), 0 where nothing was measured
    seen: Array  # (c, n) 1 where something was


class FilterInnovations(NamedTuple):
    """Prediction errors and their variances by node and channel; rows without a measurement mean nothing."""

    e: Array  # (n, c)
    s: Array  # (n, c)


class Derivatives(NamedTuple):
    """Innovations with their derivatives by the free values (m) and the initial state (4)."""

    e: Array  # (n, c)
    s: Array  # (n, c)
    de: Array  # (n, c, m + 4)
    ds: Array  # (n, c, m + 4)


def samples_of(run: Run, channels: Sequence[str]) -> Samples:
    """The run's measurements on its nodes; ValueError on one that is no sample of a state."""
    n = len(run.t)
    y, seen = np.zeros((len(channels), n)), np.zeros((len(channels), n))
    for row, name in enumerate(channels):
        if name in run.series:
            series = run.series[name]
            y[row, series.nodes], seen[row, series.nodes] = series.values, 1.0
    u, h = np.concatenate([[0.0], run.u]), np.concatenate([[0.0], np.diff(run.t)])
    return Samples(u[None, :], h[None, :], y, seen)


class InnovationsFilter:
    """The filter with some values left free: plant parameters and noise (`q_<state>`, `r_<channel>`)."""

    def __init__(
        self,
        structure: str,
        values: Mapping[str, float],
        free: Sequence[str],
        channels: Sequence[str],
        extra_forces: tuple[ExtraForce, ...] = (),
        *,
        moving: str = "both",
        noise_rule: str = "density",
        gate: float = math.inf,
    ) -> None:
        """`values`: every parameter of the structure and the forces, every q and r; `gate`: normalised innovations
        beyond it hardly move the state."""
        self.structure, self.values, self.free = structure, dict(values), tuple(free)
        self.channels, self.moving, self.active = tuple(channels), moving, ACTIVE[moving]
        self._extra_forces, self._weights, self._gate = extra_forces, NOISE_RULES[noise_rule], gate
        self._lower = tuple((i, j) for i in range(len(self.active)) for j in range(i + 1))
        self._cache: dict[tuple[str, int, int], ca.Function] = {}

    def run(self, p: Array, start: Array, samples: Samples) -> FilterInnovations:
        """Innovations with free values p (m,) from the state `start` (4,), which counts as known exactly."""
        first = np.concatenate([start, np.zeros(len(self._lower))])
        _, out = self._over("run", first, samples, p)
        e, s = np.split(out.T, 2, axis=1)
        return FilterInnovations(e, s)

    def run_with_sensitivity(self, p: Array, start: Array, samples: Samples) -> Derivatives:
        """The same with exact derivatives, taken through every step of the filter."""
        m, size, c = len(self.free), 4 + len(self._lower), len(self.channels)
        by_start = np.concatenate([np.zeros((size, m)), np.eye(size, 4)], axis=1)
        first = np.concatenate([start, np.zeros(len(self._lower)), by_start.ravel(order="F")])
        _, out = self._over("sensitivity", first, samples, p)
        out = out.T.reshape(-1, m + 5, 2 * c).transpose(0, 2, 1)
        return Derivatives(out[:, :c, 0], out[:, c:, 0], out[:, :c, 1:], out[:, c:, 1:])

    # ------------------------------------------------------------------------------------------ CasADi

    def _over(self, kind: str, first: Array, samples: Samples, p: Array) -> tuple[Array, Array]:
        count = samples.h.shape[1]
        # one column of parameters a step: a single one would make CasADi map the whole run over u instead
        columns = np.repeat(np.asarray(p, float).reshape(-1, 1), count, axis=1)
        states, out = self._function(kind, count, float(samples.h.max()))(first, *samples, columns)
        return states.full(), out.full()

    def _function(self, kind: str, count: int, longest_s: float) -> ca.Function:
        pieces = max(1, math.ceil(longest_s / STEP_S - 1e-6))
        key = (kind, count, pieces)
        if key not in self._cache:
            step = self._step(pieces) if kind == "run" else self._sensitivity(self._step(pieces))
            self._cache[key] = step.mapaccum(kind, count)
        return self._cache[key]

    def _named(self, p: ca.SX) -> dict[str, ca.SX]:
        named = {name: ca.SX(value) for name, value in self.values.items()}
        return named | {name: p[index] for index, name in enumerate(self.free)}

    def _moved(self) -> ca.Function:
        """(x, u, d, p) -> x after one Runge-Kutta step of d seconds, and F of the moving states."""
        x, u, d, p = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("d"), ca.SX.sym("p", len(self.free))
        f = ca.Function("f", [x, u, p], [rate(self.structure, x, u, self._named(p), self._extra_forces, self.moving)])
        after = runge_kutta(lambda z: f(z, u, p), x, d, 1)
        jacobian = ca.densify(ca.jacobian(after, x)[list(self.active), list(self.active)])
        return ca.Function("moved", [x, u, d, p], [after, jacobian], {"cse": True})

    def _step(self, pieces: int) -> ca.Function:
        """(z, u, h, y, seen, p) -> z after the node's samples, (e, S); z = (x, lower triangle of P)."""
        c = len(self.channels)
        z, p = ca.SX.sym("z", 4 + len(self._lower)), ca.SX.sym("p", len(self.free))
        u, h, y, seen = ca.SX.sym("u"), ca.SX.sym("h"), ca.SX.sym("y", c), ca.SX.sym("seen", c)
        x, cov = self._predicted(z[:4], self._matrix(z[4:]), u, h, p, pieces)
        e, s = [], []
        for index, name in enumerate(self.channels):
            x, cov, error, variance = self._measured(x, cov, name, y[index], seen[index], p)
            e.append(error)
            s.append(variance)
        after = ca.vertcat(x, *(cov[i, j] for i, j in self._lower))
        return ca.Function("step", [z, u, h, y, seen, p], [after, ca.vertcat(*e, *s)], {"cse": True})

    def _matrix(self, lower: ca.SX) -> ca.SX:
        cov = ca.SX.zeros(len(self.active), len(self.active))
        for index, (i, j) in enumerate(self._lower):
            cov[i, j] = cov[j, i] = lower[index]
        return cov

    def _predicted(self, x: ca.SX, cov: ca.SX, u: ca.SX, h: ca.SX, p: ca.SX, pieces: int) -> tuple[ca.SX, ca.SX]:
        named, moved, d = self._named(p), self._moved(), h / pieces
        q = ca.diag(ca.vertcat(*(named[f"q_{STATE_NAMES[i]}"] for i in self.active)))
        begin, middle, end = self._weights
        for _ in range(pieces):
            x, f = moved(x, u, d, p)
            # the second half of the step carries the noise of its middle: F_half = (1 + F) / 2 + O(d^2)
            half = (ca.SX.eye(len(self.active)) + f) / 2
            cov = f @ (cov + begin * d * q) @ f.T + middle * d * (half @ q @ half.T) + end * d * q
        return x, cov

    def _measured(
        self, x: ca.SX, cov: ca.SX, name: str, y: ca.SX, seen: ca.SX, p: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """State and covariance after one sample, its innovation and variance."""
        state = STATES[name]
        row, column = self.active.index(state), cov[:, self.active.index(state)]
        r = self._named(p)[f"r_{name}"]
        s = column[row] + r
        e = y - x[state]
        # a gate without an edge, so that the search meets none: half at the gate, 1 % of a sample three times as far
        pull = e if math.isinf(self._gate) else e / (1 + (e**2 / s / self._gate**2) ** 2)
        gain = ca.SX.zeros(4)
        gain[list(self.active)] = seen * column / s
        after = cov - seen * column @ column.T / s
        # P_ij - P_ii P_ij / S = P_ij r / S: no difference of large numbers in the measured state's own row
        kept = column * (1 - seen + seen * r / s)
        after[row, :], after[:, row] = kept.T, kept
        return x + gain * pull, after, e, s

    def _sensitivity(self, step: ca.Function) -> ca.Function:
        """The step with Z = d z / d (p, x0) behind z, column by column: Z' = dF/dz Z + [dF/dp, 0]."""
        size, m = step.size1_in(0), len(self.free)
        inputs = step.sx_in()
        after, out = step.call(inputs)
        both = ca.vertcat(after, out)
        by = ca.SX.sym("by", size, m + 4)
        own = ca.horzcat(ca.jacobian(both, inputs[5]), ca.SX.zeros(both.shape[0], 4))
        moved = ca.densify(ca.jacobian(both, inputs[0]) @ by + own)
        state = ca.vertcat(after, ca.vec(moved[:size, :]))
        # (e, S) and their derivatives, column by column
        result = ca.vertcat(out, ca.vec(moved[size:, :]))
        arguments = [ca.vertcat(inputs[0], ca.vec(by)), *inputs[1:]]
        return ca.Function("sensitivity", arguments, [state, result], {"cse": True})
