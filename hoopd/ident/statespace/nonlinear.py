"""Nonlinear grey box: parameters and initial state that make the one-step errors of a sigma-point filter least.

Least squares within bounds (scipy's trust region); all differences of one derivative run through the filter together,
one-sided ones on the way, central ones for the covariance. A prior on the parameters makes it the maximum a posteriori.

Rules of this file: f and h are the user's and are called with arrays whose first axis is the state or the parameter,
once with arrays of symbols (`filter_graph`); CasADi functions f(x, u, p) and h(x, u, p) serve as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, optimize

from hoopd.ident.checks import check_channels, check_determined, unsettled
from hoopd.ident.data import Data, driving_data, experiments
from hoopd.ident.doubts import warn
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.loopchecks import check_record
from hoopd.ident.modelchecks import integrator
from hoopd.ident.statespace.filter_graph import FilterGraph, as_array, as_symbols, filter_graph
from hoopd.ident.statespace.nonlinear_prediction import best_start, nonlinear_system, predicted, simulated
from hoopd.ident.statespace.step_sizes import STEP, difference_steps, scales, variable_sizes
from hoopd.ident.statespace.unscented import Map, NonlinearSystem, filtered

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]

INTEGRATING = 2.0  # standard errors within which a pole cannot be told from 1
NEAR_MIDDLE = 1e-2  # of a state's largest value: steps of a linearisation nearer to zero stay as long as there
LOST = 1e6  # errors of a filter that diverged, in standard deviations


@dataclass(frozen=True, repr=False)
class Nonlinear(FreeModel):
    """Parameters and initial states (by experiment) with the covariance of both (order of `names`), errors, variance.

    `errors` (n, ny) of the first experiment one step ahead; `r` their covariance; `equations` holds the filter.
    """

    parameters: Mapping[str, float]
    starts: tuple[Array, ...]
    names: tuple[str, ...]
    covariance: Array
    errors: Array
    r: Array
    cost: float
    equations: NonlinearSystem
    evaluations: int
    dt: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def system(self) -> ct.NonlinearIOSystem:
        """From u to y, as python-control's nonlinear system; time counts from 0."""
        own, p = self.equations, self.p[:, None]
        return nonlinear_system(
            lambda x, u, t: np.ravel(own.f(x[:, None], u[:, None], p, t)),
            lambda x, u, t: np.ravel(own.h(x[:, None], u[:, None], p, t)),
            self.dt, (self.inputs, self.outputs), own.nx,
        )  # fmt: skip

    def simulate(self, data: Data | ArrayLike, x0: Any = "estimate", *, seed: int | None = None) -> Array:
        """Outputs (n, ny) from the inputs alone; from the estimated state of the data of the fit, unless one is given.

        A `seed` adds noise of the covariances q and r.
        """
        own = driving_data(data, self.equations.ny, len(self.inputs), self.dt)
        return simulated(self.equations, own.u, own.t, self.p, self._start(own, x0), seed)

    def predict(self, data: Data, horizon: float = 1, x0: Any = "estimate") -> Array:
        """Outputs (n, ny) from the inputs and from the outputs up to `horizon` samples before, by the filter."""
        if horizon == np.inf:
            return self.simulate(data, x0)
        return predicted(self.equations, data, self.p, self._start(data, x0), int(horizon))

    def _start(self, data: Data, x0: Any) -> Array:
        if not isinstance(x0, str):
            return np.asarray(x0, dtype=float).reshape(-1)
        if x0 == "zero":
            return np.zeros(self.equations.nx)
        return best_start(
            lambda one, start: simulated(self.equations, one.u, one.t, self.p, start), data, self.starts
        )  # fmt: skip

    @property
    def p(self) -> Array:
        """Parameters as an array."""
        return np.array(list(self.parameters.values()))

    def deviations(self) -> dict[str, float]:
        """Standard errors by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


@dataclass(frozen=True)
class _Task:
    system: NonlinearSystem
    each: Sequence[Data]
    count: int
    free_start: bool
    fixed: tuple[Array, ...]
    weight: Array  # (ny, ny)
    prior: Array | None  # standard deviations of the parameters
    centre: Array
    graph: FilterGraph | None  # of the filter, where f and h can be followed
    sizes: Array  # of the parameters, then of the initial states where they are free, in their units


@estimated("nonlinear grey box")
def nonlinear_pem(
    data: Data | Sequence[Data],
    f: Map | Any,
    h: Map | Any,
    p0: ArrayLike,
    x0: ArrayLike,
    *,
    process: ArrayLike,
    measurement: ArrayLike,
    spread: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    bounds: tuple[ArrayLike, ArrayLike] = (-np.inf, np.inf),
    estimate_x0: bool = True,
    prior: ArrayLike | None = None,
    vectorised: bool = True,
    iterations: int = 100,
    tolerance: float = 1e-8,
) -> Nonlinear:
    """Estimate parameters of x+ = f(x, u, p, t) + w, y = h(x, u, p, t) + v by the least prediction errors of a filter.

    A missing output corrects and counts nothing. To restart with other covariances, pass the former result's `p` and
    `starts[0]`.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    f, h : callable
        Next state (nx,) and output (ny,) of (x, u, p, t). Called once with arrays of symbols too, so that all samples
        run at once where neither branches on a value.
    p0 : array_like, shape (np,)
        Start of the parameters.
    x0 : array_like, shape (nx,)
        Start of the initial state.
    process : array_like, shape (nx, nx), or float
        Covariance of w.
    measurement : array_like, shape (ny, ny), or float
        Covariance of v.
    spread : array_like, shape (nx, nx), or float, optional
        Covariance of the initial state; `process` unless given.
    names : sequence of str, optional
        Names of the parameters.
    bounds : tuple of array_like
        Least and largest values of p.
    estimate_x0 : bool
        Whether the initial state of every experiment is estimated too.
    prior : array_like, shape (np,), or float, optional
        Standard deviations of p about p0 (pull to the guess).
    vectorised : bool
        Whether f and h take x (nx, m) and p (np, m) and index the first axis; otherwise they are called column by
        column.
    iterations : int
        At most so many steps.
    tolerance : float
        Relative change at which the search ends.

    Returns
    -------
    Nonlinear
        The `parameters` by name, initial states `starts` by experiment, the `covariance` of both, `errors` (n, ny) of
        the first experiment one step ahead, and their covariance `r`; `deviations()` are the standard errors.

    Raises
    ------
    ValueError
        A start that is not finite, outside its bounds, or whose filter diverges.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, nonlinear_pem
    >>> def f(x, u, p, t):  # drag
    ...     return x + 0.3 * (u - p[0] * x * abs(x))
    >>> u, e = np.random.default_rng(0).standard_normal((2, 150))
    >>> x = [np.array([1.0])]
    >>> for k in range(149):
    ...     x.append(f(x[-1], u[k] + 1.0, [0.8], 0.0))
    >>> data = iddata(np.array(x) + 0.01 * e[:, None], u + 1.0)
    >>> found = nonlinear_pem(data, f, lambda x, u, p, t: x, p0=[0.5], x0=[1.5], process=1e-6, measurement=1e-4)
    >>> found.p.round(1)
    array([0.8])
    """
    each = experiments(data)
    check_channels(each)
    check_record(each, drift=False)  # a slow plant is no integrator, and the equations are the user's
    p, start = np.atleast_1d(np.asarray(p0, dtype=float)), np.atleast_1d(np.asarray(x0, dtype=float))
    if not (np.isfinite(p).all() and np.isfinite(start).all()):
        raise ValueError("the guess of the parameters and of the initial state must be finite")
    low, high = (np.broadcast_to(np.asarray(side, dtype=float), p.shape) for side in bounds)
    if ((p < low) | (p > high)).any():
        raise ValueError(f"parameter {int(np.argmax((p < low) | (p > high)))} starts outside its bounds")
    q, r = _matrix(process, len(start), "process"), _matrix(measurement, each[0].ny, "measurement")
    system = NonlinearSystem(
        _callable(f, vectorised), _callable(h, vectorised), len(start), each[0].ny, q, r,
        q if spread is None else _matrix(spread, len(start), "spread"),
    )  # fmt: skip
    weight = np.linalg.inv(np.linalg.cholesky(r))
    sd = None if prior is None else np.broadcast_to(np.asarray(prior, dtype=float), p.shape)
    graph = filter_graph(system, each[0].y, each[0].u, each[0].t, p, start)
    none = np.ones(len(p) + len(start) * len(each) * estimate_x0)
    task = _Task(system, each, len(p), estimate_x0, tuple(start for _ in each), weight, sd, p, graph, none)
    task = replace(task, sizes=_sizes(task, (low, high)))
    return _minimised(task, _names(names, len(p)), (low, high), iterations, tolerance)


def _minimised(
    task: _Task, names: tuple[str, ...], bounds: tuple[Array, Array], iterations: int, tolerance: float
) -> Nonlinear:
    z = _first(task)
    if _errors(task, z[:, None]).max() >= LOST:
        raise ValueError("the filter diverges from the guess: start elsewhere, or give more process noise")
    far = np.full(len(z) - task.count, np.inf)
    # one factor for all: without it, tolerances would depend on the scale of the noise
    level = np.sqrt(np.mean(np.square(_errors(task, z[:, None])[: _count(task)])) * _count(task)) + 1e-300
    # in the variables' own units the search's tolerances would hold for large ones alone
    own = scales(task.sizes)
    latest: dict[bytes, Array] = {}

    def errors(v: Array) -> Array:
        latest.clear()
        latest[v.tobytes()] = _errors(task, (v * own)[:, None])
        return np.asarray(latest[v.tobytes()][:, 0] / level)

    found = optimize.least_squares(
        errors, z / own, lambda v: _one_sided(task, v * own, bounds, latest.get(v.tobytes())) * own / level,
        (np.concatenate([bounds[0], -far]) / own, np.concatenate([bounds[1], far]) / own), x_scale="jac",
        ftol=tolerance, xtol=tolerance, gtol=1e-12, max_nfev=iterations,
    )  # fmt: skip
    if found.status == 0:
        unsettled(int(found.nfev))
    return _result(task, names, found.x * own, bounds, int(found.nfev))


def _first(task: _Task) -> Array:
    """The variables that the search begins with."""
    return np.concatenate([task.centre, *(task.fixed if task.free_start else ())])


def _sizes(task: _Task, bounds: tuple[Array, Array]) -> Array:
    """Sizes of all variables, by what they change of the outputs where they are small."""
    z = _first(task)
    here, outputs = _errors(task, z[:, None]), [np.nan_to_num(one.y) @ task.weight.T for one in task.each]
    power = float(np.sqrt(sum(np.vdot(y, y) for y in outputs)))
    if power == 0.0:
        return np.where(z == 0.0, 1.0, np.abs(z))

    def share(sets: Array) -> Array:
        return np.asarray(np.linalg.norm((_errors(task, sets) - here)[: _count(task)], axis=0) / power)

    far = np.full(len(z) - task.count, np.inf)
    return variable_sizes(share, z, (np.concatenate([bounds[0], -far]), np.concatenate([bounds[1], far])))


def _result(task: _Task, names: tuple[str, ...], z: Array, bounds: tuple[Array, Array], evaluations: int) -> Nonlinear:
    p, starts = z[: task.count], _starts(task, z[:, None])
    own = [_filter(task, one, p[:, None], x)[0][:, :, 0] for one, x in zip(task.each, starts, strict=True)]
    seen = [e[np.isfinite(one.y).all(axis=1)] for e, one in zip(own, task.each, strict=True)]
    errors = np.vstack(seen) if sum(map(len, seen)) > task.system.ny else np.vstack(own)
    r = errors.T @ errors / len(errors)
    whiten = np.linalg.inv(np.linalg.cholesky(r + 1e-18 * np.trace(r) * np.eye(len(r)) + 1e-300 * np.eye(len(r))))
    j = _central(replace(task, weight=whiten), z, bounds)
    scale = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    labels = names + tuple(
        f"x0[{i}]@{k}" for k in range(len(task.each) * task.free_start) for i in range(task.system.nx)
    )
    gram = (j / scale).T @ (j / scale)
    check_determined(gram, labels)
    covariance = linalg.pinvh(gram, rtol=1e-12) / np.outer(scale, scale)
    cost = float(np.mean(np.square(errors)))
    first = tuple(x[:, 0] for x in starts)
    _check_integrator(task, z, covariance)
    return Nonlinear(
        dict(zip(names, p.tolist(), strict=True)), first, labels, covariance, own[0], r, cost, task.system, evaluations,
        task.each[0].dt, task.each[0].inputs, task.each[0].outputs,
    )  # fmt: skip


def _check_integrator(task: _Task, z: Array, covariance: Array) -> None:
    """Warn of a pole of the linearisation about the middle of the first record that cannot be told from 1."""
    one, m = task.each[0], task.count
    states = _filter(task, one, z[:m, None], _starts(task, z[:, None])[0])[1]
    x, u = np.median(states[:, :, 0], axis=0), np.median(one.u, axis=0)
    h = difference_steps(z[:m], task.sizes[:m])
    sets = np.column_stack([z[:m], z[:m, None] + np.diag(h)])
    sizes = np.abs(states[:, :, 0]).max(axis=0)
    poles = np.array([_nearest_to_one(task.system, x, np.where(sizes > 0.0, sizes, 1.0), u, p) for p in sets.T])
    slope = (poles[1:] - poles[0]) / h
    spread = float(np.sqrt(max(float((slope.conj() @ covariance[:m, :m] @ slope).real), 0.0)))
    if abs(poles[0] - 1.0) < max(INTEGRATING * spread, np.sqrt(STEP) * STEP):
        warn(integrator(complex(poles[0]), sum(each.n for each in task.each)))


def _nearest_to_one(system: NonlinearSystem, x: Array, sizes: Array, u: Array, p: Array) -> complex:
    h = STEP * np.maximum(np.abs(x), NEAR_MIDDLE * sizes)
    points = x[:, None] + np.hstack([np.diag(h), -np.diag(h)])
    moved = np.asarray(system.f(points, u[:, None], np.repeat(p[:, None], 2 * len(x), axis=1), 0.0), dtype=float)
    moved = np.broadcast_to(moved.reshape(len(x), -1), points.shape)
    found = np.linalg.eigvals((moved[:, : len(x)] - moved[:, len(x) :]) / (2.0 * h))
    return complex(found[np.argmin(np.abs(found - 1.0))])


def _errors(task: _Task, z: Array) -> Array:
    """(rows, m) weighted errors of m sets of variables (count, m), and the prior's."""
    p = z[: task.count]
    rows = []
    for one, x in zip(task.each, _starts(task, z), strict=True):
        e = _filter(task, one, p, x)[0]
        rows.append(np.einsum("ab,nbm->nam", task.weight, e).reshape(-1, z.shape[1]))
    if task.prior is not None:
        rows.append((p - task.centre[:, None]) / task.prior[:, None])
    found = np.vstack(rows)
    return np.where(np.isfinite(found), np.clip(found, -LOST, LOST), LOST)


