"""The response of a model to a step or a pulse of each input, with the standard error that its coefficients leave.

Rules of this file: a model without a covariance has a response and no deviation; nothing is estimated here.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.confidence import coefficients_of
from hoopd.ident.delayed_model import DelayedModel
from hoopd.ident.model_forms import innovation_form
from hoopd.ident.models import Innovations

Array = NDArray[np.float64]

# Unless told otherwise: until the slowest mode has fallen to so much of it, within these numbers of samples.
SETTLED, FEWEST, MOST = 0.01, 20, 1000
# Samples of a continuous model over its slowest mode, and in the time constant of its fastest (or a sixth of a turn of
# it) as far as so many samples last. With an integrator: so many times as long as the other modes take.
FINE, FINE_FAST, MOST_FINE, INTEGRATED = 200, 5, 20_000, 10.0
# A mode that is so much slower than the fastest integrates.
INTEGRATOR = 1e-9


@dataclass(frozen=True)
class TimeResponse:
    """`t` (n,) in s, `y` (n, ny, nu) of a step or pulse of each input, and its standard error `deviation`, or None."""

    t: Array
    y: Array
    deviation: Array | None = None


def step_response(model: Any, seconds: float | None = None) -> TimeResponse:
    """Give the response to a step of one of each input, from rest, with its standard error.

    By linearisation: the derivatives with respect to the estimated coefficients, times the coefficients' covariance.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system; a continuous one is sampled with its input held.
    seconds : float, optional
        How long; until the slowest mode has fallen to a hundredth unless given.

    Returns
    -------
    TimeResponse
        Times `t` (n,) in s, responses `y` (n, ny, nu), and their `deviation`, None of a model without a covariance.

    Raises
    ------
    ValueError
        A time that is none, a model without inputs.

    Notes
    -----
    Source of the linearisation: Ljung, System Identification, 1999, 9.57.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, step_response
    >>> gain = Polynomials(
    ...     0.1, b=(np.array([0.0, 2.0]),), names=("b1",), values=np.array([2.0]), covariance=np.array([[0.01]])
    ... )
    >>> answer = step_response(gain, 0.2)
    >>> answer.y.ravel(), answer.deviation.ravel().round(6)
    (array([0., 2., 2.]), array([0. , 0.1, 0.1]))
    """
    return _answer(model, seconds, pulse=False)


def impulse_response(model: Any, seconds: float | None = None) -> TimeResponse:
    """Give the response to a pulse of each input that has an area of one and lasts a sample, with its standard error.

    So it lies on the impulse response of the continuous system, in unit of y per unit of u and second.

    Parameters
    ----------
    model : any model
        A result of this package (an `impulseest` is one), or a python-control system; a continuous one is sampled with
        its input held.
    seconds : float, optional
        How long; until the slowest mode has fallen to a hundredth unless given.

    Returns
    -------
    TimeResponse
        Times `t` (n,) in s, responses `y` (n, ny, nu), and their `deviation`, None of a model without a covariance.

    Raises
    ------
    ValueError
        A time that is none, a model without inputs.

    Notes
    -----
    Source of the linearisation: Ljung, System Identification, 1999, 9.57.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, impulse_response
    >>> model = Polynomials(0.1, a=np.array([1.0, -0.5]), b=(np.array([0.0, 2.0]),))
    >>> impulse_response(model, 0.3).y.ravel()  # a pulse of 10 for 0.1 s
    array([ 0., 20., 10.,  5.])
    """
    return _answer(model, seconds, pulse=True)


def _answer(model: Any, seconds: float | None, *, pulse: bool) -> TimeResponse:
    if seconds is not None and not 0.0 < seconds < np.inf:
        raise ValueError(f"a response takes a positive time in s, not {seconds:g}")
    late = isinstance(model, DelayedModel)
    form = model.undelayed if late else innovation_form(model)
    if form.nu == 0:
        raise ValueError("a model without inputs has no response to them")
    if form.dt == 0.0:
        length = seconds or _slowest_s(form) + max(model.delays if late else (0.0,))
        count = _samples(form, length)
        form = model.sampled(length / count) if late else innovation_form(model, length / count)
    else:
        count = _count(form) if seconds is None else max(1, round(seconds / form.dt))
    y = _answered(form, count, pulse)
    known = coefficients_of(model)
    deviation = None
    if known is not None and form.dt == known.made(known.values).dt:
        change = known.change(lambda one: _answered(one, count, pulse).astype(complex))
        deviation = np.asarray(np.sqrt(known.spread(change)[..., 0, 0]), dtype=float)
    return TimeResponse(np.asarray(form.dt * np.arange(count + 1), dtype=float), y, deviation)


def _answered(form: Innovations, count: int, pulse: bool) -> Array:
    """Responses (count + 1, ny, nu) from rest."""
    u = np.concatenate([[1.0 / form.dt], np.zeros(count)]) if pulse else np.ones(count + 1)
    x, y = np.zeros((form.nx, form.nu)), np.empty((count + 1, form.ny, form.nu))
    for k in range(count + 1):
        y[k] = form.c @ x + form.d * u[k]
        x = form.a @ x + form.b * u[k]
    return y


def _count(form: Innovations) -> int:
    radius = float(np.abs(np.linalg.eigvals(form.a)).max(initial=0.0))
    if not 0.0 < radius < 1.0:
        return min(max(FEWEST, form.nx // form.nu), MOST) if radius == 0.0 else MOST // 5
    return int(min(max(ceil(log(SETTLED) / log(radius)), FEWEST), MOST))


def _slowest_s(form: Innovations) -> float:
    """Until the slowest stable mode of a continuous model has settled, some times longer where it integrates."""
    rates = -np.linalg.eigvals(form.a).real
    slow = rates[rates > INTEGRATOR * np.abs(rates).max(initial=0.0)]
    if not len(slow):
        return 1.0
    return -log(SETTLED) / float(slow.min()) * (1.0 if len(slow) == len(rates) else INTEGRATED)


def _samples(form: Innovations, seconds: float) -> int:
    fastest = float(np.abs(np.linalg.eigvals(form.a)).max(initial=0.0))
    return int(min(max(FINE, ceil(FINE_FAST * fastest * seconds)), MOST_FINE))
