"""The sigma-point filter as a graph: f and h are followed once with symbols, then all samples run without Python.

The step of `unscented`, written in CasADi's symbols; the covariance rides along as its lower triangle. What cannot be
followed (a branch on a value, a table, a library's own code) has no graph, and runs sample by sample in numpy.

Rules of this file: CasADi is loaded where a graph is made; a graph that does not tell what numpy does is thrown away.
"""

from __future__ import annotations

import operator
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.statespace.unscented import Map, NonlinearSystem, filtered

if TYPE_CHECKING:
    import casadi as ca

Array = NDArray[np.float64]

# Samples that one call of the graph goes through, and those that it is compared by with numpy.
PART, COMPARED = 500, 20
# Of the largest error: the same sums in another order differ by less.
ALIKE = 1e-7


class SymbolArray(np.ndarray):
    """An array of symbols that numpy's functions of values go through, the largest of two and choices among them."""

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """Element by element."""
        plain = [np.asarray(one) for one in inputs]
        own = _followed().get(ufunc.__name__) if method == "__call__" and not options else None
        if own is not None:
            return _symbols(np.frompyfunc(own, ufunc.nin, 1)(*plain))
        if "out" in options:
            options["out"] = tuple(np.asarray(one) for one in options["out"])
        return _symbols(getattr(ufunc, method)(*plain, **options))

    def __array_function__(self, func: Any, types: Any, args: Any, options: Any) -> Any:
        """What is made of ufuncs and copies; of a choice, the symbol of it."""
        if func is np.where and len(args) == 3:
            return _symbols(np.frompyfunc(_casadi().if_else, 3, 1)(*map(np.asarray, args)))
        return _symbols(super().__array_function__(func, types, args, options))


def _symbols(found: Any) -> Any:
    """A symbol alone, too, as an array."""
    if isinstance(found, np.ndarray):
        return found.view(SymbolArray)
    return as_array(found).reshape(()) if isinstance(found, _casadi().SX) and found.is_scalar() else found


def _casadi() -> Any:
    import casadi

    return casadi


def _followed() -> Mapping[str, Callable[..., Any]]:
    """Functions that numpy asks the truth of a value for, as symbols."""
    ca = _casadi()
    return {
        "maximum": ca.fmax, "minimum": ca.fmin, "fmax": ca.fmax, "fmin": ca.fmin, "sign": ca.sign,
        "absolute": ca.fabs, "fabs": ca.fabs, "arctan2": ca.atan2, "hypot": ca.hypot,
        "greater": operator.gt, "greater_equal": operator.ge, "less": operator.lt, "less_equal": operator.le,
        "clip": lambda x, low, high: ca.fmin(ca.fmax(x, low), high),
    }  # fmt: skip


def as_array(symbols: ca.SX) -> SymbolArray:
    """A matrix of symbols as an array that numpy takes."""
    out = np.empty(symbols.shape, dtype=object)
    for i, j in np.ndindex(*out.shape):
        out[i, j] = symbols[i, j]
    return out.view(SymbolArray)


def as_symbols(array: Any, shape: tuple[int, int]) -> ca.SX:
    """The other way, spread to a shape."""
    ca = _casadi()
    plain = np.broadcast_to(np.asarray(array, dtype=object).reshape(shape[0], -1), shape)
    return ca.vertcat(*[ca.horzcat(*row) for row in plain])  # type: ignore[no-any-return]


@dataclass(frozen=True)
class FilterGraph:
    """One step of the filter, (state, y, known, u, t, p) -> (next state, e), and the same over many samples."""

    step: ca.Function
    system: NonlinearSystem
    over: dict[int, ca.Function] = field(default_factory=dict)

    def run(self, y: Array, u: Array, t: Array, p: Array, x0: Array) -> tuple[Array, Array]:
        """Errors (n, ny, m) and predicted states (n, nx, m) of m parameter sets p (np, m) from x0 (nx, m).

        Where a covariance is lost, what follows is NaN.
        """
        rows, columns = _lower(self.system.nx)
        spread = np.repeat(self.system.spread[rows, columns][:, None], p.shape[1], axis=1)
        state: Any = np.vstack([x0, spread])
        errors, states = [], [x0[None]]
        for first in range(0, len(y), PART):
            part = slice(first, first + PART)
            state, x, e = self._part(y[part], u[part], t[part], p, state)
            errors.append(e)
            states.append(x)
        return np.concatenate(errors), np.concatenate(states)[:-1]

    def _part(self, y: Array, u: Array, t: Array, p: Array, state: Any) -> tuple[Any, Array, Array]:
        """The state after some samples, x after each of them, errors of each."""
        n, m = len(y), p.shape[1]
        if n not in self.over:
            self.over[n] = _repeated(self.step, n, self.system.nx)
        known = np.isfinite(y)
        signals = (np.where(known, y, 0.0), known.astype(float), u, t[:, None])
        last, *found = self.over[n](state, *(np.tile(one.T, (1, m)) for one in signals), np.repeat(p, n, axis=1))
        x, e = (np.asarray(one.full()).reshape(-1, m, n).transpose(2, 0, 1) for one in found)
        return last, x, e