def _filter(task: _Task, one: Data, p: Array, x: Array) -> tuple[Array, Array]:
    """Errors (n, ny, m) and predicted states (n, nx, m); where a covariance is lost, errors of a filter that diverged.

    By the graph, a set that is lost takes no other with it.
    """
    with np.errstate(all="ignore"):
        if task.graph is not None:
            return task.graph.run(one.y, one.u, one.t, p, x)
        try:
            found = filtered(task.system, one.y, one.u, one.t, p, x)
        except np.linalg.LinAlgError:
            m = p.shape[1]
            return np.full((one.n, task.system.ny, m), LOST), np.full((one.n, task.system.nx, m), LOST)
        return found.e, found.x


def _starts(task: _Task, z: Array) -> tuple[Array, ...]:
    """Initial states (nx, m) by experiment."""
    if not task.free_start:
        return tuple(np.repeat(x[:, None], z.shape[1], axis=1) for x in task.fixed)
    nx = task.system.nx
    return tuple(z[task.count + i * nx : task.count + (i + 1) * nx] for i in range(len(task.each)))


def _central(task: _Task, z: Array, bounds: tuple[Array, Array]) -> Array:
    """Derivatives of `_errors` at z by central differences, one-sided at a bound, all in one run of the filter."""
    h = difference_steps(z, task.sizes)
    sets = z[:, None] + np.concatenate([np.diag(h), -np.diag(h)], axis=1)
    sets[: task.count] = np.clip(sets[: task.count], bounds[0][:, None], bounds[1][:, None])
    m = len(z)
    found, width = _errors(task, sets), (sets[:, :m] - sets[:, m:]).diagonal()
    return np.asarray((found[:, :m] - found[:, m:]) / np.where(width == 0.0, np.inf, width))


