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

from collections.abc import Callable

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from hoopd.ident.bases import Basis
from hoopd.ident.denominators import Denominator, Free, Stable, powers_of
from hoopd.ident.estimation_report import estimated
from hoopd.ident.rationalproblem import RationalFit, RationalProblem, Weight, solved

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Relative change of the error at which the first stage has settled.
SETTLED = 1e-10
# Powers of |l| by which the first stage weighs relative errors, from valleys to peaks; the nearest answer counts.
SHARES = (0.0, 0.5, 1.0)
# Turns in which the hold of a sampled response is settled, and when it is; at half the sampling frequency nothing tells
# a system from its images.
HOLD_TURNS, HOLD_SETTLED, BELOW_NYQUIST = 8, 1e-6, 0.999
# Steps of the second stage from every start, and those that finish the best of them.
FEW, MANY = 100, 500


@estimated("rational fit")
def rational(
    response: ct.FRD,
    poles: int | ct.TransferFunction,
    zeros: int | None = None,
    *,
    weight: Weight = "log",
    phase: bool = False,
    refine: bool = True,
    stable: bool = False,
    hold: bool | None = None,
    iterations: int = 50,
) -> RationalFit:
    """Fit B(s)/A(s) to a measured frequency response of one input and output.

    A sampled response is that of the system behind a hold: the fit is that of the continuous system, whose sampled
    response, with the images of the hold, is the one given.

    First Sanathanan and Koerner's iteration, min sum |w (B - A l)/(A' l)|^2 with A' the denominator before; then
    min sum w^2 |log(B/A) - log l|^2, or of log |.| alone. Logarithms weigh each decade of gain alike, where differences
    would see the peaks only.

    Parameters
    ----------
    response : control.FRD
        The response l at w rad/s.
    poles : int or control.TransferFunction
        Their number, or a guess, whose orders are taken and from which the search begins.
    zeros : int, optional
        Their number; one fewer than poles, unless given.
    weight : {"log", "equal"} or array_like, shape (nw,)
        Each octave alike, whatever the points; each point alike; or weights of the squares, such as 1/variance of log
        l.
    phase : bool
        Whether the second stage minds the phase; without it only gains count, and the phase settles the half planes of
        poles and zeros in the first stage.
    refine : bool
        Whether there is a second stage.
    stable : bool
        Poles stay in the left half plane.
    hold : bool, optional
        Whether the input was held between samples; unless given, where the response has a step. False fits the response
        as it is.
    iterations : int
        Of the first stage.

    Returns
    -------
    RationalFit
        The `system`, its logarithmic `error` (nw,) in nepers + j rad at `w` rad/s, and the weighted `rms` of it.

    Raises
    ------
    ValueError
        More unknowns than data, and a response that is zero or not finite.

    Notes
    -----
    Sources: Sanathanan, Koerner, IEEE Trans. AC 8 (1963); Gustavsen, IEEE Trans. Power Delivery 21 (2006); Pintelon,
    Schoukens, System Identification: A Frequency Domain Approach, 2012, ch. 9.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import rational, frequency_response
    >>> truth = control.tf([4.0], [1.0, 0.4, 4.0])  # 2 rad/s, damping 0.1
    >>> found = rational(frequency_response(truth, np.geomspace(0.1, 50.0, 60)), poles=2, zeros=0)
    >>> found.system.den[0][0].round(3), bool(found.rms < 1e-6)
    (array([1. , 0.4, 4. ]), True)
    """
    problem = RationalProblem.of(response, weight)
    step = float(response.dt or 0.0) if hold is not False else 0.0
    if hold and not step:
        raise ValueError("a hold wants a sampled response, one with a step dt")
    if step:
        kept, w, data = _below_half(response, step)
        share = weight if isinstance(weight, str) else np.asarray(weight, dtype=float)[kept]

        def fitted(without_hold: ct.FRD) -> RationalFit:
            return rational(
                without_hold, poles, zeros, weight=share, phase=phase, refine=refine, stable=stable, hold=False,
                iterations=iterations,
            )  # fmt: skip

        return _behind_hold(w, data, step, fitted)
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


