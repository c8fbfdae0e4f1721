"""ARX models A(q) y = sum_i B_i(q) u_i + e by linear regression, of one output and of several.

Rules of this file: an equation with a missing output in it is dropped; nothing runs across two experiments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import DEPENDENT, check
from hoopd.ident.data import Data, experiments
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.loopchecks import check_feedback
from hoopd.ident.modelchecks import check_excess, check_model, check_order, coefficient, wald
from hoopd.ident.models import Innovations, Polynomials
from hoopd.ident.polynomial.estimators import Estimator, band
from hoopd.ident.polynomial.regression import least_regression, regressors, residuals
from hoopd.ident.polynomial.structure import Counts, Structure, single, structure

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]


@estimated("ARX")
def arx(
    data: Data | Sequence[Data],
    na: int,
    nb: Counts,
    delay: Counts = 1,
    *,
    ridge: float = 0.0,
    estimator: Estimator | None = None,
    focus_hz: tuple[float, float] | None = None,
) -> Polynomials:
    """Fit an ARX model A(q) y = sum_i B_i(q) u_i + e of one output and any number of inputs, by least squares.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; equations with a missing output are dropped.
    na : int
        Coefficients of A after the leading 1.
    nb : int or tuple of int
        Coefficients of B, for all inputs or by input, from q^-delay on.
    delay : int or tuple of int
        Samples; 0 is a direct term.
    ridge : float
        Minimises |y - Phi x|^2 + ridge |x|^2.
    estimator : callable, optional
        (A, y) -> x in place of least squares, such as `robust()`; there is no covariance then.
    focus_hz : tuple of float, optional
        Band (low, high) in Hz to which outputs and inputs are filtered first, so the model fits there; its `variance`
        is that of e on the data as they are.

    Returns
    -------
    Polynomials
        The model with its covariance sigma^2 M^-1 Phi'Phi M^-1, M = Phi'Phi + ridge I; with `focus_hz`, whose errors
        are not white, M^-1 S M^-1 with S the covariance of Phi'e by Bartlett's weights over sqrt(n) lags, and
        no fewer than the band's memory.

    Raises
    ------
    ValueError
        Data that cannot tell such a model; what makes it doubtful is an `IdentificationWarning`.

    Notes
    -----
    Sources: Ljung, System Identification, 1999, 14.4 on the filter; Newey & West, Econometrica 55, 1987, on S.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import arx, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.8], 0.1 * e)
    >>> model = arx(iddata(y, u, dt=0.1), na=1, nb=1)
    >>> dict(zip(model.names, model.values.round(2).tolist())), round(model.variance, 3)
    ({'a1': -0.8, 'b1': 2.0}, 0.01)
    """
    each = experiments(data)
    single(each)
    if estimator is not None and ridge:
        raise ValueError("ridge belongs to least squares: give it or an estimator, not both")
    own = structure(each[0].nu, na, nb, delay=delay)
    check(each, orders=own.asked)
    fitted = [_focused(one, focus_hz) for one in each] if focus_hz else each
    if estimator is None:
        model = least_regression(fitted, own, ridge)
    else:
        a, y = regressors(fitted, na, nb, delay)
        if len(y) <= own.size:
            raise ValueError(f"too few samples: {len(y)} equations without a missing output for {own.size} parameters")
        x = estimator(a, y)
        model = own.model(x, each[0], _variance(y - a @ x, own.size))
    if focus_hz:
        rest = np.concatenate([residuals(model, one) for one in each])
        covariance = None if estimator is not None else _of_coloured(fitted, own, model.values, ridge, focus_hz)
        model = replace(model, variance=_variance(rest, own.size), covariance=covariance)
    squares = model if estimator is None and focus_hz is None else least_regression(each, own, ridge)
    _judged(model, squares, each, ridge)
    return model


def _of_coloured(
    fitted: Sequence[Data], own: Structure, x: Array, ridge: float, focus_hz: tuple[float, float]
) -> Array:
    """Covariance of the coefficients where the errors are correlated: M^-1 S M^-1."""
    a, y = regressors(fitted, own.na, own.nb, own.delay)
    scale = np.maximum(np.sqrt((a**2).sum(axis=0)), np.finfo(float).tiny)
    both = np.vstack([a, np.sqrt(ridge) * np.eye(own.size)])
    inverse = np.linalg.pinv(both / scale, rcond=DEPENDENT)[:, : len(a)].T / scale
    # what each equation adds to the coefficients
    parts = inverse * (y - a @ x)[:, None]
    dt = fitted[0].dt
    memory = int(1.0 / (min(focus_hz[1], 0.5 / dt) - focus_hz[0]) / dt)
    ends = np.cumsum([max(one.n - own.lost, 0) for one in fitted])[:-1]
    return np.asarray(sum(_bartlett(part, memory) for part in np.split(parts - parts.mean(axis=0), ends)))


def _bartlett(parts: Array, memory: int) -> Array:
    """Sum over lags of (1 - |lag|/L) sum_t parts(t + lag) parts(t)': the mean square of sums of L, sqrt(n) or more."""
    width = min(max(int(np.sqrt(len(parts))), memory, 1), max(len(parts) // 4, 1))
    sums = np.cumsum(np.pad(parts, ((width, width - 1), (0, 0))), axis=0)
    windows = sums[width:] - sums[:-width]
    return np.asarray(windows.T @ windows / width)


def _judged(model: Polynomials, squares: Polynomials, each: Sequence[Data], ridge: float) -> None:
    """The checks of the result; `squares` is least squares of the data as they are, its errors the innovations."""
    n = sum(one.n for one in each)
    check_model(model, n, order=False)
    if not ridge:
        check_order(squares, n)
    for one in each:
        check_feedback(_padded(squares, one), one.u, one.inputs)


@dataclass(frozen=True, repr=False)
class VectorArx(IdentifiedModel):
    """A(q) y = B(q) u + e: a (na + 1, ny, ny) with a[0] = 1, b (lags, ny, nu), r (ny, ny) covariance of e.

    `rows`: one model an output, its inputs being the other outputs and then the inputs.
    """

    a: Array
    b: Array
    r: Array
    dt: float
    rows: tuple[Polynomials, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def system(self) -> ct.StateSpace:
        """From u to y."""
        return self.state_space.system

    def deviations(self) -> dict[str, float]:
        """Standard errors of the coefficients of each row, by coefficient and output; empty without a covariance."""
        rows = zip(self.outputs, self.rows, strict=True)
        return {f"{name} ({output})": sd for output, row in rows for name, sd in row.deviations().items()}

    @property
    def state_space(self) -> Innovations:
        """The innovation form, in block observer form with ny * lags states."""
        ny, size = len(self.r), max(len(self.a), len(self.b)) - 1
        a = np.concatenate([self.a, np.zeros((size + 1 - len(self.a), ny, ny))])
        b = np.concatenate([self.b, np.zeros((size + 1 - len(self.b), ny, self.b.shape[2]))])
        big = np.eye(ny * size, k=ny)
        big[:, :ny] = -a[1:].reshape(ny * size, ny)
        c = np.eye(ny, ny * size)
        own = np.concatenate([b[k] - a[k] @ b[0] for k in range(1, size + 1)])
        gain = -a[1:].reshape(ny * size, ny)
        return Innovations(
            big, own, c, b[0], gain, self.dt, r=self.r, inputs=self.inputs, outputs=self.outputs
        )  # fmt: skip


@estimated("ARX of several outputs")
def varx(
    data: Data | Sequence[Data], na: int, nb: Counts, delay: Counts = 1, *, coupled: bool = True, ridge: float = 0.0
) -> VectorArx:
    """Fit an ARX model of several outputs: one regression an output, joined.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    na : int
        Coefficients of each entry of A after lag 0.
    nb : int or tuple of int
        Coefficients of B, for all inputs or by input, from q^-delay on.
    delay : int or tuple of int
        Samples; 0 is a direct term.
    coupled : bool
        Whether the past of every output stands in every row (a full matrix polynomial A); otherwise A is diagonal.
    ridge : float
        As in `arx`.

    Returns
    -------
    VectorArx
        `a` (na + 1, ny, ny), `b` (lags, ny, nu), the covariance `r` (ny, ny) of e, one model an output in `rows`, and
        the innovation form `state_space`.

    Raises
    ------
    ValueError
        Data that cannot tell such a model; what makes it doubtful is an `IdentificationWarning`.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, varx
    >>> rng = np.random.default_rng(0)
    >>> truth, u, y = np.array([[0.7, 0.2], [-0.1, 0.5]]), rng.standard_normal(1000), np.zeros((1000, 2))
    >>> for t in range(1, 1000):
    ...     y[t] = truth @ y[t - 1] + [u[t - 1], 0.0] + 0.05 * rng.standard_normal(2)
    >>> -varx(iddata(y, u, 0.1), na=1, nb=1).a[1].round(1)
    array([[ 0.7,  0.2],
           [-0.1,  0.5]])
    """
    each = experiments(data)
    ny, nu = each[0].ny, each[0].nu
    own = structure(nu, na, nb, delay=delay)
    size = own.size + (ny - 1) * na * coupled
    check(each, orders=replace(own.asked, parameters=size))
    rows = []
    for i in range(ny):
        others = [j for j in range(ny) if j != i] if coupled else []
        seen = [_with_outputs(one, i, others) for one in each]
        wide = Structure(
            na, (na,) * len(others) + own.nb, nf=(0,) * (len(others) + nu), delay=(1,) * len(others) + own.delay
        )
        rows.append(least_regression(seen, wide, ridge))
    found = _joined(rows, each, own, coupled)
    _judged_together(found, each, ridge)
    return found


def _judged_together(found: VectorArx, each: Sequence[Data], ridge: float) -> None:
    """The checks of the joint result: its poles, the last lags of all rows together, the way from errors to inputs."""
    n = sum(one.n for one in each)
    check_model(found.state_space, n)
    if not ridge:
        check_excess(_last_lags(found), n)
    for one in each:
        e = _errors(found.a, found.b, one)
        check_feedback(np.vstack([np.zeros((one.n - len(e), len(found.r))), e]), one.u, one.inputs)


def _last_lags(found: VectorArx) -> Iterator[tuple[str, float, int]]:
    """Name, Wald statistic and number of the coefficients of the last lag of the outputs, and of the inputs, of all
    rows together; of inputs that have more than one."""
    last, nu = len(found.a) - 1, len(found.inputs)
    for letter in ("a", "b"):
        told = [wald(row, list(_names_of_last(row, letter, last, nu))) for row in found.rows]
        count = sum(how_many for _, how_many in told)
        if count:
            yield f"lag of the {'outputs' if letter == 'a' else 'inputs'}", sum(one for one, _ in told), count


def _names_of_last(row: Polynomials, letter: str, last: int, nu: int) -> Iterator[str]:
    """`row.b` holds the other outputs first, then the nu inputs."""
    if letter == "a" and last:
        yield coefficient("a", last)
        yield from (coefficient("b", last, j, row.nu) for j in range(row.nu - nu))
    elif letter == "b":
        for k in range(row.nu - nu, row.nu):
            lag = len(row.b[k]) - 1
            if coefficient("b", lag - 1, k, row.nu) in row.names:
                yield coefficient("b", lag, k, row.nu)


def _focused(data: Data, focus_hz: tuple[float, float]) -> Data:
    from scipy.signal import sosfilt

    if not data.complete:
        raise ValueError(
            "a band filter needs every output: cut the data at the missing samples (hoopd.ident.data.runs)"
        )
    sections = band(*focus_hz, data.dt)
    return replace(data, y=sosfilt(sections, data.y, axis=0), u=sosfilt(sections, data.u, axis=0))


def _padded(model: Polynomials, data: Data) -> Array:
    rest = residuals(model, data)
    return np.concatenate([np.zeros(data.n - len(rest)), rest])


def _variance(rest: Array, parameters: int) -> float:
    return float(rest @ rest) / max(len(rest) - parameters, 1)


# ------------------------------------------------------------------------------------------------- several outputs


def _with_outputs(data: Data, i: int, others: Sequence[int]) -> Data:
    """Output i, the other outputs as inputs before the inputs."""
    return replace(
        data, y=data.y[:, [i]], u=np.hstack([data.y[:, list(others)], data.u]), x=None,
        outputs=(data.outputs[i],), inputs=(*(data.outputs[j] for j in others), *data.inputs),
    )  # fmt: skip


def _joined(rows: Sequence[Polynomials], each: Sequence[Data], own: Structure, coupled: bool) -> VectorArx:
    ny, nu = each[0].ny, each[0].nu
    a, b = np.zeros((own.na + 1, ny, ny)), np.zeros((max([lag.stop for lag in own.lags], default=1), ny, nu))
    for i, row in enumerate(rows):
        a[:, i, i] = row.a
        others = [j for j in range(ny) if j != i] if coupled else []
        for j, values in zip(others, row.b, strict=False):
            a[: len(values), i, j] = -values
        for k, values in enumerate(row.b[len(others) :]):
            b[: len(values), i, k] = values
    e = np.concatenate([_errors(a, b, one) for one in each])
    e = e[np.isfinite(e).all(axis=1)]
    r = e.T @ e / max(len(e) - own.na * (ny if coupled else 1) - sum(own.nb), 1)
    return VectorArx(a, b, r, each[0].dt, tuple(rows), each[0].inputs, each[0].outputs)


def _errors(a: Array, b: Array, data: Data) -> Array:
    """A y - B u, (n - longest lag, ny)."""
    first = max(len(a), len(b)) - 1
    out = sum(data.y[first - k : data.n - k] @ a[k].T for k in range(len(a)))
    return np.asarray(out - sum(data.u[first - k : data.n - k] @ b[k].T for k in range(len(b))))