def _one_sided(task: _Task, z: Array, bounds: tuple[Array, Array], here: Array | None) -> Array:
    """The same by half the runs, good enough to find the way by; `here` are the errors (rows, 1) at z, if known."""
    h = difference_steps(z, task.sizes)
    above = np.concatenate([bounds[1], np.full(len(z) - task.count, np.inf)])
    steps = np.diag(np.where(z + h > above, -h, h))
    here = _errors(task, z[:, None]) if here is None else here
    return np.asarray((_errors(task, z[:, None] + steps) - here) / steps.diagonal())


def _count(task: _Task) -> int:
    return sum(one.y.size for one in task.each)


def _names(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    own = tuple(names) if names is not None else tuple(f"p{i + 1}" for i in range(count))
    if len(own) != count or len(set(own)) != count:
        raise ValueError(f"{count} different names wanted, not {list(own)}")
    return own


def _matrix(given: ArrayLike, size: int, name: str) -> Array:
    """A covariance from a number, a diagonal or a matrix."""
    values = np.asarray(given, dtype=float)
    found = values * np.eye(size) if values.ndim == 0 else np.diag(values) if values.ndim == 1 else values
    if found.shape != (size, size) or not np.isfinite(found).all() or np.linalg.eigvalsh(found).min() <= 0.0:
        raise ValueError(f"{name} must be a positive definite ({size}, {size}) covariance")
    return np.asarray(found)


def _callable(of: Any, vectorised: bool) -> Map:
    """The user's function in the filter's form."""
    if type(of).__module__.startswith("casadi"):
        return lambda x, u, p, t: _casadis(of, x, u, p)
    if vectorised:
        return of  # type: ignore[no-any-return]

    def by_column(x: Array, u: Array, p: Array, t: float) -> Array:
        return np.stack([np.asarray(of(x[:, i], u[:, 0], p[:, i], t), dtype=x.dtype) for i in range(x.shape[1])], 1)

    return by_column


def _casadis(of: Any, x: Array, u: Array, p: Array) -> Array:
    """A CasADi function of arrays, of numbers or of symbols."""
    if x.dtype != object:
        return np.asarray(of(x, np.repeat(u, x.shape[1], axis=1), p).full())
    columns = [of(*(as_symbols(one, (len(one), 1)) for one in (x[:, i], u[:, 0], p[:, i]))) for i in range(x.shape[1])]
    return np.hstack([as_array(one) for one in columns])
