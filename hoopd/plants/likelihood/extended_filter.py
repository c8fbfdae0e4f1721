"""The innovations of an extended Kalman filter over a run, and their exact derivatives by parameters and noise.

    e = y - h(x) - C (moved so far),  S = C P C' + r,  x += K e   for every sample of a node, one after the other
    x_k+1 = f(x_k, u, h),  P_k+1 = F P F' + integral F Q F' dt

in the daemon's convention: q is a variance per second on each state, r a variance of each sensor. The covariance is
that of `covariance`, here about the filter's own estimate: what it linearises about moves with the parameters, and the
derivatives have that, too. (`kalman_filter` has one linearisation for many columns, about a reference that stays.)

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
from hoopd.plants.likelihood.covariance import carried, corrected, density, elements, from_elements, readings_taken
from hoopd.plants.likelihood.recursion_derivatives import DifferentiableRecursion, RecursionRun
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """A run on its nodes: row k is what was measured at node k, and the way to the next one."""

    u: Array  # (n, inputs)
    h: Array  # (n, 1) s, 0 at the last node
    t: Array  # (n, 1) s
    y: Array  # (n, c), 0 where nothing was measured
    seen: Array  # (n, c) 1 where something was


class FilterInnovations(NamedTuple):
    """Prediction errors and their variances by node and channel; rows without a measurement mean nothing."""

    e: Array  # (n, c)
    s: Array  # (n, c)
    run: RecursionRun


class Derivatives(NamedTuple):
    """Innovations with their derivatives by the free values (m) and the initial state (nx)."""

    e: Array  # (n, c)
    s: Array  # (n, c)
    de: Array  # (n, c, m + nx)
    ds: Array  # (n, c, m + nx)


def samples_of(run: Run, channels: Sequence[str]) -> Samples:
    """The run's measurements on its nodes."""
    n = len(run.t)
    y, seen = np.zeros((n, len(channels))), np.zeros((n, len(channels)))
    for column, name in enumerate(channels):
        if name in run.series:
            series = run.series[name]
            y[series.nodes, column], seen[series.nodes, column] = series.values, 1.0
    u, h = run.u.reshape(n - 1, -1), np.diff(run.t)
    return Samples(np.concatenate([u, np.zeros_like(u[:1])]), np.append(h, 0.0)[:, None], run.t[:, None], y, seen)


