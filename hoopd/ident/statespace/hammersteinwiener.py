"""A linear model between static nonlinearities of known shape and unknown parameters.

v = g(u, p), x+ = A x + B v + K e, z = C x + D v, y = h(z, p) + e. All matrices (in minimal local coordinates), p and
the initial states are fitted by damped least squares (`hammersteinerrors` has errors and derivatives). Behind a map
that hides signs the cost has many minima: hence many starts.

Rules of this file: maps take signals (channels, n) with time along the last axis, and keep it; the same seed gives the
same starts.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from hoopd.ident.checks import Orders, check, check_channels, check_determined, unsettled
from hoopd.ident.damped_least_squares import Damping, Ends, NormalEquations, minimise
from hoopd.ident.data import Data, driving_data, experiments
from hoopd.ident.doubts import IdentificationWarning
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.loopchecks import check_record
from hoopd.ident.modelchecks import check_model
from hoopd.ident.models import Innovations, standard_errors
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.coloured import autoregression_of, together
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.hammersteinerrors import (
    HammersteinTask,
    SearchPoint,
    Static,
    evaluated,
    gradient_covariance,
    normal_equations,
    parameter_sizes,
    same,
    weighted_by,
)
from hoopd.ident.statespace.linear import states
from hoopd.ident.statespace.nonlinear_prediction import best_start, nonlinear_system
from hoopd.ident.statespace.ordering import check_states
from hoopd.ident.statespace.sensitivities import paired, piece
from hoopd.ident.statespace.subspace import check_focus, subspaceid
from hoopd.ident.statespace.subspacefit import Focus

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]

SCREEN = 30  # steps that every start gets
FINISHED = 6  # starts that are then brought to their minimum
EXACT = 1e-20  # of the outputs' power: nothing is left to fit
DAMPING = Damping(first=1e-3, easier=0.2, harder=8.0, least=1e-9, again=1e-6, trials=10)
ROUNDS = 2  # of weights of the outputs
AGREE = 1.01  # two starts that end within a percent of the least cost have found the same minimum


@dataclass(frozen=True, repr=False)
class HammersteinWiener(FreeModel):
    """The linear part, the parameters of the maps with their covariance, initial states by experiment, errors."""

    linear: Innovations
    parameters: Mapping[str, float]
    covariance: Array
    starts: tuple[Array, ...]
    cost: float
    r: Array
    input_map: Static
    output_map: Static
    costs: tuple[float, ...]  # of the starts that were finished, the least first; of several outputs in their sizes
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.linear.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.linear.outputs

    @property
    def system(self) -> ct.NonlinearIOSystem:
        """From u to y, as python-control's nonlinear system."""
        own = self.linear
        return nonlinear_system(
            lambda x, u, t: own.a @ x + own.b @ self._driving(u[:, None])[:, 0],
            lambda x, u, t: self._measured(own.c @ x + own.d @ self._driving(u[:, None])[:, 0]),
            own.dt, (self.inputs, self.outputs), own.nx,
        )  # fmt: skip

    def deviations(self) -> dict[str, float]:
        """Standard errors of the maps' parameters by name."""
        return standard_errors(tuple(self.parameters), self.covariance)

    @property
    def p(self) -> Array:
        """Parameters of the maps as an array."""
        return np.array(list(self.parameters.values()))

    def simulate(self, data: Data | ArrayLike, x0: Any = "estimate", *, seed: int | None = None) -> Array:
        """Outputs (n, ny) from the inputs alone; the state that fits the first outputs, rest ("zero"), or a given one.

        A `seed` adds white noise of covariance r to the outputs.
        """
        own = driving_data(data, len(self.outputs), len(self.inputs), self.linear.dt)
        said = self._simulated(own, self._start(own, x0))
        if seed is None:
            return said
        return said + np.random.default_rng(seed).multivariate_normal(np.zeros(len(self.r)), self.r, own.n)

    def predict(self, data: Data, horizon: float = 1, x0: Any = "estimate") -> Array:
        """Outputs (n, ny) from the inputs and from the outputs up to `horizon` samples before, by the gain K."""
        if horizon == np.inf or not self.linear.k.any():
            return self.simulate(data, x0)
        v, own, h = self._driving(np.ascontiguousarray(data.u.T)), self.linear, int(horizon)
        driven, direct = own.b @ v, own.d @ v
        now, seen, out = self._start(data, x0), np.empty((own.nx, data.n)), np.empty((data.n, len(self.outputs)))
        for i in range(data.n):
            seen[:, i] = now
            e = data.y[i] - self._measured(own.c @ now + direct[:, i])
            now = own.a @ now + driven[:, i] + own.k @ np.nan_to_num(e)
        for i in range(data.n):
            first = max(i - h + 1, 0)
            x = seen[:, first]
            for j in range(first, i):
                x = own.a @ x + driven[:, j]
            out[i] = self._measured(own.c @ x + direct[:, i])
        return out

    def _driving(self, u: Array) -> Array:
        """v (linear inputs, n) of u (nu, n)."""
        return np.asarray(self.input_map(u, self.p), dtype=float)

    def _measured(self, z: Array) -> Array:
        """y (ny,) of z (ny,)."""
        return np.asarray(self.output_map(z[:, None], self.p), dtype=float)[:, 0]

    def _simulated(self, data: Data, x0: Array) -> Array:
        v = self._driving(np.ascontiguousarray(data.u.T))
        x = states(self.linear.a, self.linear.b @ v, x0)
        return np.asarray(self.output_map(self.linear.c @ x + self.linear.d @ v, self.p).T)

    def _start(self, data: Data, x0: Any) -> Array:
        if not isinstance(x0, str):
            return np.asarray(x0, dtype=float).reshape(-1)
        return np.zeros(self.linear.nx) if x0 == "zero" else best_start(self._simulated, data, self.starts)


