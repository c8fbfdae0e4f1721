"""Subspaces in a closed loop: where the usual ones are biased, the predictor's states are not."""

from __future__ import annotations

import tracemalloc
import warnings

import numpy as np
import pytest

from hoopd.ident.conditioning import concatenate
from hoopd.ident.data import Data, iddata
from hoopd.ident.statespace.pbsid import pbsid
from hoopd.ident.statespace.subspace import subspaceid


def looped(seed: int, n: int = 10_000, pole: float = 0.9) -> Data:
    r, e = np.random.default_rng(seed).standard_normal((2, n))
    x, u, y = 0.0, np.zeros(n), np.zeros(n)
    for k in range(n):
        y[k] = x + e[k]
        u[k] = r[k] - 0.5 * y[k - 1]
        x = pole * x + u[k] + 0.3 * e[k]
    return iddata(y, u)


def test_a_loop_does_not_bias_it() -> None:
    found, usual = [], []
    for seed in range(4):
        data = looped(seed)
        found.append(pbsid(data, 1).a[0, 0])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            usual.append(subspaceid(data, 1, direct=False).a[0, 0])
    assert abs(np.mean(found) - 0.9) < 0.01
    assert abs(np.mean(usual) - 0.9) > 0.02


def test_an_unstable_plant_in_a_loop_gaps_and_experiments() -> None:
    data = looped(5, pole=1.1)
    y = data.y.copy()
    y[[2000, 2001, 5000]] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert pbsid(iddata(y, data.u), 1).a[0, 0] == pytest.approx(1.1, abs=0.02)
        assert pbsid([data[:5000], data[5000:]], 1).a[0, 0] == pytest.approx(1.1, abs=0.02)


def test_orders_that_do_not_fit_are_refused() -> None:
    data = looped(0, 200)
    with pytest.raises(ValueError, match="does not fit"):
        pbsid(data, 3, past=2)
    with pytest.raises(ValueError, match="too few"):
        pbsid(data, 1, past=60)


def test_memory_is_a_handful_of_numbers_a_sample() -> None:
    peaks = []
    for data in (short := looped(6, 20_000), concatenate(*[short] * 4)):
        pbsid(data, 1)  # modules are loaded
        tracemalloc.start()
        pbsid(data, 1)
        peaks.append(tracemalloc.get_traced_memory()[1] / data.n)
        tracemalloc.stop()
    # a handful of numbers a sample, where a row of the long past would be twenty
    assert max(peaks) < 8 * 20
