"""Tests of residuals: their laws under the truth, and that they see what is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Polynomials
from hoopd.ident.residualtests import correlation, independence, residuals, whiteness

A, B = np.array([1.0, -1.5, 0.7]), np.array([0.0, 1.0, 0.5])
TRUE = Polynomials(1.0, a=A, b=(B,), names=("a1", "a2", "b1", "b2"), values=np.zeros(4))


def made(seed: int, n: int = 600, feedback: float = 0.0) -> Data:
    rng = np.random.default_rng(seed)
    e, r = 0.5 * rng.standard_normal(n), lfilter([1.0], [1.0, -0.8], rng.standard_normal(n))
    y, u = np.zeros(n), np.zeros(n)
    for k in range(n):
        past = [y[k - i] if k >= i else 0.0 for i in (1, 2)]
        old = [u[k - i] if k >= i else 0.0 for i in (1, 2)]
        y[k] = 1.5 * past[0] - 0.7 * past[1] + old[0] + 0.5 * old[1] + e[k]
        u[k] = r[k] - feedback * y[k]
    return iddata(y, u)


def test_whiteness_fails_white_noise_as_seldom_as_it_says() -> None:
    chances = np.array([whiteness(np.random.default_rng(s).standard_normal(500)).chance for s in range(400)])
    assert 0.005 <= np.mean(chances < 0.05) <= 0.09
    coloured = lfilter([1.0], [1.0, -0.3], np.random.default_rng(1).standard_normal(500))
    assert not whiteness(coloured).passed


def test_independence_fails_independent_signals_as_seldom_as_it_says() -> None:
    # both coloured: a band for white signals would be far too narrow
    chances = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        e, u = (lfilter([1.0], [1.0, -0.9], rng.standard_normal(900))[100:] for _ in range(2))
        chances.append(independence(e, u).chance)
    assert np.mean(np.array(chances) < 0.05) <= 0.12


@pytest.mark.parametrize("seed", range(3))
def test_the_true_model_passes_and_a_wrong_delay_does_not(seed: int) -> None:
    data = made(seed)
    good = residuals(TRUE, data)
    assert not good.warnings, good.warnings
    late = residuals(Polynomials(1.0, a=A, b=(np.array([0.0, 0.0, 1.0, 0.5]),)), data)
    assert any("follows the input" in one for one in late.warnings)
    slow = residuals(Polynomials(1.0, a=np.array([1.0, -0.9]), b=(B,)), data)
    assert any("not white" in one for one in slow.warnings)


def test_a_closed_loop_is_seen_at_negative_lags() -> None:
    assert any("closed loop" in one for one in residuals(TRUE, made(0, 4000, feedback=0.3)).warnings)
    assert not any("closed loop" in one for one in residuals(TRUE, made(0, 4000)).warnings)


def test_correlation_finds_a_delay_and_skips_what_is_missing() -> None:
    x = np.random.default_rng(3).standard_normal(400)
    y = np.concatenate([np.zeros(7), x[:-7]])
    y[50:60] = np.nan
    assert int(np.argmax(correlation(x, y, 20))) - 20 == 7
    assert np.all(correlation(np.ones(50), np.ones(50), 3) == 0.0)
