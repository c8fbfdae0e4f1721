"""Continuous transfer functions of measured frequency responses.

Two stages, after scaling s by the middle of the band:
    1  Sanathanan and Koerner: min sum |w (B - A l)/(A' l)|^2, A' the denominator before, mean of A/A' = 1
    2  min sum w^2 |log(B/A) - log l|^2, or of log |.| alone, by Levenberg and Marquardt with exact derivatives:
       d log(B/A)/d b_k = s^k/B,   d log(B/A)/d a_k = -s^k/A
Logarithms weigh each decade of gain alike, where differences would see the peaks only.
Sources: Sanathanan, Koerner, IEEE Trans. AC 8 (1963); Gustavsen, Improving the pole relocating properties of vector
fitting, IEEE Trans. Power Delivery 21 (2006) for the relaxed constraint; Pintelon, Schoukens, System Identification: A
Frequency Domain Approach, 2012, ch. 9 (logarithmic least squares).

Rules of this file: one input and output; w in rad/s; the answer has the orders that were asked for, and says how far
off it is.
"""

from __future__ import annotations

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from hoopd.ident.bases import Basis
from hoopd.ident.denominators import Denominator, Free, Stable, powers_of
from hoopd.ident.rationalproblem import Problem, RationalFit, Weight, solved

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Relative change of the error at which the first stage has settled.
SETTLED = 1e-10
# Powers of |l| by which the first stage weighs relative errors, from valleys to peaks; the nearest answer counts.
SHARES = (0.0, 0.5, 1.0)
# Steps of the second stage from every start, and those that finish the best of them.
FEW, MANY = 100, 500


def rational(
    response: ct.FRD,
    poles: int | ct.TransferFunction,
    zeros: int | None = None,
    *,
    weight: Weight = "log",
    phase: bool = False,
    refine: bool = True,
    stable: bool = False,
    iterations: int = 50,
) -> RationalFit:
    """B(s)/A(s) with so many poles and zeros (one fewer, unless given), or of the orders of a guess and begun from it.

    weight: "log" (each octave alike, whatever the points), "equal" (each point), or (nw,) weights of the squares, such
    as 1/variance of log l. phase: whether the second stage minds it; without it only gains count, and the phase settles
    the half planes of poles and zeros in the first stage. stable: poles stay in the left half plane.
    ValueError for more unknowns than data, and for a response that is zero or not finite.
    """
    problem = Problem.of(response, weight)
    guess = poles if isinstance(poles, ct.TransferFunction) else None
    n = len(guess.den[0][0]) - 1 if guess else int(poles)
    m = (len(guess.num[0][0]) - 1 if guess else n - 1) if zeros is None else zeros
    if n < 0 or m < 0 or n + m + 1 > 2 * len(problem.w):
        raise ValueError(f"{len(problem.w)} frequencies for {n} poles and {m} zeros")
    before = None if guess is None else guess.den[0][0] / guess.den[0][0][0] * problem.unit ** -np.arange(n + 1.0)
    steps = FEW if refine else 0
    starts = [_linear(problem, n, m, before, iterations, share) for share in (SHARES if refine else SHARES[:1])]
    if refine and phase:  # gains alone have no turns of 2 pi to be caught in
        starts += [_finished(problem, b, a, steps, stable=stable, phase=False) for b, a in starts]
    each = [_finished(problem, b, a, steps, stable=stable, phase=phase) for b, a in starts]
    best = min(each, key=lambda one: problem.rms(one[0], one[1], phase))
    if refine:
        best = _finished(problem, best[0], best[1], MANY, stable=stable, phase=phase)
    return problem.answered(*_unscaled(*best, problem.unit), phase)


def fit_basis_response(
    response: ct.FRD, basis: Basis, *, direct: bool = False, weight: Weight = "log", phase: bool = False
) -> RationalFit:
    """The sum of the functions of a basis (and a constant, `direct`) that lies nearest to a response by the logarithm.

    Begins from linear least squares of (sum - l)/l and goes on with log |.|, or the whole logarithm with `phase`.
    """
    problem = Problem.of(response, weight)
    columns = basis.responses(problem.w)
    if direct:
        columns = np.hstack([columns, np.ones((len(columns), 1))])
    scale = np.linalg.norm(columns, axis=0)
    start = solved(columns / scale / problem.data[:, None] * problem.root[:, None], problem.root.astype(complex))

    def misses(x: Array) -> Array:
        return problem.misses((columns / scale) @ x, phase)

    def slopes(x: Array) -> Array:
        return problem.parts((columns / scale) / ((columns / scale) @ x)[:, None], phase)

    found = optimize.least_squares(misses, start, slopes, method="trf", x_scale="jac", max_nfev=500).x / scale
    system = basis.combined(found[: len(basis)])
    if direct:
        system = ct.ss(system.A, system.B, system.C, system.D + found[-1], basis.dt)
    return problem.answer(system, columns @ found, phase)


