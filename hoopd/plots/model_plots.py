"""Pictures of models and their data, one call each: data, comparison, residuals, Bode and steps with bands, poles.

Each takes models (results of `hoopd.ident`, systems of python-control, responses), one, several or by name, and gives
matplotlib's figure: `bode([arx(data, 2, 2), oe(data, 2, 2)], data).savefig("bode.png")`.

Rules of this file: what is drawn comes from `hoopd.ident` as it is; how it is drawn is `identification`'s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from hoopd.ident import impulse_response, predict, residuals, step_response
from hoopd.ident.confidence import pole_spread, zero_spread, zeros_of
from hoopd.ident.data import Data, experiments
from hoopd.ident.model_forms import named_models, root_form
from hoopd.ident.step_responses import TimeResponse
from hoopd.plots.identification import (
    MEASURED,
    Roots,
    draw_data,
    draw_residuals,
    draw_response_matrix,
    draw_roots,
    draw_said,
    draw_time_responses,
)
from hoopd.plots.model_responses import matrix_of, measured_matrix, response_axis, without_form

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Pairs of channels whose zeros are drawn one by one.
MOST_PAIRS = 6
# Experiments of a comparison that are drawn.
MOST_EXPERIMENTS = 4


def plot(data: Data | Sequence[Data] | Mapping[str, Data], *, title: str = "", units: Units = None) -> Figure:
    """Draw data: outputs and inputs over time, several experiments over each other.

    Parameters
    ----------
    data : Data, sequence of Data, or mapping of str to Data
        One or several experiments with the same channels.
    title : str
        Stands above.
    units : mapping of str to str, optional
        Units by channel.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; a notebook shows it, `savefig` writes it.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata
    >>> from hoopd.plots import plot
    >>> [axes.get_ylabel() for axes in plot(iddata(np.zeros(9), np.ones(9)), units={"y": "V"}).axes]
    ['y (V)', 'input u']
    """
    each = (
        data if isinstance(data, Mapping) else {f"experiment {i + 1}": one for i, one in enumerate(experiments(data))}
    )
    return draw_data(dict(each), title, units)


def compare_plot(
    models: Models,
    data: Data | Sequence[Data],
    horizon: float = np.inf,
    *,
    title: str = "",
    units: Units = None,
    offsets: Mapping[str, float] | None = None,
) -> Figure:
    """Draw what models say of data beside what was measured, with their fit in percent.

    Parameters
    ----------
    models : any model, sequence of models, or mapping of str to any model
        Results of `hoopd.ident`, python-control systems or FRDs.
    data : Data or sequence of Data
        Of several experiments the first four are drawn, one below the other.
    horizon : int or inf
        Samples ahead; infinity is the simulation from the inputs alone.
    title : str
        Stands above.
    units : mapping of str to str, optional
        Units by channel.
    offsets : mapping of str to float, optional
        The operating point by output that data and models are about, added to what is drawn.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; a notebook shows it, `savefig` writes it.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import iddata
    >>> from hoopd.plots import compare_plot
    >>> lag, u = control.tf([1.0], [1.0, 1.0]), np.ones(50)
    >>> data = iddata(1.0 - np.exp(-0.1 * np.arange(50)), u, 0.1)
    >>> compare_plot({"lag": lag}, data).axes[0].get_legend_handles_labels()[1]
    ['measured', 'lag, simulated: 100.0 %']
    """
    shown = experiments(data)[:MOST_EXPERIMENTS]
    with np.errstate(over="ignore", invalid="ignore"):
        said = {name: [predict(model, one, horizon) for one in shown] for name, model in named_models(models).items()}
    how = "simulated" if horizon == np.inf else f"{horizon:g} ahead"
    return draw_said(shown, said, how, title, units, offsets)


def resid(model: Any, data: Data | Sequence[Data], lags: int = 25, *, title: str = "Residuals") -> Figure:
    """Draw the correlations of a model's one-step errors with themselves and with the inputs, with 95 % bands.

    Parameters
    ----------
    model : any model
        A result of `hoopd.ident`, a python-control system or an FRD.
    data : Data or sequence of Data
        The experiments.
    lags : int
        How many are tested.
    title : str
        Stands above.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; a notebook shows it, `savefig` writes it.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import arx, iddata
    >>> from hoopd.plots import resid
    >>> u, e = np.random.default_rng(0).standard_normal((2, 300))
    >>> data = iddata(np.concatenate([[0.0], u[:-1]]) + 0.1 * e, u)
    >>> resid(arx(data, 1, 2), data).axes[0].get_title(loc="right").startswith("white: yes")
    True
    """
    if isinstance(model, Mapping | list | tuple):
        raise TypeError("the residuals of one model are drawn, not of several: call it for each")
    return draw_residuals(residuals(model, data, lags), title)


def bode(
    models: Models, data: Data | Sequence[Data] | None = None, *, w: ArrayLike | None = None,
    title: str = "Frequency response",
) -> Figure:  # fmt: skip
    """Draw gain and phase of models with the 95 % bands of those that have a covariance, and the data's own response.

    Parameters
    ----------
    models : any model, sequence of models, or mapping of str to any model
        Results of `hoopd.ident`, python-control systems or FRDs.
    data : Data or sequence of Data, optional
        Their response without a model (Welch), where the coherence is above 0.1, is drawn broad and light behind.
    w : array_like, shape (nw,), optional
        Frequencies in rad/s; three decades up to half of the sampling frequency unless given.
    title : str
        Stands above.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, a gain and a phase for each output and input.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import arx, iddata
    >>> from hoopd.plots import bode
    >>> u, e = np.random.default_rng(0).standard_normal((2, 500))
    >>> data = iddata(np.concatenate([[0.0], u[:-1]]) + 0.1 * e, u)
    >>> gain, phase = bode(arx(data, 1, 2), data).axes
    >>> gain.get_legend_handles_labels()[1]
    ['from the data', 'ARX']
    """
    named = named_models(models)
    axis = response_axis(list(named.values()), data) if w is None else np.asarray(w, dtype=float).reshape(-1)
    drawn = {name: matrix_of(model, axis) for name, model in named.items()}
    first = next(iter(drawn.values()))
    if any(one.h.shape[:2] != first.h.shape[:2] for one in drawn.values()):
        raise ValueError("the models have different numbers of outputs or inputs: draw them one by one")
    behind = {} if data is None else {"from the data": measured_matrix(data, axis)}
    ny, nu = first.h.shape[:2]
    outputs, inputs = _channels(next(iter(named.values())), ny, nu)
    curves = [
        [
            [*(one.entry(name, i, j, MEASURED) for name, one in behind.items()), *(
                one.entry(name, i, j) for name, one in drawn.items()
            )]
            for j in range(nu)
        ]
        for i in range(ny)
    ]  # fmt: skip
    return draw_response_matrix(curves, title, outputs=outputs, inputs=inputs)


def step(models: Models, seconds: float | None = None, *, title: str = "Step response") -> Figure:
    """Draw the response of models to a step of each input with the 95 % bands of those that have a covariance.

    Parameters
    ----------
    models : any model, sequence of models, or mapping of str to any model
        Results of `hoopd.ident` or python-control systems.
    seconds : float, optional
        How long; until the slowest mode of the slowest model has fallen to a hundredth unless given.
    title : str
        Stands above.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, a picture for each output and input.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import arx, iddata
    >>> from hoopd.plots import step
    >>> u, e = np.random.default_rng(0).standard_normal((2, 500))
    >>> data = iddata(np.concatenate([[0.0], u[:-1]]) + 0.1 * e, u)
    >>> step(arx(data, 1, 2), 5.0).axes[0].get_ylabel()
    'y per step of u'
    """
    return _over_time(models, seconds, step_response, title, "step")


def impulse(models: Models, seconds: float | None = None, *, title: str = "Impulse response") -> Figure:
    """Draw the response of models to a pulse of each input of area one, with 95 % bands where there is a covariance.

    Parameters
    ----------
    models : any model, sequence of models, or mapping of str to any model
        Results of `hoopd.ident` (one of `impulseest` is drawn as it was estimated) or python-control systems.
    seconds : float, optional
        How long; until the slowest mode of the slowest model has fallen to a hundredth unless given.
    title : str
        Stands above.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, a picture for each output and input.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import arx, iddata, impulseest
    >>> from hoopd.plots import impulse
    >>> u, e = np.random.default_rng(0).standard_normal((2, 500))
    >>> data = iddata(np.concatenate([[0.0], u[:-1]]) + 0.1 * e, u)
    >>> impulse({"ARX": arx(data, 1, 2), "no structure": impulseest(data, 20)}).axes[0].get_ylabel()
    'y per unit pulse of u'
    """
    return _over_time(models, seconds, impulse_response, title, "unit pulse")


def _over_time(
    models: Models, seconds: float | None, answer: Callable[[Any, float | None], TimeResponse], title: str, to: str
) -> Figure:
    named = named_models(models)
    for one in named.values():
        if without_form(one):
            raise TypeError(f"a {type(one).__name__} has no response to a {to} of its own")
    first = next(iter(named.values()))
    answers = {name: answer(one, seconds) for name, one in named.items()}
    sizes = {one.y.shape[1:] for one in answers.values()}
    if len(sizes) > 1:
        raise ValueError("the models have different numbers of outputs or inputs: draw them one by one")
    if seconds is None and len(named) > 1:
        longest = max(float(one.t[-1]) for one in answers.values())
        answers = {name: answer(one, longest) for name, one in named.items()}
    return draw_time_responses(answers, *_channels(first, *sizes.pop()), title, to)


def pzmap(models: Models, *, title: str = "Poles and zeros") -> Figure:
    """Draw poles and zeros of models with the 95 % ellipses of those that have a covariance.

    Parameters
    ----------
    models : any model, sequence of models, or mapping of str to any model
        Results of `hoopd.ident` or python-control systems, all sampled or all continuous.
    title : str
        Stands above.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; of several channels the zeros are those of each pair for one model, of the first pair for several.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import arx, iddata
    >>> from hoopd.plots import pzmap
    >>> u, e = np.random.default_rng(0).standard_normal((2, 500))
    >>> made = pzmap(arx(iddata(np.concatenate([[0.0], u[:-1]]) + 0.1 * e, u), 1, 2))
    >>> made.axes[0].get_legend_handles_labels()[1]
    ['ARX']
    """
    named = named_models(models)
    continuous = {root_form(one).dt == 0.0 for one in named.values()}
    if len(continuous) > 1:
        raise ValueError("sampled and continuous models have no plane in common: draw them one by one")
    only = next(iter(named.values()))
    pairs = root_form(only).ny * root_form(only).nu
    if len(named) == 1 and 1 < pairs <= MOST_PAIRS:
        sets = _by_pair(only)
    else:
        sets = [_root_set(name, one) for name, one in named.items()]
    return draw_roots(sets, title, continuous=continuous.pop())


# ------------------------------------------------------------------------------------------------- inside

Models = Any
_Spread = tuple[Complex, Sequence[Array] | Array]
NONE: _Spread = (np.zeros(0, dtype=complex), ())
Units = Mapping[str, str] | None


def _root_set(name: str, model: Any) -> Roots:
    """Poles, and zeros of the first pair, with their covariances where the model has them."""
    poles, zeros = _poles(model), _zeros(model, 0, 0) if root_form(model).nu else NONE
    return Roots(name, poles[0], zeros[0], poles[1], zeros[1])


def _by_pair(model: Any) -> list[Roots]:
    """Poles once, zeros by output and input."""
    form, poles = root_form(model), _poles(model)
    outputs, inputs = _channels(model, form.ny, form.nu)
    sets = [Roots("poles", poles[0], NONE[0], poles[1])]
    for i in range(form.ny):
        for j in range(form.nu):
            zeros = _zeros(model, i, j)
            sets.append(Roots(f"zeros, {outputs[i]} from {inputs[j]}", NONE[0], zeros[0], (), zeros[1]))
    return sets


def _poles(model: Any) -> _Spread:
    spread = pole_spread(model)
    if spread is None:
        return np.linalg.eigvals(root_form(model).a).astype(complex), ()
    return spread.roots, spread.covariances


def _zeros(model: Any, output: int, channel: int) -> _Spread:
    spread = zero_spread(model, output, channel)
    if spread is None:
        return zeros_of(root_form(model), output, channel), ()
    return spread.roots, spread.covariances


def _channels(model: Any, ny: int, nu: int) -> tuple[list[str], list[str]]:
    own = getattr(model, "system", model)
    return list(getattr(own, "output_labels", [f"y{i + 1}" for i in range(ny)])), list(
        getattr(own, "input_labels", [f"u{i + 1}" for i in range(nu)])
    )
