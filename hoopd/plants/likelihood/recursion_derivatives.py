"""A recursion over many nodes, and its exact derivatives: backward for one number, forward for every node.

    z_k+1, o_k = step(z_k, data_k, v)

The derivatives of a number that is a function of all o by the start and by v come from one pass back over the states
that the run left (the adjoint); those of every o_k from a pass forward that carries Z_k = dz_k/d(v, start). Both are
made from the step by automatic differentiation. Source: Griewank and Walther, Evaluating Derivatives, 2008, ch. 3.

Rules of this file: a step comes in and numbers come out; it knows no filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.batch_calls import Recursion

Array = NDArray[np.float64]


class RecursionRun(NamedTuple):
    """What a run left."""

    before: Array  # (n, size) states with which each node begins
    results: Array  # (n, k)


class DifferentiableRecursion:
    """A step (state, data ..., v) -> (state after, results), repeated over any number of nodes."""

    def __init__(self, step: ca.Function) -> None:
        self._step, self._forward = step, Recursion(step)
        self._size, self._m = step.nnz_in(0), step.nnz_in(step.n_in() - 1)
        self._kept: dict[int, Recursion] = {}

    def run(self, start: Array, data: Sequence[Array], v: Array) -> RecursionRun:
        """From the start (size,), with data of n rows each and v (m,) the same at every node."""
        states, results = self._forward(start, *data, self._same(data, v))
        before = np.empty((len(states), self._size))
        before[0], before[1:] = start, states[:-1, :, 0]
        return RecursionRun(before, results[:, :, 0])

    def gradient(self, run: RecursionRun, data: Sequence[Array], v: Array, seeds: Array) -> tuple[Array, Array]:
        """By the start (size,) and by v (m,), of a number whose derivatives by the results are `seeds` (n, k)."""
        back = [one[::-1] for one in (run.before, *data, self._same(data, v), seeds)]
        last = self._adjoint(np.zeros(self._size + self._m), *back)[0][-1, :, 0]
        return last[: self._size], last[self._size :]

    def sensitivity(self, start: Array, by_start: Array, data: Sequence[Array], v: Array) -> tuple[Array, Array]:
        """Results (n, k), and their derivatives (n, k, m + j) by v and by j directions of the start (size, j)."""
        directions = np.concatenate([np.zeros((self._size, self._m)), by_start], axis=1)
        tangent = self._tangents(directions.shape[1])
        first = np.concatenate([start, directions.ravel(order="F")])
        out = tangent(first, *data, self._same(data, v))[1][:, :, 0]
        out = out.reshape(len(out), directions.shape[1] + 1, -1).transpose(0, 2, 1)
        return out[:, :, 0], out[:, :, 1:]

    @staticmethod
    def _same(data: Sequence[Array], v: Array) -> Array:
        return np.broadcast_to(v, (len(data[0]), len(v)))

    @cached_property
    def _adjoint(self) -> Recursion:
        """(by state after, by v so far), state, data, v, seeds -> the same one node earlier."""
        inputs = self._step.sx_in()
        after, out = self._step.call(inputs)
        late, seed = ca.SX.sym("late", self._size + self._m), ca.SX.sym("seed", out.numel())
        by = ca.gradient(ca.dot(late[: self._size], after) + ca.dot(seed, out), ca.vertcat(inputs[0], inputs[-1]))
        early = by + ca.vertcat(ca.SX.zeros(self._size), late[self._size :])
        return Recursion(ca.Function("adjoint", [late, *inputs, seed], [ca.densify(early)], {"cse": True}))

    def _tangents(self, count: int) -> Recursion:
        """The step with Z (size, count) behind its state, column by column: Z+ = ds/dz Z + [ds/dv, 0]."""
        if count not in self._kept:
            inputs = self._step.sx_in()
            after, out = self._step.call(inputs)
            z = ca.SX.sym("directions", self._size, count)
            own = ca.horzcat(ca.SX.eye(self._m), ca.SX(self._m, count - self._m))
            by = ca.vertcat(inputs[0], inputs[-1])
            moved = ca.densify(ca.jtimes(ca.vertcat(after, out), by, ca.vertcat(z, own)))
            results = [
                ca.vertcat(after, ca.vec(moved[: self._size, :])),
                ca.vertcat(out, ca.vec(moved[self._size :, :])),
            ]
            arguments = [ca.vertcat(inputs[0], ca.vec(z)), *inputs[1:]]
            self._kept[count] = Recursion(ca.Function("tangents", arguments, results, {"cse": True}))
        return self._kept[count]