@estimated("basis functions over frequency")
def fit_basis_response(
    response: ct.FRD, basis: Basis, *, direct: bool = False, weight: Weight = "log", phase: bool = False
) -> RationalFit:
    """Fit the sum of the functions of a basis to a frequency response, nearest by the logarithm.

    Begins from linear least squares of (sum - l)/l and goes on with log |.|, or the whole logarithm.

    Parameters
    ----------
    response : control.FRD
        The response l at w rad/s, of one input and output.
    basis : Basis
        The functions.
    direct : bool
        Whether a constant is added.
    weight : {"log", "equal"} or array_like, shape (nw,)
        As in `rational`.
    phase : bool
        Whether the phase counts and not the gains alone.

    Returns
    -------
    RationalFit
        The `system`, its logarithmic `error` (nw,) in nepers + j rad at `w` rad/s, and the weighted `rms` of it.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import fit_basis_response, laguerre, frequency_response
    >>> truth = control.tf([1.0, 5.0], [1.0, 2.0, 1.0])
    >>> measured = frequency_response(truth, np.geomspace(0.1, 10.0, 40))
    >>> found = fit_basis_response(measured, laguerre(-1.0, 2), phase=True)
    >>> found.system.dcgain().round(3).item()
    5.0
    """
    problem = RationalProblem.of(response, weight)
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
    """Mirror poles and zeros of the wrong half plane (at the unit circle, if sampled): the gain stays at every
    frequency.

    The sign is that of the gain at rest, or of the leading coefficients where that is 0 or infinite.

    Parameters
    ----------
    system : control.TransferFunction or control.StateSpace
        One input and output.

    Returns
    -------
    control.TransferFunction
        The minimum-phase system.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import minimum_phase
    >>> minimum_phase(control.tf([-1.0, 2.0], [1.0, 3.0])).zeros().real
    array([-2.])
    """
    tf = ct.tf(system)
    num, den = np.trim_zeros(tf.num[0][0], "f"), np.trim_zeros(tf.den[0][0], "f")
    mirrored = _reflected_z if tf.dt else _reflected_s
    top, bottom = mirrored(num), mirrored(den)
    at = 1.0 if tf.dt else 0.0
    before, after = (np.polyval(one, at) * np.polyval(other, at) for one, other in ((num, den), (top, bottom)))
    sign = np.sign(before) * np.sign(after) or 1.0
    return ct.tf(sign * top, bottom, tf.dt)


# ---------------------------------------------------------------------------------------------- the hold


def _below_half(response: ct.FRD, step: float) -> tuple[NDArray[np.bool_], Array, Complex]:
    """Which frequencies lie between 0 and half the sampling frequency, those frequencies, the response there."""
    w = np.asarray(response.omega, float)
    kept = (w > 0.0) & (w * step < BELOW_NYQUIST * np.pi)
    return kept, w[kept], np.asarray(response.frdata, complex)[:, :, kept]


def _behind_hold(w: Array, data: Complex, step: float, fitted: Callable[[ct.FRD], RationalFit]) -> RationalFit:
    """The continuous system whose response, sampled behind a hold, is nearest to the one given.

    At first the hold is (1 - e^-jwT)/(jwT) alone; then what the system found makes of it, with its images, until that
    stays.
    """
    z = np.exp(-1j * w * step)
    hold = (1.0 - z) / (1j * w * step)
    for _ in range(HOLD_TURNS):
        found = fitted(ct.FRD(data / hold, w))
        sampled = _sampled_response(found.system, w, step)
        if sampled is None:
            break
        before, hold = hold, sampled / found.system(1j * w)
        if np.abs(hold / before - 1.0).max() < HOLD_SETTLED:
            break
    return found


def _sampled_response(system: ct.TransferFunction, w: Array, step: float) -> Complex | None:
    """Of the system behind a hold; None where it has more zeros than poles."""
    num, den = system.num[0][0], system.den[0][0]
    if len(np.trim_zeros(num, "f")) > len(den):
        return None
    return np.asarray(ct.ss(ct.sample_system(ct.ss(system), step, "zoh"))(np.exp(1j * w * step)), dtype=complex)


# ---------------------------------------------------------------------------------------------- stages


def _linear(
    problem: RationalProblem, n: int, m: int, before: Array | None, iterations: int, share: float
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


def _finished(
    problem: RationalProblem, b: Array, a: Array, steps: int, *, stable: bool, phase: bool
) -> tuple[Array, Array]:
    """So many steps of the second stage; if `stable`, from a denominator whose roots are mirrored and B fitted anew."""
    denominator: Denominator = Stable.of(a) if stable else Free.of(a)
    if stable and (np.roots(a).real > 0.0).any():
        b = _numerator(problem, len(b) - 1, denominator.at(problem.s, denominator.start)[0])
    return (
        _refined(problem, b, denominator, steps, phase) if steps else (b, denominator.coefficients(denominator.start))
    )


def _numerator(problem: RationalProblem, m: int, a: Complex) -> Array:
    """B of a given A, by relative least squares; from the highest power."""
    weight = problem.root / np.abs(problem.data)
    columns = powers_of(problem.s, m) / a[:, None] * weight[:, None]
    return solved(columns, problem.data * weight)[::-1]


def _refined(problem: RationalProblem, b: Array, a: Denominator, steps: int, phase: bool) -> tuple[Array, Array]:
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
