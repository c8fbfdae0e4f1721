"""Order scans: criteria against their formulas, the same equations for all, the right order, other data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.model_comparison import compare
from hoopd.ident.polynomial.arx import arx
from hoopd.ident.polynomial.orders import aic, aicc, bic, fpe, scan
from hoopd.ident.polynomial.pem import oe
from hoopd.ident.polynomial.recursive import RecursiveArx
from hoopd.ident.polynomial.regression import regressors

A, B = np.array([1.0, -1.5, 0.7]), np.array([0.0, 0.0, 0.0, 1.0, 0.5])


def made(n: int, seed: int = 0, noise: float = 0.5) -> Data:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    return iddata(lfilter(B, A, u) + lfilter([1.0], A, noise * e), u)


def test_orders_may_be_numbers_of_numpy() -> None:
    data, one, two = made(600), np.int64(1), np.int64(2)
    assert np.array_equal(arx(data, two, two, two).values, arx(data, 2, 2, 2).values)
    assert np.array_equal(oe(data, two, two, one).values, oe(data, 2, 2, 1).values)
    by_numbers, by_ranges = (scan(data, span, span, one) for span in (np.arange(1, 4), range(1, 4)))
    assert len(by_numbers.candidates) == 9
    assert by_numbers.candidates == by_ranges.candidates and type(by_numbers.candidates[0].na) is int
    assert RecursiveArx(one, two, two).coefficients.shape == (3,)
    plain = compare(oe(data, 2, 2), data, 5)[0].percent[5]
    assert compare(oe(data, 2, 2), data, np.int64(5))[0].percent[5] == pytest.approx(plain)


def test_criteria_are_their_formulas() -> None:
    n, p, v = 50, 4, 0.3
    assert aic(v, n, p) == pytest.approx(50 * np.log(0.3) + 8)
    assert aicc(v, n, p) == pytest.approx(aic(v, n, p) + 2 * 5 * 6 / 44)
    assert bic(v, n, p) == pytest.approx(50 * np.log(0.3) + 4 * np.log(50))
    assert fpe(v, n, p) == pytest.approx(0.3 * 54 / 46)
    assert aicc(v, 6, 4) == fpe(v, 4, 4) == np.inf


def test_several_outputs_count_by_the_determinant_of_the_mean() -> None:
    e = np.random.default_rng(0).standard_normal((40, 2)) * [1.0, 3.0]
    v = e.T @ e / 40
    assert fpe(v, 40, 6) == pytest.approx(np.linalg.det(v) * 46 / 34)
    assert aic(v, 40, 6) == pytest.approx(40 * np.log(np.linalg.det(v)) + 12)


def test_every_candidate_is_its_least_squares_fit_on_the_same_rows() -> None:
    data = made(300)
    found = scan(data, range(4), [1, 3], [1, 2, 3])
    assert len(found.candidates) == 24 and {one.samples for one in found.candidates} == {300 - 5}
    for one in found.candidates:
        a, y = regressors(data, one.na, one.nb, one.delay)
        a, y = a[-295:], y[-295:]
        rest = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
        assert one.variance == pytest.approx(rest @ rest / 295, rel=1e-9)
        assert one.criterion("bic") == pytest.approx(bic(rest @ rest / 295, 295, one.na + one.nb[0]))


def test_the_right_orders_are_found() -> None:
    for seed in range(5):
        found = scan(made(2000, seed), range(1, 6), range(1, 6), range(1, 6))
        best = found.best("bic")
        assert (best.na, best.nb, best.delay) == (2, (2,), (3,))
        assert found.best("aic").parameters >= best.parameters
        assert len(found.values("fpe")) == 125


def test_without_noise_no_parameter_is_wasted() -> None:
    best = scan(made(500, noise=0.0), range(1, 6), range(1, 6), range(1, 5)).best("aic")
    assert (best.na, best.nb, best.delay) == (2, (2,), (3,))


def test_other_data_and_parts_of_the_same() -> None:
    data, other = made(120, noise=2.0), made(5000, 1, noise=2.0)
    found = scan(data, range(1, 9), [2], [3], validation=other)
    for one in found.candidates:
        a, y = regressors(data, one.na, one.nb, one.delay)
        a_other, y_other = regressors(other, one.na, one.nb, one.delay)
        lost = 8 - max(one.na, 4)
        x = np.linalg.lstsq(a[lost:], y[lost:], rcond=None)[0]
        assert one.validation == pytest.approx(np.mean((y_other - a_other @ x)[lost:] ** 2), rel=1e-8)
    parts = scan(made(1000, noise=2.0), range(1, 9), [2], [3], folds=5)
    assert parts.best("validation").na <= 4
    assert all(one.validation is not None and one.validation > one.variance for one in parts.candidates)
    with pytest.raises(ValueError, match="no validation"):
        scan(data, 2, 2).best("validation")


def test_ar_two_inputs_and_holes() -> None:
    data = made(3000)
    assert scan(iddata(lfilter([1.0], A, np.random.default_rng(5).standard_normal(3000))), range(7)).best().na == 2
    rng = np.random.default_rng(1)
    u = rng.standard_normal((3000, 2))
    y = lfilter([0.0, 1.0], [1.0, -0.8], u[:, 0]) + lfilter([0.3, 0.4], [1.0, -0.8], u[:, 1])
    y = y + lfilter([1.0], [1.0, -0.8], 0.2 * rng.standard_normal(3000))
    y[[500, 900]] = np.nan
    best = scan(iddata(y, u), [1, 2], [(1, 1), (1, 2), (2, 2)], [(1, 0), (1, 1)]).best()
    assert (best.na, best.nb, best.delay) == (1, (1, 2), (1, 0)) and best.samples == 3000 - 2 - 6
    with pytest.raises(ValueError, match="folds"):
        scan(data, 1, 1, folds=1)
    with pytest.raises(ValueError, match="no orders"):
        scan(data, [], [1])
