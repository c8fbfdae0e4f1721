"""Data made ready: trends and scales taken off, ends faded, gaps filled, pieces joined.

Rules of this file: a new object each time; every channel is treated alike where the dynamics between them must stay
what they are; whatever is taken off or made up is handed back, so that it can be put on again or left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from hoopd.ident.data import Data, experiments, iddata

Array = NDArray[np.float64]
Map = Callable[[Array], ArrayLike]


# ---------------------------------------------------------------------------------------------- trends


@dataclass(frozen=True)
class Trend:
    """Polynomials of time by channel, coefficients (order + 1, channels) of ((t - centre_s) / span_s)^k."""

    y: Array
    u: Array
    x: Array | None
    centre_s: float
    span_s: float

    def at(self, t: Array, part: Array) -> Array:
        """(len(t), channels) values of `part` (one of y, u, x) at the times t."""
        return _powers((t - self.centre_s) / self.span_s, len(part) - 1) @ part

    def removed(self, data: Data) -> Data:
        """The data without this trend; times count from the same zero as those that it was found in."""
        return self._added(data, -1.0)

    def restored(self, data: Data) -> Data:
        """The data with this trend put on again."""
        return self._added(data, 1.0)

    def _added(self, data: Data, sign: float) -> Data:
        x = None if data.x is None or self.x is None else data.x + sign * self.at(data.t, self.x)
        return _made(data, data.y + sign * self.at(data.t, self.y), data.u + sign * self.at(data.t, self.u), x)


def trend(data: Data, order: int = 0) -> Trend:
    """Find the polynomial in time that lies nearest to each channel.

    Parameters
    ----------
    data : Data
        One experiment; gaps count not.
    order : int
        0 is the mean, 1 the line.

    Returns
    -------
    Trend
        It takes itself off data by `removed(data)` and puts itself on again by `restored(data)`.

    Raises
    ------
    ValueError
        A channel with fewer samples than coefficients, or a negative order.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, trend
    >>> data = iddata([1.0, 3.0, 5.0, 7.0], dt=1.0)
    >>> line = trend(data, order=1)
    >>> np.allclose(line.removed(data).y, 0.0), line.at(np.array([10.0]), line.y).round(6)
    (True, array([[21.]]))
    """
    if order < 0:
        raise ValueError(f"the order of a trend is 0 (mean), 1 (line) or more, not {order}")
    centre, span = float(np.mean(data.t)) if data.n else 0.0, max(data.dt * data.n / 2.0, data.dt)
    basis = _powers((data.t - centre) / span, order)
    x = None if data.x is None else _fitted(basis, data.x, "x")
    return Trend(_fitted(basis, data.y, "y"), _fitted(basis, data.u, "u"), x, centre, span)


def detrend(data: Data, order: int = 0) -> Data:
    """Take the mean, the line or a polynomial in time off every channel; `trend` tells what was taken off.

    Parameters
    ----------
    data : Data
        One experiment; gaps count not.
    order : int
        0 is the mean, 1 the line.

    Returns
    -------
    Data
        The data without it.

    Raises
    ------
    ValueError
        A channel with fewer samples than coefficients, or a negative order.

    Examples
    --------
    >>> from hoopd.ident import detrend, iddata
    >>> detrend(iddata([1.0, 2.0, 6.0])).y[:, 0]
    array([-2., -1.,  3.])
    """
    return trend(data, order).removed(data)


def _powers(t: Array, order: int) -> Array:
    return np.asarray(np.vander(t, order + 1, increasing=True))


def _fitted(basis: Array, values: Array, name: str) -> Array:
    found = np.zeros((basis.shape[1], values.shape[1]))
    for i, column in enumerate(values.T):
        seen = np.isfinite(column)
        if seen.sum() < basis.shape[1]:
            raise ValueError(f"{name}[{i}] has {seen.sum()} samples, too few for a trend of {basis.shape[1]} numbers")
        found[:, i] = np.linalg.lstsq(basis[seen], column[seen], rcond=None)[0]
    return found


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
    return _made(data, _times(data.y, outputs, "outputs"), _times(data.u, inputs, "inputs"), data.x)


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
        Length of the ramp; one or none does nothing.

    Returns
    -------
    Data
        The result.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, ramp_in
    >>> ramp_in(iddata(np.ones(6)), 3).y[:, 0]
    array([0. , 0.5, 1. , 1. , 1. , 1. ])
    """
    return _faded(data, np.concatenate([np.linspace(0.0, 1.0, samples), np.ones(data.n - samples)]), samples)


