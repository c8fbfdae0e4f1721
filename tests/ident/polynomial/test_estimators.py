"""Estimators that solve A x = y: against their definitions, and against what least squares gets wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter, sosfiltfilt

from hoopd.ident.data import Data, iddata
from hoopd.ident.polynomial.arx import arx
from hoopd.ident.polynomial.estimators import (
    band,
    frequency_weighted,
    least_squares,
    output_noise,
    robust,
    total_least_squares,
    weighted_total_least_squares,
)
from hoopd.ident.polynomial.regression import regressors


def noisy(n: int, seed: int = 0, sigma: float = 1.0) -> Data:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    return iddata(lfilter([0.0, 0.8], [1.0, -0.9], u) + sigma * e, u)


def test_exact_equations_are_solved_by_all() -> None:
    rng = np.random.default_rng(0)
    a, x = rng.standard_normal((200, 3)), np.array([1.0, -2.0, 0.5])
    for solve in (
        least_squares, total_least_squares, weighted_total_least_squares([1.0, 0.0, 0.0, 1.0]), robust(),
        robust("tukey"), frequency_weighted(0.1, 0.3),
    ):  # fmt: skip
        assert np.allclose(solve(a, a @ x), x, rtol=1e-8)


def test_total_least_squares_minimises_what_it_says() -> None:
    rng = np.random.default_rng(1)
    a = rng.standard_normal((100, 3))
    y, noise = a @ [1.0, -2.0, 0.5] + 0.3 * rng.standard_normal(100), np.array([0.5, 0.0, 1.0, 0.3])
    w = rng.uniform(0.5, 2.0, 100)

    def cost(x: np.ndarray) -> float:
        v = np.append(x, -1.0)
        return float(np.sum((w * (np.column_stack([a, y]) @ v)) ** 2) / np.sum((noise * v) ** 2))

    x = weighted_total_least_squares(noise, w)(a, y)
    assert np.allclose(x, minimize(cost, x + 0.05, tol=1e-12).x, atol=1e-5)
    even = weighted_total_least_squares(np.ones(4))(a, y)
    assert np.allclose(even, total_least_squares(a, y), rtol=1e-9)
    with pytest.raises(ValueError, match="at least one positive"):
        weighted_total_least_squares([0.0, 0.0])
    with pytest.raises(ValueError, match="noise has 2 numbers"):
        weighted_total_least_squares([1.0, 1.0])(a, y)


def test_noise_on_the_output_biases_least_squares_and_not_the_weighted_total_one() -> None:
    plain = np.mean([arx(noisy(2000, seed), 1, 1).values for seed in range(6)], axis=0)
    total = np.mean(
        [arx(noisy(2000, seed), 1, 1, estimator=weighted_total_least_squares(output_noise(1, 1))).values
         for seed in range(6)], axis=0,
    )  # fmt: skip
    assert plain[0] > -0.8
    assert np.allclose(total, [-0.9, 0.8], atol=0.03)


def test_frequency_weights_are_a_toeplitz_matrix() -> None:
    rng = np.random.default_rng(2)
    a, y = rng.standard_normal((300, 2)), rng.standard_normal(300)
    w = sosfiltfilt(band(0.1, 0.2, 1.0), np.eye(300), axis=0)
    assert np.allclose(frequency_weighted(0.1, 0.2)(a, y), least_squares(w @ a, w @ y), rtol=1e-8)
    inner = w[100:200, 100:200]
    assert np.allclose(inner, inner.T, atol=1e-6) and np.ptp(np.diag(inner)) < 1e-6


@pytest.mark.parametrize("loss", ["huber", "tukey"])
def test_outliers_do_little(loss: str) -> None:
    rng = np.random.default_rng(3)
    a = rng.standard_normal((400, 2))
    y = a @ [1.0, -1.0] + 0.1 * rng.standard_normal(400)
    y[:40] += 20.0 * a[:40, 0]
    assert np.abs(robust(loss)(a, y) - [1.0, -1.0]).max() < 0.1 < np.abs(least_squares(a, y) - [1.0, -1.0]).max()


def test_bands() -> None:
    assert band(0.0, 1.0, 0.1).shape == (1, 6) and band(1.0, np.inf, 0.1).shape == (1, 6)
    for low, high in ((0.0, np.inf), (2.0, 1.0), (6.0, 7.0)):
        with pytest.raises(ValueError, match="no band"):
            band(low, high, 0.1)


def test_a_fit_in_a_band() -> None:
    data = noisy(2000)
    a, y = regressors(data, 1, 1)
    model = arx(data, 1, 1, focus_hz=(0.01, 0.1))
    assert np.allclose(model.values, frequency_weighted(0.01, 0.1, order=1)(a, y), atol=0.1)
