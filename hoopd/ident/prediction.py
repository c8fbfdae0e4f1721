"""What a model says of data: simulation, prediction any number of steps ahead, its errors, the initial state.

One step ahead (Ljung, System Identification, 1999, 4.86): x+ = (a - k c) x + (b - k d) u + k y, yhat = c x + d u.
h steps ahead: the state estimated h - 1 samples earlier is carried on with the inputs that followed. A missing output
corrects nothing: there the state goes on by the model alone.

Rules of this file: nothing is estimated but the initial state; every result has a row for each sample of the data.
"""

from __future__ import annotations

from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data, driving_data, experiments
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.model_forms import innovation_form, predicting_form
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.linear import states

Array = NDArray[np.float64]
Start = Literal["estimate", "zero"] | ArrayLike

# Samples of the free response that tell the initial state: so many times the slowest time constant.
SLOWEST = 3.0
# Responses beyond it are those of an unstable model, and near the largest numbers there are.
RAN_AWAY = 1e100


@overload
def simulate(
    model: Any, data: list[Data] | tuple[Data, ...], x0: Start = "estimate", *, seed: int | None = None
) -> list[Array]: ...


@overload
def simulate(model: Any, data: Data | ArrayLike, x0: Start = "estimate", *, seed: int | None = None) -> Array: ...


def simulate(
    model: Any, data: Data | ArrayLike | list[Data] | tuple[Data, ...], x0: Start = "estimate", *,
    seed: int | None = None,
) -> Array | list[Array]:  # fmt: skip
    """Simulate a model: the outputs from the inputs alone.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system or FRD; a continuous one is sampled with held inputs.
    data : Data or array_like, shape (n,), (n, nu) or (nu, n)
        Inputs; the outputs of data count for the initial state only. An array alone begins at rest. Of a list of
        experiments each is simulated.
    x0 : {"estimate", "zero"} or array_like, shape (nx,)
        The initial state: the one that fits the first outputs best, rest, or a given one.
    seed : int, optional
        Adds noise drawn as the model believes it: white e of covariance r, through k into the states.

    Returns
    -------
    ndarray, shape (n, ny)
        The outputs; a list of them of several experiments.

    Raises
    ------
    ValueError
        Channels or steps that differ; a `seed` where the model does not know r.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, iddata, simulate
    >>> model = Polynomials(1.0, a=np.array([1.0, -0.5]), b=(np.array([0.0, 1.0]),))
    >>> step = iddata(np.zeros(5), np.ones(5))
    >>> simulate(model, step, x0="zero")[:, 0]
    array([0.   , 1.   , 1.5  , 1.75 , 1.875])
    """
    if isinstance(data, list | tuple) and data and isinstance(data[0], Data):
        return [simulate(model, one, x0, seed=seed) for one in experiments(data)]
    form = predicting_form(model, data.dt if isinstance(data, Data) else None)
    if isinstance(form, FreeModel):
        inputs: Any = data
        return form.simulate(inputs, x0, seed=seed)
    given = driving_data(data, form.ny, form.nu, form.dt or None)
    own = matched(form, given)
    start = _start(own, given, x0, simulation=True)
    said = _run(own, given, start, correct=False)[0]
    return said if seed is None else said + _disturbance(own, given.n, seed)


def _disturbance(model: Innovations, n: int, seed: int) -> Array:
    if model.r is None:
        raise ValueError("the model does not know the covariance of its innovations: there is no noise to draw")
    values, vectors = np.linalg.eigh(model.r)
    e = np.random.default_rng(seed).standard_normal((n, model.ny)) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    out, x = np.empty((n, model.ny)), np.zeros(model.nx)
    for i in range(n):
        out[i] = model.c @ x + e[i]
        x = model.a @ x + model.k @ e[i]
    return out


@overload
def predict(model: Any, data: Data, horizon: float = 1, x0: Start = "estimate") -> Array: ...


@overload
def predict(
    model: Any, data: list[Data] | tuple[Data, ...], horizon: float = 1, x0: Start = "estimate"
) -> list[Array]: ...


