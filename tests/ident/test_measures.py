"""Figures of merit: fit, errors, criteria that agree between methods, models side by side."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.information_criteria import aicc, bic, criteria, parameters_of
from hoopd.ident.measures import fit_percent, mse, nrmse, rms, sse
from hoopd.ident.model_comparison import compare, table
from hoopd.ident.models import Innovations, Polynomials
from hoopd.ident.polynomial import orders
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.subspace import subspaceid

A, B = np.array([1.0, -1.5, 0.7]), np.array([0.0, 1.0, 0.5])
TRUE = Polynomials(1.0, a=A, b=(B,), names=("a1", "a2", "b1", "b2"), values=np.zeros(4))


def made(seed: int, n: int = 600) -> Data:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    return iddata(lfilter(B, A, u) + lfilter([1.0], A, 0.5 * e), u)


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
    # Hurvich and Tsai (1989), their n (1 + m/n)/(1 - (m + 2)/n) less the terms that no model changes
    assert one.aicc == pytest.approx(100 * (1 + 0.04) / (1 - 0.06) - 100 - 2) and one.fpe == pytest.approx(1.04 / 0.96)
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


def test_there_is_one_set_of_criteria() -> None:
    assert (orders.aicc, orders.bic) == (aicc, bic)


def test_a_state_space_counts_what_its_order_has_whatever_method_gave_it() -> None:
    data = made(5, 1500)
    first, second = subspaceid(data, 2), pem(data, 2)
    assert len(second.values) == 11 and parameters_of(first) == parameters_of(second) == 6
    one, other = compare({"subspace": first, "pem": second}, data, estimation=data)
    assert one.criteria is not None and other.criteria is not None
    # the same system but for its estimator: the criteria differ by their errors alone, not by 5 log n = 37
    assert abs(one.criteria.bic - other.criteria.bic) < 4.0 and one.criteria.d == other.criteria.d
    wide = Innovations(np.eye(4), np.ones((4, 2)), np.ones((3, 4)), np.ones((3, 2)), np.ones((4, 3)), 1.0)
    assert parameters_of(wide) == 4 * (2 + 3) + 4 * 3 + 3 * 2
    simulated = Innovations(np.eye(4), np.ones((4, 2)), np.ones((3, 4)), np.zeros((3, 2)), np.zeros((4, 3)), 1.0)
    assert parameters_of(simulated) == 4 * (2 + 3)
    assert parameters_of(TRUE) == 4 and parameters_of(Polynomials(1.0, a=A, b=(B,))) == 4


def test_models_side_by_side() -> None:
    fitted, other = made(5), [made(6), made(7)]
    models = {"true": TRUE, "static": Polynomials(1.0, b=(np.array([0.0, 1.0]),))}
    found = compare(models, other, estimation=fitted)
    true, static = found
    assert true.percent[1][0] > 80.0 > static.percent[1][0]
    assert true.percent[1][0] > true.percent[10][0] >= true.percent[np.inf][0] - 1.0
    assert true.criteria is not None and static.criteria is not None and true.criteria.bic < static.criteria.bic
    assert true.criteria.n == 600
    # a penalty for what was fitted means nothing on other data
    assert all(one.criteria is None for one in compare(models, other))
    head, first, _ = table(found).splitlines()
    assert "fit %, simulated (validation)" in head and "AICc (estimation)" in head and first.startswith("true")
