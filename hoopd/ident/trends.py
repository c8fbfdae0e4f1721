"""Trends: the mean, a line or a polynomial in time of every channel, taken off and put on again.

Rules of this file: a new object each time; what is taken off is handed back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments, one_experiment, with_values

Array = NDArray[np.float64]


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
        return with_values(data, data.y + sign * self.at(data.t, self.y), data.u + sign * self.at(data.t, self.u), x)


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
    TypeError
        Several experiments.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, trend
    >>> data = iddata([1.0, 3.0, 5.0, 7.0], dt=1.0)
    >>> line = trend(data, order=1)
    >>> np.allclose(line.removed(data).y, 0.0), line.at(np.array([10.0]), line.y).round(6)
    (True, array([[21.]]))
    """
    one_experiment(data, "a trend")
    if order < 0:
        raise ValueError(f"the order of a trend is 0 (mean), 1 (line) or more, not {order}")
    centre, span = float(np.mean(data.t)) if data.n else 0.0, max(data.dt * data.n / 2.0, data.dt)
    basis = _powers((data.t - centre) / span, order)
    x = None if data.x is None else _fitted(basis, data.x, "x")
    return Trend(_fitted(basis, data.y, "y"), _fitted(basis, data.u, "u"), x, centre, span)


@overload
def detrend(data: Data, order: int = 0) -> Data: ...


@overload
def detrend(data: Sequence[Data], order: int = 0) -> list[Data]: ...


def detrend(data: Data | Sequence[Data], order: int = 0) -> Data | list[Data]:
    """Take the mean, the line or a polynomial in time off every channel; `trend` tells what was taken off.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments, each with a trend of its own; gaps count not.
    order : int
        0 is the mean, 1 the line.

    Returns
    -------
    Data or list of Data
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
    if not isinstance(data, Data):
        return [detrend(one, order) for one in experiments(data)]
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
