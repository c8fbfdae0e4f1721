"""What a nonlinear model says of data: simulation, prediction by its sigma-point filter, the state that it begins at.

h steps ahead: the filtered state of h samples before is carried on by f with the inputs that followed.

Rules of this file: nothing is estimated but the initial state; arrays run with time along the first axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from hoopd.ident.data import Data
from hoopd.ident.statespace.unscented import NonlinearSystem, filtered

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]

# Samples from which an initial state is told, and what stands for an error that is no number.
START_SAMPLES, NO_NUMBER = 100, 1e6


def simulated(system: NonlinearSystem, u: Array, t: Array, p: Array, x0: Array, seed: int | None = None) -> Array:
    """Outputs (n, ny) from inputs u (n, nu) at t (n,) s; with a seed, noise of covariances q and r is drawn."""
    if len(x0) != system.nx:
        raise ValueError(f"x0 has {len(x0)} numbers, the model {system.nx} states")
    rng = None if seed is None else np.random.default_rng(seed)
    x, column, out = x0[:, None].astype(float), p[:, None], np.empty((len(u), system.ny))
    with np.errstate(all="ignore"):
        for i in range(len(u)):
            out[i] = _column(system.h(x, u[i][:, None], column, t[i]), system.ny)[:, 0]
            x = _column(system.f(x, u[i][:, None], column, t[i]), system.nx)
            if rng is not None:
                x = x + rng.multivariate_normal(np.zeros(system.nx), system.q)[:, None]
    return out if rng is None else out + rng.multivariate_normal(np.zeros(system.ny), system.r, len(u))


def predicted(system: NonlinearSystem, data: Data, p: Array, x0: Array, horizon: int) -> Array:
    """Outputs (n, ny) `horizon` steps ahead; the first ones from the initial state."""
    if horizon < 1:
        raise ValueError(f"the horizon is a whole number of samples or infinite, not {horizon}")
    found = filtered(system, data.y, data.u, data.t, p[:, None], x0[:, None])
    states, column = found.x[:, :, 0], p[:, None]
    out = np.empty((data.n, system.ny))
    with np.errstate(all="ignore"):
        for i in range(data.n):
            first = max(i - horizon + 1, 0)
            x = states[first][:, None] if i - horizon + 1 >= 0 else x0[:, None].astype(float)
            for j in range(first, i):
                x = _column(system.f(x, data.u[j][:, None], column, data.t[j]), system.nx)
            out[i] = _column(system.h(x, data.u[i][:, None], column, data.t[i]), system.ny)[:, 0]
    return out


def best_start(simulate: Callable[[Data, Array], Array], data: Data, guesses: Sequence[Array]) -> Array:
    """The initial state whose simulation of the first samples errs least, from the best of the guesses on."""
    part = data[:START_SAMPLES]
    known = np.isfinite(part.y)
    if not known.any():
        return np.zeros_like(guesses[0])

    def errors(x0: Array) -> Array:
        return np.asarray(np.nan_to_num((simulate(part, x0) - part.y)[known], nan=NO_NUMBER).clip(-1e9, 1e9))

    first = min([*guesses, np.zeros_like(guesses[0])], key=lambda x: float(np.square(errors(x)).sum()))
    return np.asarray(optimize.least_squares(errors, first, x_scale="jac", max_nfev=50).x)


def nonlinear_system(
    f: Callable[[Array, Array, float], Array], h: Callable[[Array, Array, float], Array], dt: float,
    channels: tuple[Sequence[str], Sequence[str]], nx: int,
) -> ct.NonlinearIOSystem:  # fmt: skip
    """python-control's system of the next state f(x, u, t) and the output h(x, u, t), from inputs to outputs."""
    import control as ct

    def update(t: float, x: Array, u: Array, _: Any) -> Array:
        return f(x, np.atleast_1d(u), t)

    def output(t: float, x: Array, u: Array, _: Any) -> Array:
        return h(x, np.atleast_1d(u), t)

    inputs, outputs = channels
    return ct.nlsys(update, output, inputs=list(inputs), outputs=list(outputs), states=nx, dt=dt)


def _column(values: Any, rows: int) -> Array:
    return np.broadcast_to(np.asarray(values, dtype=float).reshape(rows, -1), (rows, 1))
