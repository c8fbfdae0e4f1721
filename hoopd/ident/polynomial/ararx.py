"""ARARX models A y = B u + e/D: generalised least squares and the prediction-error method.

The sum of squares can have a second minimum, where A and D have changed places (Soderstrom, Automatica 10, 1974); so
every way to share the poles of A D between the two is a start, and the least sum wins.

Rules of this file: C = F = 1; complete stretches only, as in `pem`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from hoopd.ident.checks import check
from hoopd.ident.data import Data, experiments
from hoopd.ident.estimation_report import estimated
from hoopd.ident.loopchecks import check_feedback
from hoopd.ident.modelchecks import check_model
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial.pem import Initial, pem
from hoopd.ident.polynomial.regression import residuals, solve_arx
from hoopd.ident.polynomial.structure import Counts, Structure, single, structure

Array = NDArray[np.float64]

# Ways to share the poles that are tried at most.
SHARES = 12
REAL = 1e-9


@estimated("ARARX")
def ararx(
    data: Data | Sequence[Data], na: int, nb: Counts, nd: int, delay: Counts = 1, *,
    method: Literal["pem", "gls"] = "pem", prior: ArrayLike | None = None, iterations: int = 30,
    tolerance: float = 1e-6, initial: Initial = "estimate",
) -> Polynomials:  # fmt: skip
    """Fit an ARARX model A y = B u + e/D of one output.

    The sum of squares can have a second minimum, where A and D have changed places (Soderstrom, Automatica 10, 1974);
    so every way to share the poles of A D between the two is a start, and the least sum wins.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; with missing outputs "pem" only.
    na : int
        Coefficients of A after the leading 1.
    nb : int or tuple of int
        Coefficients of B, for all inputs or by input, from q^-delay on.
    nd : int
        Coefficients of D after the leading 1.
    delay : int or tuple of int
        Samples; 0 is a direct term.
    method : {"pem", "gls"}
        The least prediction errors, with covariance; or regression of data filtered by D and D from the residuals by
        turns.
    prior : array_like, shape (nd + 1,), optional
        D = [1, d1, ...] known roughly; then only the minimum that it leads to is looked at.
    iterations : int
        Turns of "gls" at most.
    tolerance : float
        "gls" ends when the residual variance changes by less.
    initial : {"estimate", "zero"}
        The state before each experiment is estimated beside the coefficients, or zero.

    Returns
    -------
    Polynomials
        The model.

    Raises
    ------
    ValueError
        Orders below 1, missing outputs with "gls", data that cannot tell such a model.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import ararx, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0], np.convolve([1.0, -0.8], [1.0, 0.6]), 0.5 * e)
    >>> model = ararx(iddata(y, u, 0.1), na=1, nb=1, nd=1)
    >>> model.a.round(1), model.d.round(1)
    (array([ 1. , -0.8]), array([1. , 0.6]))
    """
    each = experiments(data)
    single(each)
    own = structure(each[0].nu, na, nb, 0, nd, delay=delay)
    if not (na and nd):
        raise ValueError("na and nd are at least 1: without D take arx, without A take bj")
    check(each, orders=own.asked)
    if method not in ("pem", "gls"):
        raise ValueError(f'method is "pem" or "gls", not {method!r}')
    whole = all(one.complete for one in each)
    if not whole and method == "gls":
        raise ValueError('generalised least squares filters the outputs: with missing ones take method="pem"')
    if not whole:
        return pem(each, own, initial=initial)
    firsts = [_prior(prior, nd)] if prior is not None else _shares(each, own)
    found = min((_turns(each, own, d, iterations, tolerance) for d in firsts), key=lambda one: one.variance)
    if method == "pem":
        known = pem(each, own, initial=initial, start=found)
        return known if prior is not None else _least(known, each, own, initial)
    check_model(found, sum(one.n for one in each))
    for one in each:
        check_feedback(innovations(found, one), one.u, one.inputs)
    return found


def innovations(model: Polynomials, data: Data) -> Array:
    """e = D (A y - B u) (n,), zero where the lags reach before the data."""
    rest = residuals(model, data)
    return np.concatenate([np.zeros(data.n - len(rest)), lfilter(model.d, [1.0], rest)])


def _least(first: Polynomials, each: Sequence[Data], own: Structure, initial: Initial) -> Polynomials:
    other = pem(each, own, initial=initial)
    return other if other.variance < first.variance * (1.0 - 1e-9) else first


def _prior(prior: ArrayLike, nd: int) -> Array:
    d = np.asarray(prior, dtype=float)
    if d.ndim != 1 or len(d) < 1 or d[0] != 1.0 or len(d) > nd + 1:
        raise ValueError(f"prior is D in q^-1, [1, d1, ...] with at most {nd + 1} numbers")
    return d


def _turns(each: Sequence[Data], own: Structure, d: Array, iterations: int, tolerance: float) -> Polynomials:
    """A, B for a D and D for an A, B, until the residual variance stays."""
    dynamics = replace(own, nd=0)
    before, tail = np.inf, np.zeros(own.nd)
    for _ in range(iterations):
        filtered = [
            replace(one, y=lfilter(d, [1.0], one.y, axis=0), u=lfilter(d, [1.0], one.u, axis=0)) for one in each
        ]
        x = solve_arx([one[len(d) - 1 :] for one in filtered], dynamics)[0]
        model = dynamics.model(x, each[0])
        rest = [_series(residuals(model, one), each[0]) for one in each]
        tail, _, total = solve_arx(rest, structure(0, own.nd, (), delay=()))
        d = np.concatenate([[1.0], tail])
        variance = total / max(sum(one.n - own.lost - own.nd for one in each) - own.size, 1)
        if abs(before - variance) <= tolerance * variance:
            break
        before = variance
    return own.model(np.concatenate([x, tail]), each[0], variance)


def _shares(each: Sequence[Data], own: Structure) -> list[Array]:
    """D = 1 and every share of the poles of ARX(na + nd, nb + nd) that leaves D real."""
    wide = replace(own, na=own.na + own.nd, nb=tuple(n + own.nd for n in own.nb), nd=0)
    longest = max(each, key=lambda one: one.n)
    found = [np.ones(1)]
    if longest.n <= wide.lost + wide.size:
        return found
    roots = np.roots(np.concatenate([[1.0], solve_arx(each, wide)[0][: wide.na]]))
    for chosen in combinations(range(len(roots)), min(own.nd, len(roots))):
        d = np.poly(roots[list(chosen)])
        if np.abs(np.imag(d)).max() < REAL:
            found.append(np.real(d))
    return found[: SHARES + 1]


def _series(values: Array, like: Data) -> Data:
    return replace(like, y=values[:, None], u=np.zeros((len(values), 0)), x=None, inputs=())
