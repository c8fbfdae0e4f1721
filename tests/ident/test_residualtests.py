"""Figures of merit and tests of residuals: their laws under the truth, and that they see what is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.measures import compare, criteria, fit_percent, mse, nrmse, parameters_of, rms, sse
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


def test_fit_is_100_on_itself_and_0_on_the_mean() -> None:
    y = np.random.default_rng(0).standard_normal((50, 2))
    assert fit_percent(y, y) == pytest.approx([100.0, 100.0])
    assert fit_percent(y, np.tile(y.mean(axis=0), (50, 1))) == pytest.approx([0.0, 0.0])
    y[3, 1] = np.nan
    assert np.isfinite(fit_percent(y, np.zeros((50, 2)))).all() and nrmse(y[:, 0], y[:, 0]) == pytest.approx([0.0])
    assert np.isnan(fit_percent(np.ones(5), np.zeros(5))).all()
    with pytest.raises(ValueError, match="measured is"):
        fit_percent(np.ones(5), np.ones(4))


def test_sums_of_errors() -> None:
    e = np.array([3.0, -4.0, np.nan])
    assert (sse(e)[0], mse(e)[0], rms(e)[0]) == pytest.approx((25.0, 12.5, np.sqrt(12.5)))


def test_criteria_do_not_depend_on_how_the_errors_lie_in_memory() -> None:
    # n = 100, unit mean square: log det = 0
    e = np.tile([1.0, -1.0], 50)
    one = criteria(e, 4)
    assert (one.n, one.aic, one.bic) == (100, pytest.approx(8.0), pytest.approx(4 * np.log(100)))
    assert one.aicc == pytest.approx(8.0 + 2 * 4 * 5 / 95) and one.fpe == pytest.approx(1.04 / 0.96)
    # two outputs: the determinant of the MEAN outer product
    both = criteria(np.column_stack([e, np.roll(e, 1) * np.repeat([1.0, -1.0], 50)]), 4)
    assert both.fpe == pytest.approx(1.04 / 0.96, rel=1e-3)
    with pytest.raises(ValueError, match="nothing is left"):
        criteria(e[:5], 4)


def test_the_final_prediction_error_is_what_new_data_show() -> None:
    # FPE of a linear regression with d parameters is unbiased for the error on new data
    n, d, ratio = 60, 10, []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        x, y, x2, y2 = rng.standard_normal((n, d)), rng.standard_normal(n), *_more(rng, d)
        theta = np.linalg.lstsq(x, y, rcond=None)[0]
        ratio.append((criteria(y - x @ theta, d).fpe, float(np.mean((y2 - x2 @ theta) ** 2))))
    said, seen = np.mean(ratio, axis=0)
    assert said == pytest.approx(seen, rel=0.05)


def _more(rng: np.random.Generator, d: int) -> tuple[np.ndarray, np.ndarray]:
    return rng.standard_normal((400, d)), rng.standard_normal(400)


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


def test_models_side_by_side() -> None:
    data = made(5)
    found = compare({"true": TRUE, "static": Polynomials(1.0, b=(np.array([0.0, 1.0]),))}, data)
    true, static = found
    assert true.percent[1][0] > 80.0 > static.percent[1][0]
    assert true.percent[1][0] > true.percent[10][0] >= true.percent[np.inf][0] - 1.0
    assert true.criteria is not None and static.criteria is not None and true.criteria.bic < static.criteria.bic
    assert parameters_of(TRUE) == 4 and parameters_of(Polynomials(1.0, a=A, b=(B,))) == 4
