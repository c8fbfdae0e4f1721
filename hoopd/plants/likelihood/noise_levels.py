"""The likelihood of the levels of the noise in readings and of the disturbances, and its slope.

With the innovations e and their variances S of every reading, those of its node before it taken,

    -log L = sum (e^2 / S + log S) / 2,   by e: e/S,   by S: (1/S - e^2/S^2) / 2

and the slope by the levels comes from one pass back through the filter (`recursion_derivatives`).

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.covariance import carried, corrected, elements, from_elements, readings_taken
from hoopd.plants.likelihood.kalman_filter import (
    LinearReference,
    Noise,
    Pattern,
    disturbance,
    nonzeros,
    pattern_of,
    rate_floor,
    symbol,
)
from hoopd.plants.likelihood.recursion_derivatives import DifferentiableRecursion, RecursionRun

Array = NDArray[np.float64]

# A part of the data: blocks of so many nodes, every so manyth of them.
BLOCK, EVERY = 150, 5


class Criterion:
    """The likelihood of the noise levels, given one residual f (n-1, nz), eps (n, nc)."""

    def __init__(self, model: LinearReference, f: Array, eps: Array) -> None:
        self.model, self._f, self._eps = model, f, np.where(model.seen, eps, 0.0)
        moving = np.concatenate([model.a, model.w], axis=2)
        dynamic, seen = pattern_of(moving), pattern_of(model.c)
        is_known = model.unresolved is None
        self._filter = _linear_filter(dynamic, seen, model.nx, model.sizes, model.first_order, is_known)
        # the way from the last node leads nowhere
        parts = [nonzeros(moving, dynamic), model.h[:, None], f]
        onward = [np.concatenate([part, np.zeros((1, part.shape[1]))]) for part in parts]
        read = [nonzeros(model.c, seen), model.seen.astype(float), model.scatter, self._eps]
        self._data = [*onward, *read]
        if model.unresolved is not None and model.displaced is not None:
            self._data += [model.unresolved, np.concatenate([model.displaced, np.zeros((1, model.displaced.shape[1]))])]

    def parts(self) -> list[Criterion]:
        """Of some blocks of the nodes."""
        m, n = self.model, len(self.model.c)
        found = []
        for first in range(0, n - min(BLOCK, n) + 1, BLOCK * EVERY):
            nodes, steps = slice(first, first + BLOCK), slice(first, first + BLOCK - 1)
            model = LinearReference(
                m.a[steps],
                m.w[steps],
                m.c[nodes],
                m.h[steps],
                m.seen[nodes],
                m.nx,
                m.scatter[nodes],
                m.lagged,
                m.sizes,
                m.first_order,
                None if m.unresolved is None else m.unresolved[nodes],
                None if m.displaced is None else m.displaced[steps],
            )
            found.append(Criterion(model, self._f[steps], self._eps[nodes]))
        return found

    def value(self, noise: Noise) -> float:
        """Negative log-likelihood without its constant."""
        return self._value(self._run(noise))

    def gradient(self, noise: Noise) -> tuple[float, Array]:
        """The value, and its derivatives by the logarithms of force, time_s and reading, one after the other."""
        run, seen, levels = self._run(noise), self.model.seen, np.concatenate(noise)
        e, s = np.split(run.results, 2, axis=1)
        seeds = np.concatenate([np.where(seen, e / s, 0.0), np.where(seen, (1.0 - e**2 / s) / s / 2.0, 0.0)], axis=1)
        by_start, by = self._filter.gradient(run, self._data, levels, seeds)
        slope = by * levels
        # the first disturbances have the variances force^2
        diagonal = np.cumsum(np.arange(1, self.model.size + 1)) - 1
        slope[: len(noise.force)] += 2.0 * noise.force**2 * by_start[diagonal[self.model.a.shape[1] :]]
        return self._value(run), slope

    def _run(self, noise: Noise) -> RecursionRun:
        size = self.model.size
        start = np.concatenate([noise.start(self.model)[np.tril_indices(size)], np.zeros(size)])
        return self._filter.run(start, self._data, np.concatenate(noise))

    def _value(self, run: RecursionRun) -> float:
        e, s = np.split(run.results, 2, axis=1)
        return float(np.sum((e**2 / s + np.log(s))[self.model.seen])) / 2


@lru_cache(maxsize=16)
def _linear_filter(
    dynamic: Pattern, seen: Pattern, nx: int, sizes: tuple[float, ...], first_order: tuple[int, ...], is_known: bool
) -> DifferentiableRecursion:
    """(P and d, [A W], h, f, C, seen, scatter, eps, levels) -> P and d at the next node, e and S of every reading.

    Before the levels what is not known of each reading and each step, where not all inputs are known.
    """
    moving, c = symbol("moving", dynamic), symbol("c", seen)
    (nz, size), nc, nq = moving.shape, c.size1(), moving.size2() - moving.size1()
    half, d, h = ca.SX.sym("p", size * (size + 1) // 2), ca.SX.sym("d", size), ca.SX.sym("h")
    f, eps, present = ca.SX.sym("f", nz), ca.SX.sym("eps", nc), ca.SX.sym("seen", nc)
    scatter, levels = ca.SX.sym("scatter", nc), ca.SX.sym("levels", 2 * nq + nc)
    force, time_s, reading = ca.vertsplit(levels, [0, nq, 2 * nq, 2 * nq + nc])
    unresolved, displaced = ca.SX.sym("unresolved", nc), ca.SX.sym("displaced", nz)
    variances = (reading * scatter) ** 2 + (0.0 if is_known else unresolved**2)
    taken = readings_taken(from_elements(half, size), c, present, variances)
    moved, e = corrected(taken, c, eps - ca.mtimes(c, d[:nz]))
    decay, variance = disturbance(h, force, time_s, ca.exp)
    phi = ca.vertcat(moving, ca.horzcat(ca.SX(nq, nz), ca.diag(decay)))
    floor = rate_floor(nz, nx, sizes, first_order) + (0.0 if is_known else displaced**2)
    added = ca.diag(ca.vertcat(floor, variance))
    after = ca.vertcat(
        *elements(carried(taken.after, phi, added)), ca.mtimes(phi, d + moved) + ca.vertcat(f, ca.SX(nq, 1))
    )
    data = [moving, h, f, c, present, scatter, eps, *([] if is_known else [unresolved, displaced])]
    out = ca.vertcat(*e, *taken.variances)
    return DifferentiableRecursion(
        ca.Function("filter", [ca.vertcat(half, d), *data, levels], [after, out], {"cse": True})
    )
