"""Any linear model from continuous to sampled time, back, and to another step.

Rules of this file: the conversions themselves are `statespace.sampling`'s; here models become the form that it takes.
"""

from __future__ import annotations

from typing import Any

from hoopd.ident.delayed_model import DelayedModel, undelayed
from hoopd.ident.model_forms import innovation_form
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.sampling import continuous_form, sampled_form


def c2d(model: Any, dt: float) -> Innovations:
    """Sample a continuous model with noise, inputs and innovations held over the step.

    Parameters
    ----------
    model : any model
        A continuous one (dt = 0), a python-control system too; its q, r, s are densities. One with a dead time
        (`srivc`'s, or what `d2c` gives) gets the inputs of the steps before as states.
    dt : float
        Step in s.

    Returns
    -------
    Innovations
        The sampled model, the noise integrated over the step.

    Raises
    ------
    ValueError
        A model that is sampled already, or a step that is none.

    Notes
    -----
    Source: Van Loan, IEEE Trans. Automatic Control 23, 1978.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Innovations, c2d
    >>> one = np.ones((1, 1))
    >>> lag = c2d(Innovations(-2.0 * one, one, one, 0.0 * one, 0.0 * one, dt=0.0), 0.1)
    >>> lag.a.round(4), lag.b.round(4)  # exp(-0.2) and (1 - exp(-0.2))/2
    (array([[0.8187]]), array([[0.0906]]))
    """
    if has_dead_time(model):
        return DelayedModel(model.undelayed, model.delays).sampled(dt)
    return sampled_form(innovation_form(model), dt)


def d2c(model: Any) -> Innovations | DelayedModel:
    """Give the continuous model that a sampled one comes from.

    Whole steps of dead time of a polynomial model or a transfer function, beyond the one of the hold, are no part of
    the continuous dynamics: they stand beside them.

    Parameters
    ----------
    model : any model
        A sampled one, a python-control system too.

    Returns
    -------
    Innovations or DelayedModel
        The continuous model (dt = 0); its q, r, s are densities. With a dead time, which no finite state space has, it
        is a model's `undelayed`, and the `delays` in s stand beside it.

    Raises
    ------
    ValueError
        A pole on the negative real axis or at zero, whose logarithm is not real; a model that is continuous already.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Innovations, d2c
    >>> one = np.ones((1, 1))
    >>> d2c(Innovations(np.exp(-0.2) * one, one, one, 0.0 * one, 0.0 * one, dt=0.1)).a.round(6)
    array([[-2.]])
    """
    if isinstance(model, DelayedModel):
        raise ValueError("the model is continuous already")
    if has_dead_time(model):
        form, delays = model.undelayed, model.delays
    else:
        bare, delays = undelayed(model)
        form = continuous_form(innovation_form(bare))
    return DelayedModel(form, delays) if any(delays) else form


def d2d(model: Any, dt: float) -> Innovations:
    """Bring a sampled model to another step, by way of continuous time.

    Parameters
    ----------
    model : any model
        A sampled one, a python-control system too.
    dt : float
        New step in s.

    Returns
    -------
    Innovations
        The model at that step.

    Raises
    ------
    ValueError
        A pole on the negative real axis or at zero.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Innovations, d2d
    >>> one = np.ones((1, 1))
    >>> slower = d2d(Innovations(0.9 * one, one, one, 0.0 * one, 0.0 * one, dt=0.1), 0.2)
    >>> slower.a.round(6), slower.b.round(6)
    (array([[0.81]]), array([[1.9]]))
    """
    return c2d(d2c(model), dt)


def has_dead_time(model: Any) -> bool:
    """Whether it is a continuous model with a dead time: `undelayed` and `delays`."""
    return hasattr(model, "undelayed") and hasattr(model, "delays")
