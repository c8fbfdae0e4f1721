"""Linear grey box: the user builds the system from parameters, the data choose them.

The errors of the predictor (or of the simulation) are minimised over the parameters, the gain and the initial states
by a trust region method within bounds (Branch, Coleman & Li, 1999, as in scipy); `structurederrors` knows them and
their derivatives.

Rules of this file: the user's function is the only model; a continuous system is sampled with held inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, optimize

from hoopd.ident.checks import Orders, check, check_determined, unsettled
from hoopd.ident.data import Data, experiments
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.loopchecks import check_record
from hoopd.ident.modelchecks import check_model
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.coloured import autoregression_of, gradient_covariance, together
from hoopd.ident.statespace.sensitivities import paired, piece
from hoopd.ident.statespace.step_sizes import scales
from hoopd.ident.statespace.structurederrors import (
    Task,
    allowed,
    errors,
    parameter_sizes,
    parts_of,
    paths_of,
    sizes_of,
    slope,
    variance_of,
    weight_of,
)
from hoopd.ident.statespace.subspace import check_focus
from hoopd.ident.statespace.subspacefit import Focus

Array = NDArray[np.float64]
Constructor = Callable[[Array], Any]

ROUNDS = 3  # of weights of the outputs
# A search out of steps has settled where a straight step promises less of the squares; so near is at a bound.
SETTLED_SHARE, NEAR_BOUND = 1e-6, 1e-6


@dataclass(frozen=True, repr=False)
class Structured(IdentifiedModel):
    """Parameters by name with their covariance (the order of `names`), the sampled model, x0 by experiment, the cost.

    `cost` is the mean squared error by output (ny,); `at_bound` names the parameters that stand on a bound: their
    variance is not known and stands as NaN.
    """

    parameters: Mapping[str, float]
    covariance: Array
    model: Innovations
    starts: tuple[Array, ...]
    cost: Array
    at_bound: tuple[str, ...]
    evaluations: int
    built: Callable[[Array], Innovations] | None = field(default=None, compare=False)  # the sampled model of parameters
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def state_space(self) -> Innovations:
        """The sampled model."""
        return self.model

    @property
    def system(self) -> ct.StateSpace:
        """From u to y, sampled."""
        return self.model.system

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters in the order of the covariance."""
        return tuple(self.parameters)

    def deviations(self) -> dict[str, float]:
        """Standard errors by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


@estimated("grey box")
def structured_pem(
    data: Data | Sequence[Data],
    constructor: Constructor,
    p0: ArrayLike,
    *,
    names: Sequence[str] | None = None,
    bounds: tuple[ArrayLike, ArrayLike] = (-np.inf, np.inf),
    gain: ArrayLike | Literal["free", "model", "zero"] = "model",
    x0: ArrayLike | Literal["estimate", "zero", "model"] = "estimate",
    focus: Focus = "prediction",
    horizon: int = 1,
    regulariser: Callable[[Array, Innovations], Array] | None = None,
    iterations: int = 300,
) -> Structured:
    """Estimate the parameters of a linear grey box: the user builds the system from them, the data choose them.

    The errors of the predictor (or of the simulation) are minimised over the parameters, the gain and the initial
    states by a trust region method within bounds. Missing outputs are left out.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    constructor : callable
        Of the parameters (np,), giving a python-control system (continuous or sampled) or `Innovations`; or a CasADi
        function giving A, B, C, D (and K) of a continuous system. A continuous one is sampled with held inputs.
    p0 : array_like, shape (np,)
        Start of the parameters.
    names : sequence of str, optional
        Their names; p1, p2 ... unless given.
    bounds : tuple of array_like
        Least and largest values.
    gain : {"model", "zero", "free"} or array_like, shape (nx, ny)
        K is that of the model, zero, free (started at the model's), or given.
    x0 : {"estimate", "zero", "model"} or array_like, shape (nx,)
        The initial state, estimated for every experiment, zero, the model's, or given.
    focus : {"prediction", "simulation"}
        Errors `horizon` steps ahead, or those of the simulation.
    horizon : int
        Samples ahead.
    regulariser : callable, optional
        Of (p, model); its squared entries are added to the mean squared error of outputs in standard deviations.
    iterations : int
        At most so many evaluations.

    Returns
    -------
    Structured
        The `parameters` by name with their `covariance`, the sampled `model`, the initial states `starts` by
        experiment, the `cost` (ny,), the names `at_bound`; `deviations()` are the standard errors.

    Raises
    ------
    ValueError
        p0 outside its bounds, a start without a stable predictor, matrices that do not fit the data.

    Notes
    -----
    Source: Branch, Coleman & Li, 1999, on the trust region within bounds.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import iddata, innovations, simulate, structured_pem
    >>> def tank(p):  # area p[0], outlet p[1]: a h' = -k h + u
    ...     return control.ss([[-p[1] / p[0]]], [[1.0 / p[0]]], [[1.0]], [[0.0]])
    >>> rng = np.random.default_rng(0)
    >>> u, e = np.repeat(rng.standard_normal(60), 5), rng.standard_normal(300)
    >>> truth = innovations(control.c2d(tank([2.0, 0.5]), 0.2))
    >>> data = iddata(simulate(truth, iddata(u, u, 0.2), "zero")[:, 0] + 0.001 * e, u, 0.2)
    >>> found = structured_pem(data, tank, [1.0, 1.0], names=["area", "outlet"])
    >>> {name: round(value, 1) for name, value in found.parameters.items()}
    {'area': 2.0, 'outlet': 0.5}
    """
    each = experiments(data)
    start = np.atleast_1d(np.asarray(p0, dtype=float))
    own = tuple(names) if names is not None else tuple(f"p{i + 1}" for i in range(len(start)))
    if len(own) != len(start) or len(set(own)) != len(own):
        raise ValueError(f"{len(start)} different names wanted, not {list(own)}")
    low, high = (np.broadcast_to(np.asarray(side, dtype=float), start.shape) for side in bounds)
    for name, value, a, b in zip(own, start, low, high, strict=True):
        if not a <= value <= b:
            raise ValueError(f"the start of {name} is {value:g}, outside its bounds {a:g} .. {b:g}")
    if horizon < 1:
        raise ValueError(f"horizon is from 1 on, not {horizon}")
    check_focus(focus)
    # a line of the input gives two numbers of every output
    check(each, orders=Orders(len(start), -(-len(start) // (each[0].ny * each[0].nu)) if each[0].nu else 0))
    check_record(each, drift=False)
    build = _built(constructor, each[0].dt, gain, focus == "simulation")
    model = build(start)
    if (model.ny, model.nu) != (each[0].ny, each[0].nu):
        raise ValueError(f"the constructor gives {model.ny} outputs and {model.nu} inputs, the data have others")
    task = Task(
        build, [piece(one) for one in each], each[0].dt, len(start), isinstance(gain, str) and gain == "free",
        isinstance(x0, str) and x0 == "estimate", tuple(_fixed(x0, model) for _ in each), horizon,
        focus == "simulation", regulariser, own, parameter_sizes(build, start, (low, high)),
    )  # fmt: skip
    return _finished(task, (low, high), *_minimised(task, start, (low, high), iterations), each[0])


def _built(constructor: Constructor, dt: float, gain: Any, simulation: bool) -> Callable[[Array], Innovations]:
    """p -> sampled innovation form, with the gain that was asked for."""
    kind = gain if isinstance(gain, str) else "given"

    def build(p: Array) -> Innovations:
        model = _innovations(constructor(p), dt)
        if simulation or kind == "zero":
            return replace(model, k=np.zeros((model.nx, model.ny)))
        return replace(model, k=np.asarray(gain, dtype=float)) if kind == "given" else model

    return build


def _innovations(made: Any, dt: float) -> Innovations:
    if isinstance(made, Innovations):
        return made
    if isinstance(made, ct.StateSpace):
        parts = [made.A, made.B, made.C, made.D]
        continuous = made.dt == 0 or made.dt is None
        if not continuous and not np.isclose(float(made.dt), dt, rtol=1e-6, atol=0.0):
            raise ValueError(f"the constructor gives a step of {made.dt} s, the data have one of {dt} s")
    else:  # what a CasADi function or a plain one hands out
        parts, continuous = [np.array(one, dtype=float) for one in made], True
    a, b, c, d = (np.asarray(one, dtype=float) for one in parts[:4])
    k = np.asarray(parts[4], dtype=float) if len(parts) > 4 else np.zeros((len(a), len(c)))
    if continuous:
        n, m = b.shape
        whole = np.zeros((n + m + len(c),) * 2)
        whole[:n] = np.hstack([a, b, k])
        e = linalg.expm(whole * dt)
        a, b, k = e[:n, :n], e[:n, n : n + m], e[:n, n + m :]
    return Innovations(a, b, c, d, k, dt)


def _fixed(x0: Any, model: Innovations) -> Array:
    if isinstance(x0, str):
        return model.x0 if x0 == "model" and model.x0 is not None else np.zeros(model.nx)
    start = np.asarray(x0, dtype=float).reshape(-1)
    if len(start) != model.nx:
        raise ValueError(f"x0 has {len(start)} numbers, the model {model.nx} states")
    return start


def _minimised(task: Task, start: Array, bounds: tuple[Array, Array], iterations: int) -> tuple[Array, int]:
    """All variables and the evaluations."""
    model = task.constructor(start)
    if not allowed(task, model):
        raise ValueError("the predictor of the start is not stable: start elsewhere, or give a gain")
    extra = model.k.size * task.free_gain + model.nx * len(task.pieces) * task.estimate
    z = np.concatenate(
        [start, model.k.ravel() if task.free_gain else [], np.zeros(extra - model.k.size * task.free_gain)]
    )
    lower, upper = (
        np.concatenate([side, np.full(extra, far)]) for side, far in zip(bounds, (-np.inf, np.inf), strict=True)
    )
    free = lower < upper
    # in the variables' own units the search's tolerances and its distances from bounds would hold for large ones alone
    own = scales(sizes_of(task, len(z)))[free]
    weight, evaluations = weight_of(task, None), 0
    for _ in range(ROUNDS if model.ny > 1 else 1):
        found = optimize.least_squares(
            lambda v, at, w: errors(task, _put(at, free, v * own), w), z[free] / own,
            lambda v, at, w: slope(task, _put(at, free, v * own), w)[:, free] * own,
            (lower[free] / own, upper[free] / own), x_scale="jac", ftol=1e-13, xtol=1e-13, gtol=1e-15,
            max_nfev=iterations, args=(z, weight),
        )  # fmt: skip
        z, evaluations = _put(z, free, found.x * own), evaluations + int(found.nfev)
        weight = weight_of(task, paths_of(task, z))
    if found.status == 0 and _promised(found, upper[free] / own, lower[free] / own) > SETTLED_SHARE:
        unsettled(evaluations)
    return z, evaluations


def _promised(found: optimize.OptimizeResult, upper: Array, lower: Array) -> float:
    """By what share a straight step to the minimum would lower the squares, variables at their bounds left there.

    Beside a bound the search's own steps grow short for ever, with nothing left to gain.
    """
    near = NEAR_BOUND * np.maximum(np.abs(found.x), 1.0)
    inside = (found.x - lower > near) & (upper - found.x > near)
    squares = float(found.fun @ found.fun)
    if not inside.any() or squares == 0.0:
        return 0.0
    j = found.jac[:, inside]
    scale = np.linalg.norm(j, axis=0)
    step = np.linalg.lstsq(j[:, scale > 0.0] / scale[scale > 0.0], found.fun, rcond=1e-10)[0]
    gone = j[:, scale > 0.0] @ (step / scale[scale > 0.0])
    return float(gone @ gone) / squares


def _put(z: Array, free: NDArray[np.bool_], v: Array) -> Array:
    whole = z.copy()
    whole[free] = v
    return whole


def _finished(
    task: Task,
    bounds: tuple[Array, Array],
    z: Array,
    evaluations: int,
    one: Data,
) -> Structured:
    model, starts = parts_of(task, z)
    paths = paths_of(task, z)
    p, variance = z[: task.count], variance_of(task, paths)
    near = 1e-9 * np.maximum(np.abs(p), 1e-12)
    bound = (p - bounds[0] <= near) | (bounds[1] - p <= near)
    covariance = _covariance(task, z, paths, np.concatenate([~bound, np.ones(len(z) - task.count, dtype=bool)]))
    model = replace(
        model, r=paired(paths, [piece.known for piece in task.pieces]), x0=starts[0], names=task.names, values=p,
        covariance=covariance, inputs=one.inputs, outputs=one.outputs,
    )  # fmt: skip
    check_model(model, sum(piece.n for piece in task.pieces))
    at = tuple(n for n, on in zip(task.names, bound, strict=True) if on)
    return Structured(
        dict(zip(task.names, p.tolist(), strict=True)), covariance, model, starts, variance, at, evaluations,
        task.constructor,
    )  # fmt: skip


def _covariance(task: Task, z: Array, paths: Sequence[Array], free: NDArray[np.bool_]) -> Array:
    """(count, count): the inverse of J'J of errors in standard deviations; J'SJ between two of them where these are not
    white, or where those of several outputs go together."""
    count = sum(one.y.size for one in task.pieces)
    sd = np.sqrt(np.maximum(variance_of(task, paths), 1e-300))
    whiten = np.diag(1.0 / sd)
    j = slope(replace(task, regulariser=None), z, whiten) * np.sqrt(count)
    # a starting state that reaches no output, as the far end of a line of delays, is not for the data to determine
    reached = free & ((np.arange(len(free)) < task.count) | (np.linalg.norm(j, axis=0) > 0.0))
    j = j[:, reached]
    scale = np.maximum(np.linalg.norm(j, axis=0), np.sqrt(np.finfo(float).tiny))
    gram = (j / scale).T @ (j / scale)
    names = [task.names[i] for i in np.flatnonzero(reached[: task.count])]
    check_determined(gram, names)
    inverse = linalg.pinvh(gram, rtol=1e-12) / np.outer(scale, scale)
    scaled = [whiten @ e for e in paths]
    white = not task.simulation and task.horizon == 1
    if len(sd) > 1 or not white:
        known = [one.known for one in task.pieces]
        noise = together(scaled, known) if white else autoregression_of([e.T for e in scaled])
        ends = np.cumsum([one.y.size for one in task.pieces])[:-1]
        changes = [
            rows.reshape(*one.y.shape, -1).transpose(0, 2, 1)
            for rows, one in zip(np.split(j, ends), task.pieces, strict=True)
        ]
        inverse = inverse @ gradient_covariance(changes, noise) @ inverse
    whole = np.full((len(free), len(free)), np.nan)
    whole[np.ix_(reached, reached)] = inverse
    return whole[: task.count, : task.count]