@estimated("Hammerstein-Wiener")
def hammerstein_wiener(
    data: Data | Sequence[Data],
    order: int,
    p0: ArrayLike,
    *,
    input_map: Static | None = None,
    output_map: Static | None = None,
    linear_inputs: int | None = None,
    names: Sequence[str] | None = None,
    start: Innovations | None = None,
    direct: bool = False,
    focus: Focus = "simulation",
    starts: int = 20,
    seed: int = 0,
    iterations: int = 60,
) -> HammersteinWiener:
    """Estimate a linear model between static nonlinearities of known shape and unknown parameters.

    v = g(u, p), x+ = A x + B v + K e, z = C x + D v, y = h(z, p) + e. The model of least squared errors, each output
    beside the size of its errors, is looked for from many starts: `start` or a subspace estimate, then random stable
    ones. The search ends early when two starts agree on the least cost. Missing outputs are left out.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    order : int
        States of the linear part.
    p0 : array_like, shape (np,)
        Start of the parameters of the maps.
    input_map : callable, optional
        (u, p) -> (linear_inputs, n), elementwise in time, of u (nu, n).
    output_map : callable, optional
        (z, p) -> (ny, n), elementwise in time.
    linear_inputs : int, optional
        Inputs of the linear part; as many as of the data unless given.
    names : sequence of str, optional
        Names of the parameters.
    start : Innovations, optional
        The linear part to begin with.
    direct : bool
        Whether D is estimated.
    focus : {"simulation", "prediction"}
        The latter fits K too, from the best simulation.
    starts : int
        At most so many.
    seed : int
        Of the random starts.
    iterations : int
        Steps from each start at most.

    Returns
    -------
    HammersteinWiener
        The `linear` part, the `parameters` by name with their `covariance` (of a simulation with the errors' colour),
        initial states, errors; it can `simulate(data)`.

    Raises
    ------
    ValueError
        Maps whose shapes do not fit, no start with a finite simulation, options that are none.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 5.2.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import hammerstein_wiener, iddata
    >>> def dead_zone(u, p):
    ...     return np.sign(u) * np.maximum(np.abs(u) - p[0], 0.0)
    >>> u, e = np.random.default_rng(0).standard_normal((2, 300))
    >>> y = lfilter([0.0, 1.0], [1.0, -0.7], dead_zone(u, [0.5])) + 0.01 * e
    >>> found = hammerstein_wiener(iddata(y, u), 1, [0.2], input_map=dead_zone, names=["half width"], starts=3)
    >>> round(float(found.parameters["half width"]), 2), found.linear.a.round(2)
    (0.5, array([[0.7]]))
    """
    each = experiments(data)
    check_channels(each)
    check_record(each, drift=False)
    check_focus(focus)
    if min(order, iterations) < 1:
        raise ValueError(f"order and iterations are from 1 on, not {order} and {iterations}")
    p = np.atleast_1d(np.asarray(p0, dtype=float))
    own = tuple(names) if names is not None else tuple(f"p{i + 1}" for i in range(len(p)))
    if len(own) != len(p) or len(set(own)) != len(p):
        raise ValueError(f"{len(p)} different names wanted, not {list(own)}")
    task = HammersteinTask(
        [piece(one) for one in each], input_map or same, output_map or same, Freedom(direct, False),
        np.ones(each[0].ny), np.ones(len(p)),
    )  # fmt: skip
    _check_maps(task, p, each[0], linear_inputs)
    task = weighted_by(replace(task, sizes=parameter_sizes(task, p)), None)
    first = start or _approximation(task, each, order, p)
    found = _search(task, first, order, p, starts, np.random.default_rng(seed), iterations)
    best = found[0]
    if not np.isfinite(best.cost):
        raise ValueError("no start gave a finite simulation")
    task, best = _reweighted(task, best, iterations)
    if focus == "prediction":
        task = replace(task, free=Freedom(direct, True))
        task, best = _reweighted(task, _minimised(task, best, iterations), iterations)
    if not best.ended:
        unsettled(iterations)
    _check_linear(task, best, each)
    return _result(task, best, own, [one.cost for one in found], each[0])


