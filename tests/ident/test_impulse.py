"""Impulse responses from data: plain, weighted, and with priors tuned to the data."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest
from samples import sampled
from scipy import signal

from hoopd.ident import kernels
from hoopd.ident.data import Data, iddata
from hoopd.ident.impulse import _triangle, impulseest
from hoopd.ident.prediction import simulate

DT = 0.1
TAPS = signal.lfilter([0.0, 0.5, 0.2], [1.0, -1.5, 0.7], np.eye(1, 120)[0])
OTHER = signal.lfilter([1.0], [1.0, -0.6], np.eye(1, 120)[0])


def made(seed: int, n: int = 1000, noise: float = 0.5, cut: float | None = None) -> Data:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, 2))
    if cut:
        u = signal.sosfilt(signal.butter(4, cut, output="sos"), u, axis=0)
    y = signal.lfilter(TAPS, 1.0, u[:, 0]) + signal.lfilter(OTHER, 1.0, u[:, 1])
    return iddata(y + noise * np.std(y) * rng.standard_normal(n), u, DT, inputs=["a", "b"])


def error(found: np.ndarray) -> float:
    n = len(found)
    true = np.column_stack([TAPS[:n], OTHER[:n]]) / DT
    return float(np.linalg.norm(found[:, 0] - true) / np.linalg.norm(true))


def test_the_response_is_that_of_the_continuous_system() -> None:
    plant = ct.TransferFunction([2.0], [1.0, 1.0, 4.0])
    u = np.random.default_rng(0).standard_normal(3000)
    t = 0.02 * np.arange(3000)
    y = ct.forced_response(ct.c2d(plant, 0.02), T=t, U=u).outputs
    found = impulseest(iddata(y, u, 0.02), 600)
    true = ct.impulse_response(plant, T=found.t).outputs
    assert np.abs(found.g[:, 0, 0] - true).max() < 0.03 and found.g[0, 0, 0] == pytest.approx(0.0, abs=1e-3)
    assert found.step()[-1, 0, 0] == pytest.approx(0.5, abs=0.01)


def test_errors_are_as_large_as_the_covariance_says() -> None:
    misses = []
    for seed in range(20):
        found = impulseest(made(seed), 60)
        true = np.column_stack([TAPS[:60], OTHER[:60]]) / DT
        misses.append(((found.g[:, 0] - true) / found.deviation[:, 0]).reshape(-1))
    assert np.std(misses) == pytest.approx(1.0, abs=0.06)
    assert np.mean(np.abs(misses) < 1.96) == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize("prior", sampled(["tc", "dc", "ss"], ["tc"]))
def test_a_prior_beats_least_squares_and_knows_its_error(prior: str) -> None:
    better, misses = [], []
    for seed in range(4):
        data = made(seed, n=400, cut=0.6)
        found = impulseest(data, 80, prior)  # type: ignore[arg-type]
        better.append(error(found.g) / error(impulseest(data, 80).g))
        true = np.column_stack([TAPS[:80], OTHER[:80]]) / DT
        misses.append(((found.g[:, 0] - true) / found.deviation[:, 0])[:15].reshape(-1))
    assert max(better) < 0.1 and np.mean(np.abs(misses) < 1.96) > 0.8
    assert set(found.priors[0].values) >= {"size1", "decay2"}


@pytest.mark.parametrize("prior", list(kernels.KERNELS))
def test_the_gradient_of_the_likelihood(prior: str) -> None:
    lags = np.arange(12)
    problem = kernels._Problem(_triangle([made(1, 200)], 0, lags), 2, lags, kernels.KERNELS[prior])
    x = problem.starts()[-1] + 0.01
    gradient = problem.cost(x)[1]
    for i in range(len(x)):
        step = 1e-5 * np.eye(len(x))[i]
        assert (problem.cost(x + step)[0] - problem.cost(x - step)[0]) / 2e-5 == pytest.approx(gradient[i], rel=1e-5)


def test_the_likelihood_is_that_of_all_rows() -> None:
    lags, data = np.arange(5), made(2, 60)
    given = _triangle([data], 0, lags)
    found = kernels.tuned(given, 2, lags, "tc")
    rows = np.array([data.u[t - lags].T.reshape(-1) for t in range(4, 60)])
    covariance = rows @ found.p @ rows.T + found.variance * np.eye(56)
    y = data.y[4:, 0]
    exact = -0.5 * (y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(2 * np.pi * covariance)[1])
    assert found.log_likelihood == pytest.approx(exact, rel=1e-10)


def test_experiments_gaps_and_a_weight() -> None:
    data = made(3, 2000)
    y = data.y.copy()
    y[500:520] = np.nan
    holes = iddata(y, data.u, DT)
    whole = impulseest(data, 40)
    assert error(impulseest(holes, 40).g) < 1.3 * error(whole.g)
    assert error(impulseest([data[:900], data[900:]], 40).g) < 1.3 * error(whole.g)
    weighted = impulseest(data, 40, ridge=1e4)
    assert np.linalg.norm(weighted.g) < 0.9 * np.linalg.norm(whole.g)
    assert (weighted.deviation < whole.deviation).all() and error(impulseest(data, 40, "ridge").g) < error(
        whole.g
    ) * 1.05


def test_no_direct_term_and_the_model_of_it() -> None:
    data = made(4, noise=0.0)
    found = impulseest(data, 100, direct=False)
    assert (found.g[0] == 0.0).all() and found.deviation[0].max() == 0.0
    again = impulseest(data, 100)
    said = simulate(again.model(), data, x0="zero")
    assert np.abs(said - data.y)[100:].max() < 1e-3 and again.model().inputs == ("a", "b")


def test_data_that_cannot_tell_are_refused() -> None:
    sine = np.sin(0.3 * np.arange(500))
    with pytest.raises(ValueError, match=r"do not excite 30 lags \(rank 2\)"):
        impulseest(iddata(sine, sine), 30)
    with pytest.raises(ValueError, match="fewer lags"):
        impulseest(made(0, 60), 50)
    with pytest.raises(ValueError, match="wants an input"):
        impulseest(iddata(sine))
