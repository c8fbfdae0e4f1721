"""What may be wrong with data or with a result, said by name: no method of this room gives a bad model silently.

An error where there is nothing to identify, an `IdentificationWarning` where the answer is doubtful.

Rules of this file: one function a cause; a threshold is a level of significance or of the arithmetic, and stands with
its reason; nothing is corrected here.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.models import Innovations, Model, Polynomials

Array = NDArray[np.float64]

# Eigenvalue of a Gram matrix below so much of the largest: nothing but rounding is left of that direction.
SINGULAR = 1e-11
# The same of the singular values of a matrix itself, which rounding leaves smaller.
DEPENDENT = 1e-12
# Rounding of a constant that went through other units.
CONSTANT = 1e-12
# N (1 - pole) of an integrator that was estimated stays below this in 95 of 100 (Dickey & Fuller, JASA 74, 1979).
DICKEY_FULLER = 8.0
# Lags at which an input may answer a disturbance, and the samples that the test of it needs.
FEEDBACK_LAGS = 10
FEEDBACK_SAMPLES = 100
# Upper 1e-5 point of chi-square with 10 degrees of freedom: one false alarm in 100 000 inputs.
FEEDBACK_LEVEL = 41.30
# An input that its own past tells to this share (a sine, a constant) answers nobody.
FORETOLD = 1e-6
# Poles and zeros nearer than so many standard errors of their distance cancel.
CANCELLED = 2.0
# ... but roots that nobody knows are not equal for that: so far apart they are two.
APART = 0.3
# Without a covariance: poles and zeros nearer than rounding leaves double roots.
CANCELLED_EXACTLY = 1e-6


class IdentificationWarning(UserWarning):
    """The data or the result make a model doubtful; the message names the cause."""


@dataclass(frozen=True)
class Orders:
    """What a method asks of data: free `parameters` of one output, `lags` of the inputs to tell apart, samples `lost`.

    `lost`: samples at the start of an experiment that give no equation.
    """

    parameters: int
    lags: int = 0
    lost: int = 0


def check(data: Data | Sequence[Data], *, orders: Orders) -> None:
    """Stop at data that cannot give a model of these orders, warn of data that hardly can.

    ValueError: a channel that is constant, missing or not finite; too few samples. IdentificationWarning: inputs that
    do not excite so many lags.
    """
    each = experiments(data)
    _channels(each)
    _samples(each, orders)
    for said in _excitation(each, orders.lags):
        warn(said)


def check_model(model: Model, n: int) -> None:
    """Warn of a result from n samples: an integrator, common poles and zeros, coefficients that nothing determined."""
    for said in (*_integrator(model, n), *_cancelled(model), *_undetermined(model), *_predictor(model)):
        warn(said)


def check_feedback(errors: Array, u: Array, names: Sequence[str] = ()) -> None:
    """Warn when inputs u (n, nu) answer earlier prediction errors (n,) of a model: the data were taken in a loop."""
    for i in range(u.shape[1]):
        if answers(errors, u[:, i]):
            name = names[i] if names else f"u{i + 1}"
            warn(
                f"feedback suspected: input {name} follows earlier disturbances of the output; direct methods with a "
                "full noise model (armax, bj, pem) stay right in a loop, output-error, correlation and subspace "
                "methods do not"
            )  # fmt: skip


def check_regressors(columns: Array, names: Sequence[str]) -> None:
    """Warn when columns (m, p) of a regression, or its triangular factor (p, p), depend on each other."""
    weak = dependent(columns)
    if len(weak):
        said = ", ".join(names[i] for i in weak)
        warn(
            f"the regressors of {said} depend on each other, so the smallest coefficients that fit are taken: the "
            "order is too high for data so free of noise, or the input excites too little"
        )  # fmt: skip


def warn(text: str) -> None:
    """An IdentificationWarning at the caller of the estimator."""
    warnings.warn(text, IdentificationWarning, stacklevel=4)


# ------------------------------------------------------------------------------------------------- statistics


def dependent(columns: Array) -> NDArray[np.intp]:
    """Columns of a matrix (m, p) that take part in its null directions; none when its rank is full."""
    scale = np.sqrt((columns**2).sum(axis=0))
    dead = np.flatnonzero(scale <= 0.0)
    if len(dead):
        return dead
    values, vectors = np.linalg.svd(columns / scale, full_matrices=False)[1:]
    null = np.abs(vectors[values < DEPENDENT * values[0]])
    return np.flatnonzero((null > 0.1 * null.max(axis=1, initial=0.0, keepdims=True)).any(axis=0))


def excitation(u: Array, lags: int) -> int:
    """How many of `lags` consecutive values of each of the inputs u (n, nu) are independent, nu * lags when all are.

    Source: rank of the sample covariance of the lagged input (Ljung, System Identification, 1999, definition 13.1).
    """
    if lags < 1 or u.shape[1] == 0 or len(u) <= lags:
        return 0
    columns = [np.ascontiguousarray(u[:, i]) for i in range(u.shape[1])]
    scale = [float(np.sqrt(one @ one)) or 1.0 for one in columns]
    gram = lagged_gram([one / s for one, s in zip(columns, scale, strict=True)], [range(lags)] * len(columns), lags - 1)
    values = np.linalg.eigvalsh(gram)
    return int((values > SINGULAR * values[-1]).sum())


def answers(errors: Array, u: Array) -> bool:
    """Whether an input (n,) follows earlier errors (n,) beyond chance, at 1 to 10 samples.

    Both are whitened by their own past, so what an error still holds of earlier inputs does not count; then n times the
    sum of squared correlations is chi-square (Granger, Econometrica 37, 1969; Box & Jenkins, 1970, 11.2). NaN errors
    count nothing.
    """
    n = len(u)
    if n < FEEDBACK_SAMPLES:
        return False
    m = FEEDBACK_LAGS
    fresh = _whitened(u, m)
    power = float(fresh @ fresh) / len(fresh)
    if power <= FORETOLD * float(u @ u) / n:
        return False
    late = _whitened(np.nan_to_num(errors), m)
    size = float(late @ late) * power
    together = _following(fresh, late, m)
    return size > 0.0 and float(together @ together) / size > FEEDBACK_LEVEL


def _whitened(signal: Array, m: int) -> Array:
    """What the m samples before do not tell of a signal (n - m,)."""
    gram = lagged_gram([np.ascontiguousarray(signal)], [range(m + 1)], m)
    own = np.linalg.lstsq(gram[1:, 1:], gram[1:, 0], rcond=SINGULAR)[0]
    return np.convolve(signal, np.concatenate([[1.0], -own]), "valid")


def _following(fresh: Array, errors: Array, m: int) -> Array:
    """sum_t fresh(t) errors(t - k), k = 1 .. m."""
    return np.array([fresh[k:] @ errors[:-k] for k in range(1, m + 1)])


# ------------------------------------------------------------------------------------------------- the data


def _channels(each: Sequence[Data]) -> None:
    first = each[0]
    for kind, names in (("output", first.outputs), ("input", first.inputs)):
        parts = [one.y if kind == "output" else one.u for one in each]
        for i, name in enumerate(names):
            trouble = _trouble([part[:, i] for part in parts])
            if trouble:
                raise ValueError(f"{kind} {name} {trouble}")


def _trouble(parts: Sequence[Array]) -> str:
    """What is wrong with a channel of all experiments; empty when nothing is."""
    known = [part if np.isfinite(part).all() else part[~np.isnan(part)] for part in parts]
    if not any(len(part) for part in known):
        return "is missing: it holds no number"
    if not all(np.isfinite(part).all() for part in known):
        return "is not finite"
    spread = max(float(part.max() - part.min()) for part in known if len(part))
    largest = max(float(np.abs(part[0])) for part in known if len(part))
    return "is constant: it tells nothing, leave it out" if spread <= CONSTANT * largest else ""


def _samples(each: Sequence[Data], orders: Orders) -> None:
    rows = sum(max(one.n - orders.lost, 0) for one in each)
    if rows <= orders.parameters:
        raise ValueError(
            f"too few samples: {sum(one.n for one in each)} give {rows} equations for {orders.parameters} parameters"
        )


def _excitation(each: Sequence[Data], lags: int) -> Iterator[str]:
    longest = max(each, key=lambda one: one.n)
    wanted = lags * longest.nu
    if not wanted or longest.n <= 2 * lags:
        return
    found = max(excitation(one.u, lags) for one in each)
    if found < wanted:
        names = ", ".join(longest.inputs)
        yield (
            f"not persistently exciting: {names} excite order {found} and {wanted} is wanted; use a richer input "
            "(noise, PRBS, more sines) or a lower order"
        )


# ------------------------------------------------------------------------------------------------- the result


def poles(model: Model) -> NDArray[np.complex128]:
    """Poles of the dynamics from u to y (of the noise where there is no input)."""
    if isinstance(model, Innovations):
        return np.asarray(np.linalg.eigvals(model.a), dtype=complex)
    factors = [model.a, *model.f] if model.nu else [model.a, model.d]
    return np.concatenate([np.roots(one) for one in factors]).astype(complex)


def _integrator(model: Model, n: int) -> Iterator[str]:
    found = poles(model)
    near = found[np.abs(found - 1.0) * n < DICKEY_FULLER]
    if len(near):
        yield (
            f"an integrator: the pole {_number(near[0])} cannot be told from 1 by {n} samples; simulations drift, fit "
            "differences of the output instead"
        )


def _predictor(model: Model) -> Iterator[str]:
    if isinstance(model, Innovations):
        own = np.linalg.eigvals(model.a - model.k @ model.c)
    else:
        own = np.concatenate([np.roots(one) for one in (model.c, *model.f)])
    radius = float(np.abs(own).max(initial=0.0))
    if radius > 1.0 + CANCELLED_EXACTLY:
        yield f"the predictor is unstable (a pole of magnitude {radius:.4g}): do not use the model to predict"


def _cancelled(model: Model) -> Iterator[str]:
    """Roots that all polynomials of a transfer function share: B and F of an input, C and D, or A, B and C."""
    if isinstance(model, Innovations):
        return
    for name, parts in _partners(model):
        for root in np.roots(_polynomial(model, parts[0])):
            near = [_nearest(model, parts[0], root, other) for other in parts[1:]]
            if abs(root) > CANCELLED_EXACTLY and all(near):
                yield (
                    f"order too high: {name} nearly share the root {_number(root)}, a pole and a zero that cancel; "
                    "take a lower order"
                )  # fmt: skip
                break


def _partners(model: Polynomials) -> Iterator[tuple[str, list[str]]]:
    for i, f in enumerate(model.f):
        if len(f) > 1:
            yield f"B and F of input {i + 1}", [f"f{i}", f"b{i}"]
    if len(model.d) > 1 and len(model.c) > 1:
        yield "C and D", ["d", "c"]
    if len(model.a) > 1 and len(model.c) > 1:
        yield "A, B and C" if model.nu else "A and C", ["a", "c", *(f"b{i}" for i in range(model.nu))]


def _polynomial(model: Polynomials, part: str) -> Array:
    if part[0] in "bf" and len(part) > 1:
        own: Sequence[Array] = getattr(model, part[0])
        return _without_delay(own[int(part[1:])])
    return np.asarray(getattr(model, part))


def _without_delay(values: Array) -> Array:
    nonzero = np.flatnonzero(values)
    return values[nonzero[0] :] if len(nonzero) else values[:1]


def _nearest(model: Polynomials, part: str, root: complex, other: str) -> bool:
    """Whether the other polynomial is zero at the root, by its value there and the error of that."""
    roots = np.roots(_polynomial(model, other))
    if not len(roots):
        return False
    closest = roots[np.abs(roots - root).argmin()]
    limit = CANCELLED_EXACTLY
    if model.covariance is not None:
        error = _gradient(model, part, root) - _gradient(model, other, closest)
        size = float((error @ model.covariance @ error.conj()).real)
        limit = max(limit, CANCELLED * max(size, 0.0) ** 0.5)
    return bool(abs(closest - root) < min(limit, APART))


def _gradient(model: Polynomials, part: str, root: complex) -> NDArray[np.complex128]:
    """d root / d coefficients, by `names`: -z^(n-k) / P'(z) for the coefficient of q^-k."""
    values, out = _polynomial(model, part), np.zeros(len(model.names), dtype=complex)
    slope = np.polyval(np.polyder(values), root)
    full = getattr(model, part[0])
    skipped = len(full[int(part[1:])]) - len(values) if len(part) > 1 else 0
    for k in range(len(values)):
        name = coefficient(part[0], k + skipped, int(part[1:]) if len(part) > 1 else 0, model.nu)
        if name in model.names and slope != 0.0:
            out[model.names.index(name)] = -(root ** (len(values) - 1 - k)) / slope
    return out