def _reweighted(task: HammersteinTask, best: SearchPoint, iterations: int) -> tuple[HammersteinTask, SearchPoint]:
    """Minima under weights of the outputs that are renewed from their errors."""
    for _ in range(ROUNDS if len(task.weight) > 1 else 0):
        task = weighted_by(task, best)
        best = _minimised(task, evaluated(task, best.model, best.p, best.starts), iterations)
    return task, best


def _check_linear(task: HammersteinTask, best: SearchPoint, each: Sequence[Data]) -> None:
    """The checks of the linear part; its order by the data where the output is its own, else only what drives it."""
    driven = [_driven(one, path.v) for one, path in zip(each, best.paths, strict=True)]
    if task.h is same:
        check_states(driven, best.model.nx)
    else:
        check(driven, orders=Orders(best.model.nx, 2 * best.model.nx))
    check_model(best.model, sum(one.n for one in each))


def _driven(one: Data, v: Array) -> Data:
    """The data with the signals behind the input map as inputs."""
    return replace(one, u=v.T, inputs=tuple(f"input_map[{i}]" for i in range(len(v))))


def _search(
    task: HammersteinTask,
    first: Innovations | None,
    order: int,
    p: Array,
    starts: int,
    rng: np.random.Generator,
    iterations: int,
) -> list[SearchPoint]:
    """Minima of the simulation from many starts, the least first: all are begun, the best of them finished."""
    begun: list[SearchPoint] = []
    for i in range(max(starts, 1)):
        model = first if i == 0 and first is not None else _random(task, order, p, rng)
        begun.append(_minimised(task, evaluated(task, model, p, None), min(SCREEN, iterations)))
        least = min(one.cost for one in begun)
        if sum(one.cost <= AGREE * least for one in begun) > 1:
            break
    begun.sort(key=lambda one: one.cost)
    return sorted((_minimised(task, one, iterations) for one in begun[:FINISHED]), key=lambda one: one.cost)


def _check_maps(task: HammersteinTask, p: Array, one: Data, linear_inputs: int | None) -> None:
    v = np.asarray(task.g(task.pieces[0].u, p))
    wanted = (one.nu if linear_inputs is None else linear_inputs, one.n)
    if v.shape != wanted:
        raise ValueError(f"input_map gives {v.shape}, not {wanted}: channels first, time last")
    y = np.asarray(task.h(task.pieces[0].y, p))
    if y.shape != (one.ny, one.n):
        raise ValueError(f"output_map gives {y.shape}, not {(one.ny, one.n)}: channels first, time last")


def _approximation(task: HammersteinTask, each: Sequence[Data], order: int, p: Array) -> Innovations | None:
    """The linear model from g(u, p) to y."""
    try:
        driven = [_driven(one, task.g(own.u, p)) for one, own in zip(each, task.pieces, strict=True)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IdentificationWarning)  # of a start; the result is judged at the end
            found = subspaceid(driven, order, focus="simulation", stable=0.999)
    except ValueError:
        return None
    return replace(found, k=np.zeros_like(found.k), dt=1.0)


