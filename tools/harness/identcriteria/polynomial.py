"""Criteria of the polynomial models, one function each: `criterion_NN(seed)` gives figures and whether they passed.

The numbers are those of the tests of ControlSystemIdentification.jl, and so are the bounds: how often they hold is the
benchmark's to print. Where a bound is another one, the docstring says "ours" and why. FRT: the largest difference of
log10 squared gain over 30 frequencies from 0.001 to pi.
"""

from __future__ import annotations

import control as ct
import numpy as np
from scipy.signal import cont2discrete, lfilter

from harness.identcriteria.judged import Array, Criterion, Figures, frt, passed, quiet
from hoopd.ident.conditioning import predictor_data
from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial.ar import ar, arma, arma_ssa, driving_noise
from hoopd.ident.polynomial.ararx import ararx, innovations
from hoopd.ident.polynomial.arx import arx
from hoopd.ident.polynomial.estimators import (
    Estimator,
    least_squares,
    output_noise,
    total_least_squares,
    weighted_total_least_squares,
)
from hoopd.ident.polynomial.plr import plr
from hoopd.ident.polynomial.structure import structure
from hoopd.ident.prediction import predict, simulate
from hoopd.ident.predictor_systems import error_system

# ------------------------------------------------------------------------------------------------- 1 to 5: ARX, PLR

FIRST = (np.array([0.0, 0.8]), np.array([1.0, -0.9]))


def _first(n: int, seed: int, sigma: float) -> Data:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    return iddata(lfilter(*FIRST, u) + sigma * e, u)


def _first_by_all(data: Data) -> dict[str, float]:
    ways: dict[str, Estimator] = {
        "ls": least_squares, "tls": total_least_squares, "wtls": weighted_total_least_squares(output_noise(1, 1)),
    }  # fmt: skip
    found = {name: frt(arx(data, 1, 1, estimator=one).dynamics(0), FIRST) for name, one in ways.items()}
    return found | {"plr": frt(plr(data, 1, 1, 1, initial_order=10).dynamics(0), FIRST)}


@quiet
def criterion_01(seed: int) -> Figures:
    """0.8/(z - 0.9), 2000 samples, output noise of one: bias of LS and TLS, none of weighted TLS and PLR."""
    found = _first_by_all(_first(2000, seed, 1.0))
    out = passed(found, ls=1.5, tls=1.0, wtls=0.12, plr=0.12)
    out["passed"] = bool(out["passed"]) and found["ls"] > 0.7 and found["tls"] > 0.5
    return out


@quiet
def criterion_02(seed: int) -> Figures:
    """The same without noise: exact by all four."""
    return passed(_first_by_all(_first(2000, seed, 0.0)), ls=1.5e-8, tls=1.5e-8, wtls=1.5e-8, plr=1.5e-8)


