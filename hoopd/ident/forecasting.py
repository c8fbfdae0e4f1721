"""What comes after the last sample: outputs for inputs that are planned, with the standard error of what is foretold.

Rules of this file: the state at the end of the data is the predictor's, and as sure as the outputs before it make it;
what the parameters leave open is not counted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data, input_rows
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import matched, predict_states

Array = NDArray[np.float64]


class OutputForecast(NamedTuple):
    """Times `t` (k,) in s, outputs `y` (k, ny) and their standard error `deviation`, None where r is not known."""

    t: Array
    y: Array
    deviation: Array | None


def forecast(model: Any, data: Data, samples: int, u: ArrayLike | None = None) -> OutputForecast:
    """Foretell the outputs that follow data, from inputs that are planned.

    The predictor follows the data to their end; from there on the model runs alone. Its error grows with the noise that
    is still to come, C A^j K e, and with the noise of outputs that are missing, which the predictor did not see; those
    of the parameters and of the initial state are not in it.

    Parameters
    ----------
    model : any model
        A linear result of this package, or a python-control system; a continuous one is sampled with held inputs.
    data : Data
        One experiment, whose end is the beginning.
    samples : int
        How many follow.
    u : array_like, shape (samples,), (samples, nu) or (nu, samples), optional
        The inputs then; left out where the model has none.

    Returns
    -------
    OutputForecast
        Times `t` in s, outputs `y` (samples, ny) and their `deviation`, None where the model does not know r.

    Raises
    ------
    ValueError
        Inputs of another size, channels or steps that differ.
    TypeError
        A model without a linear state space.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 3.2.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, forecast, iddata
    >>> model = Polynomials(1.0, a=np.array([1.0, -0.5]), variance=1.0)  # y(t) = 0.5 y(t-1) + e(t)
    >>> told = forecast(model, iddata([4.0, 3.0, 1.0, 2.0]), 2)
    >>> told.t, told.y[:, 0], told.deviation[:, 0].round(3)  # the second: sqrt(1 + 0.5 ** 2)
    (array([4., 5.]), array([1. , 0.5]), array([1.   , 1.118]))
    """
    own = matched(model, data)
    if samples < 1:
        raise ValueError(f"a forecast is of one sample at least, not of {samples}")
    planned = _planned(u, samples, own.nu)
    said, states = predict_states(own, data)
    last = data.n - 1
    x = own.a @ states[last] + own.b @ data.u[last] + own.k @ np.nan_to_num(data.y[last] - said[last])
    y, spread = np.empty((samples, own.ny)), np.empty((samples, own.ny))
    noise = np.zeros((own.ny, own.ny)) if own.r is None else np.asarray(own.r)
    p, entering = _state_covariance(own, data.y, noise), own.k @ noise @ own.k.T
    for i in range(samples):
        y[i], spread[i] = own.c @ x + own.d @ planned[i], np.sqrt(np.diag(own.c @ p @ own.c.T + noise))
        x, p = own.a @ x + own.b @ planned[i], own.a @ p @ own.a.T + entering
    t = data.t[-1] + data.dt * np.arange(1, samples + 1)
    return OutputForecast(t, y, None if own.r is None else spread)


def _planned(u: ArrayLike | None, samples: int, nu: int) -> Array:
    """(samples, nu)."""
    given = np.zeros((samples, 0)) if u is None else np.asarray(u, dtype=float)
    given = given.reshape(1, -1) if samples == 1 and given.ndim < 2 else given
    planned = given if u is None else input_rows(given, nu)
    if planned.shape != (samples, nu):
        raise ValueError(f"a forecast wants {samples} values of each of the {nu} inputs, not {given.shape}")
    return planned


def _state_covariance(model: Innovations, y: Array, noise: Array) -> Array:
    """(nx, nx) of the predictor's state after outputs y (n, ny), NaN where one is missing and corrects nothing."""
    a, c, k = model.a, model.c, model.k
    p = np.zeros_like(a)
    gaps = np.isnan(y)
    for missing in gaps[int(gaps.any(axis=1).argmax()) :] if gaps.any() else ():
        # x - xhat goes on by a - k M c, M the outputs that are there; the noise of the others comes in unseen
        free, unseen = a - (k * ~missing) @ c, k * missing
        p = free @ p @ free.T + unseen @ noise @ unseen.T
    return p
