"""CasADi functions on many nodes at once, their arguments and results plain arrays of rows.

A row is what CasADi takes for one node: a matrix (rows, cols) is stored column after column. Results come as
(n, rows, cols) views on memory of the call's own.

Rules of this file: no model; functions are set up once for each length and kept with their memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.vectorised import Vectorised, takes

Array = NDArray[np.float64]

# Nodes of a recursion in one call: set up in a millisecond; the call itself then costs nothing.
CHUNK = 50
# Steps of a recursion that are written out in one call.
AT_ONCE = 5
# Functions that are kept with their memory (some hundred kilobytes each).
KEPT = 64
# From so many nodes on numpy is faster than CasADi.
MANY = 100


class Mapped:
    """A function evaluated at n nodes; arguments that are the same at all of them are given once."""

    def __init__(self, function: ca.Function, n: int, same: Sequence[int] = ()) -> None:
        self._rows = [1 if i in same else n for i in range(function.n_in())]
        self._sizes = [function.nnz_in(i) for i in range(function.n_in())]
        self._call = Vectorised(function, n, same) if n >= MANY and takes(function) else _Buffered(function, n, same)

    def __call__(self, *arguments: Array) -> list[Array]:
        """Results (n, rows, cols) of arguments (n, elements), or (elements,) of what is the same everywhere."""
        held = [_row_major(a, (n, size)) for a, n, size in zip(arguments, self._rows, self._sizes, strict=True)]
        return [array.transpose(0, 2, 1) for array in self._call(*held)]


class _Buffered:
    """By CasADi's own map."""

    def __init__(self, function: ca.Function, n: int, same: Sequence[int]) -> None:
        self._buffer, self._trigger = function.map("mapped", "serial", n, list(same), []).buffer()
        self._shapes = [(n, function.size2_out(i), function.size1_out(i)) for i in range(function.n_out())]

    def __call__(self, *arguments: Array) -> list[Array]:
        for i, array in enumerate(arguments):
            self._buffer.set_arg(i, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]
        out = [np.zeros(shape) for shape in self._shapes]
        for i, array in enumerate(out):
            self._buffer.set_res(i, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]
        self._trigger()
        return out


class Recursion:
    """A step (state, arguments) -> (state after, results) repeated over any number of nodes."""

    def __init__(self, step: ca.Function) -> None:
        self._buffer, self._trigger = _in_a_row(step, AT_ONCE).mapaccum("recursion", CHUNK // AT_ONCE).buffer()
        # of the states of a row the last one goes on
        self._state = np.zeros((AT_ONCE, step.nnz_in(0)))
        self._sizes = [step.nnz_in(i) for i in range(1, step.n_in())]
        self._shapes = [(step.size2_out(i), step.size1_out(i)) for i in range(step.n_out())]

    def __call__(self, start: Array, *arguments: Array) -> list[Array]:
        """States after each node and further results, (n, rows, cols), of arguments (n, elements)."""
        n = len(arguments[0])
        padded = -(-n // CHUNK) * CHUNK
        held = [_padded(a, padded, size) for a, size in zip(arguments, self._sizes, strict=True)]
        out = [np.zeros((padded, *shape)) for shape in self._shapes]
        self._state[-1] = start
        self._buffer.set_arg(0, memoryview(self._state))  # type: ignore[call-arg, arg-type, unused-ignore]
        for first in range(0, padded, CHUNK):
            part = slice(first, first + CHUNK)
            for i, array in enumerate(held, start=1):
                self._buffer.set_arg(i, memoryview(array[part]))  # type: ignore[call-arg, arg-type, unused-ignore]
            for i, array in enumerate(out):
                self._buffer.set_res(i, memoryview(array[part]))  # type: ignore[call-arg, arg-type, unused-ignore]
            self._trigger()
            self._state[-1] = out[0][first + CHUNK - 1].ravel()
        return [array[:n].transpose(0, 2, 1) for array in out]


def _in_a_row(step: ca.Function, count: int) -> ca.Function:
    """So many steps in one call, which costs as much as a quarter of a step: of every argument and result, and of the
    states, the elements of one step after those of the other."""
    size = step.nnz_in(0)
    before = ca.SX.sym("before", size * count)
    every = [ca.SX.sym(f"all{i}", step.nnz_in(i) * count) for i in range(1, step.n_in())]
    state, rows = before[-size:], []
    for k in range(count):
        some = [one[k * one.numel() // count : (k + 1) * one.numel() // count] for one in every]
        found = step.call([state, *(ca.SX(step.sparsity_in(i), one) for i, one in enumerate(some, start=1))])
        state = ca.densify(found[0])
        rows.append([ca.vec(ca.densify(one)) for one in found])
    return ca.Function("row", [before, *every], [ca.vertcat(*parts) for parts in zip(*rows, strict=True)])


@lru_cache(maxsize=KEPT)
def mapped(function: ca.Function, n: int, same: tuple[int, ...] = ()) -> Mapped:
    """The same object for the same function and length."""
    return Mapped(function, n, same)


def flat(x: Array) -> Array:
    """(n, rows, cols) as rows of elements, column after column."""
    return np.ascontiguousarray(x.transpose(0, 2, 1)).reshape(len(x), -1)


def _row_major(a: Array, shape: tuple[int, int]) -> Array:
    found = np.ascontiguousarray(a, dtype=float)
    if found.size != shape[0] * shape[1]:
        raise ValueError(f"expected {shape}, not {a.shape}")
    return found.reshape(shape)


def _padded(a: Array, rows: int, size: int) -> Array:
    """Filled up with the last row."""
    out = np.empty((rows, size))
    out[: len(a)] = a.reshape(len(a), size)
    out[len(a) :] = out[len(a) - 1]
    return out
