"""A CasADi function at many nodes at once: its operations one after the other, each over all nodes by numpy.

CasADi's own map goes through all operations at one node, then at the next, some 4 ns an operation and node; over
thousands of nodes numpy takes a quarter of that. What depends on arguments alone that are the same at every node is
computed once.

Rules of this file: the operations of SX functions, no model; a function with an operation that is not in the tables is
not taken (`takes`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _if_else_zero(x: Any, y: Any, out: Any = None) -> Any:
    """y where x is not 0, else 0."""
    if out is None:
        return np.where(np.asarray(x) != 0.0, y, 0.0)
    # the result may have the memory of either
    nothing = np.equal(x, 0.0)
    np.copyto(out, y)
    np.copyto(out, 0.0, where=nothing)
    return out


def _and(x: Any, y: Any, out: Any = None) -> Any:
    return np.logical_and(x, y, out=out)


def _twice(x: Any, out: Any = None) -> Any:
    return np.multiply(x, 2.0, out=out)


def _inverse(x: Any, out: Any = None) -> Any:
    return np.divide(1.0, x, out=out)


UNARY: Mapping[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: np.positive, ca.OP_NEG: np.negative, ca.OP_EXP: np.exp, ca.OP_LOG: np.log, ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: np.square, ca.OP_TWICE: _twice, ca.OP_SIN: np.sin, ca.OP_COS: np.cos, ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin, ca.OP_ACOS: np.arccos, ca.OP_ATAN: np.arctan, ca.OP_NOT: np.logical_not,
    ca.OP_FLOOR: np.floor, ca.OP_CEIL: np.ceil, ca.OP_FABS: np.fabs, ca.OP_SIGN: np.sign, ca.OP_INV: _inverse,
    ca.OP_SINH: np.sinh, ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh, ca.OP_LOG1P: np.log1p, ca.OP_EXPM1: np.expm1,
}  # fmt: skip
BINARY: Mapping[int, Callable[..., Any]] = {
    ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply, ca.OP_DIV: np.divide, ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power, ca.OP_LT: np.less, ca.OP_LE: np.less_equal, ca.OP_EQ: np.equal, ca.OP_NE: np.not_equal,
    ca.OP_AND: _and, ca.OP_OR: np.logical_or, ca.OP_FMOD: np.fmod, ca.OP_COPYSIGN: np.copysign,
    ca.OP_IF_ELSE_ZERO: _if_else_zero, ca.OP_FMIN: np.fmin, ca.OP_FMAX: np.fmax, ca.OP_ATAN2: np.arctan2,
    ca.OP_HYPOT: np.hypot,
}  # fmt: skip


class VectorOperation(NamedTuple):
    """One step: where its result goes, where its operands are; of a constant, an input or a result, which."""

    kind: int
    out: tuple[int, ...]
    operands: tuple[int, ...]
    constant: float


def takes(function: ca.Function) -> bool:
    """Whether all operations are in the tables."""
    return bool(function.is_a("SXFunction")) and _operations(function) is not None


@lru_cache(maxsize=512)
def _operations(function: ca.Function) -> tuple[VectorOperation, ...] | None:
    known, found = {*UNARY, *BINARY, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}, []
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        if kind not in known:
            return None
        constant = function.instruction_constant(k) if kind == ca.OP_CONST else 0.0
        found.append(
            VectorOperation(kind, tuple(function.instruction_output(k)), tuple(function.instruction_input(k)), constant)
        )
    return tuple(found)


class Vectorised:
    """A function for n nodes; of the arguments in `same` there is one row for all of them."""

    def __init__(self, function: ca.Function, n: int, same: Sequence[int] = ()) -> None:
        operations = _operations(function)
        if operations is None:
            raise ValueError(f"{function.name()} has operations that are not in the tables")
        self._n, self._same = n, frozenset(same)
        self._shapes = [(n, function.size2_out(i), function.size1_out(i)) for i in range(function.n_out())]
        self._places = [_places(function.sparsity_out(i)) for i in range(function.n_out())]
        self._slots = int(function.sz_w())
        self._plan = list(self._planned(operations, function.sz_w()))

    def _planned(self, operations: Sequence[VectorOperation], slots: int) -> Any:
        """(what, function, slot, operand, operand): 0 constant, 1 argument, 2 result, 3, 4 once, 5, 6 at all nodes."""
        once = [True] * slots
        for one in operations:
            if one.kind == ca.OP_CONST:
                once[one.out[0]] = True
                yield 0, None, one.out[0], one.constant, 0
            elif one.kind == ca.OP_INPUT:
                once[one.out[0]] = one.operands[0] in self._same
                yield 1, None, one.out[0], *one.operands
            elif one.kind == ca.OP_OUTPUT:
                yield 2, None, one.operands[0], *one.out
            elif one.kind in UNARY:
                a, out = one.operands[0], one.out[0]
                yield (3 if once[a] else 5), UNARY[one.kind], out, a, 0
                once[out] = once[a]
            else:
                (a, b), out = one.operands, one.out[0]
                alone = once[a] and once[b]
                yield (4 if alone else 6), BINARY[one.kind], out, a, b
                once[out] = alone

    def __call__(self, *arguments: Array) -> list[Array]:
        """Results (n, cols, rows) of arguments (n, elements), or (1, elements) of what is the same everywhere."""
        columns = [a[0].tolist() if i in self._same else np.ascontiguousarray(a.T) for i, a in enumerate(arguments)]
        results, places = [np.zeros(shape) for shape in self._shapes], self._places
        work = list(_workspace(self._slots * self._n).reshape(self._slots, self._n))
        w: list[Any] = [0.0] * self._slots
        with np.errstate(all="ignore"):
            for what, function, out, a, b in self._plan:
                if what == 6:
                    w[out] = function(w[a], w[b], out=work[out])
                elif what == 5:
                    w[out] = function(w[a], out=work[out])
                elif what == 2:
                    results[a][:, places[a][0][b], places[a][1][b]] = w[out]
                elif what == 4:
                    w[out] = float(function(w[a], w[b]))
                elif what == 3:
                    w[out] = float(function(w[a]))
                elif what == 1:
                    w[out] = columns[a][b]
                else:
                    w[out] = a
        return results


_scratch = threading.local()


def _workspace(size: int) -> Array:
    """(size,) numbers that belong to nobody between two calls; one for each thread."""
    held: Array | None = getattr(_scratch, "held", None)
    if held is None or len(held) < size:
        held = _scratch.held = np.empty(size)
    return held[:size]


def _places(pattern: ca.Sparsity) -> tuple[list[int], list[int]]:
    """Column and row of every element of a result."""
    rows, columns = pattern.get_triplet()
    return list(columns), list(rows)
