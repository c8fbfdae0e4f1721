"""On-line ARX: it equals least squares, follows a change, keeps its covariance bounded, bridges missing samples."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.data import iddata
from hoopd.ident.polynomial.recursive import RecursiveArx
from hoopd.ident.polynomial.regression import regressors


def signals(n: int, seed: int = 0, a: float = -0.8, b: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    return u, lfilter([0.0, 0.0, b], [1.0, a], u) + lfilter([1.0], [1.0, a], 0.1 * e)


def test_without_forgetting_it_is_least_squares() -> None:
    u, y = signals(300)
    own = RecursiveArx(2, [2], 1, forgetting=1.0, p0=1e9)
    errors = [own.update(one, float(v)) for one, v in zip(y, u, strict=True)]
    padded = iddata(np.concatenate([np.zeros(2), y]), np.concatenate([np.zeros(2), u]))
    a, b = regressors(padded, 2, 2, 1)
    assert np.allclose(own.coefficients, np.linalg.lstsq(a, b, rcond=None)[0], atol=1e-7)
    assert np.allclose(own.p, np.linalg.inv(a.T @ a), rtol=1e-4, atol=1e-9)
    assert errors[0] == y[0]


def test_forgetting_weighs_the_past_down() -> None:
    u, y = signals(400)
    own = RecursiveArx(1, 1, 2, forgetting=0.95, p0=1e9)
    for one, v in zip(y, u, strict=True):
        own.update(one, float(v))
    a, b = regressors(iddata(np.concatenate([np.zeros(2), y]), np.concatenate([np.zeros(2), u])), 1, 1, 2)
    w = 0.95 ** (np.arange(len(b))[::-1] / 2.0)
    assert np.allclose(own.coefficients, np.linalg.lstsq(a * w[:, None], b * w, rcond=None)[0], atol=1e-6)


def test_it_follows_a_change() -> None:
    own = RecursiveArx(1, [1], [2], forgetting=0.98)
    for seed, b in ((0, 1.0), (1, 2.0)):
        for v, one in zip(*signals(500, seed, b=b), strict=True):
            own.update(one, float(v))
        assert np.allclose(own.coefficients, [-0.8, b], atol=0.1)


def test_nothing_happens_while_nothing_happens() -> None:
    own = RecursiveArx(1, 1, 2, forgetting=0.95, dead_zone=1e-6, trace_bound=50.0)
    for v, one in zip(*signals(300), strict=True):
        own.update(one, float(v))
    for _ in range(10):
        own.update(0.0, 0.0)
    theta, p = own.coefficients.copy(), own.p.copy()
    for _ in range(2000):
        own.update(0.0, 0.0)
    assert np.array_equal(own.coefficients, theta) and np.array_equal(own.p, p)


def test_the_trace_is_bounded_while_one_direction_only_is_seen() -> None:
    bound, free = (RecursiveArx(1, 1, 2, forgetting=0.95, p0=10.0, trace_bound=b) for b in (50.0, np.inf))
    for own in (bound, free):
        for _ in range(500):
            own.update(1.0, 1.0)
    assert 25.0 < np.trace(bound.p) <= 50.0 + 1e-9 < 1e6 < np.trace(free.p)


def test_a_reset_makes_it_quick_again() -> None:
    own = RecursiveArx(1, 1, 2, forgetting=1.0)
    for v, one in zip(*signals(2000), strict=True):
        own.update(one, float(v))
    own.reset()
    assert np.array_equal(own.p, own.p0 * np.eye(2))
    for v, one in zip(*signals(60, 1, b=3.0), strict=True):
        own.update(one, float(v))
    assert own.coefficients[1] == pytest.approx(3.0, abs=0.3)


def test_missing_samples_are_bridged() -> None:
    u, y = signals(600)
    y[100:110] = np.nan
    own = RecursiveArx(1, 1, 2, forgetting=1.0)
    for one, v in zip(y, u, strict=True):
        before = own.coefficients.copy()
        expected = own.predict(float(v))
        error = own.update(one, float(v))
        assert np.isnan(error) == np.isnan(one)
        if np.isnan(one):
            assert np.array_equal(before, own.coefficients)
        else:
            assert error == pytest.approx(one - expected, abs=1e-12)
    assert own.samples == 590
    assert np.allclose(own.coefficients, [-0.8, 1.0], atol=0.05)


def test_two_inputs_and_the_model_of_the_moment() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((300, 2))
    y = lfilter([0.0, 0.0, 1.0], [1.0, -0.5], u[:, 0]) + lfilter([0.3], [1.0, -0.5], u[:, 1])
    own = RecursiveArx(1, [1, 1], [2, 0], forgetting=1.0, p0=1e8)
    for one, v in zip(y, u, strict=True):
        own.update(one, v)
    model = own.model(0.1, variance=0.01)
    assert model.names == ("a1", "b2(1)", "b0(2)")
    assert np.allclose(model.values, [-0.5, 1.0, 0.3], atol=1e-6)
    with pytest.raises(ValueError, match="1 inputs given, the model has 2"):
        own.update(0.0, 1.0)


def test_wrong_settings() -> None:
    for call, said in (
        (lambda: RecursiveArx(0, 0), "at least one coefficient"),
        (lambda: RecursiveArx(1, 1, forgetting=0.0), "forgetting"),
        (lambda: RecursiveArx(1, 1, dead_zone=1.0), "dead_zone"),
        (lambda: RecursiveArx(1, 1, start=[1.0]), "start has 1"),
    ):
        with pytest.raises(ValueError, match=said):
            call()


def test_it_imports_numpy_only() -> None:
    code = (
        "import sys, hoopd.ident.polynomial.recursive as r; r.RecursiveArx(1, 1).update(1.0, 1.0);"
        "sys.exit(any(name in sys.modules for name in ('scipy', 'control', 'casadi', 'matplotlib')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
