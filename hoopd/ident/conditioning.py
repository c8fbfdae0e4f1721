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
    """The polynomial of this order that lies nearest to each channel: 0 the mean, 1 the line; gaps count not.

    ValueError when a channel has fewer samples than coefficients.
    """
    if order < 0:
        raise ValueError(f"the order of a trend is 0 (mean), 1 (line) or more, not {order}")
    centre, span = float(np.mean(data.t)) if data.n else 0.0, max(data.dt * data.n / 2.0, data.dt)
    basis = _powers((data.t - centre) / span, order)
    x = None if data.x is None else _fitted(basis, data.x, "x")
    return Trend(_fitted(basis, data.y, "y"), _fitted(basis, data.u, "u"), x, centre, span)


def detrend(data: Data, order: int = 0) -> Data:
    """Data without the mean (0), the line (1) or a polynomial in time; `trend` tells what was taken off."""
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


def applied(data: Data, outputs: Map | None = None, inputs: Map | None = None, dt: float | None = None) -> Data:
    """Functions of whole arrays (n, channels) put on outputs and inputs; `dt` when they change the step.

    One function for both is given twice. States are left out unless the samples stay the same.
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


def scaled(data: Data, outputs: ArrayLike = 1.0, inputs: ArrayLike = 1.0) -> Data:
    """Outputs and inputs times a number, a number each, or a square matrix (channels, channels) from the left."""
    return _made(data, _times(data.y, outputs, "outputs"), _times(data.u, inputs, "inputs"), data.x)


class Unit(NamedTuple):
    """Data of unit variance, and what each channel was divided by."""

    data: Data
    y: Array
    u: Array


def normalised(data: Data) -> Unit:
    """Every channel divided by its standard deviation; ValueError for a constant channel, which has none."""
    y, u = _deviations(data.y, data.outputs), _deviations(data.u, data.inputs)
    return Unit(scaled(data, 1.0 / y, 1.0 / u), y, u)


def ramp_in(data: Data, samples: int) -> Data:
    """All inputs and outputs faded in, from 0 to 1 in a line over the first samples; one or none does nothing."""
    return _faded(data, np.concatenate([np.linspace(0.0, 1.0, samples), np.ones(data.n - samples)]), samples)


def ramp_out(data: Data, samples: int) -> Data:
    """All inputs and outputs faded out over the last samples."""
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


def joined(*pieces: Data) -> Data:
    """Pieces one after the other in time, as one experiment; the first one's times go on.

    Joining claims that the state goes on as well: separate experiments belong in a list (`merged`).
    """
    each = experiments(pieces)
    states = [one.x for one in each if one.x is not None]
    x = np.concatenate(states) if len(states) == len(each) else None
    return _made(each[0], np.concatenate([one.y for one in each]), np.concatenate([one.u for one in each]), x)


def merged(*given: Data | Sequence[Data]) -> list[Data]:
    """Separate experiments of one system in one flat list; ValueError when channels or steps differ."""
    return experiments([one for part in given for one in ([part] if isinstance(part, Data) else part)])


def predictor_data(data: Data) -> Data:
    """Data whose input is [u; y], for predictors and error filters; ValueError where an output is missing."""
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
    """Missing outputs interpolated in time; gaps longer than `longest_s` and those at the ends stay missing."""
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
