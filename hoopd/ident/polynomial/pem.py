"""Prediction-error estimates of polynomial models: ARMAX, output error, Box-Jenkins, ARARX and any other orders.

One search for all (`gaussnewton`), from linear starts (`starts`). The estimate is maximum likelihood for normal e
(Ljung, System Identification, 1999, 7.4); its covariance is variance (J'J)^-1 where the noise model is right, and
H^-1 Q H^-1 with the residuals' correlation where it is not (9.4).

Rules of this file: initial states are estimated unless "zero" is asked for. Missing outputs of an output-error model
do not count; with noise dynamics, and where many short experiments start anywhere, the likelihood is exact
(`incomplete`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.checks import check, unsettled
from hoopd.ident.data import Data, experiments
from hoopd.ident.doubts import warn
from hoopd.ident.estimation_report import estimated
from hoopd.ident.gapsearch import GapOptimum
from hoopd.ident.loopchecks import check_feedback
from hoopd.ident.modelchecks import DICKEY_FULLER, check_model
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial import incomplete
from hoopd.ident.polynomial.gaussnewton import Optimum, PolynomialExperiment, errors, jacobian, search
from hoopd.ident.polynomial.stable import EDGE, radius
from hoopd.ident.polynomial.starts import long_model, starts
from hoopd.ident.polynomial.structure import Counts, Structure, single, structure
from hoopd.ident.prediction import prediction_error

Array = NDArray[np.float64]
Initial = Literal["estimate", "zero"]
Kind = Literal["white", "robust"]


@estimated("ARMAX")
def armax(
    data: Data | Sequence[Data], na: int, nb: Counts, nc: int, delay: Counts = 1, *, initial: Initial = "estimate",
    covariance: Kind = "white", start: ArrayLike | Polynomials | None = None,
) -> Polynomials:  # fmt: skip
    """Fit an ARMAX model A y = B u + C e by the prediction-error method.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; of missing outputs the exact likelihood is taken.
    na : int
        Coefficients of A after the leading 1.
    nb : int or tuple of int
        Coefficients of B, for all inputs or by input, from q^-delay on.
    nc : int
        Coefficients of C after the leading 1.
    delay : int or tuple of int
        Samples; 0 is a direct term.
    initial : {"estimate", "zero"}
        The state before each experiment is estimated beside the coefficients, or zero.
    covariance : {"white", "robust"}
        For residuals that are white, or for any.
    start : array_like or Polynomials, optional
        Coefficients in the order of the names, or a model of at most these orders, instead of the built-in starts.

    Returns
    -------
    Polynomials
        The model of the least squared one-step prediction errors, with its covariance.

    Raises
    ------
    ValueError
        Data that cannot tell such a model; what makes it doubtful is an `IdentificationWarning`.

    Notes
    -----
    Maximum likelihood for normal e; source: Ljung, System Identification, 1999, 7.4 and, on the covariance, 9.4.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import armax, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0, 0.5], [1.0, -0.8], 0.2 * e)
    >>> model = armax(iddata(y, u, 0.1), na=1, nb=1, nc=1)
    >>> model.a.round(2), model.b[0].round(1), model.c.round(1)
    (array([ 1. , -0.8]), array([0., 2.]), array([1. , 0.5]))
    """
    each = experiments(data)
    own = structure(each[0].nu, na, nb, nc, delay=delay)
    return pem(each, own, initial=initial, covariance=covariance, start=start)


@estimated("output error")
def oe(
    data: Data | Sequence[Data], nb: Counts, nf: Counts, delay: Counts = 1, *, initial: Initial = "estimate",
    covariance: Kind = "robust", start: ArrayLike | Polynomials | None = None,
) -> Polynomials:  # fmt: skip
    """Fit an output-error model y = sum B_i/F_i u_i + e by the prediction-error method (the simulation error).

    The dynamics are right for coloured noise too, as long as no feedback is in the data; so is the robust covariance.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; missing outputs do not count.
    nb : int or tuple of int
        Coefficients of B, for all inputs or by input, from q^-delay on.
    nf : int or tuple of int
        Coefficients of F after the leading 1, for all inputs or by input.
    delay : int or tuple of int
        Samples; 0 is a direct term.
    initial : {"estimate", "zero"}
        The state before each experiment is estimated beside the coefficients, or zero.
    covariance : {"white", "robust"}
        For residuals that are white, or for any.
    start : array_like or Polynomials, optional
        Coefficients in the order of the names, or a model of at most these orders, instead of the built-in starts.

    Returns
    -------
    Polynomials
        The model, with its covariance.

    Raises
    ------
    ValueError
        Data that cannot tell such a model; what makes it doubtful is an `IdentificationWarning`.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 7.4 and, on the covariance, 9.4.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import arx, iddata, oe
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> data = iddata(lfilter([0.0, 2.0], [1.0, -0.8], u) + e, u, 0.1)  # white noise on the sensor
    >>> oe(data, nb=1, nf=1).f[0].round(2), arx(data, na=1, nb=1).a.round(2)  # least squares is biased
    (array([ 1. , -0.8]), array([ 1.  , -0.72]))
    """
    each = experiments(data)
    own = structure(each[0].nu, 0, nb, 0, 0, nf, delay)
    return pem(each, own, initial=initial, covariance=covariance, start=start)


@estimated("Box-Jenkins")
def bj(
    data: Data | Sequence[Data], nb: Counts, nc: int, nd: int, nf: Counts, delay: Counts = 1, *,
    initial: Initial = "estimate", covariance: Kind = "white", start: ArrayLike | Polynomials | None = None,
) -> Polynomials:  # fmt: skip
    """Fit a Box-Jenkins model y = sum B_i/F_i u_i + C/D e by the prediction-error method.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; of missing outputs the exact likelihood is taken.
    nb : int or tuple of int
        Coefficients of B, for all inputs or by input, from q^-delay on.
    nc, nd : int
        Coefficients of C and D after the leading 1.
    nf : int or tuple of int
        Coefficients of F after the leading 1, for all inputs or by input.
    delay : int or tuple of int
        Samples; 0 is a direct term.
    initial : {"estimate", "zero"}
        The state before each experiment is estimated beside the coefficients, or zero.
    covariance : {"white", "robust"}
        For residuals that are white, or for any.
    start : array_like or Polynomials, optional
        Coefficients in the order of the names, or a model of at most these orders, instead of the built-in starts.

    Returns
    -------
    Polynomials
        The model, with its covariance.

    Raises
    ------
    ValueError
        Data that cannot tell such a model; what makes it doubtful is an `IdentificationWarning`.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 7.4 and, on the covariance, 9.4.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import bj, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.5], 0.5 * e)
    >>> model = bj(iddata(y, u, 0.1), nb=1, nc=0, nd=1, nf=1)
    >>> model.f[0].round(1), model.d.round(1)
    (array([ 1. , -0.8]), array([ 1. , -0.5]))
    """
    each = experiments(data)
    own = structure(each[0].nu, 0, nb, nc, nd, nf, delay)
    return pem(each, own, initial=initial, covariance=covariance, start=start)


def pem(
    data: Data | Sequence[Data], own: Structure, *, initial: Initial = "estimate", covariance: Kind = "white",
    start: ArrayLike | Polynomials | None = None,
) -> Polynomials:  # fmt: skip
    """The polynomial model of these orders with the least squared one-step prediction errors.

    `initial`: the state before each experiment is estimated beside the coefficients, or zero. `covariance`: "white"
    for residuals that are white, "robust" for any. `start`: coefficients (in the order of `own.names`) or a model of
    at most these orders instead of the built-in starts. ValueError and warnings: `hoopd.ident.checks`.
    """
    each = experiments(data)
    single(each)
    check(each, orders=own.asked)
    free = initial == "estimate"
    if incomplete.wanted(own, each, free_start=free):
        return _likeliest(own, each, start, covariance, free)
    pieces = stretches(own, each)
    candidates = _given(own, start) if start is not None else _found(own, pieces)
    best = _best(own, pieces, candidates, free)
    return _reported(own, each, pieces, best, covariance)


def _likeliest(
    own: Structure, each: Sequence[Data], start: ArrayLike | Polynomials | None, kind: Kind, free: bool
) -> Polynomials:  # fmt: skip
    """Through gaps and from many short starts: the exact likelihood."""
    candidates = _given(own, start) if start is not None else _found(own, incomplete.bridged(each))
    best = incomplete.search(own, each, candidates, free_start=free)
    spread = best.covariance if kind == "white" else _sandwich(best.covariance, best)
    model = own.model(best.x, each[0], best.variance, spread)
    if not best.settled:
        unsettled(best.steps)
    _judged(model, best.count)
    for one in each:
        check_feedback(np.nan_to_num(prediction_error(model, one)[:, 0]), one.u, each[0].inputs)
    return model


def _sandwich(inverse: Array, best: GapOptimum) -> Array:
    """H^-1 Q H^-1 of errors with what is missing eliminated."""
    outer = inverse / best.variance
    return np.asarray(outer @ _serial(best.jacobian, best.errors) @ outer)


def prediction_errors(model: Polynomials, data: Data, *, initial: Initial = "estimate") -> Array:
    """e (n,) of any polynomial model by its filters; NaN where it cannot be told.

    As `predict.prediction_error`, but with the initial state that is best for all of the data and at filter speed.
    """
    own = orders_of(model)
    if incomplete.wanted(own, [data], free_start=initial == "estimate"):
        return np.asarray(prediction_error(model, data, x0=initial)[:, 0])
    out = np.full(data.n, np.nan)
    for first, piece in _placed(own, data):
        p = np.zeros(0) if initial == "zero" else _initial(own, own.values(model), piece)
        e = errors(own, own.values(model), p, piece).e
        out[first : first + len(e)] = e if piece.seen is None else np.where(piece.seen > 0.0, e, np.nan)
    return out


def orders_of(model: Polynomials) -> Structure:
    """The orders of a model; leading zeros of B are its delay."""
    first = [int(np.flatnonzero(b)[0]) if np.any(b) else 0 for b in model.b]
    return Structure(
        len(model.a) - 1, tuple(len(b) - d for b, d in zip(model.b, first, strict=True)), len(model.c) - 1,
        len(model.d) - 1, tuple(len(f) - 1 for f in model.f) or (0,) * model.nu, tuple(first),
    )  # fmt: skip


def stretches(own: Structure, each: Sequence[Data], initial: Initial = "estimate") -> list[PolynomialExperiment]:
    """What the plain search takes: whole experiments; a missing output, of output error, does not count."""
    found = [piece for one in each for _, piece in _placed(own, one)]
    free = own.size + (own.states * len(found) if initial == "estimate" else 0)
    if sum(piece.count for piece in found) <= free:
        raise ValueError(
            f"too few samples: {sum(piece.count for piece in found)} in stretches without a missing output, for "
            f"{free} coefficients and initial states"
        )
    return found


# ------------------------------------------------------------------------------------------------- steps


def _placed(own: Structure, data: Data) -> list[tuple[int, PolynomialExperiment]]:
    """The experiment and the sample at which it begins; missing outputs of output error do not count."""
    if data.complete:
        return [(0, _stretch(data))]
    seen = np.isfinite(data.y[:, 0])
    return [(0, PolynomialExperiment(np.where(seen, data.y[:, 0], 0.0), _inputs(data), seen.astype(float)))]


def _stretch(data: Data) -> PolynomialExperiment:
    return PolynomialExperiment(np.ascontiguousarray(data.y[:, 0]), _inputs(data))


def _inputs(data: Data) -> Array:
    return np.ascontiguousarray(data.u.T)


def _found(own: Structure, pieces: Sequence[PolynomialExperiment]) -> list[Array]:
    whole = long_model(own, pieces)
    if any(own.nf) and whole.radius > 1.0 + DICKEY_FULLER / sum(one.count for one in pieces):
        warn(
            f"the system looks unstable (a pole of magnitude {whole.radius:.3g}), and F is kept stable: an unstable "
            "system wants its poles in A (arx, armax)"
        )  # fmt: skip
    return starts(own, pieces, whole)


def _given(own: Structure, start: ArrayLike | Polynomials) -> list[Array]:
    x = own.values(start) if isinstance(start, Polynomials) else np.asarray(start, dtype=float)
    if x.shape != (own.size,):
        raise ValueError(f"the start has {x.size} coefficients, the model {own.size}: {', '.join(own.names)}")
    return [x]


def _best(own: Structure, pieces: Sequence[PolynomialExperiment], candidates: Sequence[Array], free: bool) -> Optimum:
    """The least optimum: from the best start, or from each where the sum may have several minima."""
    if len(candidates) > 1 and not _several(own):
        candidates = [min(candidates, key=lambda x: _cost(own, x, pieces))]
    found = [search(own, pieces, one, free_start=free) for one in candidates]
    return min(found, key=lambda one: one.total)


def _several(own: Structure) -> bool:
    """Structures in which two factors can change places, so that the sum has a second minimum."""
    return own.na > 0 and (own.nd > 0 or any(own.nf))


def _cost(own: Structure, x: Array, pieces: Sequence[PolynomialExperiment]) -> float:
    with np.errstate(all="ignore"):
        total = sum(float(np.square(errors(own, x, np.zeros(0), one).e).sum()) for one in pieces)
    return total if np.isfinite(total) else np.inf


def _reported(
    own: Structure, each: Sequence[Data], pieces: Sequence[PolynomialExperiment], best: Optimum, kind: Kind
) -> Polynomials:  # fmt: skip
    count = sum(one.count for one in pieces)
    variance = best.total / max(count - own.size - best.p.size, 1)
    spread = variance * best.inverse if kind == "white" else _robust(own, pieces, best)
    model = own.model(best.x, each[0], variance, spread)
    if not best.settled:
        unsettled(best.steps)
    _judged(model, count)
    for one, p in zip(pieces, best.p, strict=True):
        check_feedback(errors(own, best.x, p, one).e, one.u.T, each[0].inputs)
    return model


def _judged(model: Polynomials, count: int) -> None:
    at_edge = [name for name, one in _guarded(model) if radius(one) > EDGE - 1e-7]
    if at_edge:
        warn(f"{', '.join(at_edge)} ends at the limit of stability: there the estimate has no covariance")
    check_model(model, count)


def _guarded(model: Polynomials) -> list[tuple[str, Array]]:
    return [("C", model.c), *((f"F of input {i + 1}", f) for i, f in enumerate(model.f))]


def _robust(own: Structure, pieces: Sequence[PolynomialExperiment], best: Optimum) -> Array:
    """H^-1 Q H^-1, Q = sum of psi(t) e(t) e(s) psi(s)' over |t - s| <= L, Bartlett's weights (Newey & West, 1987)."""
    q = np.zeros((own.size, own.size))
    for one, p in zip(pieces, best.p, strict=True):
        found = errors(own, best.x, p, one)
        q += _serial(jacobian(own, found, one, 0), found.e, one.seen)
    count = sum(one.count for one in pieces)
    return np.asarray(best.inverse @ q @ best.inverse * count / max(count - own.size - best.p.size, 1))


def _serial(rows: Array, e: Array, seen: Array | None = None) -> Array:
    """Sum of psi(t) r(t - s) psi(s)' of derivatives psi (m, n); white inputs are independent of e."""
    r = _correlation(e, min(len(e) // 4, round(4.0 * len(e) ** (1.0 / 3.0))), np.ones(len(e)) if seen is None else seen)
    smooth = np.apply_along_axis(np.convolve, 1, rows, np.concatenate([r[:0:-1], r]), "same")
    q = rows @ smooth.T
    return np.asarray(0.5 * (q + q.T))


def _correlation(e: Array, lags: int, seen: Array) -> Array:
    """Covariance of e, 0 where it was not seen, at lags 0 .. L: of what was, under Bartlett's weights."""
    n, own = len(e), np.where(seen > 0.0, e, 0.0)
    sums, pairs = (np.array([a[k:] @ a[: n - k] for k in range(lags + 1)]) for a in (own, seen))
    raw = sums / np.maximum(pairs, 1.0) * (1.0 - np.arange(lags + 1) / n)
    return np.asarray(raw * (1.0 - np.arange(lags + 1) / (lags + 1.0)))


def _initial(own: Structure, x: Array, piece: PolynomialExperiment) -> Array:
    """The response to the initial state that leaves the least errors of one stretch."""
    zero = errors(own, x, np.zeros(own.states), piece)
    rows = jacobian(own, zero, piece, own.states)[own.size :]
    return np.asarray(-np.linalg.lstsq(rows.T, zero.e, rcond=None)[0]) if own.states else np.zeros(0)
