"""What a model says of data: simulation, prediction any number of steps ahead, its errors, the initial state.

One step ahead (Ljung, System Identification, 1999, 4.86): x+ = (a - k c) x + (b - k d) u + k y, yhat = c x + d u.
h steps ahead: the state estimated h - 1 samples earlier is carried on with the inputs that followed. A missing output
corrects nothing: there the state goes on by the model alone.

Rules of this file: nothing is estimated but the initial state; every result has a row for each sample of the data.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data
from hoopd.ident.models import Innovations, Model, Polynomials, state_space

Array = NDArray[np.float64]
Start = Literal["estimate", "zero"] | ArrayLike

# Samples of the free response that tell the initial state: so many times the slowest time constant.
SLOWEST = 3.0


def simulate(model: Model, data: Data, x0: Start = "estimate") -> Array:
    """Outputs (n, ny) from the inputs alone."""
    own = _state_space(model, data)
    return _run(own, data, _start(own, data, x0, simulation=True), correct=False)[0]


def predict(model: Model, data: Data, horizon: float = 1, x0: Start = "estimate") -> Array:
    """Outputs (n, ny) from the inputs and the outputs up to `horizon` samples before; infinity simulates.

    The first samples, where so much is not known, are predicted from the initial state.
    """
    if horizon == np.inf:
        return simulate(model, data, x0)
    if horizon < 1 or int(horizon) != horizon:
        raise ValueError(f"the horizon is a whole number of samples or infinite, not {horizon}")
    own, h = _state_space(model, data), int(horizon)
    said, states = _run(own, data, _start(own, data, x0, simulation=False), correct=True)
    return said if h == 1 else _ahead(own, data, states, h)


def prediction_error(model: Model, data: Data, horizon: float = 1, x0: Start = "estimate") -> Array:
    """y - yhat (n, ny), NaN where an output is missing."""
    return np.asarray(data.y - predict(model, data, horizon, x0))


def estimate_x0(model: Model, data: Data, *, samples: int | None = None, simulation: bool = False) -> Array:
    """The initial state (nx,) that makes the first prediction errors least.

    `samples`: how many are used; without it three times the slowest time constant of the free response, at least nx.
    Source: linear least squares; the response is linear in the initial state.
    """
    own = _state_space(model, data)
    free = own.a if simulation else own.a - own.k @ own.c
    n = min(data.n, _settled(free, own.nx) if samples is None else max(samples, own.nx))
    part = data[:n]
    rest = part.y - _run(own, part, np.zeros(own.nx), correct=not simulation)[0]
    response = np.empty((n, own.ny, own.nx))
    power = np.eye(own.nx)
    for i in range(n):
        response[i] = own.c @ power
        power = free @ power
    seen = np.isfinite(rest)
    return np.asarray(np.linalg.lstsq(response[seen], rest[seen], rcond=None)[0])


def _state_space(model: Model, data: Data) -> Innovations:
    own = state_space(model) if isinstance(model, Polynomials) else model
    if (own.ny, own.nu) != (data.ny, data.nu):
        raise ValueError(f"the model has {own.ny} outputs and {own.nu} inputs, the data have {data.ny} and {data.nu}")
    if not np.isclose(own.dt, data.dt, rtol=1e-6):
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


def _run(model: Innovations, data: Data, start: Array, *, correct: bool) -> tuple[Array, Array]:
    """Predictions (n, ny) and the states (n, nx) that they were made from."""
    a, c, k = model.a, model.c, model.k
    driven, direct = data.u @ model.b.T, data.u @ model.d.T
    said, states, x = np.empty((data.n, model.ny)), np.empty((data.n, model.nx)), start
    for i in range(data.n):
        states[i] = x
        said[i] = c @ x + direct[i]
        x = a @ x + driven[i]
        if correct:
            x = x + k @ np.nan_to_num(data.y[i] - said[i])
    return said, states


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