def predict(
    model: Any, data: Data | list[Data] | tuple[Data, ...], horizon: float = 1, x0: Start = "estimate"
) -> Array | list[Array]:
    """Predict the outputs from the inputs, and from the outputs up to `horizon` samples before.

    The first samples, where so much is not known, are predicted from the initial state.
    A missing output corrects nothing.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system or FRD; a continuous one is sampled with held inputs.
    data : Data or list of Data
        Inputs (n, nu) and outputs (n, ny), of one or several experiments.
    horizon : int or inf
        Samples ahead; infinity simulates.
    x0 : {"estimate", "zero"} or array_like, shape (nx,)
        The initial state.

    Returns
    -------
    ndarray, shape (n, ny)
        The predictions; a list of them of several experiments.

    Raises
    ------
    ValueError
        A horizon that is none; channels or steps that differ.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 4.86.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, iddata, predict
    >>> model = Polynomials(1.0, a=np.array([1.0, -0.5]))  # y(t) = 0.5 y(t-1) + e(t)
    >>> data = iddata([4.0, 3.0, 1.0, 2.0])
    >>> predict(model, data, 1)[1:, 0]
    array([2. , 1.5, 0.5])
    >>> predict(model, data, 2)[2:, 0]
    array([1.  , 0.75])
    """
    if isinstance(data, list | tuple) and data and isinstance(data[0], Data):
        return [predict(model, one, horizon, x0) for one in experiments(data)]
    _needs_data(data)
    assert isinstance(data, Data)
    if horizon == np.inf:
        return simulate(model, data, x0)
    form, h = predicting_form(model, data.dt), whole_horizon(horizon)
    if isinstance(form, FreeModel):
        return form.predict(data, h, x0)
    own = matched(form, data)
    said, passed = predict_states(own, data, x0)
    return said if h == 1 else _ahead(own, data, passed, h)


def prediction_error(model: Any, data: Data, horizon: float = 1, x0: Start = "estimate") -> Array:
    """Give the errors of prediction, y - yhat.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system or FRD; a continuous one is sampled with held inputs.
    data : Data
        Inputs (n, nu) and outputs (n, ny).
    horizon : int or inf
        Samples ahead; infinity simulates.
    x0 : {"estimate", "zero"} or array_like, shape (nx,)
        The initial state.

    Returns
    -------
    ndarray, shape (n, ny)
        The errors, NaN where an output is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, iddata, prediction_error, simulate
    >>> true = Polynomials(0.1, a=np.array([1.0, -0.8]), b=(np.array([0.0, 2.0]),), variance=0.04)
    >>> u = np.random.default_rng(0).standard_normal(1000)
    >>> data = iddata(simulate(true, iddata(u, u, 0.1), "zero", seed=1), u, 0.1)
    >>> round(float(prediction_error(true, data).std()), 2)  # the innovations: sqrt 0.04
    0.2
    """
    return np.asarray(data.y - predict(model, data, horizon, x0))


def estimate_x0(
    model: Any, data: Data, *, samples: int | None = None, simulation: bool = False, fixed: ArrayLike | None = None
) -> Array:
    """Estimate the initial state that makes the first prediction errors least.

    The response is linear in the initial state, so this is linear least squares.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system or FRD; a continuous one is sampled with held inputs.
    data : Data
        Inputs (n, nu) and outputs (n, ny).
    samples : int, optional
        How many samples are used; without it three times the slowest time constant of the free response, at least nx.
    simulation : bool
        Whether the errors of the simulation are meant and not those one step ahead.
    fixed : array_like, shape (nx,), optional
        States that are known, NaN where they are to be found.

    Returns
    -------
    ndarray, shape (nx,)
        The state at the first sample.

    Raises
    ------
    ValueError
        `fixed` does not have a number for each state.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import estimate_x0, iddata, innovations
    >>> model = innovations(control.ss([[0.9]], [[1.0]], [[1.0]], [[0.0]], 0.1))
    >>> free = iddata(3.0 * 0.9 ** np.arange(20), np.zeros(20), 0.1)
    >>> estimate_x0(model, free).round(6)
    array([3.])
    """
    own = matched(model, data)
    start = np.full(own.nx, np.nan) if fixed is None else np.array(fixed, dtype=float).reshape(-1)
    if len(start) != own.nx or np.isinf(start).any():
        raise ValueError(f"fixed has {len(start)} numbers for {own.nx} states; NaN marks those that are to be found")
    sought = np.isnan(start)
    free = own.a if simulation else own.a - own.k @ own.c
    n = min(data.n, _settled(free, own.nx) if samples is None else max(samples, own.nx))
    part = data[:n]
    with np.errstate(over="ignore", invalid="ignore"):
        rest = part.y - _run(own, part, np.nan_to_num(start), correct=not simulation)[0]
    with np.errstate(over="ignore", invalid="ignore"):
        response = free_response(own.c, free, n)[:, :, sought]
        # an unstable model says nothing more where it has run away
        seen = np.isfinite(rest) & (np.abs(rest) < RAN_AWAY) & (np.abs(response) < RAN_AWAY).all(axis=2)
    start[sought] = np.linalg.lstsq(response[seen], rest[seen], rcond=None)[0]
    return start


