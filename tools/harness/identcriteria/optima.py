"""Criteria of focus, delay and information, and the optima of the polynomial models on known sets.

Bounds as in `polynomial`.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, lfilter
from scipy.stats import multivariate_normal

from harness.identcriteria import sets
from harness.identcriteria.judged import Array, Criterion, Figures, passed, quiet, response
from hoopd.ident.data import Data, iddata
from hoopd.ident.information_criteria import criteria, fpe
from hoopd.ident.measures import fit_percent, mse, nrmse, rms, sse
from hoopd.ident.models import Polynomials
from hoopd.ident.polynomial.arx import arx
from hoopd.ident.polynomial.delay import delay
from hoopd.ident.polynomial.gaussnewton import search
from hoopd.ident.polynomial.orders import scan
from hoopd.ident.polynomial.pem import armax, oe, stretches
from hoopd.ident.polynomial.structure import structure


@quiet
def criterion_41(seed: int) -> Figures:
    """Two resonances, 10 and 20 rad/s, damping 0.02, step 0.05 s: ARX(2, 2) focused on each finds its poles.

    Poles in continuous time, relative to their own distance from 0, and log10 squared gain over a tenth to either side;
    noise of 5 % of the output, ours: the source has none.
    """
    dt, rng = 0.05, np.random.default_rng(seed)
    u = rng.standard_normal(3000)
    true = [cont2discrete(([w * w], [1.0, 0.04 * w, w * w]), dt) for w in (10.0, 20.0)]
    y = sum(lfilter(b[0], a, u) for b, a, _ in true)
    data = iddata(y + 0.05 * np.std(y) * rng.standard_normal(3000), u, dt)
    poles, gains = [], []
    for w, (_, own, _) in zip((10.0, 20.0), true, strict=True):
        model = arx(data, 2, 2, focus_hz=(0.9 * w / (2 * np.pi), 1.1 * w / (2 * np.pi)))
        poles.append(float(abs(_upper_rate(model.a, dt) / _upper_rate(own, dt) - 1.0)))
        omega = np.linspace(0.9 * w, 1.1 * w, 50) * dt
        exact = sum(response(b[0], a, omega) for b, a, _ in true)
        off = 2.0 * np.log10(np.abs(response(*model.dynamics(0), omega) / exact))
        gains.append(float(np.quantile(np.abs(off), 0.9)))
    return passed({"poles": max(poles), "gain": max(gains)}, poles=0.05, gain=0.22)


def _upper_rate(a: Array, dt: float) -> complex:
    """The pole of 1/A in continuous time, the one with positive imaginary part; 1/s."""
    return complex(max((np.log(complex(one)) / dt for one in np.roots(a)), key=lambda one: one.imag))


@quiet
def criterion_49(seed: int) -> Figures:
    """Fit, sums and criteria as the toolbox gives them: 100 % and 0 on equal signals, their definitions on others.

    Two outputs, a sample in ten of the second missing. BIC finds the orders of arx2 (ours: the source scans by AIC).
    """
    rng = np.random.default_rng(seed)
    y, said = rng.standard_normal((2, 60, 2))
    out = passed({"itself": float(np.abs(fit_percent(y, y) - 100.0).max()), "nothing": _all_errors(np.zeros((60, 2))),
                  "sums": _sums(y, said), "criteria": _information(y - said, 7)},
                 itself=1e-12, nothing=1e-12, sums=1e-12, criteria=1e-9)  # fmt: skip
    best = scan(sets.arx2(2000, seed)[0], range(1, 5), range(1, 5), range(3)).best("bic")
    out["orders"] = (best.na, best.nb, best.delay) == (2, (2,), (1,))
    out["passed"] = bool(out["passed"]) and bool(out["orders"])
    return out


def _all_errors(e: Array) -> float:
    """The largest of the sums and means, and the prediction error of a covariance of no errors."""
    return max(float(np.max(one(e))) for one in (sse, mse, rms)) + fpe(e.T @ e / len(e), len(e), 3)


def _sums(y: Array, said: Array) -> float:
    """Relative distance from the definitions, written out sample by sample."""
    y = y.copy()
    y[::10, 1] = np.nan
    worst = 0.0
    for i in range(2):
        pairs = [(a, b) for a, b in zip(y[:, i], said[:, i], strict=True) if np.isfinite(a)]
        total = sum((a - b) ** 2 for a, b in pairs)
        middle = sum(a for a, _ in pairs) / len(pairs)
        ratio = (total / sum((a - middle) ** 2 for a, _ in pairs)) ** 0.5
        wanted = (total, total / len(pairs), (total / len(pairs)) ** 0.5, ratio, 100.0 * (1.0 - ratio))
        e = y - said
        told = (sse(e)[i], mse(e)[i], rms(e)[i], nrmse(y, said)[i], fit_percent(y, said)[i])
        worst = max(worst, *(abs(a / b - 1.0) for a, b in zip(told, wanted, strict=True)))
    return float(worst)


def _information(e: Array, d: int) -> float:
    """`criteria` against the likelihood: what the log likelihood of normal errors differs by from -AIC/2."""
    found, n = criteria(e, d), len(e)
    v = e.T @ e / n
    likelihood = float(np.sum(multivariate_normal(np.zeros(2), v).logpdf(e)))
    aic = -2.0 * (likelihood + n * (1.0 + np.log(2.0 * np.pi))) + 2.0 * d
    k = d + 1
    wanted = {
        "aic": aic, "aicc": aic + 2.0 * k * (k + 1) / (n - k - 1), "bic": aic + d * (np.log(n) - 2.0),
        "fpe": float(np.prod(np.linalg.eigvalsh(v))) * (1.0 + d / n) / (1.0 - d / n),
    }  # fmt: skip
    return max(abs(getattr(found, name) / value - 1.0) for name, value in wanted.items())


@quiet
def criterion_delay(seed: int) -> Figures:
    """The interval holds the delay of a system that rises slowly under noise (95 of 100 and more)."""
    b, a, _ = cont2discrete(([1.0], [1.0, 0.5, 1.0]), 0.1)
    u, e = np.random.default_rng(seed).standard_normal((2, 1000))
    clean = lfilter(np.concatenate([np.zeros(19), b[0]]), a, u)
    found = delay(iddata(clean + 0.2 * clean.std() * e, u, 0.1), longest=30)
    return {
        "samples": float(found.samples), "width": float(found.interval[1] - found.interval[0]),
        "passed": found.interval[0] <= 20 <= found.interval[1],
    }  # fmt: skip


def _bar(model: Polynomials, data: Data, true: Array) -> Figures:
    """Relative error of the coefficients, and the distance to the optimum from the truth in standard errors."""
    own = structure(
        1, len(model.a) - 1, len(model.b[0]) - 1, len(model.c) - 1, 0, len(model.f[0]) - 1 if model.f else 0
    )
    best = search(own, stretches(own, [data]), true, free_start=True)
    distance = float(np.abs((model.values - best.x) / np.array(list(model.deviations().values()))).max())
    error = float(np.linalg.norm(model.values - true) / np.linalg.norm(true))
    scatter = (model.values - true) @ np.linalg.solve(model.covariance, model.values - true)  # type: ignore[arg-type]
    # 1e-5 point of chi-square: 27.9 with 4 degrees, 33.1 with 6
    return passed({"error": error, "from the optimum": distance, "scatter": float(scatter)},
                  **{"from the optimum": 1e-3, "scatter": 33.1})  # fmt: skip


@quiet
def bar_arx2(seed: int) -> Figures:
    """arx2: the relative error of the coefficients."""
    data, true = sets.arx2(seed=seed)
    return _bar(arx(data, 2, 2), data, true)


@quiet
def bar_armax2(seed: int) -> Figures:
    """armax2: the same optimum as from the truth."""
    data, true = sets.armax2(seed=seed)
    return _bar(armax(data, 2, 2, 2), data, true)


@quiet
def bar_oe2(seed: int) -> Figures:
    """oe2: the same optimum as from the truth."""
    data, true = sets.oe2(seed=seed)
    return _bar(oe(data, 2, 2), data, true)


FUNCTIONS: tuple[Criterion, ...] = (
    criterion_41, criterion_49, criterion_delay, bar_arx2, bar_armax2, bar_oe2,
)  # fmt: skip
