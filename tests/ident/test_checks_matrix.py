"""Every estimator with every kind of bad data: an error or a warning that names the cause, or the reason why not."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import control as ct
import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd import ident
from hoopd.ident import Data, RecursiveArx, iddata
from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.models import innovations

A, B, A_INTEGRATING = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -1.5, 0.5]
N = 600
HIGH, LOW = 5, 2

# What a message has to say of each cause.
CAUSES = {
    "sine": "excit",
    "order": "too high|do not determine",
    "loop": "feedback suspected",
    "integrator": "an integrator",
    "constant input": "input (u|1) is constant",
    "constant output": "output( y| 1)? is constant",
    "not finite": "not finite",
}


def made(cause: str, n: int) -> Data:
    """y of ARX(2, 2) with noise, spoiled in one way."""
    rng = np.random.default_rng(3)
    u, e = rng.standard_normal(n), 0.5 * rng.standard_normal(n)
    a = A_INTEGRATING if cause == "integrator" else A
    if cause == "sine":
        u, e = np.sin(0.3 * np.arange(n)), 0.1 * e
    if cause == "loop":
        return looped(u, e)
    y = lfilter(B, a, u) + lfilter([1.0], a, e)
    if cause == "constant input":
        u = np.full(n, 0.3)
    if cause == "constant output":
        y = np.full(n, 0.3)
    data = iddata(y, u)
    if cause == "not finite":
        u = u.copy()
        u[10] = np.inf
        data = replace(data, u=u[:, None])
    return data


def looped(r: np.ndarray, e: np.ndarray) -> Data:
    y, u = np.zeros(len(r)), np.zeros(len(r))
    for t in range(len(r)):
        past = [(y[t - k], u[t - k]) if t >= k else (0.0, 0.0) for k in (1, 2)]
        y[t] = 1.5 * past[0][0] - 0.7 * past[1][0] + past[0][1] + 0.5 * past[1][1] + e[t]
        u[t] = 0.5 * r[t] - 0.3 * y[t]
    return iddata(y, u)


def recursive(data: Data, n: int) -> object:
    own = RecursiveArx(n, [n + 1], forgetting=1.0)
    for y, u in zip(data.y[:, 0], data.u[:, 0], strict=True):
        own.update(y, u)
    return own.model(1.0, variance=0.25)


def companion(p: np.ndarray) -> ct.StateSpace:
    return ct.ss([[-p[0], 1.0], [-p[1], 0.0]], [[p[2]], [0.5 * p[2]]], [[1.0, 0.0]], [[0.0]], 1.0)


def redundant(p: np.ndarray) -> ct.StateSpace:
    """Parameters 2 and 3 as a product."""
    return companion(np.array([p[0], p[1], p[2] * p[3]]))


def guess(data: Data, n: int) -> list[float]:
    """Near the truth, of three parameters or of four."""
    return [-1.45, 0.6, 0.9] if n == LOW else [-1.45, 0.6, 0.9, 0.9]


def grey(data: Data, n: int) -> object:
    return ident.structured_pem(data, companion if n == LOW else redundant, guess(data, n))


def filtered(data: Data, n: int) -> object:
    def f(x: np.ndarray, u: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
        gain = p[2] if n == LOW else p[2] * p[3]
        return np.stack([-p[0] * x[0] + x[1] + gain * u[0], -p[1] * x[0] + 0.5 * gain * u[0]])

    def h(x: np.ndarray, u: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
        return x[:1]

    return ident.nonlinear_pem(
        data[:300], f, h, guess(data, n), [0.0, 0.0], process=0.1, measurement=0.1, iterations=15
    )


def hammerstein(data: Data, n: int) -> object:
    def into(u: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.asarray(np.tanh(p[0] * u))

    return ident.hammerstein_wiener(data[:400], n, [0.5], input_map=into, starts=1, iterations=20)


def begun(data: Data, n: int) -> object:
    """A start of so many states: the truth, and states that do nothing but die out."""
    a = np.diag(np.linspace(0.1, 0.3, n)) + 0.0
    a[:2, :2] = [[1.45, 1.0], [-0.65, 0.0]]
    b, c = np.full((n, 1), 0.1), np.full((1, n), 0.1)
    b[:2, 0], c[0, :2] = [1.0, 0.5], [1.0, 0.0]
    return ident.pem(data, start=innovations(ct.ss(a, b, c, [[0.0]], 1.0), np.full((n, 1), 0.01)), iterations=15)


def over_frequency(data: Data, n: int) -> object:
    """Spectra of the record; a measured response with white noise where the order is asked about."""
    if n == LOW:
        done = ident.fft(data)
        return ident.frequency_subspace(done.w, done.y, done.u, dt=1.0, order=n)
    rng, w = np.random.default_rng(0), np.linspace(0.05, 3.0, 60)
    z = np.exp(1j * w)
    g = np.polyval([1.0, 0.5], z) / np.polyval(A, z) + 0.02 * (rng.standard_normal(60) + 1j * rng.standard_normal(60))
    return ident.frequency_subspace(w, g[:, None, None], dt=1.0, order=n)


SAYS_NO_MODEL = "gives no model: the estimator that takes its answer says it"
NO_ORDER = "has no order"
SMOOTHED = "the number of lags is no order: a prior or the covariance says which are none"
NO_INPUT = "has no input"
ALONE = dict.fromkeys(("sine", "loop", "constant input", "not finite"), NO_INPUT)

Estimator = Callable[[Data, int], Any]
ESTIMATORS: dict[str, tuple[Estimator, Mapping[str, str]]] = {
    "arx": (lambda d, n: ident.arx(d, n, n), {}),
    "arx estimator": (lambda d, n: ident.arx(d, n, n, estimator=ident.least_squares), {}),
    "arx focus": (lambda d, n: ident.arx(d, n, n, focus_hz=(0.0, 0.2)), {}),
    "varx": (lambda d, n: ident.varx(d, n, n), {}),
    "plr": (lambda d, n: ident.plr(d, n, n, n - 1), {}),
    "armax": (lambda d, n: ident.armax(d, n, n, 1), {}),
    "ararx": (lambda d, n: ident.ararx(d, n, n, 1), {}),
    "oe": (lambda d, n: ident.oe(d, n, n), {}),
    "bj": (lambda d, n: ident.bj(d, n, 0, n, n), {}),
    "ar": (lambda d, n: ident.ar(d, n + 1), ALONE),
    "arma": (lambda d, n: ident.arma(d, n, n - 1), ALONE),
    "arma_ssa": (
        lambda d, n: ident.arma_ssa(d, n, 1),
        ALONE | {"order": "the smoothed signal is no sample of the model: it has no likelihood to test by"},
    ),
    "scan": (
        lambda d, n: ident.scan(d, range(1, n + 1), n + 1),
        dict.fromkeys(("order", "loop", "integrator"), SAYS_NO_MODEL),
    ),
    "delay": (lambda d, n: ident.delay(d, longest=8), {"order": "too high an order widens the interval, no more"}),
    "RecursiveArx": (
        recursive,
        {"loop": "keeps no record to look for it in", "not finite": "skips such samples and counts them"},
    ),
    "subspaceid": (ident.subspaceid, {}),
    "subspaceid simulation": (lambda d, n: ident.subspaceid(d, n, focus="simulation"), {}),
    "pem": (lambda d, n: ident.pem(d, n, iterations=15), {}),
    "pem start": (begun, {}),
    "pem simulation": (lambda d, n: ident.pem(d, n, focus="simulation", iterations=15), {}),
    "frequency_subspace": (over_frequency, {"loop": "spectra keep no order of time"}),
    "okid": (lambda d, n: ident.okid(d, 4 * n), {"order": "its lags are a window: era of its result has an order"}),
    "era": (lambda d, n: ident.era_of_data(d, n, lags=12), {}),
    "structured_pem": (grey, {}),
    "nonlinear_pem": (filtered, {"sine": "harmonics count too: what is not determined is said by its name"}),
    "hammerstein_wiener": (hammerstein, {"sine": "the map's harmonics are as many lines as it takes"}),
    "impulseest": (lambda d, n: ident.impulseest(d, 20), {"order": SMOOTHED}),
    "impulseest kernel": (lambda d, n: ident.impulseest(d, 20, "tc"), {"order": SMOOTHED}),
    "tfest": (lambda d, n: ident.tfest(d), {"order": NO_ORDER}),
    "coherence": (lambda d, n: ident.coherence(d), {"order": NO_ORDER}),
    "fit_basis": (lambda d, n: ident.fit_basis(d, ident.orthonormal([0.75 + 0.37j] + [0.3] * (n - 1), 1.0)), {}),
    "empirical": (lambda d, n: ident.etfe(d), {"order": NO_ORDER}),
}


def said_of(call: Callable[[], object]) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            call()
        except ValueError as error:
            return [str(error), *(str(one.message) for one in caught)]
    return [str(one.message) for one in caught if issubclass(one.category, IdentificationWarning)]


@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_cause_is_named(name: str, cause: str) -> None:
    estimator, excused = ESTIMATORS[name]
    said = said_of(lambda: estimator(made(cause, N), HIGH if cause == "order" else LOW))
    if cause in excused:
        assert not any(re.search(CAUSES[cause], one) for one in said), "the excuse is out of date"
    else:
        assert any(re.search(CAUSES[cause], one) for one in said), said


# ARX data want no noise model and no third coefficient of B, and a basis holds them but roughly.
ONE_MORE = {"plr", "armax", "ararx", "RecursiveArx", "fit_basis"}


@pytest.mark.parametrize("name", sorted(set(ESTIMATORS) - ONE_MORE))
def test_good_data_are_left_in_peace(name: str) -> None:
    assert not said_of(lambda: ESTIMATORS[name][0](made("", N), LOW))


@pytest.mark.parametrize(
    ("given", "said"),
    [({"order": 0}, "order"), ({"order": -1}, "order"), ({"horizon": 0}, "horizon"), ({"stable": -0.5}, "stable")],
)
def test_numbers_that_mean_nothing_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=f"^{said} is"):
        ident.subspaceid(made("", N), **given)


def test_a_ridge_beside_an_estimator_is_refused() -> None:
    with pytest.raises(ValueError, match="not both"):
        ident.arx(made("", N), 2, 2, ridge=1.0, estimator=ident.least_squares)


def test_a_search_that_stops_early_says_so() -> None:
    with pytest.warns(IdentificationWarning, match="has not settled after 2 steps"):
        ident.structured_pem(made("", N), companion, [-1.3, 0.5, 0.5], iterations=2)


def test_variance_counts_the_samples_that_were_measured() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(2000)
    y = lfilter(B, A, u) + 0.5 * rng.standard_normal(2000)
    y[rng.random(2000) < 0.6] = np.nan
    found = ident.structured_pem(iddata(y, u), companion, [-1.45, 0.65, 0.9])
    assert found.model.r is not None
    assert found.model.r[0, 0] == pytest.approx(0.25, rel=0.15)


def test_a_missing_output_is_no_constant_one() -> None:
    data = made("", N)
    y = np.column_stack([data.y[:, 0], np.roll(data.y[:, 0], 3)])
    y[::2, 1] = np.nan
    with pytest.raises(ValueError, match="0 equations without a missing output"):
        ident.varx(iddata(y, data.u, outputs=["theta", "psi"]), 2, 2)


def test_one_missing_output_hides_no_loop() -> None:
    data = made("loop", N)
    y = data.y.copy()
    y[100] = np.nan
    with pytest.warns(IdentificationWarning, match="feedback suspected"):
        ident.oe(replace(data, y=y), 2, 2)


def test_exact_data_of_a_lower_order_are_told() -> None:
    u = np.random.default_rng(0).standard_normal(500)
    assert any("too high" in one for one in said_of(lambda: ident.subspaceid(iddata(lfilter(B, A, u), u), 8)))


def test_no_sample_poisons_the_estimate_on_line() -> None:
    data = made("", N)
    own = RecursiveArx(2, 2, forgetting=1.0)
    for t, (y, u) in enumerate(zip(data.y[:, 0], data.u[:, 0], strict=True)):
        own.update(np.inf if t == 100 else y, np.float32(np.nan) if t == 200 else np.float32(u))
    assert np.allclose(own.coefficients, [-1.5, 0.7, 1.0, 0.5], atol=0.15)
    assert own.skipped > 1 and own.samples + own.skipped == N
    with pytest.raises(ValueError, match="p0 and trace_bound"):
        RecursiveArx(1, 1, p0=-1.0)
