"""Tests of residuals: their laws under the truth, and that they see what is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from samples import sampled
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Polynomials
from hoopd.ident.residualtests import independence, residuals, whiteness

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


def holed(rng: np.random.Generator, x: np.ndarray, share: float) -> np.ndarray:
    return np.where(rng.random(len(x)) < share, np.nan, x)


def rate(chances: list[float]) -> float:
    return float(np.mean(np.array(chances) < 0.05))


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
def test_whiteness_fails_white_noise_as_seldom_as_it_says(share: float) -> None:
    chances = []
    for seed in range(500):
        rng = np.random.default_rng(seed)
        chances.append(whiteness(holed(rng, rng.standard_normal(1000), share)).chance)
    assert 0.03 <= rate(chances) <= 0.07


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_colour_is_seen_with_half_of_the_samples_missing(share: float) -> None:
    # n r^2 (1 - share)^2 = 3000 x 0.04 x 0.25 = 30 above the 25 of chance, of which 1 in 100 reach 44
    seen = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        seen.append(not whiteness(holed(rng, lfilter([1.0], [1.0, -0.2], rng.standard_normal(3000)), share)).passed)
    assert np.mean(seen) > 0.7


def test_a_channel_read_at_every_other_sample_is_tested_at_even_lags() -> None:
    rng = np.random.default_rng(2)
    chances = []
    for _ in range(300):
        x = rng.standard_normal(600)
        x[::2] = np.nan
        chances.append(whiteness(x).chance)
    assert 0.02 <= rate(chances) <= 0.08
    with pytest.raises(ValueError, match="0 errors are known"):
        whiteness(np.full(100, np.nan))


def signals(rng: np.random.Generator, n: int) -> dict[str, np.ndarray]:
    t = np.arange(n)
    return {
        "white": rng.standard_normal(n),
        "coloured": lfilter([1.0], [1.0, -0.9], rng.standard_normal(n)),
        "steps": np.repeat(rng.standard_normal(n // 20 + 1), 20)[:n],
        "sine": np.sin(0.3 * t + 6.0 * rng.random()),
        "three sines": sum((np.sin(w * t + 6.0 * rng.random()) for w in (0.1, 0.37, 0.9)), np.zeros(n)),
    }


@pytest.mark.parametrize("name", ["white", "coloured", "steps", "sine", "three sines"])
@pytest.mark.parametrize(("colour", "share"), sampled([(0.0, 0.0), (0.9, 0.0), (0.9, 0.3)], [(0.0, 0.0), (0.9, 0.3)]))
def test_independence_fails_independent_signals_as_seldom_as_it_says(name: str, colour: float, share: float) -> None:
    chances = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        e = lfilter([1.0], [1.0, -colour], rng.standard_normal(900))[100:]
        chances.append(independence(holed(rng, e, share), signals(rng, 800)[name]).chance)
    # 3 to 7 in 100, and three standard deviations of 60 trials
    assert rate(chances) <= 0.14


@pytest.mark.parametrize("name", ["white", "coloured", "steps", "sine", "three sines"])
def test_a_neglected_lag_is_seen_whatever_the_colour_of_the_input(name: str) -> None:
    seen, false = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        u = signals(rng, 1000)[name]
        e = rng.standard_normal(1000) + 0.2 * np.concatenate([[0.0], u[:-1]]) / np.std(u)
        seen.append(not independence(e, u).passed)
        false.append(not independence(e, u, 10, after=False).passed)
    assert np.mean(seen) > 0.7 and np.mean(false) < 0.1


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


def test_no_lag_reaches_from_one_experiment_into_the_next() -> None:
    """The second experiment's errors are the first one's last inputs: 60 samples apart, were there 25 between them."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((2, 200))
    e = rng.standard_normal((2, 200))
    e[1, :35] = 20.0 * u[0, -35:]
    white = Polynomials(1.0, b=(np.zeros(2),))
    found = residuals(white, [iddata(e[i], u[i]) for i in range(2)], lags=60, x0="zero")
    assert abs(found.independent[0].values[60]) < 0.2


def test_several_experiments_are_tested_together_and_apart() -> None:
    parts = [made(seed, 300) for seed in range(3)]
    found = residuals(TRUE, parts)
    assert len(found.errors) == 900 and not found.warnings
    late = Polynomials(1.0, a=A, b=(np.array([0.0, 0.0, 1.0, 0.5]),))
    # right on the first, wrong on the others
    shifted = [parts[0], *(iddata(one.y[1:], one.u[:-1]) for one in parts[1:])]
    assert not residuals(TRUE, shifted[:1]).warnings and residuals(TRUE, shifted).warnings
    assert residuals(late, parts).independent[0].chance < 1e-6
    with pytest.raises(ValueError, match="0 errors"):
        residuals(TRUE, iddata(np.full(300, np.nan), parts[0].u), x0="zero")
    with pytest.raises(ValueError, match="predictor of the model is unstable"):
        residuals(Polynomials(1.0, b=(B,), f=(np.array([1.0, -40.0]),)), parts[0])