def coefficient(letter: str, power: int, channel: int = 0, channels: int = 1) -> str:
    """Name of the coefficient of q^-power: a1, c2; b1, f2 of one input, b1(2) for the second of several."""
    return f"{letter}{power}({channel + 1})" if letter in "bf" and channels > 1 else f"{letter}{power}"


def _undetermined(model: Model) -> Iterator[str]:
    """Coefficients of A, C, D, F whose error is half the range that a stable polynomial leaves them."""
    if isinstance(model, Innovations) or model.covariance is None:
        return
    errors = model.deviations()
    for part in ("a", "c", "d", *(f"f{i}" for i in range(len(model.f)))):
        size = len(_polynomial(model, part)) - 1
        channel = int(part[1:]) if len(part) > 1 else 0
        for k in range(1, size + 1):
            name = coefficient(part[0], k, channel, model.nu)
            # |coefficient of q^-k| <= binomial(n, k) for roots within the unit circle
            if errors.get(name, 0.0) > 0.5 * comb(size, k):
                yield f"order too high or too little data: {name} is known to +-{errors[name]:.2g} only"
                return


def _number(value: complex) -> str:
    return f"{value.real:.4g}" if abs(value.imag) < 1e-9 else f"{value.real:.4g}{value.imag:+.4g}j"