def free_response(c: Array, free: Array, n: int) -> Array:
    """c free^t, (n, ny, nx)."""
    response, power = np.empty((n, *c.shape)), np.eye(len(free))
    for i in range(n):
        response[i] = c @ power
        power = free @ power
    return response


def whole_horizon(horizon: float) -> int:
    """A number of samples; for code of this room."""
    if horizon < 1 or int(horizon) != horizon:
        raise ValueError(f"the horizon is a whole number of samples or infinite, not {horizon}")
    return int(horizon)


def _needs_data(data: Any) -> None:
    if not isinstance(data, Data):
        experiments(data)  # says what it is instead
        raise TypeError("one experiment is wanted: take them one by one")


def matched(model: Any, data: Data) -> Innovations:
    """The innovation form of a model that has the channels and the step of the data."""
    _needs_data(data)
    own = innovation_form(model, data.dt)
    if (own.ny, own.nu) != (data.ny, data.nu):
        raise ValueError(f"the model has {own.ny} outputs and {own.nu} inputs, the data have {data.ny} and {data.nu}")
    if not np.isclose(own.dt, data.dt, rtol=1e-6, atol=0.0):
        raise ValueError(f"the model has a step of {own.dt} s, the data of {data.dt} s: resample one of them")
    return own


def _start(model: Innovations, data: Data, x0: Start, *, simulation: bool) -> Array:
    if isinstance(x0, str):
        if x0 == "zero":
            return np.zeros(model.nx)
        if x0 == "estimate":
            return estimate_x0(model, data, simulation=simulation)
        raise ValueError(f'x0 is "estimate", "zero" or a state, not {x0!r}')
    start = np.asarray(x0, dtype=float).reshape(-1)
    if len(start) != model.nx:
        raise ValueError(f"x0 has {len(start)} numbers, the model {model.nx} states")
    return start


def _settled(free: Array, nx: int) -> int:
    """Samples until the free response has died out."""
    radius = float(np.abs(np.linalg.eigvals(free)).max(initial=0.0))
    slowest = -1.0 / np.log(radius) if 0.0 < radius < 1.0 - 1e-9 else (1.0 if radius == 0.0 else np.inf)
    return int(min(max(np.ceil(SLOWEST * slowest), 2 * nx + 2), 1e9)) if np.isfinite(slowest) else 10**9


def predict_states(model: Innovations, data: Data, x0: Start = "estimate") -> tuple[Array, Array]:
    """One-step predictions (n, ny), and the states (n, nx) that they were made from; for code of this room."""
    return _run(model, data, _start(model, data, x0, simulation=False), correct=True)


def _run(model: Innovations, data: Data, start: Array, *, correct: bool) -> tuple[Array, Array]:
    """Predictions (n, ny) and the states (n, nx) that they were made from."""
    if correct and not data.complete:
        return _stepped(model, data, start)
    driven, free = model.b, model.a
    pushed = driven @ data.u.T
    if correct:
        free = model.a - model.k @ model.c
        pushed = (driven - model.k @ model.d) @ data.u.T + model.k @ data.y.T
    found = states(free, pushed, start).T
    return found @ model.c.T + data.u @ model.d.T, found


def _stepped(model: Innovations, data: Data, start: Array) -> tuple[Array, Array]:
    """The same sample by sample: a missing output corrects nothing."""
    a, c, k = model.a, model.c, model.k
    driven, direct = data.u @ model.b.T, data.u @ model.d.T
    said, passed, x = np.empty((data.n, model.ny)), np.empty((data.n, model.nx)), start
    for i in range(data.n):
        passed[i] = x
        said[i] = c @ x + direct[i]
        x = a @ x + driven[i] + k @ np.nan_to_num(data.y[i] - said[i])
    return said, passed


def _ahead(model: Innovations, data: Data, states: Array, h: int) -> Array:
    """Predictions h steps ahead: the state of h - 1 samples before, carried on without outputs."""
    driven, direct = data.u @ model.b.T, data.u @ model.d.T
    x = states[: max(data.n - h + 1, 0)]
    for j in range(h - 1):
        x = x @ model.a.T + driven[j : j + len(x)]
    out = np.empty((data.n, model.ny))
    out[h - 1 :] = x @ model.c.T + direct[h - 1 :]
    first, early = states[0], min(h - 1, data.n)
    for i in range(early):
        out[i] = model.c @ first + direct[i]
        first = model.a @ first + driven[i]
    return out