def ramp_out(data: Data, samples: int) -> Data:
    """Fade all inputs and outputs out, from 1 to 0 in a line over the last samples.

    Parameters
    ----------
    data : Data
        One experiment.
    samples : int
        Length of the ramp; one or none does nothing.

    Returns
    -------
    Data
        The result.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, ramp_out
    >>> ramp_out(iddata(np.ones(6)), 3).y[:, 0]
    array([1. , 1. , 1. , 1. , 0.5, 0. ])
    """
    return _faded(data, np.concatenate([np.ones(data.n - samples), np.linspace(1.0, 0.0, samples)]), samples)


def _faded(data: Data, gain: Array, samples: int) -> Data:
    if samples <= 1:
        return data
    return _made(data, data.y * gain[:, None], data.u * gain[:, None], data.x)


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
    return _made(each[0], np.concatenate([one.y for one in each]), np.concatenate([one.u for one in each]), x)


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


# ---------------------------------------------------------------------------------------------- gaps


class Filled(NamedTuple):
    """Data without gaps and which samples (n, ny) were made up."""

    data: Data
    filled: NDArray[np.bool_]


def fill_gaps(data: Data, method: Literal["linear", "pchip"] = "linear", longest_s: float = np.inf) -> Filled:
    """Interpolate missing outputs in time.

    Parameters
    ----------
    data : Data
        One experiment.
    method : {"linear", "pchip"}
        Lines, or cubics that do not overshoot.
    longest_s : float
        Gaps longer than so many seconds stay missing, as those at the ends do.

    Returns
    -------
    Filled
        The `data`, and which samples (n, ny) were made up, `filled`.

    Raises
    ------
    ValueError
        A method that is none.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import fill_gaps, iddata
    >>> done = fill_gaps(iddata([1.0, np.nan, 3.0, np.nan]))
    >>> done.data.y[:, 0], done.filled[:, 0]
    (array([ 1.,  2.,  3., nan]), array([False,  True, False, False]))
    """
    y = data.y.copy()
    for i in range(data.ny):
        y[:, i] = _interpolated(data.t, data.y[:, i], method, longest_s)
    return Filled(_made(data, y, data.u, data.x), np.isnan(data.y) & np.isfinite(y))


def whole(data: Data, what: str) -> Data:
    """The data, if no output is missing; ValueError that says what to do if one is."""
    if not data.complete:
        gap = int(np.argwhere(~np.isfinite(data.y))[0, 0])
        raise ValueError(f"{what}: y is missing at sample {gap}; fill_gaps(data) first, or take each of runs(data)")
    return data


def _interpolated(t: Array, values: Array, method: str, longest_s: float) -> Array:
    seen = np.isfinite(values)
    if seen.all() or seen.sum() < 2:
        return values
    known = np.flatnonzero(seen)
    if method not in {"linear", "pchip"}:
        raise ValueError(f'a gap is filled by "linear" or "pchip", not {method!r}')
    inside = t[known[0] : known[-1] + 1]
    found = (
        np.interp(inside, t[known], values[known])
        if method == "linear"
        else PchipInterpolator(t[known], values[known])(inside)
    )
    out = values.copy()
    out[known[0] : known[-1] + 1] = found
    for first, last in pairwise(known):
        if t[last] - t[first] > longest_s:
            out[first + 1 : last] = np.nan
    return np.asarray(np.where(seen, values, out))


def _made(data: Data, y: Array, u: Array, x: Array | None) -> Data:
    for one in (y, u):
        one.setflags(write=False)
    return replace(data, y=y, u=u, x=x)
