"""Data made ready: scales taken off, ends faded, pieces joined.

Rules of this file: a new object each time; every channel is treated alike where the dynamics between them must stay
what they are; whatever is taken off or made up is handed back, so that it can be put on again or left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data, experiments, iddata, with_values
from hoopd.ident.gaps import whole

Array = NDArray[np.float64]
Map = Callable[[Array], ArrayLike]


# ---------------------------------------------------------------------------------------------- values


def apply(data: Data, outputs: Map | None = None, inputs: Map | None = None, dt: float | None = None) -> Data:
    """Put functions on outputs and inputs.

    Parameters
    ----------
    data : Data
        One experiment.
    outputs, inputs : callable, optional
        Functions of whole arrays (n, channels); without one the channels stay. One function for both is given twice.
    dt : float, optional
        Step in s of the result, when the functions change it.

    Returns
    -------
    Data
        The result; states are left out unless the samples stay the same.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import apply, iddata
    >>> data = iddata([1.0, 2.0, 3.0], [1.0, 0.0, 1.0])
    >>> apply(data, outputs=np.square).y[:, 0]
    array([1., 4., 9.])
    """
    y = data.y if outputs is None else np.asarray(outputs(data.y), dtype=float)
    u = data.u if inputs is None else np.asarray(inputs(data.u), dtype=float)
    kept = data.x if len(y) == data.n and dt in {None, data.dt} else None
    step = data.dt if dt is None else dt
    same = y.ndim == 2 and y.shape[1] == data.ny
    return iddata(
        y, u, step, t0=data.t0, x=kept,
        outputs=data.outputs if same else None, inputs=data.inputs if u.shape[1:] == (data.nu,) else None,
    )  # fmt: skip


def scale(data: Data, outputs: ArrayLike = 1.0, inputs: ArrayLike = 1.0) -> Data:
    """Multiply outputs and inputs.

    Parameters
    ----------
    data : Data
        One experiment.
    outputs, inputs : float or array_like, shape (channels,) or (channels, channels)
        A number for all, a number each, or a square matrix from the left.

    Returns
    -------
    Data
        The result.

    Raises
    ------
    ValueError
        Numbers that do not fit the channels.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, scale
    >>> data = iddata(np.ones((3, 2)), np.ones(3))
    >>> scale(data, outputs=[1.0, 100.0]).y[0]
    array([  1., 100.])
    """
    return with_values(data, _times(data.y, outputs, "outputs"), _times(data.u, inputs, "inputs"), data.x)


class UnitVariance(NamedTuple):
    """Data of unit variance, and what each channel was divided by."""

    data: Data
    y: Array
    u: Array


def normalize(data: Data) -> UnitVariance:
    """Divide every channel by its standard deviation.

    Parameters
    ----------
    data : Data
        One experiment.

    Returns
    -------
    Unit
        The `data` of unit variance, and what each channel was divided by, `y` (ny,) and `u` (nu,).

    Raises
    ------
    ValueError
        A constant channel, which has no deviation.

    Examples
    --------
    >>> from hoopd.ident import iddata, normalize
    >>> unit = normalize(iddata([0.0, 4.0, 0.0, 4.0], [1.0, -1.0, 1.0, -1.0]))
    >>> unit.y, unit.data.y[:, 0]
    (array([2.]), array([0., 2., 0., 2.]))
    """
    y, u = _deviations(data.y, data.outputs), _deviations(data.u, data.inputs)
    return UnitVariance(scale(data, 1.0 / y, 1.0 / u), y, u)


def ramp_in(data: Data, samples: int) -> Data:
    """Fade all inputs and outputs in, from 0 to 1 in a line over the first samples.

    Parameters
    ----------
    data : Data
        One experiment.
    samples : int
        Length of the ramp, up to that of the data; one or none does nothing.

    Returns
    -------
    Data
        The result.

    Raises
    ------
    ValueError
        A ramp that is longer than the data.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, ramp_in
    >>> ramp_in(iddata(np.ones(6)), 3).y[:, 0]
    array([0. , 0.5, 1. , 1. , 1. , 1. ])
    """
    return _faded(data, samples)


def ramp_out(data: Data, samples: int) -> Data:
    """Fade all inputs and outputs out, from 1 to 0 in a line over the last samples.

    Parameters
    ----------
    data : Data
        One experiment.
    samples : int
        Length of the ramp, up to that of the data; one or none does nothing.

    Returns
    -------
    Data
        The result.

    Raises
    ------
    ValueError
        A ramp that is longer than the data.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, ramp_out
    >>> ramp_out(iddata(np.ones(6)), 3).y[:, 0]
    array([1. , 1. , 1. , 1. , 0.5, 0. ])
    """
    return _faded(data, samples, backwards=True)


def _faded(data: Data, samples: int, *, backwards: bool = False) -> Data:
    if samples > data.n:
        raise ValueError(f"a ramp over {samples} samples is longer than the data, which have {data.n}")
    if samples <= 1:
        return data
    gain = np.concatenate([np.linspace(0.0, 1.0, samples), np.ones(data.n - samples)])
    gain = gain[::-1] if backwards else gain
    return with_values(data, data.y * gain[:, None], data.u * gain[:, None], data.x)


def _times(values: Array, factor: ArrayLike, name: str) -> Array:
    gain = np.asarray(factor, dtype=float)
    if gain.ndim == 2 and gain.shape == (values.shape[1],) * 2:
        return np.asarray(values @ gain.T)
    if gain.ndim > 1 or (gain.ndim == 1 and len(gain) != values.shape[1]):
        raise ValueError(f"{name}: {values.shape[1]} channels want a number, so many numbers or a square matrix")
    return np.asarray(values * gain)


def _deviations(values: Array, names: Sequence[str]) -> Array:
    spread = np.nanstd(values, axis=0)
    for one, name in zip(spread, names, strict=True):
        if not one > 0.0:
            raise ValueError(f"{name} is constant: it cannot be brought to unit variance")
    return np.asarray(spread)


# ---------------------------------------------------------------------------------------------- pieces


def concatenate(*pieces: Data) -> Data:
    """Join pieces one after the other in time to one experiment; the first one's times go on.

    Joining claims that the state goes on as well: separate experiments belong in a list (`merged`).

    Parameters
    ----------
    *pieces : Data
        The pieces.

    Returns
    -------
    Data
        One experiment.

    Raises
    ------
    ValueError
        Channels or steps that differ.

    Examples
    --------
    >>> from hoopd.ident import iddata, concatenate
    >>> concatenate(iddata([1.0, 2.0]), iddata([3.0])).y[:, 0]
    array([1., 2., 3.])
    """
    each = experiments(pieces)
    states = [one.x for one in each if one.x is not None]
    x = np.concatenate(states) if len(states) == len(each) else None
    return with_values(each[0], np.concatenate([one.y for one in each]), np.concatenate([one.u for one in each]), x)


def merge(*given: Data | Sequence[Data]) -> list[Data]:
    """Put separate experiments of one system into one flat list.

    Parameters
    ----------
    *given : Data or sequence of Data
        The experiments.

    Returns
    -------
    list of Data
        All of them.

    Raises
    ------
    ValueError
        Channels or steps that differ.

    Examples
    --------
    >>> from hoopd.ident import iddata, merge
    >>> one, other = iddata([1.0, 2.0]), iddata([3.0, 4.0])
    >>> len(merge(one, [other, one]))
    3
    """
    return experiments([one for part in given for one in ([part] if isinstance(part, Data) else part)])


def predictor_data(data: Data) -> Data:
    """Give the data whose input is [u; y], for predictors and error filters.

    Parameters
    ----------
    data : Data
        One experiment.

    Returns
    -------
    Data
        The same outputs, and the inputs u and y.

    Raises
    ------
    ValueError
        An output is missing.

    Examples
    --------
    >>> from hoopd.ident import iddata, predictor_data
    >>> predictor_data(iddata([1.0, 2.0], [0.0, 5.0])).inputs
    ('u', 'y measured')
    """
    names = [*data.inputs, *(f"{name} measured" for name in data.outputs)]
    return iddata(
        data.y, np.hstack([data.u, whole(data, "as an input").y]), data.dt,
        t0=data.t0, x=data.x, outputs=data.outputs, inputs=names,
    )  # fmt: skip
