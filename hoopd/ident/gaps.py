"""Missing outputs: filled where they are few, refused where a method cannot go through them.

Rules of this file: a new object each time; what is made up is handed back, so that it can be left out.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from hoopd.ident.data import Data, with_values

Array = NDArray[np.float64]


class Filled(NamedTuple):
    """Data without gaps and which samples (n, ny) were made up."""

    data: Data
    filled: NDArray[np.bool_]

    def __repr__(self) -> str:
        return f"{self.data}, {int(self.filled.sum())} of its outputs made up"


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
    if method not in ("linear", "pchip"):
        told = repr(method) if isinstance(method, str) else f"a {type(method).__name__}"
        raise ValueError(f'a gap is filled by "linear" or "pchip", not {told}; by a model: smooth(model, data)')
    y = data.y.copy()
    for i in range(data.ny):
        y[:, i] = _interpolated(data.t, data.y[:, i], method, longest_s)
    return Filled(with_values(data, y, data.u, data.x), np.isnan(data.y) & np.isfinite(y))


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
