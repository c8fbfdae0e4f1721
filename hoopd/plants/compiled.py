"""CasADi functions behind buffers of their own, called once or over many rows, and the linear model over a held input.

Rules of this file: nothing here knows a plant. The buffers of one object are shared by its calls: it belongs to one
thread.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

# Rows in one call: few enough to be written out in a millisecond, many enough that the call costs nothing.
CHUNK = 50
# Functions of many steps that are kept for the next model of the same kind.
KEPT = 32


class Call:
    """A CasADi function behind preallocated buffers: a call costs a copy and the arithmetic, a few microseconds."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._arguments = [np.zeros(function.size1_in(i)) for i in range(function.n_in())]
        # CasADi is column-major: a matrix is kept as its transpose and handed out as a transposed view
        self._results = [np.zeros((function.size2_out(i), function.size1_out(i))) for i in range(function.n_out())]
        self._buffer, self._trigger = function.buffer()
        for index, array in enumerate(self._arguments):
            self._buffer.set_arg(index, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]
        for index, result in enumerate(self._results):
            self._buffer.set_res(index, memoryview(result))  # type: ignore[call-arg, arg-type, unused-ignore]
        self.x = self._arguments[0]
        self._scalars: list[Any] = [
            memoryview(array)  # type: ignore[arg-type, unused-ignore]
            for array in self._arguments[1:]
        ]  # numpy takes longer for one number
        self._wide = any(array.size > 1 for array in self._arguments[1:])
        if self._wide:
            self._scalars = [*self._arguments[1:]]
        self._first: Vector = self._results[0][0]

    def __reduce__(self) -> tuple[type[Call], tuple[ca.Function]]:
        """To another process go the instructions, which give the same bits there; buffers are its own."""
        return Call, (self._function,)

    def vector(self, x: ArrayLike, *scalars: Any) -> Vector:
        """First result as a new vector."""
        self.x[:] = x
        if self._wide:
            for array, values in zip(self._scalars, scalars, strict=True):
                array[:] = values
        else:
            for array, value in zip(self._scalars, scalars, strict=True):
                array[0] = value
        self._trigger()
        return self._first.copy()

    def matrix(self, index: int) -> Matrix:
        """Result `index` of the last call as a new matrix."""
        return self._results[index].T.copy()


class Chunks:
    """A function of CHUNK columns, called for any number of rows; parameters last, for all the same."""

    def __init__(self, function: ca.Function, *, accumulates: bool = False) -> None:
        self._function, self._accumulates = function, accumulates
        self._buffer, self._trigger = function.buffer()
        self._last = function.n_in() - 1
        self._start = np.zeros(function.size1_in(0))
        self._p = np.zeros((CHUNK, function.size1_in(self._last)))
        self._set(self._last, self._p)
        if accumulates:
            self._set(0, self._start)

    def __call__(self, start: Vector | None, columns: Sequence[Vector], p: Vector) -> Vector:
        """Results (n, k) for arguments of n rows each; `start` (k,) where each result is the next one's beginning."""
        count = len(columns[0])
        # the last chunk is filled up by repeating its last row
        rows = np.minimum(np.arange(-(-count // CHUNK) * CHUNK), count - 1)
        filled = [np.ascontiguousarray(np.atleast_2d(one.T).T[rows]) for one in columns] if count else []
        out = np.empty((len(rows), self._function.size1_out(0)))
        self._p[:] = p
        if start is not None:
            self._start[:] = start
        for begin in range(0, len(rows), CHUNK):
            part = slice(begin, begin + CHUNK)
            for index, array in enumerate(filled):
                self._set(index + int(self._accumulates), array[part])
            self._buffer.set_res(0, memoryview(out[part]))  # type: ignore[call-arg, arg-type, unused-ignore]
            self._trigger()
            if self._accumulates:
                self._start[:] = out[part][-1]
        return out[:count]

    def _set(self, index: int, array: Vector) -> None:
        self._buffer.set_arg(index, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]


# The functions made last: a fit makes several models of one kind in a row.
_FUNCTIONS: OrderedDict[Hashable, ca.Function] = OrderedDict()


def kept(key: Hashable, make: Callable[[], ca.Function]) -> ca.Function:
    """CHUNK steps of a function, made once for models of the same kind."""
    if key not in _FUNCTIONS:
        _FUNCTIONS[key] = make().mapaccum("steps", CHUNK)
        while len(_FUNCTIONS) > KEPT:
            _FUNCTIONS.popitem(last=False)
    _FUNCTIONS.move_to_end(key)
    return _FUNCTIONS[key]


def zero_order_hold(a: Matrix, b: Matrix, h: float) -> tuple[Matrix, Matrix]:
    """Give Ad, Bd of dx/dt = A x + B u held over `h`: exp([[A, B], [0, 0]] h) by a scaled Taylor series.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        A.
    b : ndarray, shape (n, m)
        B.
    h : float
        Step in s.

    Returns
    -------
    ad : ndarray, shape (n, n)
        Ad.
    bd : ndarray, shape (n, m)
        Bd.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.compiled import zero_order_hold
    >>> ad, bd = zero_order_hold(np.array([[-2.0]]), np.array([[1.0]]), 0.1)
    >>> ad.round(4), bd.round(4)  # exp(-0.2) and (1 - exp(-0.2))/2
    (array([[0.8187]]), array([[0.0906]]))
    """
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a * h, b * h
    # scale until the norm is below 1/8, where 12 terms reach rounding (1/8^13/13! < 1e-21), then square back
    squarings = max(0, math.ceil(math.log2(max(float(np.linalg.norm(block, 1)), 1e-300) * 8)))
    scaled = block / 2**squarings
    term = result = np.eye(n + m)
    for k in range(1, 13):
        term = term @ scaled / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result[:n, :n], result[:n, n:]
