"""The prediction-error search: exact derivatives, the optimum, covariance, missing samples, initial states, traps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.data import Data, iddata
from hoopd.ident.polynomial.gaussnewton import PolynomialExperiment, errors, jacobian
from hoopd.ident.polynomial.pem import armax, bj, oe, orders_of, pem, prediction_errors, stretches
from hoopd.ident.polynomial.stable import radius, reflected
from hoopd.ident.polynomial.structure import structure
from hoopd.ident.prediction import prediction_error, simulate

A, B, C = np.array([1.0, -1.5, 0.7]), np.array([0.0, 1.0, 0.5]), np.array([1.0, -1.0, 0.2])
D = np.array([1.0, -0.6])
C_BJ = np.array([1.0, 0.8, 0.3])


def made(kind: str, n: int, seed: int = 0, noise: float = 0.5, before: int = 0) -> Data:
    """Data of B/A with the noise of the kind; `before`: samples cut off in front, so that no state is zero."""
    u, e = np.random.default_rng(seed).standard_normal((2, n + before))
    shape = {"armax": (C, A), "oe": ([1.0], [1.0]), "bj": (C_BJ, D), "ararx": ([1.0], np.convolve(A, D))}[kind]
    y = lfilter(B, A, u) + lfilter(*shape, noise * e)
    return iddata(y[before:], u[before:])


def test_derivatives_are_those_of_the_errors() -> None:
    own = structure(2, 2, [2, 3], 2, 1, [1, 2], [1, 0])
    rng = np.random.default_rng(0)
    x = np.array([-0.5, 0.2, 1, 0.5, 0.3, 0.2, 0.1, 0.4, 0.1, -0.3, 0.5, -0.4, 0.2])
    stretch = PolynomialExperiment(rng.standard_normal(60), rng.standard_normal((2, 60)))
    z = np.concatenate([x, rng.standard_normal(own.states)])
    by_differences = [
        (
            errors(own, (z + d)[: own.size], (z + d)[own.size :], stretch).e
            - errors(own, (z - d)[: own.size], (z - d)[own.size :], stretch).e
        )
        / 2e-6
        for d in 1e-6 * np.eye(len(z))
    ]
    found = errors(own, x, z[own.size :], stretch)
    assert np.allclose(jacobian(own, found, stretch, own.states), by_differences, atol=1e-7)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", ["armax", "oe", "bj", "ararx"])
def test_the_optimum_is_the_one_a_general_optimiser_finds_from_the_truth(kind: str, seed: int) -> None:
    data = made(kind, 600, seed, before=50)
    own, true = {
        "armax": (structure(1, 2, 2, 2), [*A[1:], *B[1:], *C[1:]]),
        "oe": (structure(1, 0, 2, 0, 0, 2), [*B[1:], *A[1:]]),
        "bj": (structure(1, 0, 2, 2, 1, 2), [*B[1:], *C_BJ[1:], *D[1:], *A[1:]]),
        "ararx": (structure(1, 2, 2, 0, 1), [*A[1:], *B[1:], *D[1:]]),
    }[kind]
    model = pem(data, own)
    stretch = stretches(own, [data])[0]
    start = np.concatenate([true, np.zeros(own.states)])
    best = least_squares(
        lambda z: errors(own, z[: own.size], z[own.size :], stretch).e, start, xtol=1e-12, ftol=1e-14
    )  # fmt: skip
    deviations = np.array(list(model.deviations().values()))
    assert np.abs((model.values - best.x[: own.size]) / deviations).max() < 2e-3
    assert model.variance * (600 - own.size - own.states) == pytest.approx(2.0 * best.cost, rel=1e-6)
    assert np.abs((model.values - true) / deviations).max() < 4.5


@pytest.mark.parametrize("kind", ["armax", "oe", "bj"])
def test_errors_lie_within_the_covariance(kind: str) -> None:
    squares = []
    for seed in range(25):
        data = made(kind, 500, seed, before=20)
        if kind == "armax":
            model, true = armax(data, 2, 2, 2), [*A[1:], *B[1:], *C[1:]]
        elif kind == "oe":
            model, true = oe(data, 2, 2), [*B[1:], *A[1:]]
        else:
            model, true = bj(data, 2, 2, 1, 2), [*B[1:], *C_BJ[1:], *D[1:], *A[1:]]
        assert model.covariance is not None
        d = model.values - true
        squares.append(d @ np.linalg.solve(model.covariance, d) / len(d))
    assert 0.7 < np.mean(squares) < 1.5


def test_the_robust_covariance_holds_for_coloured_noise() -> None:
    white, robust = [], []
    for seed in range(40):
        u, e = np.random.default_rng(seed).standard_normal((2, 800))
        data = iddata(lfilter(B, A, u) + lfilter([1.0], [1.0, -0.95], 0.3 * e), u)
        for kind, out in (("white", white), ("robust", robust)):
            model = oe(data, 2, 2, covariance=kind)
            out.append((model.values - [*B[1:], *A[1:]]) / np.array(list(model.deviations().values())))
    assert 0.6 < np.mean(np.square(robust)) < 1.5
    assert abs(np.log(np.mean(np.square(robust), axis=0))).max() < abs(np.log(np.mean(np.square(white), axis=0))).max()


@pytest.mark.parametrize("missing", [0.0, 0.2, 0.5])
def test_a_missing_output_is_no_error_of_zero_in_the_robust_covariance(missing: float) -> None:
    """Of white noise both kinds say the same; a zero in a gap once made the robust one too sure."""
    data = made("oe", 4000, seed=1)
    gone = np.random.default_rng(2).random(data.n) < missing
    data = iddata(np.where(gone, np.nan, data.y[:, 0]), data.u)
    robust, white = (oe(data, 2, 2, covariance=kind).covariance for kind in ("robust", "white"))
    assert robust is not None and white is not None
    assert np.sqrt(np.diag(robust) / np.diag(white)) == pytest.approx(np.ones(4), abs=0.06)


def test_missing_outputs() -> None:
    data = made("oe", 2000, before=30)
    y = data.y.copy()
    y[np.random.default_rng(1).random(2000) < 0.3] = np.nan
    model = oe(iddata(y, data.u), 2, 2)
    assert np.abs((model.values - [*B[1:], *A[1:]]) / np.array(list(model.deviations().values()))).max() < 4.0
    data = made("armax", 2000, before=30)
    y = data.y.copy()
    y[[400, 401, 900, 905, 1500]] = np.nan
    model = armax(iddata(y, data.u), 2, 2, 2)
    assert np.abs((model.values - [*A[1:], *B[1:], *C[1:]]) / np.array(list(model.deviations().values()))).max() < 4.0
    left = prediction_errors(model, iddata(y, data.u))
    assert np.isnan(left[400]) and np.isfinite(left[402]) and np.nanstd(left) == pytest.approx(0.5, abs=0.03)


def test_several_experiments_have_their_own_initial_states() -> None:
    data = [made("oe", 60, seed, noise=0.0, before=10) for seed in range(3)]
    model = oe(data, 2, 2)
    assert np.allclose(model.values, [*B[1:], *A[1:]], atol=1e-8)
    assert np.abs(simulate(model, data[1]) - data[1].y).max() < 1e-6
    zero = oe(data, 2, 2, initial="zero")
    assert np.abs(zero.values - model.values).max() > 1e-3


def test_filters_and_states_predict_alike() -> None:
    data = made("bj", 300, before=40)
    model = bj(data, 2, 2, 1, 2)
    assert orders_of(model) == structure(1, 0, 2, 2, 1, 2)
    zero = prediction_errors(model, data, initial="zero")
    assert np.allclose(zero, prediction_error(model, data, x0="zero")[:, 0], atol=1e-9)
    assert np.sum(prediction_errors(model, data) ** 2) <= np.sum(prediction_error(model, data) ** 2) + 1e-9


def test_two_inputs_with_their_own_delays() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1500, 2))
    clean = lfilter([0.0, 0.0, 0.0, 1.0], [1.0, -0.8], u[:, 0]) + lfilter([0.5, 0.2], [1.0, 0.3, 0.4], u[:, 1])
    data = iddata(clean + 0.1 * rng.standard_normal(1500), u, inputs=("valve", "pump"))
    model = oe(data, [1, 2], [1, 2], [3, 0])
    assert model.names == ("b3(1)", "b0(2)", "b1(2)", "f1(1)", "f1(2)", "f2(2)")
    assert np.allclose(model.values, [1.0, 0.5, 0.2, -0.8, 0.3, 0.4], atol=0.03)


def test_too_high_an_order_is_said() -> None:
    with pytest.warns(IdentificationWarning, match="order too high"):
        oe(made("oe", 1000, 1), 3, 3)


def test_an_unstable_system_as_output_error_is_said() -> None:
    rng = np.random.default_rng(0)
    r, e = rng.standard_normal((2, 400))
    y, u = np.zeros(400), np.zeros(400)
    for t in range(1, 400):
        y[t] = 1.1 * y[t - 1] + u[t - 1] + 0.1 * e[t]
        u[t] = r[t] - 0.5 * y[t]
    with pytest.warns(IdentificationWarning) as said:
        oe(iddata(y, u), 1, 1)
    assert any("looks unstable (a pole of magnitude 1.1" in str(one.message) for one in said)


def test_the_loop_is_seen_and_a_full_noise_model_is_right_in_it() -> None:
    rng = np.random.default_rng(0)
    r, e = rng.standard_normal((2, 2000))
    y, u = np.zeros(2000), np.zeros(2000)
    for t in range(1, 2000):
        y[t] = 0.9 * y[t - 1] + u[t - 1] + e[t] - 0.5 * e[t - 1]
        u[t] = r[t] - 0.4 * y[t]
    with pytest.warns(IdentificationWarning, match="feedback suspected"):
        model = armax(iddata(y, u), 1, 1, 1)
    assert np.abs((model.values - [-0.9, 1.0, -0.5]) / np.array(list(model.deviations().values()))).max() < 3.5


def test_roots_are_mirrored() -> None:
    out = reflected(np.array([1.0, -2.5, 1.0, 0.0]))
    assert radius(out) == pytest.approx(0.5, abs=1e-6) and len(out) == 4
    assert radius(reflected(np.array([1.0, -1.0]))) < 1.0
    assert radius(np.array([1.0, -1.8, 0.97])) == pytest.approx(np.abs(np.roots([1.0, -1.8, 0.97])).max())


def test_a_start_is_taken_or_refused() -> None:
    data = made("armax", 800)
    first = armax(data, 2, 2, 2)
    assert np.allclose(armax(data, 2, 2, 2, start=first).values, first.values, atol=1e-5)
    with pytest.raises(ValueError, match="the start has 2 coefficients, the model 6"):
        armax(data, 2, 2, 2, start=[0.0, 1.0])


def with_gaps(data: Data, share: float, seed: int) -> Data:
    y = data.y.copy()
    y[np.random.default_rng(seed).random(data.n) < share] = np.nan
    return iddata(y, data.u)


def test_scattered_gaps_do_not_bias_the_noise_model() -> None:
    found = [armax(with_gaps(made("armax", 1500, seed, before=30), 0.2, seed), 2, 2, 2) for seed in range(6)]
    misses = np.array([(one.values - [*A[1:], *B[1:], *C[1:]]) / list(one.deviations().values()) for one in found])
    # cut at the gaps, c1 = -1 came out at -1.3 with an error of 0.02 claimed
    assert np.abs(misses.mean(axis=0)).max() * np.sqrt(6.0) < 3.5
    assert 0.6 < np.mean(misses**2) < 1.6


def test_many_short_experiments_do_not_bias_the_noise_model() -> None:
    model = armax([made("armax", 25, seed, before=30) for seed in range(200)], 2, 2, 2)
    assert np.abs((model.values - [*A[1:], *B[1:], *C[1:]]) / list(model.deviations().values())).max() < 3.5
    assert model.deviations()["c1"] < 0.02


def test_the_start_at_rest_reaches_through_gaps() -> None:
    data = with_gaps(made("armax", 800, 3), 0.1, 3)
    model = armax(data, 2, 2, 2, initial="zero")
    assert np.abs((model.values - [*A[1:], *B[1:], *C[1:]]) / list(model.deviations().values())).max() < 4.0


@pytest.mark.proof
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("share", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("kind", ["armax", "bj", "ararx"])
def test_standard_errors_are_the_spread_of_many_estimates(kind: str, share: float) -> None:
    own, true = {
        "armax": (structure(1, 2, 2, 2), [*A[1:], *B[1:], *C[1:]]),
        "bj": (structure(1, 0, 2, 1, 1, 2), [*B[1:], 0.6, -0.8, *A[1:]]),
        "ararx": (structure(1, 2, 2, 0, 1), [*A[1:], *B[1:], *D[1:]]),
    }[kind]
    values, claimed = [], []
    for seed in range(1000):
        u, e = np.random.default_rng(seed).standard_normal((2, 830))
        noise = {"armax": (C, A), "bj": ([1.0, 0.6], [1.0, -0.8]), "ararx": ([1.0], np.convolve(A, D))}[kind]
        y = lfilter(B, A, u) + lfilter(*noise, 0.5 * e)
        model = pem(with_gaps(iddata(y[30:], u[30:]), share, seed), own)
        values.append(model.values)
        claimed.append(np.square(list(model.deviations().values())))
    spread = np.std(values, axis=0)
    ratio = np.sqrt(np.mean(claimed, axis=0)) / spread
    assert (np.abs(ratio - 1.0) < 0.1).all(), ratio
    assert (np.abs(np.mean(values, axis=0) - true) < 0.25 * spread).all()
