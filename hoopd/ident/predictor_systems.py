"""The predictor of a model, and its errors, as systems from [u; y].

Rules of this file: exact, and nothing is estimated; numbers of data come from `prediction`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hoopd.ident.model_forms import innovation_form
from hoopd.ident.prediction import whole_horizon

if TYPE_CHECKING:
    import control as ct


def predictor_system(model: Any, horizon: float = 1) -> ct.StateSpace:
    """Give the predictor as a system from [u; y] to the prediction `horizon` samples ahead.

    x(t|t-h) = x(t|t-1) - sum_{j=1}^{h-1} a^(j-1) k e(t-j), so beside the state of the one-step predictor the last h - 1
    innovations are its states: yhat(t) follows from u up to t and y up to t - horizon.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system.
    horizon : int or inf
        Samples ahead; infinity is the simulation, in which y plays no part.

    Returns
    -------
    control.StateSpace
        Inputs u, then y; outputs yhat.

    Raises
    ------
    ValueError
        A horizon that is none; one in samples of a continuous model.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, predictor_system
    >>> model = Polynomials(1.0, a=np.array([1.0, -0.5]), b=(np.array([0.0, 2.0]),))
    >>> predictor = predictor_system(model)  # yhat(t) = 0.5 y(t-1) + 2 u(t-1)
    >>> predictor.C @ predictor.B
    array([[2. , 0.5]])
    """
    import control as ct

    own = innovation_form(model)
    if horizon == np.inf:
        b, d = np.hstack([own.b, np.zeros_like(own.k)]), np.hstack([own.d, np.zeros((own.ny, own.ny))])
        return ct.StateSpace(own.a, b, own.c, d, own.dt)
    held = whole_horizon(horizon) - 1
    if not own.dt:
        raise ValueError(
            "a horizon is in samples and a continuous model has none: c2d(model, dt) first, or horizon=inf (simulation)"
        )
    shift = np.eye(own.ny * held, k=-own.ny)
    first = np.eye(own.ny * held, own.ny)
    # e = y - c x - d u enters the line of the last ones
    a = np.block([[own.a - own.k @ own.c, np.zeros((own.nx, own.ny * held))], [-first @ own.c, shift]])
    b = np.block([[own.b - own.k @ own.d, own.k], [-first @ own.d, first]])
    back = [own.c @ np.linalg.matrix_power(own.a, j) @ own.k for j in range(held)]
    c = np.hstack([own.c, *(-one for one in back)])
    return ct.StateSpace(a, b, c, np.hstack([own.d, np.zeros((own.ny, own.ny))]), own.dt)


def error_system(model: Any, horizon: float = 1) -> ct.StateSpace:
    """Give the error filter as a system from [u; y] to y - yhat, `horizon` samples ahead.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system.
    horizon : int or inf
        Samples ahead; infinity is the simulation.

    Returns
    -------
    control.StateSpace
        Inputs u, then y; outputs y - yhat.

    Raises
    ------
    ValueError
        A horizon that is none; one in samples of a continuous model.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, error_system
    >>> model = Polynomials(1.0, a=np.array([1.0, -0.5]), b=(np.array([0.0, 2.0]),))
    >>> error = error_system(model)  # y(t) - 0.5 y(t-1) - 2 u(t-1)
    >>> error.D, error.C @ error.B
    (array([[0., 1.]]), array([[-2. , -0.5]]))
    """
    import control as ct

    said = predictor_system(model, horizon)
    nu = said.ninputs - said.noutputs
    own = np.hstack([np.zeros((said.noutputs, nu)), np.eye(said.noutputs)])
    return ct.StateSpace(said.A, said.B, -said.C, own - said.D, said.dt)
