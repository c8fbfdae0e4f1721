"""Signals without inputs: AR, ARMA by three ways, and the noise that drove them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.polynomial.ar import ar, arma, arma_ssa, driving_noise, reconstructed

A, C = np.array([1.0, -1.2, 0.6]), np.array([1.0, 0.5])


def made(n: int, seed: int = 0, c: np.ndarray = C, measurement: float = 0.0) -> Data:
    e, v = np.random.default_rng(seed).standard_normal((2, n))
    return iddata(lfilter(c, A, e) + measurement * v)


def test_ar_is_exact_without_noise_and_its_noise_is_rebuilt() -> None:
    e = np.zeros(60)
    e[0] = 2.0
    data = iddata(lfilter([1.0], A, e))
    model = ar(data, 2)
    assert np.allclose(model.values, A[1:], rtol=1e-9)
    assert np.allclose(driving_noise(model, data), e, atol=1e-9)


def test_inputs_are_left_aside() -> None:
    data = made(500)
    both = iddata(data.y, np.random.default_rng(9).standard_normal(500))
    assert np.array_equal(ar(both, 2).values, ar(data, 2).values)
    assert ar(both, 2).b == ()


@pytest.mark.parametrize("method", ["pem", "two-stage"])
def test_arma(method: str) -> None:
    models = [arma(made(2000, seed), 2, 1, method=method) for seed in range(8)]
    assert np.allclose(np.mean([one.values for one in models], axis=0), [-1.2, 0.6, 0.5], atol=0.03)
    assert np.mean([one.variance for one in models]) == pytest.approx(1.0, abs=0.05)
    assert (models[0].covariance is not None) == (method == "pem")
    e = np.random.default_rng(0).standard_normal((2, 2000))[0]
    assert np.mean((driving_noise(models[0], made(2000)) - e)[50:] ** 2) < 0.01


def test_holes_leave_arma_alone() -> None:
    data = made(3000)
    y = data.y.copy()
    y[[500, 1200, 1201, 2500]] = np.nan
    for method in ("pem", "two-stage"):
        assert np.allclose(arma(iddata(y), 2, 1, method=method).values, [-1.2, 0.6, 0.5], atol=0.12)


def test_singular_spectra_keep_what_is_strong() -> None:
    y = made(700).y[:, 0]
    assert np.allclose(reconstructed(y, 60, 1.0), y, atol=1e-10)
    # against the definition: projection of the trajectory matrix, mean of its antidiagonals
    trajectory = np.lib.stride_tricks.sliding_window_view(y, 60)
    vectors = np.linalg.svd(trajectory, full_matrices=False)[2][:45]
    projected = trajectory @ vectors.T @ vectors
    means = [np.mean(np.fliplr(projected).diagonal(k)) for k in range(59, -len(projected), -1)]
    assert np.allclose(reconstructed(y, 60, 0.75), means, atol=1e-9)


def test_arma_by_singular_spectra() -> None:
    models = [arma_ssa(made(1000, seed), 2, 1, window=200) for seed in range(3)]
    assert np.allclose(np.mean([one.values for one in models], axis=0), [-1.2, 0.6, 0.5], atol=0.15)
    with pytest.raises(ValueError, match="window"):
        arma_ssa(made(100), 2, 1, window=80)


def test_outliers_are_told_from_the_signal_where_that_is_asked() -> None:
    rng = np.random.default_rng(0)
    e, v = rng.standard_normal((2, 1000))
    y = lfilter([1.0], [1.0, -1.8, 0.9], e) + 0.5 * v
    y[rng.choice(1000, 20, replace=False)] += 40.0
    plain, robust = (arma_ssa(iddata(y), 2, 1, window=60, robust=one) for one in (False, True))
    assert np.abs(np.abs(np.roots(robust.a)) - 0.95).max() < 0.03
    assert np.abs(np.abs(np.roots(plain.a)) - 0.95).max() > 0.1