def filter_graph(system: NonlinearSystem, y: Array, u: Array, t: Array, p: Array, x0: Array) -> FilterGraph | None:
    """The graph of a filter; None where f or h cannot be followed, or the graph tells otherwise than numpy at p, x0."""
    some = slice(0, COMPARED)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", FutureWarning)  # CasADi's, of numpy's functions of one symbol
            graph = FilterGraph(_step(system, u.shape[1], len(p)), system)
            own = graph.run(y[some], u[some], t[some], p[:, None], x0[:, None])[0]
            said = filtered(system, y[some], u[some], t[some], p[:, None], x0[:, None]).e
    except Exception:  # whatever a user's function says to symbols
        return None
    return graph if np.abs(own - said).max() <= ALIKE * (1.0 + np.abs(said).max()) else None


def _lower(nx: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.tril_indices(nx)


def _step(system: NonlinearSystem, nu: int, count: int) -> ca.Function:
    """As `unscented.filtered` goes from one sample to the next."""
    ca = _casadi()
    nx, ny = system.nx, system.ny
    rows, columns = _lower(nx)
    x, low, p = ca.SX.sym("x", nx), ca.SX.sym("low", len(rows)), ca.SX.sym("p", count)
    y, known, u, t = ca.SX.sym("y", ny), ca.SX.sym("known", ny), ca.SX.sym("u", nu), ca.SX.sym("t")
    cov = ca.SX(nx, nx)
    for place, (i, j) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True)):
        cov[i, j] = cov[j, i] = low[place]

    def called(of: Map, points: Any, size: int) -> Any:
        each = as_array(ca.repmat(p, 1, 2 * nx))
        at = as_array(t).reshape(())
        return as_symbols(of(as_array(points), as_array(u), each, at), (size, 2 * nx))  # type: ignore[arg-type]

    points, there = _points(x, cov)
    mean, off = _centred(called(system.h, points, ny))
    e = (y - mean) * known
    cross = (points - ca.repmat(x, 1, 2 * nx)) @ off.T / (2 * nx) * ca.repmat(known.T, nx, 1)
    used = (off @ off.T / (2 * nx) + system.r) * (known @ known.T) + ca.diag(1.0 - known)
    root = ca.chol(used)
    gain = ca.solve(root, ca.solve(root.T, cross.T)).T
    moved, still = _points(x + gain @ e, cov - gain @ used @ gain.T)
    x_next, off = _centred(called(system.f, moved, nx))
    spread = [
        ca.dot(off[i, :], off[j, :]) / (2 * nx) + system.q[i, j]
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True)
    ]  # fmt: skip
    # a bound of the user's (np.maximum) makes numbers of NaN again: what is lost stays lost
    seen = there * _is_definite(root)
    e, after = ca.if_else(seen, e, np.nan), ca.if_else(seen * still, ca.vertcat(x_next, *spread), np.nan)
    inputs = [ca.vertcat(x, low), y, known, u, t, p]
    return ca.Function("step", inputs, [after, e], {"cse": True})  # type: ignore[no-any-return]


def _repeated(step: ca.Function, n: int, nx: int) -> ca.Function:
    """Over n samples: the last state, x after each sample, the errors."""
    ca = _casadi()
    own = step.mapaccum(n)
    inputs = [ca.MX.sym(f"i{i}", own.sparsity_in(i)) for i in range(own.n_in())]
    states, errors = own(*inputs)
    return ca.Function("over", inputs, [states[:, -1], states[:nx, :], errors])  # type: ignore[no-any-return]


def _points(x: ca.SX, cov: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Sigma points, and whether the covariance has a root."""
    ca = _casadi()
    nx = x.shape[0]
    upper = ca.chol(cov)
    root = np.sqrt(nx) * upper.T
    middle = ca.repmat(x, 1, nx)
    return ca.horzcat(middle + root, middle - root), _is_definite(upper)


def _is_definite(root: ca.SX) -> ca.SX:
    """1 where the diagonal of a Cholesky factor is positive, 0 where it is not, or no number."""
    ca = _casadi()
    return ca.sum1(ca.diag(root) > 0) == root.shape[0]  # type: ignore[no-any-return]


def _centred(values: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Mean of the columns, and the columns less it."""
    ca = _casadi()
    mean = ca.sum2(values) / values.shape[1]
    return mean, values - ca.repmat(mean, 1, values.shape[1])
