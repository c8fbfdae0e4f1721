"""How well frequency responses, poles and zeros of an estimated model are known, whatever form the model has.

By linearisation: the derivatives of a response, a pole or a zero with respect to the estimated coefficients, times the
coefficients' covariance (Ljung, System Identification, 1999, 9.57). Derivatives are central differences; a zero z of a
channel has dz = -dG/(dG/dz).

Rules of this file: a model without a covariance gives None; nothing is estimated here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from hoopd.ident.continuous_transfer import ContinuousTransfer, companion
from hoopd.ident.impulse import Impulse
from hoopd.ident.models import Innovations, Polynomials, response_at, state_space
from hoopd.ident.polynomial.arx import VectorArx
from hoopd.ident.stacked_models import StackedModels
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.structured import Structured
from hoopd.ident.statespace.uncertainty import matrices_covariance

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
# Whatever of these carries a covariance has regions.
Estimated = Polynomials | VectorArx | StackedModels | Innovations | Structured | Impulse | ContinuousTransfer

# Step of the differences: of the coefficient's standard error, and at least of the coefficient.
STEP, LEAST = 1e-3, 1e-7
# Roots nearer to zero are delays, or one that is met several times there: they have no derivative.
AT_ZERO = 0.02
# Step of dG/dz.
APART = 1e-6


@dataclass(frozen=True)
class ResponseSpread:
    """Response h (nw, ny, nu), standard error of |h| relative to it, and that of its phase in rad."""

    h: Complex
    gain: Array
    phase: Array


@dataclass(frozen=True)
class RootSpread:
    """Roots (k,) and the covariances (k, 2, 2) of real and imaginary part, zero where a root has none."""

    roots: Complex
    covariances: Array


@dataclass(frozen=True)
class Coefficients:
    values: Array
    covariance: Array
    made: Callable[[Array], Innovations]

    def change(self, function: Callable[[Innovations], Complex]) -> Complex:
        """Derivatives (..., m) of a function of the model."""
        sd = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        steps = np.maximum(STEP * sd, LEAST * np.abs(self.values))
        steps[steps == 0.0] = LEAST  # a zero that is known: what it changes counts for nothing
        columns = []
        for i, step in enumerate(steps):
            up, down = (self.made(self.values + sign * step * np.eye(len(steps))[i]) for sign in (1.0, -1.0))
            columns.append((function(up) - function(down)) / (2.0 * step))
        return np.stack(columns, axis=-1)

    def spread(self, change: Complex) -> Array:
        """Covariances (..., 2, 2) of real and imaginary part."""
        parts = np.stack([change.real, change.imag], axis=-2)
        return np.asarray(parts @ self.covariance @ parts.swapaxes(-1, -2))


def response_spread(model: Estimated, w: ArrayLike) -> ResponseSpread | None:
    """Give the response of an estimated model with its standard errors.

    By linearisation: the derivatives with respect to the estimated coefficients, times the coefficients' covariance.

    Parameters
    ----------
    model : any model
        A result of this package; one without a covariance has no regions.
    w : array_like, shape (nw,)
        Frequencies in rad/s.

    Returns
    -------
    ResponseSpread or None
        The response `h` (nw, ny, nu), the relative standard error of its `gain` and that of its `phase` in rad; None
        without a covariance.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 9.57.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, response_spread
    >>> gain = Polynomials(
    ...     0.1, b=(np.array([2.0]),), names=("b0",), values=np.array([2.0]), covariance=np.array([[0.01]])
    ... )
    >>> spread = response_spread(gain, [1.0])  # 2 +- 0.1
    >>> spread.h.real.item(), round(spread.gain.item(), 4), spread.phase.item()
    (2.0, 0.05, 0.0)
    """
    known = coefficients_of(model)
    if known is None:
        return None
    own = known.made(known.values)
    z = np.exp(1j * np.asarray(w, dtype=float) * own.dt)
    h = response_at(own, z)
    change = known.change(lambda one: response_at(one, z))
    # d ln h = d|h|/|h| + j d arg h
    relative = known.spread(change / h[..., None])
    return ResponseSpread(h, np.sqrt(relative[..., 0, 0]), np.sqrt(relative[..., 1, 1]))


def pole_spread(model: Estimated) -> RootSpread | None:
    """Give the poles of the dynamics from u to y with their covariances.

    Parameters
    ----------
    model : any model
        A result of this package; one without a covariance has no regions.

    Returns
    -------
    RootSpread or None
        The `roots` (k,) and the `covariances` (k, 2, 2) of real and imaginary part; None without a covariance.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 9.57.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import arx, iddata, pole_spread
    >>> rng = np.random.default_rng(0)
    >>> u, y = rng.standard_normal(400), np.zeros(400)
    >>> for t in range(1, 400):
    ...     y[t] = 0.8 * y[t - 1] + u[t - 1] + 0.1 * rng.standard_normal()
    >>> spread = pole_spread(arx(iddata(y, u, 0.1), na=1, nb=1))
    >>> spread.roots.real.round(2), bool(np.sqrt(spread.covariances[0, 0, 0]) < 0.01)
    (array([0.8]), True)
    """
    known = _root_coefficients(model)
    if known is None:
        return None
    own = known.made(known.values)
    poles = np.asarray(np.linalg.eigvals(own.a), dtype=complex)
    change = known.change(lambda one: _nearest(poles, np.asarray(np.linalg.eigvals(one.a), dtype=complex)))
    return _roots(known, poles, change, own.dt)


def zero_spread(model: Estimated, output: int, channel: int = 0) -> RootSpread | None:
    """Give the zeros of one output from one input with their covariances.

    Parameters
    ----------
    model : any model
        A result of this package; one without a covariance has no regions.
    output : int
        Number of the output.
    channel : int
        Number of the input.

    Returns
    -------
    RootSpread or None
        The `roots` (k,) and the `covariances` (k, 2, 2) of real and imaginary part; None without a covariance.

    Notes
    -----
    A zero z of a channel G has dz = -dG/(dG/dz).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import arx, iddata, zero_spread
    >>> rng = np.random.default_rng(0)
    >>> u, y = rng.standard_normal(400), np.zeros(400)
    >>> for t in range(2, 400):
    ...     y[t] = 0.8 * y[t - 1] + u[t - 1] - 0.5 * u[t - 2] + 0.1 * rng.standard_normal()
    >>> spread = zero_spread(arx(iddata(y, u, 0.1), na=1, nb=2), output=0)
    >>> bool(abs(spread.roots[0] - 0.5) < 3 * np.sqrt(spread.covariances[0, 0, 0]))
    True
    """
    known = _root_coefficients(model)
    if known is None:
        return None
    own = known.made(known.values)
    zeros = zeros_of(own, output, channel)
    slope = [response_at(own, zeros + step)[:, output, channel] for step in (APART, -APART)]
    change = known.change(lambda one: response_at(one, zeros)[:, output, channel])
    return _roots(known, zeros, -change / ((slope[0] - slope[1]) / (2.0 * APART))[:, None], own.dt)


def zeros_of(model: Innovations, output: int, channel: int = 0) -> Complex:
    """Zeros (k,) of one output from one input; what does not show in that output is left out."""
    import control as ct

    part = ct.StateSpace(
        model.a, model.b[:, [channel]], model.c[[output]], model.d[[output]][:, [channel]], model.dt
    )  # fmt: skip
    found = np.asarray(ct.zeros(part), dtype=complex)
    poles = np.linalg.eigvals(model.a)
    # modes of the other outputs are a pole and a zero at once
    own = np.array([np.abs(z - poles).min(initial=np.inf) > np.sqrt(np.finfo(float).eps) for z in found], dtype=bool)
    return np.asarray(found[own & np.isfinite(found)], dtype=complex)


def _roots(known: Coefficients, roots: Complex, change: Complex, dt: float) -> RootSpread:
    spread = known.spread(change)
    if dt > 0.0:
        spread[np.abs(roots) < AT_ZERO] = 0.0
    return RootSpread(roots, np.nan_to_num(spread, nan=0.0, posinf=0.0, neginf=0.0))


def _nearest(before: Complex, after: Complex) -> Complex:
    """`after` in the order of `before`."""
    return np.array([after[np.abs(after - one).argmin()] for one in before], dtype=complex)


# ------------------------------------------------------------------------------------------- coefficients of a model


def coefficients_of(model: Any) -> Coefficients | None:
    known = next((of for kind, of in _KINDS.items() if isinstance(model, kind)), None)
    return None if known is None else known(model)


def _root_coefficients(model: Any) -> Coefficients | None:
    """Those whose model has the roots that are meant: in the plane of s of a continuous transfer function."""
    known = coefficients_of(model)
    if known is None or not isinstance(model, ContinuousTransfer):
        return known
    first, order = len(model.num), len(model.den) - 1
    return replace(known, made=lambda values: companion(values[:first], values[first : first + order]))


def _of_polynomials(model: Polynomials) -> Coefficients | None:
    if model.covariance is None:
        return None
    return Coefficients(model.values, model.covariance, lambda values: state_space(_changed(model, values)))


def _of_matrices(model: Innovations) -> Coefficients | None:
    covariance = matrices_covariance(model)
    if covariance is None:
        return None
    return Coefficients(
        coordinates.values(model), covariance, lambda values: coordinates.with_values(model, values)
    )  # fmt: skip


def _of_stack(model: StackedModels) -> Coefficients | None:
    covariances = [row.covariance for row in model.rows if row.covariance is not None]
    if len(covariances) < len(model.rows):
        return None
    ends = np.cumsum([len(row.values) for row in model.rows])[:-1]

    def made(values: Array) -> Innovations:
        parts = zip(model.rows, np.split(values, ends), strict=True)
        return replace(model, rows=tuple(_changed(row, part) for row, part in parts)).state_space

    return Coefficients(
        np.concatenate([row.values for row in model.rows]), linalg.block_diag(*covariances), made
    )  # fmt: skip


def _of_taps(model: Impulse) -> Coefficients:
    n, ny, nu = model.g.shape
    taps = model.g.transpose(1, 2, 0).reshape(-1)
    return Coefficients(
        taps, linalg.block_diag(*model.covariance),
        lambda values: replace(model, g=values.reshape(ny, nu, n).transpose(2, 0, 1)).state_space,
    )  # fmt: skip


def _of_parameters(model: Structured) -> Coefficients | None:
    if model.built is None or not np.isfinite(model.covariance).all():
        return None
    return Coefficients(np.array(list(model.parameters.values())), model.covariance, model.built)


def _place(name: str) -> tuple[str, int, int]:
    """Polynomial, power of q^-1 and channel of a coefficient's name: b2(3) is ("b", 2, 2)."""
    found = re.fullmatch(r"([abcdf])(\d+)(?:\((\d+)\))?", name)
    if found is None:
        raise ValueError(f"{name!r} is no coefficient of a polynomial model")
    return found[1], int(found[2]), int(found[3] or 1) - 1