def minimum_phase(system: ct.TransferFunction | ct.StateSpace) -> ct.TransferFunction:
    """Poles and zeros of the wrong half plane mirrored (at the unit circle, if sampled): same gain at every frequency.

    The sign is that of the gain at rest, or of the leading coefficients where that is 0 or infinite.
    """
    tf = ct.tf(system)
    num, den = np.trim_zeros(tf.num[0][0], "f"), np.trim_zeros(tf.den[0][0], "f")
    mirrored = _reflected_z if tf.dt else _reflected_s
    top, bottom = mirrored(num), mirrored(den)
    at = 1.0 if tf.dt else 0.0
    before, after = (np.polyval(one, at) * np.polyval(other, at) for one, other in ((num, den), (top, bottom)))
    sign = np.sign(before) * np.sign(after) or 1.0
    return ct.tf(sign * top, bottom, tf.dt)


# ---------------------------------------------------------------------------------------------- stages


def _linear(
    problem: Problem, n: int, m: int, before: Array | None, iterations: int, share: float
) -> tuple[Array, Array]:
    """The first stage: coefficients from the highest power, of the nearest iterate by |said/l - 1| |l|^share."""
    s, powers = problem.s, powers_of(problem.s, max(n, m))
    # without a guess: as large as (s + 1)^n, so that no end of the band outweighs the other
    size = (1.0 + s) ** n if before is None else np.polyval(before, s)
    scale = np.abs(problem.data) ** share
    root = problem.root * scale / np.linalg.norm(problem.root * scale)
    best, last, kept = np.inf, np.inf, (np.zeros(m + 1), np.ones(n + 1))
    for _ in range(iterations):
        shape = powers[:, : n + 1] / size[:, None]
        rows = np.hstack([powers[:, : m + 1] / size[:, None] / problem.data[:, None], -shape]) * root[:, None]
        # the mean of A/A' is 1: a leading coefficient of 1 would pull A, and with it the fit, towards 0 where noise is
        fixed = np.concatenate([np.zeros(m + 1), root**2 @ shape.real])
        x = solved(np.vstack([rows, fixed]), np.append(np.zeros(len(s)), 1.0).astype(complex))
        b, a = x[m::-1] / x[-1], x[:m:-1] / x[-1]
        size = np.polyval(a, s)
        error = float(np.linalg.norm(root * (np.polyval(b, s) / size / problem.data - 1.0)))
        if error < best:
            best, kept = error, (b, a)
        if abs(error - last) <= SETTLED * last:
            break
        last = error
    return kept


def _finished(problem: Problem, b: Array, a: Array, steps: int, *, stable: bool, phase: bool) -> tuple[Array, Array]:
    """So many steps of the second stage; if `stable`, from a denominator whose roots are mirrored and B fitted anew."""
    denominator: Denominator = Stable.of(a) if stable else Free.of(a)
    if stable and (np.roots(a).real > 0.0).any():
        b = _numerator(problem, len(b) - 1, denominator.at(problem.s, denominator.start)[0])
    return (
        _refined(problem, b, denominator, steps, phase) if steps else (b, denominator.coefficients(denominator.start))
    )


def _numerator(problem: Problem, m: int, a: Complex) -> Array:
    """B of a given A, by relative least squares; from the highest power."""
    weight = problem.root / np.abs(problem.data)
    columns = powers_of(problem.s, m) / a[:, None] * weight[:, None]
    return solved(columns, problem.data * weight)[::-1]


def _refined(problem: Problem, b: Array, a: Denominator, steps: int, phase: bool) -> tuple[Array, Array]:
    """The second stage."""
    powers, size = powers_of(problem.s, len(b) - 1), len(b)

    def misses(x: Array) -> Array:
        return problem.misses(powers @ x[:size] / a.at(problem.s, x[size:])[0], phase)

    def slopes(x: Array) -> Array:
        by_b = powers / (powers @ x[:size])[:, None]
        return problem.parts(np.hstack([by_b, -a.at(problem.s, x[size:])[1]]), phase)

    start = np.concatenate([b[::-1], a.start])
    found = optimize.least_squares(
        misses, start, slopes, method="trf", x_scale="jac", xtol=1e-10, ftol=1e-10, max_nfev=steps
    ).x
    return found[size - 1 :: -1], a.coefficients(found[size:])


# ---------------------------------------------------------------------------------------------- inside


def _unscaled(b: Array, a: Array, unit: float) -> tuple[Array, Array]:
    """Polynomials in s/unit as polynomials in s, the denominator's leading coefficient 1."""
    top = b * unit ** -np.arange(len(b) - 1.0, -1.0, -1.0)
    bottom = a * unit ** -np.arange(len(a) - 1.0, -1.0, -1.0)
    return top / bottom[0], bottom / bottom[0]


def _reflected_s(p: Array) -> Array:
    roots = np.roots(p)
    return np.atleast_1d(p[0] * np.real(np.poly(np.where(roots.real > 0.0, -roots.conj(), roots))))


def _reflected_z(p: Array) -> Array:
    roots = np.roots(p)
    outside = np.abs(roots) > 1.0
    moved = roots.copy()
    moved[outside] = 1.0 / roots[outside].conj()
    return np.atleast_1d(p[0] * np.prod(np.abs(roots[outside])) * np.real(np.poly(moved)))
