"""What is wrong with a result, said by name: integrators, roots that cancel, coefficients that nothing determined.

Rules of this file: one function a cause; only the model and the number of samples are looked at; a threshold is a level
of significance or of the arithmetic, and stands with its reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import comb

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.doubts import warn
from hoopd.ident.models import Innovations, Model, Polynomials

Array = NDArray[np.float64]

# N (1 - pole) of an integrator that was estimated stays below this in 95 of 100 (Dickey & Fuller, JASA 74, 1979).
DICKEY_FULLER = 8.0
# Poles and zeros nearer than so many standard errors of their distance cancel.
CANCELLED = 2.0
# ... but roots that nobody knows are not equal for that: so far apart they are two.
APART = 0.3
# Without a covariance: poles and zeros nearer than rounding leaves double roots.
CANCELLED_EXACTLY = 1e-6
# What an input moves by less than this, beside the largest of what it moves, it does not.
NEVER = 1e-12


def check_model(model: Model, n: int, *, order: bool = True) -> None:
    """Warn of a result from n samples: an integrator, common poles and zeros, coefficients that nothing determined.

    `order`: the covariance is that of an efficient estimate, so it tells whether the last coefficients are needed.
    """
    found = poles(model)
    for said in (
        *_unstable(found, n),
        *_integrator(_reached(model, found), n),
        *_cancelled(model),
        *_undetermined(model),
        *_predictor(model),
    ):
        warn(said)
    if order:
        check_order(model, n)


def check_predictor(model: Model) -> None:
    """Warn when the one-step predictor, or the simulation of a model without a gain, grows without bound."""
    for said in _predictor(model):
        warn(said)


def check_order(model: Model, n: int) -> None:
    """Warn when the last coefficients of a polynomial, by their covariance, are no more than chance gives."""
    if isinstance(model, Polynomials) and model.covariance is not None:
        check_excess(((name, *wald(model, group)) for name, group in last_coefficients(model)), n)


def check_excess(told: Iterable[tuple[str, float, int]], n: int) -> None:
    """Warn of those groups of coefficients (name, Wald statistic, how many) that BIC would leave out.

    x' cov(x)^-1 x < (how many) ln n, Wald's form of the ratio of likelihoods (Schwarz, Ann. Statist. 6, 1978).
    """
    idle = [name for name, statistic, count in told if statistic < count * np.log(max(n, 2))]
    if idle:
        warn(f"order too high: the last {' and '.join(idle)} is no larger than chance gives; take one less")


def wald(model: Polynomials, names: Sequence[str]) -> tuple[float, int]:
    """x' cov(x)^-1 x of coefficients by name, and how many they are."""
    assert model.covariance is not None
    at = [model.names.index(name) for name in names]
    x, spread = model.values[at], model.covariance[np.ix_(at, at)]
    if not np.isfinite(spread).all():
        return 0.0, len(at)
    if len(at) == 1:
        return float(x[0] ** 2 / spread[0, 0]) if spread[0, 0] > 0.0 else 0.0, 1
    size = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    inner = np.linalg.pinv(spread / np.outer(size, size), rcond=1e-10, hermitian=True)
    return float((x / size) @ inner @ (x / size)), len(at)


def last_coefficients(model: Polynomials) -> Iterator[tuple[str, list[str]]]:
    """Of A, C, D and each F the last one; of all B together the last ones, where a B has more than one."""
    for letter in "acd":
        if len(getattr(model, letter)) > 1:
            yield f"{letter}{len(getattr(model, letter)) - 1}", [f"{letter}{len(getattr(model, letter)) - 1}"]
    for i, f in enumerate(model.f):
        if len(f) > 1:
            name = coefficient("f", len(f) - 1, i, model.nu)
            yield name, [name]
    found = [
        coefficient("b", len(b) - 1, i, model.nu)
        for i, b in enumerate(model.b)
        if len(model.b[i]) and coefficient("b", len(b) - 2, i, model.nu) in model.names
    ]
    if found:
        yield ", ".join(found), found


# ------------------------------------------------------------------------------------------------- the result


def poles(model: Model) -> NDArray[np.complex128]:
    """Poles of the dynamics from u to y (of the noise where there is no input)."""
    if isinstance(model, Innovations):
        return np.asarray(np.linalg.eigvals(model.a), dtype=complex)
    factors = [model.a, *model.f] if model.nu else [model.a, model.d]
    found = [np.roots(one) for one in factors if len(one) > 1]
    return np.concatenate(found).astype(complex) if found else np.zeros(0, dtype=complex)


def drifting(found: NDArray[np.complex128], n: int) -> NDArray[np.complex128]:
    """Those of the poles that n samples cannot tell from 1."""
    return found[np.abs(found - 1.0) * n < DICKEY_FULLER]


def integrator(pole: complex, n: int, where: str = "") -> str:
    """The words for a pole at 1."""
    return (
        f"an integrator{where}: the pole {_number(pole)} cannot be told from 1 by {n} samples; simulations drift, fit "
        "differences of the output instead"
    )


def _integrator(reached: NDArray[np.complex128], n: int) -> Iterator[str]:
    for pole in drifting(reached, n)[:1]:
        yield integrator(pole, n)


def _reached(model: Model, every: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Poles that an input moves, where there is one: a slow disturbance's state drifts by no input."""
    if not isinstance(model, Innovations) or not model.nu:
        return every
    found, left = np.linalg.eig(model.a.T)
    return np.asarray(found[np.abs(left.T @ model.b).max(axis=1) > NEVER * np.abs(model.b).max(initial=0.0)], complex)


def _unstable(found: NDArray[np.complex128], n: int) -> Iterator[str]:
    """Poles outside of the unit circle, of those that are no integrators."""
    outside = found[(np.abs(found) > 1.0) & (np.abs(found - 1.0) * n >= DICKEY_FULLER)]
    if len(outside):
        worst = outside[np.argmax(np.abs(outside))]
        yield (
            f"the model is unstable: the pole {_number(complex(worst))} has the modulus {abs(worst):.4g}; simulations "
            "grow without bound"
        )


def _predictor(model: Model) -> Iterator[str]:
    if isinstance(model, Innovations):
        own = np.linalg.eigvals(model.a - model.k @ model.c)
    else:
        own = np.concatenate([np.zeros(0), *(np.roots(one) for one in (model.c, *model.f) if len(one) > 1)])
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