def _random(task: HammersteinTask, order: int, p: Array, rng: np.random.Generator) -> Innovations:
    """Random stable poles, each pair with its own time scale; the output as large as the data's."""
    a = np.zeros((order, order))
    for i in range(0, order - 1, 2):
        size, angle = np.exp(-1.0 / rng.uniform(1.0, 50.0)), np.pi * rng.uniform(0.0, 0.7) ** 2
        a[i : i + 2, i : i + 2] = size * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    if order % 2:
        a[-1, -1] = np.exp(-1.0 / rng.uniform(1.0, 50.0))
    ny = len(task.pieces[0].y)
    v = task.g(task.pieces[0].u, p)
    b, c = rng.standard_normal((order, len(v))), rng.standard_normal((ny, order))
    z = c @ states(a, b @ v)
    c *= task.pieces[0].y.std(axis=1, keepdims=True) / np.maximum(z.std(axis=1, keepdims=True), 1e-300)
    return Innovations(a, b, c, np.zeros((ny, len(v))), np.zeros((order, ny)), 1.0)


def _minimised(task: HammersteinTask, point: SearchPoint, iterations: int) -> SearchPoint:
    if not np.isfinite(point.cost):
        return point
    ends = Ends(iterations, exact=EXACT * _power(task))
    found = minimise(point, lambda at: _Equations(task, at), lambda at, step: _moved(task, at, *step), DAMPING, ends)
    return replace(found.point, ended=found.converged)


class _Equations:
    """A step goes with the coordinates that it is made of."""

    def __init__(self, task: HammersteinTask, point: SearchPoint) -> None:
        self.columns = coordinates.basis(point.model, task.free)
        gradient, gram = normal_equations(task, point, self.columns)
        self.equations = NormalEquations(gram, gradient)

    def step(self, damping: float) -> tuple[Array, Array]:
        return self.columns, self.equations.step(damping)

    def promised(self, damping: float) -> float:
        return self.equations.promised(damping)


def _moved(task: HammersteinTask, point: SearchPoint, columns: Array, step: Array) -> SearchPoint:
    m, nx = columns.shape[1], point.model.nx
    model = coordinates.with_values(point.model, coordinates.values(point.model) + columns @ step[:m])
    starts = tuple(x + step[m + i * nx : m + (i + 1) * nx] for i, x in enumerate(point.starts))
    return evaluated(task, model, point.p + step[m + nx * len(starts) :], starts)


def _power(task: HammersteinTask) -> float:
    return float(sum(np.sum(np.square(task.weight[:, None] * one.y)) for one in task.pieces))


def _result(
    task: HammersteinTask, best: SearchPoint, names: tuple[str, ...], costs: list[float], one: Data
) -> HammersteinWiener:
    count = sum(int(own.known.sum()) for own in task.pieces)
    covariance = _covariance(task, best, names)
    first = len(covariance) - len(best.p)
    cost = float(sum(np.vdot(path.e, path.e) for path in best.paths))
    r = paired([path.e for path in best.paths], [own.known for own in task.pieces])
    return HammersteinWiener(
        replace(best.model, dt=one.dt, x0=best.starts[0], inputs=one.inputs, outputs=one.outputs),
        dict(zip(names, best.p.tolist(), strict=True)),
        covariance[first:, first:], best.starts, cost / count, r, task.g, task.h, tuple(costs),
    )  # fmt: skip


def _covariance(task: HammersteinTask, best: SearchPoint, names: tuple[str, ...]) -> Array:
    """(unknowns, unknowns): J'SJ between two inverses of J'J, S the covariance of all errors.

    Those of a predictor are white, and of several outputs correlated at one moment; those of a simulation hold whatever
    disturbs, by an autoregression of theirs.
    """
    known = [own.known for own in task.pieces]
    count = sum(int(one.sum()) for one in known)
    columns = coordinates.basis(best.model, task.free)
    _, gram = normal_equations(task, best, columns)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    relative = gram / np.outer(scale, scale)
    check_determined(np.roll(relative, len(best.p), axis=(0, 1)), names)
    inverse = linalg.pinvh(relative, rtol=1e-12) / np.outer(scale, scale)
    scaled = [task.weight[:, None] * path.e for path in best.paths]
    noise = together(scaled, known) if task.free.gain else autoregression_of([e.T for e in scaled])
    middle = gradient_covariance(task, best, columns, noise)
    return np.asarray(inverse @ middle @ inverse * count / max(count - len(gram), 1))