class ExtendedKalmanFilter:
    """The filter with some values left free: plant parameters and noise (`q_<state>`, `r_<channel>`)."""

    def __init__(
        self,
        composite: Composite,
        values: Mapping[str, float],
        free: Sequence[str],
        channels: Sequence[str],
        *,
        rule: str = "density",
        gate: float = math.inf,
    ) -> None:
        """`values`: every parameter of the plant, every q and r; `rule`: when a step's noise is added (`covariance`);
        `gate`: normalised innovations beyond it hardly move the state."""
        self.composite, self.values, self.free, self.channels = composite, dict(values), tuple(free), tuple(channels)
        self._rule, self._gate, self._size = rule, gate, composite.nz
        self._recursions: dict[int, DifferentiableRecursion] = {}

    def run(self, p: Array, start: Array, samples: Samples) -> FilterInnovations:
        """Innovations with free values p (m,) from the state `start` (nx,), which counts as known exactly."""
        run = self._recursion(samples).run(self._first(start), samples, p)
        c = len(self.channels)
        return FilterInnovations(run.results[:, :c], run.results[:, c:], run)

    def gradient(self, run: RecursionRun, p: Array, samples: Samples, by_e: Array, by_s: Array) -> Array:
        """By free values and initial state (m + nx,), of a number of which `by_e`, `by_s` (n, c) are derivatives."""
        seeds = np.concatenate([by_e, by_s], axis=1)
        by_start, by_p = self._recursion(samples).gradient(run, samples, p, seeds)
        return np.concatenate([by_p, by_start[: self._size]])

    def run_with_sensitivity(self, p: Array, start: Array, samples: Samples) -> Derivatives:
        """Innovations with the derivatives of each of them, taken through every step of the filter."""
        first = self._first(start)
        out, by = self._recursion(samples).sensitivity(first, np.eye(len(first), self._size), samples, p)
        c = len(self.channels)
        return Derivatives(out[:, :c], out[:, c:], by[:, :c], by[:, c:])

    def _first(self, start: Array) -> Array:
        return np.concatenate([start, np.zeros(self._size * (self._size + 1) // 2)])

    def _recursion(self, samples: Samples) -> DifferentiableRecursion:
        pieces = max(1, math.ceil(float(samples.h.max()) / self.composite.longest_step_s - 1e-6))
        if pieces not in self._recursions:
            self._recursions[pieces] = DifferentiableRecursion(self._step(pieces))
        return self._recursions[pieces]

    # ------------------------------------------------------------------------------------------ CasADi

    def _step(self, pieces: int) -> ca.Function:
        """(z, u, h, t, y, seen, p) -> z at the next node, (e, S); z = (x, lower half of P)."""
        nx, c = self._size, len(self.channels)
        x, half, p = ca.SX.sym("x", nx), ca.SX.sym("p", nx * (nx + 1) // 2), ca.SX.sym("free", len(self.free))
        u, h, t = ca.SX.sym("u", self.composite.nu), ca.SX.sym("h"), ca.SX.sym("t")
        y, seen = ca.SX.sym("y", c), ca.SX.sym("seen", c)
        named = {name: ca.SX(value) for name, value in self.values.items()}
        named |= {name: p[index] for index, name in enumerate(self.free)}
        here, cov, e, s = self._measured(x, from_elements(half, nx), t, y, seen, named)
        there, cov = self._predicted(here, cov, u, h, t, named, pieces)
        inputs, results = [ca.vertcat(x, half), u, h, t, y, seen, p], ca.vertcat(*e, *s)
        return ca.Function("filter", inputs, [ca.vertcat(there, *elements(cov)), results], {"cse": True})

    def _measured(
        self, x: ca.SX, cov: ca.SX, t: ca.SX, y: ca.SX, seen: ca.SX, named: Mapping[str, ca.SX]
    ) -> tuple[ca.SX, ca.SX, list[ca.SX], list[ca.SX]]:
        """State and covariance after a node's samples, their innovations and variances."""
        expected = ca.vertcat(*(self.composite.reading(name, x, t, named) for name in self.channels))
        c = ca.jacobian(expected, x)
        taken = readings_taken(cov, c, seen, ca.vertcat(*(named[f"r_{name}"] for name in self.channels)))
        moved, e = corrected(taken, c, y - expected, self._pull)
        return x + moved, taken.after, e, taken.variances

    def _pull(self, e: ca.SX, s: ca.SX) -> ca.SX:
        """Without an edge, so that the search meets none: half at the gate, 1 % of a sample three times as far."""
        return e if math.isinf(self._gate) else e / (1 + (e**2 / s / self._gate**2) ** 2)

    def _predicted(
        self, x: ca.SX, cov: ca.SX, u: ca.SX, h: ca.SX, t: ca.SX, named: Mapping[str, ca.SX], pieces: int
    ) -> tuple[ca.SX, ca.SX]:
        model, d = self.composite, h / pieces
        p = ca.vertcat(*(named[name] for name in model.names))
        q = ca.vertcat(*(named[f"q_{state}"] for state in model.plant.states))
        torques, still = ca.repmat(u.T, model.substeps, 1), ca.SX.zeros(model.nw)
        for j in range(pieces):
            z = ca.SX.sym("z", self._size)
            after = model.step_function(z, torques, still, d, t + j * d, p)
            moved = ca.Function("moved", [z, u, h, t, *ca.symvar(p)], [after, ca.densify(ca.jacobian(after, z))])
            x, f = moved(x, u, h, t, *ca.symvar(p))
            cov = carried(cov, f, density(f, d, q, self._rule))
        return x, cov
