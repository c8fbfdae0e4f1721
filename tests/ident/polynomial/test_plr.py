"""Pseudo-linear regression: near the efficient estimate, with any estimator, with holes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.data import Data, iddata
from hoopd.ident.polynomial.estimators import robust
from hoopd.ident.polynomial.pem import armax
from hoopd.ident.polynomial.plr import plr

TRUE = [-0.9, 1.0, 0.4, 0.5]  # a1, b1(1), b0(2), c1


def made(n: int, seed: int = 0, noise: float = 0.3) -> Data:
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((n, 2)), noise * rng.standard_normal(n)
    right = lfilter([0.0, 1.0], [1.0], u[:, 0]) + 0.4 * u[:, 1] + lfilter([1.0, 0.5], [1.0], e)
    return iddata(lfilter([1.0], [1.0, -0.9], right), u)


def test_it_is_near_the_efficient_estimate() -> None:
    data = made(3000)
    found, best = plr(data, 1, [1, 1], 1, [1, 0]), armax(data, 1, [1, 1], 1, [1, 0])
    assert found.names == best.names
    assert np.allclose(found.values, best.values, atol=0.03) and np.allclose(found.values, TRUE, atol=0.06)
    assert found.variance == pytest.approx(0.09, rel=0.1) and found.covariance is None


def test_more_passes_and_several_experiments() -> None:
    model = plr([made(1000), made(1500, 1)], 1, [1, 1], 1, [1, 0], passes=5)
    assert np.allclose(model.values, TRUE, atol=0.06)


def test_holes_and_outliers() -> None:
    data = made(3000)
    y = data.y.copy()
    y[[100, 700, 701]] = np.nan
    assert np.allclose(plr(iddata(y, data.u), 1, [1, 1], 1, [1, 0], passes=3).values, TRUE, atol=0.06)
    assert np.allclose(plr(data, 1, [1, 1], 1, [1, 0], estimator=robust()).values, TRUE, atol=0.06)


def test_few_samples_stop() -> None:
    with pytest.raises(ValueError, match="too few samples"):
        plr(made(30), 1, [1, 1], 1, [1, 0])


def test_passes_that_diverge_are_told_and_do_not_count() -> None:
    u, e = np.random.default_rng(0).standard_normal((2, 2000))
    data = iddata(lfilter([0.0, 1.0], [1.0, -0.8], u) + lfilter([1.0, -1.8, 0.9], [1.0, -0.8], e), u)
    with pytest.warns(IdentificationWarning, match="does not converge: after pass 2 .* pass 1"):
        model = plr(data, 1, 1, 2, passes=20)
    assert np.allclose(model.values, plr(data, 1, 1, 2).values)
    assert model.a[1] == pytest.approx(-0.8, abs=0.05)
