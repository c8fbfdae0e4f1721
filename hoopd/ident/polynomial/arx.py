"""ARX models A(q) y = sum_i B_i(q) u_i + e by linear regression, of one output and of several.

The regression is solved from the Gram matrix of the lagged signals, which needs no matrix of regressors (memory
linear in the samples), and by orthogonal triangles over chunks of rows where that matrix is ill-conditioned or outputs
are missing (Ljung, System Identification, 1999, 10.1).

Rules of this file: an equation with a missing output in it is dropped; nothing runs across two experiments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import DEPENDENT, check, check_feedback, check_model, check_regressors
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.models import Innovations, Polynomials
from hoopd.ident.polynomial.estimators import Estimator, band
from hoopd.ident.polynomial.structure import Counts, Structure, single, structure

Array = NDArray[np.float64]

# Below this reciprocal condition the Gram matrix loses more than ten digits: triangles instead.
WELL_CONDITIONED = 1e-6
# A sum of squared residuals below this share of the outputs' is a difference of nearly equal numbers.
RESOLVED = 1e-8
# Rows of regressors that exist at a time.
CHUNK = 32768


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
    """ARX model of one output and any number of inputs, by least squares.

    `nb` coefficients of each input from q^-delay on (delay 0: a direct term). `ridge` minimises |y - Phi x|^2 +
    ridge |x|^2; `estimator` (A, y) -> x replaces least squares (no covariance then); `focus_hz` filters outputs and
    inputs to a band first, so the model fits there (Ljung 1999, 14.4). Covariance sigma^2 M^-1 Phi'Phi M^-1, M =
    Phi'Phi + ridge I. Missing outputs: their equations are dropped. ValueError and warnings: `hoopd.ident.checks`.
    """
    each = experiments(data)
    single(each)
    own = structure(each[0].nu, na, nb, delay=delay)
    check(each, orders=own.asked)
    fitted = [_focused(one, focus_hz) for one in each] if focus_hz else each
    if estimator is None:
        model = _regression(fitted, own, ridge)
    else:
        a, y = regressors(fitted, na, nb, delay)
        x = estimator(a, y)
        model = own.model(x, each[0], _variance(y - a @ x, own.size))
    check_model(model, sum(one.n for one in each))
    if focus_hz is None:
        for one in each:
            check_feedback(_padded(model, one), one.u, one.inputs)
    return model


def regressors(data: Data | Sequence[Data], na: int, nb: Counts = (), delay: Counts = 1) -> tuple[Array, Array]:
    """A (rows, na + sum nb) and y (rows,) of y = A x: columns -y(t-1) ..., then the inputs' lags, by input.

    Rows of all experiments under each other, without those in which an output is missing.
    """
    each = experiments(data)
    own = structure(each[0].nu, na, nb, delay=delay)
    parts = [part for one in each for part in _chunks(one, own)] or [np.zeros((0, own.size + 1))]
    z = np.concatenate(parts)
    return z[:, 1:], z[:, 0]


def residuals(model: Polynomials, data: Data) -> Array:
    """A y - sum B u (n - longest lag,), NaN where an output in it is missing; the errors of an ARX or AR model."""
    first = max([len(model.a) - 1, *(len(one) - 1 for one in model.b)])
    out = np.convolve(data.y[:, 0], model.a)[first : data.n]
    for i, one in enumerate(model.b):
        out = out - np.convolve(data.u[:, i], one)[first : data.n]
    return np.asarray(out)


@dataclass(frozen=True)
class VectorArx:
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


def varx(
    data: Data | Sequence[Data], na: int, nb: Counts, delay: Counts = 1, *, coupled: bool = True, ridge: float = 0.0
) -> VectorArx:
    """ARX model of several outputs: one regression an output, joined.

    `coupled`: the past of every output stands in every row (a full matrix polynomial A); otherwise A is diagonal.
    """
    each = experiments(data)
    ny, nu = each[0].ny, each[0].nu
    own = structure(nu, na, nb, delay=delay)
    rows = []
    for i in range(ny):
        others = [j for j in range(ny) if j != i] if coupled else []
        seen = [_with_outputs(one, i, others) for one in each]
        wide = Structure(
            na, (na,) * len(others) + own.nb, nf=(0,) * (len(others) + nu), delay=(1,) * len(others) + own.delay
        )
        check(_complete(seen), orders=wide.asked)
        rows.append(_regression(seen, wide, ridge))
    return _joined(rows, each, own, coupled)


# ------------------------------------------------------------------------------------------------- regression


def solve_arx(each: Sequence[Data], own: Structure, ridge: float = 0.0) -> tuple[Array, Array, float]:
    """Coefficients, inverse of their Gram matrix and sum of squared residuals, with nothing checked.

    For the methods that start from an ARX model; complete data.
    """
    gram, _ = gram_of(each, own)
    m = gram[1:, 1:] + ridge * np.eye(own.size)
    inverse = np.asarray(np.linalg.pinv(m, rcond=1e-13, hermitian=True), dtype=float)
    x = inverse @ gram[1:, 0]
    return x, inverse, float(gram[0, 0] - 2.0 * x @ gram[1:, 0] + x @ gram[1:, 1:] @ x)


def _regression(each: Sequence[Data], own: Structure, ridge: float) -> Polynomials:
    if ridge < 0.0:
        raise ValueError(f"ridge must not be negative, it is {ridge}")
    if all(_whole(one) for one in each):
        gram, rows = gram_of(each, own)
        if _conditioned(gram[1:, 1:] + ridge * np.eye(own.size)):
            return _from_gram(gram, rows, each, own, ridge)
    return _from_triangle(each, own, ridge)


def gram_of(each: Sequence[Data], own: Structure) -> tuple[Array, int]:
    """Gram matrix of [y(t), regressors] over all experiments and the number of equations; for code of this room."""
    gram, rows = np.zeros((own.size + 1, own.size + 1)), 0
    for one in each:
        if _whole(one) and one.n > own.lost:
            gram += _shifted(one, own)
            rows += one.n - own.lost
        elif not _whole(one):
            for part in _chunks(one, own):
                gram += part.T @ part
                rows += len(part)
    return gram, rows


def _shifted(data: Data, own: Structure) -> Array:
    signals = [np.ascontiguousarray(data.y[:, 0]), *(np.ascontiguousarray(column) for column in data.u.T)]
    signs = np.concatenate([[1.0], -np.ones(own.na), np.ones(sum(own.nb))])
    return lagged_gram(signals, [range(own.na + 1), *own.lags], own.lost) * np.outer(signs, signs)


def _whole(data: Data) -> bool:
    return data.complete and bool(np.isfinite(data.u).all())


def _conditioned(gram: Array) -> bool:
    scale = np.sqrt(np.diag(gram))
    if not (scale > 0.0).all():
        return False
    values = np.linalg.eigvalsh(gram / np.outer(scale, scale))
    return bool(values[0] > WELL_CONDITIONED * values[-1])


def _from_gram(gram: Array, rows: int, each: Sequence[Data], own: Structure, ridge: float) -> Polynomials:
    inner, right = gram[1:, 1:], gram[1:, 0]
    inverse = np.linalg.inv(inner + ridge * np.eye(own.size))
    x = inverse @ right
    total = float(gram[0, 0] - 2.0 * x @ right + x @ inner @ x)
    if total < RESOLVED * gram[0, 0]:
        model = own.model(x, each[0])
        total = sum(float(np.square(residuals(model, one)).sum()) for one in each)
    variance = total / max(rows - own.size, 1)
    return own.model(x, each[0], variance, variance * inverse @ inner @ inverse)


def _from_triangle(each: Sequence[Data], own: Structure, ridge: float) -> Polynomials:
    r, rows = np.zeros((0, own.size + 1)), 0
    for one in each:
        for part in _chunks(one, own):
            r = np.asarray(np.linalg.qr(np.vstack([r, part]), mode="r"))
            rows += len(part)
    if rows <= own.size:
        raise ValueError(f"too few samples: {rows} equations without a missing output for {own.size} parameters")
    r, right = r[:, 1:], r[:, 0]
    scale = np.sqrt((r**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    if ridge == 0.0:
        check_regressors(r, own.names)
        inverse = np.linalg.pinv(r / scale, rcond=DEPENDENT) / scale[:, None]
    else:
        inverse = np.linalg.pinv(np.vstack([r, np.sqrt(ridge) * np.eye(own.size)]))[:, : len(r)]
    x = inverse @ right
    variance = float(np.square(right - r @ x).sum()) / max(rows - own.size, 1)
    return own.model(x, each[0], variance, variance * inverse @ inverse.T)


def _chunks(data: Data, own: Structure) -> Iterator[Array]:
    """[y(t), regressors] of rows without a missing value, `CHUNK` rows at a time."""
    y = data.y[:, 0]
    for start in range(own.lost, data.n, CHUNK):
        t = np.arange(start, min(start + CHUNK, data.n))
        columns = [y[t], *(-y[t - k] for k in range(1, own.na + 1))]
        columns += [data.u[t - k, i] for i, lag in enumerate(own.lags) for k in lag]
        z = np.column_stack(columns)
        yield z[np.isfinite(z).all(axis=1)]


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


def _complete(each: Sequence[Data]) -> list[Data]:
    """The longest stretch of each experiment without a missing value among outputs that serve as inputs."""
    found = []
    for one in each:
        if np.isfinite(one.u).all():
            found.append(one)
            continue
        whole = replace(one, y=np.hstack([one.y, one.u]), u=one.u)
        best = max(runs(whole), key=lambda part: part.n, default=None)
        if best is not None:
            found.append(replace(best, y=best.y[:, :1]))
    if not found:
        raise ValueError("no stretch of samples in which every output was measured")
    return found


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
