"""ARARX: both methods find the least of the two minima, with a prior the one it leads to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.polynomial.ararx import ararx, innovations
from hoopd.ident.polynomial.pem import pem
from hoopd.ident.polynomial.structure import structure


def made(a: float, d: float, noise: float, n: int = 500, seed: int = 0) -> tuple[Data, np.ndarray]:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    e = noise * e
    return iddata(lfilter([0.0, 1.0], [1.0, a], u) + lfilter([1.0], np.convolve([1.0, a], [1.0, d]), e), u), e


@pytest.mark.parametrize("method", ["pem", "gls"])
@pytest.mark.parametrize("seed", range(4))
def test_the_systems_of_soderstrom(method: str, seed: int) -> None:
    for a, d, noise in ((0.8, 0.7, 1.0), (0.7, 0.9, 1.2**0.5), (-0.9, -0.9, 1.0)):
        data, e = made(a, d, noise, seed=seed)
        model = ararx(data, 1, 1, 1, method=method)
        assert np.allclose(model.values, [a, 1.0, d], atol=0.2)
        assert np.mean((innovations(model, data) - e)[2:] ** 2) < 0.1


def test_no_start_ends_lower() -> None:
    own = structure(1, 1, 1, 0, 1)
    for seed in range(6):
        data, _ = made(-0.7, 0.9, 3.0, n=120, seed=seed)
        least = min(pem(data, own, start=[a, 1.0, d]).variance for a in (-0.9, 0.0, 0.9) for d in (-0.9, 0.0, 0.9))
        assert ararx(data, 1, 1, 1).variance <= least * (1.0 + 1e-6)


def test_a_prior_leads() -> None:
    data, _ = made(0.5, 0.5, 5.0, n=2000)
    for method in ("pem", "gls"):
        assert np.allclose(ararx(data, 1, 1, 1, method=method, prior=[1.0, 0.4]).values, [0.5, 1.0, 0.5], atol=0.35)
    with pytest.raises(ValueError, match="prior"):
        ararx(data, 1, 1, 1, prior=[2.0, 1.0])


def test_two_inputs_a_delay_and_two_experiments() -> None:
    def one(seed: int) -> Data:
        rng = np.random.default_rng(seed)
        u, e = rng.standard_normal((800, 2)), rng.standard_normal(800)
        right = lfilter([0.0, 0.0, 1.0], [1.0], u[:, 0]) + 0.5 * u[:, 1] + lfilter([1.0], [1.0, 0.7], 0.2 * e)
        return iddata(lfilter([1.0], [1.0, -0.8], right), u)

    for method in ("pem", "gls"):
        model = ararx([one(0), one(1)], 1, [1, 1], 1, [2, 0], method=method)
        assert np.allclose(model.values, [-0.8, 1.0, 0.5, 0.7], atol=0.06)


def test_missing_outputs_want_the_search() -> None:
    data, _ = made(-0.8, 0.7, 0.5, n=1500)
    y = data.y.copy()
    y[[200, 900]] = np.nan
    assert np.allclose(ararx(iddata(y, data.u), 1, 1, 1).values, [-0.8, 1.0, 0.7], atol=0.12)
    with pytest.raises(ValueError, match="pem"):
        ararx(iddata(y, data.u), 1, 1, 1, method="gls")