@quiet
def criterion_03(seed: int) -> Figures:
    """[G 2G] by PLR."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((2000, 2))
    y = lfilter(*FIRST, u[:, 0]) + 2.0 * lfilter(*FIRST, u[:, 1]) + rng.standard_normal(2000)
    model = plr(iddata(y, u), 1, [1, 1], 1, initial_order=10)
    pairs = [frt(model.dynamics(0), FIRST), frt(model.dynamics(1), (2.0 * FIRST[0], FIRST[1]))]
    return passed({"frt": max(pairs)}, frt=0.12)


@quiet
def criterion_04(seed: int) -> Figures:
    """ARX on 20 samples without noise in every shape of orders; two copies equal one; drawn by their covariance, 500
    sets of coefficients have the true ones for their mean (the source's particles)."""
    rng = np.random.default_rng(seed)
    worst, copies, particles = 0.0, 0.0, 0.0
    for na, nb, lag in ((1, (1,), (1,)), (1, (2,), (1,)), (0, (1,), (1,)), (1, (1,), (2,)), (1, (1,), (0,)),
                        (1, (2, 3), (1, 1)), (1, (2, 3), (2, 3))):  # fmt: skip
        own = structure(len(nb), na, nb, delay=lag)
        true = np.concatenate([-rng.uniform(0.2, 0.9, na), rng.uniform(0.5, 2.0, sum(nb))])
        u = rng.standard_normal((20, len(nb)))
        parts = list(own.split(true))
        y = lfilter([1.0], parts[0], sum(lfilter(b, [1.0], u[:, i]) for i, b in enumerate(parts[1 : 1 + len(nb)])))
        data = iddata(y, u)
        one, two = arx(data, na, nb, lag), arx([data, data], na, nb, lag)
        assert one.covariance is not None
        drawn = rng.multivariate_normal(one.values, one.covariance, 500).mean(axis=0)
        worst = max(worst, float(np.abs(one.values / true - 1.0).max()))
        copies = max(copies, float(np.abs(one.values - two.values).max()))
        particles = max(particles, float(np.abs(drawn - true).max()))
    return passed({"error": worst, "copies": copies, "particles": particles}, error=1e-8, copies=1e-10, particles=1e-4)


@quiet
def criterion_05(seed: int) -> Figures:
    """Random MISO ARX of order 2 with direct terms, 20 000 samples, two experiments: exact."""
    rng = np.random.default_rng(seed)
    poles = rng.uniform(0.3, 0.9) * np.exp(1j * rng.uniform(0.2, 2.5))
    a = np.real(np.poly([poles, np.conj(poles)]))
    b = rng.standard_normal((2, 3))
    parts = []
    for _ in range(2):
        u = rng.standard_normal((20_000, 2))
        parts.append(iddata(lfilter([1.0], a, lfilter(b[0], [1.0], u[:, 0]) + lfilter(b[1], [1.0], u[:, 1])), u))
    model = arx(parts, 2, [3, 3], [0, 0])
    return passed({"frt": max(frt(model.dynamics(i), (b[i], a)) for i in range(2))}, frt=1e-6)


# ------------------------------------------------------------------------------------------------- 6 to 9: AR, ARMA


@quiet
def criterion_06(seed: int) -> Figures:
    """AR(1) without noise after a start: the pole, and the impulse that drove it."""
    e = np.zeros(10_000)
    e[0] = 1.0 + abs(np.random.default_rng(seed).standard_normal())
    data = iddata(lfilter([1.0], [1.0, -0.9], e))
    model = ar(data, 1)
    rebuilt = float(np.abs(driving_noise(model, data) - e).max()) / e[0]
    return passed({"pole": abs(model.values[0] + 0.9), "rebuilt": rebuilt}, pole=1e-12, rebuilt=1e-12)


@quiet
def criterion_07(seed: int) -> Figures:
    """AR(1), 10 000 samples, noise of 0.01, a large start."""
    rng = np.random.default_rng(seed)
    e = 0.01 * rng.standard_normal(10_000)
    e[0] += 5.0 * rng.standard_normal()
    data = iddata(lfilter([1.0], [1.0, -0.9], e))
    model = ar(data, 1)
    rms = float(np.sqrt(np.mean(driving_noise(model, data)[1:] ** 2)))
    return passed(
        {"pole": abs(model.values[0] + 0.9), "frt": frt((np.ones(1), model.a), (np.ones(1), np.array([1.0, -0.9]))),
         "rms": rms}, pole=0.02, frt=0.08, rms=0.0105,
    )  # fmt: skip


@quiet
def criterion_08(seed: int) -> Figures:
    """ARMA (z + 0.1)/(z^2 - 0.9 z + 0.1), 5000 samples, both methods; two coefficients of a and, the leading one fixed,
    one of c (the source counts it: two). FRT 0.15, ours: 0.3 there, 0.12 at most seen."""
    c, a = np.array([1.0, 0.1]), np.array([1.0, -0.9, 0.1])
    e = np.random.default_rng(seed).standard_normal(5000)
    data = iddata(lfilter(c, a, e))
    found: dict[str, float] = {}
    for name in ("pem", "two-stage"):
        model = arma(data, 2, 1, method=name)  # type: ignore[arg-type]
        found[f"{name} coefficients"] = float(np.abs(model.values - [-0.9, 0.1, 0.1]).max())
        found[f"{name} frt"] = frt((model.c, model.a), (c, a))
        found[f"{name} noise"] = float(np.mean((driving_noise(model, data) - e) ** 2))
    bounds = {f"{name} {what}": b for name in ("pem", "two-stage")
              for what, b in (("coefficients", 0.5), ("frt", 0.15), ("noise", 0.01))}  # fmt: skip
    return passed(found, **bounds)


@quiet
def criterion_09(seed: int) -> Figures:
    """ARMA by singular spectra: 1/(s^2 + 0.2 s + 1) sampled at 1 s and driven by noise, 1000 samples, 200 lags."""
    return passed(_by_singular_spectra(seed), numerator=0.7, denominator=0.2, frt=2.1)


@quiet
def bar_arma_ssa(seed: int) -> Figures:
    """The same to bounds that tell more: half of the denominator's, a quarter of the response's."""
    return passed(_by_singular_spectra(seed), denominator=0.1, frt=0.6)


def _by_singular_spectra(seed: int) -> dict[str, float]:
    b, a, _ = cont2discrete(([1.0], [1.0, 0.2, 1.0]), 1.0)
    e = np.random.default_rng(seed).standard_normal(1000)
    model = arma_ssa(iddata(lfilter(b[0], a, e)), 2, 1, window=200)
    shown = (np.sqrt(model.variance) * model.c, model.a)
    return {
        "numerator": float(np.abs(shown[0] - b[0][1:]).max()), "denominator": float(np.abs(model.a - a).max()),
        "frt": frt(shown, (b[0][1:], a)),
    }  # fmt: skip


# ------------------------------------------------------------------------------------------------- 10 to 14: ARARX


def _soderstrom(a: float, d: float, sigma: float, n: int, seed: int) -> tuple[Data, Array]:
    """(1 + a q^-1) y = q^-1 u + e / (1 + d q^-1)."""
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    e = sigma * e
    return iddata(lfilter([0.0, 1.0], [1.0, a], u) + lfilter([1.0], np.convolve([1.0, a], [1.0, d]), e), u), e


def _both(data: Data, e: Array, a: float, d: float, prior: Array | None = None) -> dict[str, float]:
    """Errors of G (a, b) and H (d) and of the innovations, the worse of both methods."""
    models = [ararx(data, 1, 1, 1, method=one, prior=prior) for one in ("pem", "gls")]  # type: ignore[arg-type]
    return {
        "g": max(float(np.abs(one.values[:2] - [a, 1.0]).max()) for one in models),
        "h": max(float(abs(one.values[2] - d)) for one in models),
        "e": max(float(np.var((innovations(one, data) - e)[2:]) / np.var(e)) for one in models),
    }


@quiet
def criterion_10(seed: int) -> Figures:
    """S1: a 0.8, d 0.7, noise of one, 500 samples; the filter of the errors; prediction beats simulation."""
    data, e = _soderstrom(0.8, 0.7, 1.0, 500, seed)
    found = _both(data, e, 0.8, 0.7)
    model = ararx(data, 1, 1, 1)
    errors = [float(np.mean((data.y - said) ** 2)) for said in (predict(model, data), simulate(model, data))]
    found["prediction over simulation"] = errors[0] / errors[1]
    found["filter"] = _filter_error(model, data, e)
    return passed(found, g=0.1, h=0.1, e=0.1, filter=0.2, **{"prediction over simulation": 1.0})


def _filter_error(model: Polynomials, data: Data, e: Array) -> float:
    """|ehat - e|/|e| of the errors that the model's own filter makes of [u; y], from rest."""
    said = ct.forced_response(error_system(model), U=predictor_data(data).u.T).outputs
    return float(np.linalg.norm(np.squeeze(said) - e) / np.linalg.norm(e))


@quiet
def criterion_11(seed: int) -> Figures:
    """S12: a 0.7, d 0.9, variance 1.2: the least of two minima."""
    data, e = _soderstrom(0.7, 0.9, 1.2**0.5, 500, seed)
    return passed(_both(data, e, 0.7, 0.9), g=0.2, h=0.1)


@quiet
def criterion_12(seed: int) -> Figures:
    """AR noise model of moving-average noise 1 + 0.7 q^-1 of 0.1: D within 0.1 of 1 - 0.49 q^-1.

    The best D is 1 - 0.7/1.49 q^-1, 0.02 from it, and the estimates scatter about that one by 0.04.
    """
    u, e = np.random.default_rng(seed).standard_normal((2, 500))
    y = lfilter([0.0, 1.0], [1.0, 0.8], u) + lfilter([1.0, 0.7], [1.0, 0.8], 0.1 * e)
    return passed(_both(iddata(y, u), 0.1 * e, 0.8, -0.49), g=0.1, h=0.1)


@quiet
def criterion_13(seed: int) -> Figures:
    """S10: a 0.5, d 0.5, noise of 5, 2000 samples, the noise model given first.

    H within 0.1 by the ten turns of the source, which end as soon as the residual variance moves by less than 0.001:
    they stay at the D that they were given. H within 0.2, ours, at the least sum of squares: there d has a standard
    error of 0.09 (a and d can hardly be told apart under such noise), so that 0.1 holds at five seeds of six.
    """
    data, e = _soderstrom(0.5, 0.5, 5.0, 2000, seed)
    prior = np.array([1.0, 0.5])
    few = ararx(data, 1, 1, 1, method="gls", prior=prior, iterations=10, tolerance=1e-3)
    found = _both(data, e, 0.5, 0.5, prior)
    found["few turns g"] = float(np.abs(few.values[:2] - [0.5, 1.0]).max())
    found["few turns h"] = float(abs(few.values[2] - 0.5))
    models = (few, ararx(data, 1, 1, 1, prior=prior))
    found["frt"] = max(frt(one.dynamics(0), (np.array([0.0, 1.0]), np.array([1.0, 0.5]))) for one in models)
    return passed(found, g=0.4, h=0.2, frt=0.5, **{"few turns g": 0.4, "few turns h": 0.1})


@quiet
def criterion_14(seed: int) -> Figures:
    """Two inputs, 500 samples, with one and with two samples of delay."""
    found = {}
    for lag in (1, 2):
        rng = np.random.default_rng([seed, lag])
        u, e = rng.standard_normal((500, 2)), rng.standard_normal(500)
        right = sum(lfilter([0.0] * lag + [gain], [1.0], u[:, i]) for i, gain in enumerate((1.0, 2.0)))
        y = lfilter([1.0], [1.0, 0.8], right + lfilter([1.0], [1.0, 0.7], e))
        model = ararx(iddata(y, u), 1, [1, 1], 1, lag)
        found[f"g{lag}"] = float(np.abs(model.values[:3] - [0.8, 1.0, 2.0]).max())
        found[f"h{lag}"] = float(abs(model.values[3] - 0.7))
    return passed(found, g1=0.3, h1=0.3, g2=0.1, h2=0.1)


FUNCTIONS: tuple[Criterion, ...] = (
    criterion_01, criterion_02, criterion_03, criterion_04, criterion_05, criterion_06, criterion_07, criterion_08,
    criterion_09, criterion_10, criterion_11, criterion_12, criterion_13, criterion_14, bar_arma_ssa,
)  # fmt: skip