def _changed(model: Polynomials, values: Array) -> Polynomials:
    a, c, d = model.a.copy(), model.c.copy(), model.d.copy()
    b, f = tuple(one.copy() for one in model.b), tuple(one.copy() for one in model.f)
    single = {"a": a, "c": c, "d": d}
    for name, value in zip(model.names, values, strict=True):
        letter, power, channel = _place(name)
        target = single[letter] if letter in single else (b if letter == "b" else f)[channel]
        target[power] = value
    return replace(model, a=a, b=b, c=c, d=d, f=f)


def _of_rows(model: VectorArx) -> Coefficients | None:
    """All rows together; their errors are as correlated as the innovations (the same regressors stand in all)."""
    roots = []
    for row in model.rows:
        if row.covariance is None:
            return None
        values, vectors = np.linalg.eigh(row.covariance)
        roots.append(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
    sd = np.sqrt(np.maximum(np.diag(model.r), np.finfo(float).tiny))
    related = model.r / np.outer(sd, sd)
    orders = [_order(model, i) for i in range(len(model.rows))]
    whole = linalg.block_diag(*(row.covariance for row in model.rows))
    starts = np.cumsum([0, *(len(row.values) for row in model.rows)])
    for i in range(len(roots)):
        for j in range(len(roots)):
            if i != j and set(orders[i]) == set(orders[j]):
                same = _reordered(model, i, j, orders)
                whole[starts[i] : starts[i + 1], starts[j] : starts[j + 1]] = related[i, j] * same
    return Coefficients(
        np.concatenate([row.values for row in model.rows]), whole, lambda values: _with_rows(model, values).state_space
    )


def _reordered(model: VectorArx, i: int, j: int, orders: Sequence[Sequence[tuple[str, int, int]]]) -> Array:
    """P sqrt(r_ii r_jj), rows by the coefficients of row i and columns by those of row j, P of row i."""
    own, size = np.asarray(model.rows[i].covariance), np.sqrt(model.r[j, j] / model.r[i, i])
    signs = [np.array([-1.0 if one[0] == "a" and one[2] != k else 1.0 for one in orders[k]]) for k in (i, j)]
    at = [orders[i].index(one) for one in orders[j]]
    return np.asarray((own * np.outer(signs[0], signs[0]))[:, at] * np.outer(signs[0], signs[1]) * size)


def _order(model: VectorArx, i: int) -> list[tuple[str, int, int]]:
    """Which entry of A and B in row i each of its coefficients is: letter, power, column."""
    row, ny = model.rows[i], len(model.rows)
    others = [j for j in range(ny) if j != i] if len(model.rows[i].b) > len(model.inputs) else []
    out = []
    for name in row.names:
        letter, power, channel = _place(name)
        if letter == "a":
            out.append(("a", power, i))
        elif channel < len(others):
            out.append(("a", power, others[channel]))
        else:
            out.append(("b", power, channel - len(others)))
    return out


def _with_rows(model: VectorArx, values: Array) -> VectorArx:
    a, b, at = model.a.copy(), model.b.copy(), 0
    for i in range(len(model.rows)):
        for letter, power, column in _order(model, i):
            if letter == "b":
                b[power, i, column] = values[at]
            else:
                # the past of another output is an input of the row
                a[power, i, column] = values[at] if column == i else -values[at]
            at += 1
    return replace(model, a=a, b=b)


_KINDS: dict[type, Callable[[Any], Coefficients | None]] = {
    VectorArx: _of_rows,
    StackedModels: _of_stack,
    Impulse: _of_taps,
    Polynomials: _of_polynomials,
    Structured: _of_parameters,
    Innovations: _of_matrices,
    ContinuousTransfer: lambda model: _of_parameters(model.sampled),
}
