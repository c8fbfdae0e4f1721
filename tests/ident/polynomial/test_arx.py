"""ARX: exact data give exact coefficients; missing samples, several experiments and outputs; what is warned of."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.data import Data, iddata
from hoopd.ident.polynomial.arx import arx, varx
from hoopd.ident.polynomial.estimators import least_squares
from hoopd.ident.polynomial.regression import regressors, residuals
from hoopd.ident.prediction import prediction_error

A = np.array([1.0, -1.5, 0.7])
B = (np.array([0.0, 0.0, 1.0, 0.5]), np.array([0.3, -0.2, 0.0, 0.0]))


def made(n: int, seed: int = 0, noise: float = 0.0) -> Data:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, 2))
    right = sum(lfilter(b, [1.0], u[:, i]) for i, b in enumerate(B)) + noise * rng.standard_normal(n)
    return iddata(lfilter([1.0], A, right), u, 0.1, inputs=("left", "right"))


@pytest.mark.parametrize("n", [20, 5000])
def test_two_inputs_with_delays_and_a_direct_term(n: int) -> None:
    model = arx(made(n), 2, [2, 2], [2, 0])
    assert model.names == ("a1", "a2", "b2(1)", "b3(1)", "b0(2)", "b1(2)")
    assert np.allclose(model.values, [-1.5, 0.7, 1.0, 0.5, 0.3, -0.2], rtol=1e-8)
    assert np.allclose(model.b[0], B[0], atol=1e-8)
    assert model.system.input_labels == ["left", "right"]


def test_the_gram_matrix_and_the_triangles_agree_with_plain_least_squares() -> None:
    data = made(3000, noise=1.0)
    a, y = regressors(data, 2, [3, 2], [1, 0])
    plain = least_squares(a, y)
    model = arx(data, 2, [3, 2], [1, 0])
    assert np.allclose(model.values, plain, rtol=1e-9)
    assert np.allclose(arx(data, 2, [3, 2], [1, 0], estimator=least_squares).values, plain, rtol=1e-9)
    rest = y - a @ plain
    variance = rest @ rest / (len(y) - 7)
    assert model.variance == pytest.approx(variance)
    assert model.covariance is not None
    assert np.allclose(model.covariance, variance * np.linalg.inv(a.T @ a), rtol=1e-8)
    assert np.allclose(residuals(model, data), rest, atol=1e-9)
    assert np.allclose(prediction_error(model, data)[3:, 0], rest, atol=1e-6 * np.abs(rest).max() + 1e-6)


def test_a_missing_output_drops_its_equations_only() -> None:
    data = made(1000, noise=0.5)
    y = data.y.copy()
    y[[100, 300, 301]] = np.nan
    holed = iddata(y, data.u, 0.1)
    a, b = regressors(holed, 2, [2, 2], [2, 0])
    assert len(b) == 1000 - 3 - 7
    assert np.allclose(arx(holed, 2, [2, 2], [2, 0]).values, least_squares(a, b), rtol=1e-9)


def test_experiments_count_together_and_nothing_runs_across() -> None:
    one, other = made(300, noise=0.5), made(400, 1, noise=0.5)
    rows = [regressors(part, 2, [2, 2], [2, 0]) for part in (one, other)]
    plain = least_squares(np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows]))
    assert np.allclose(arx([one, other], 2, [2, 2], [2, 0]).values, plain, rtol=1e-9)
    assert np.allclose(arx([one, one], 2, [2, 2], [2, 0]).values, arx(one, 2, [2, 2], [2, 0]).values, rtol=1e-10)


@pytest.mark.parametrize("holes", [False, True])
def test_ridge_weighs_the_same_in_the_answer_and_its_covariance(holes: bool) -> None:
    data, ridge = made(200, noise=0.5), 30.0
    y = data.y.copy()
    y[50 : 52 if holes else 50] = np.nan
    data = iddata(y, data.u, 0.1)
    a, b = regressors(data, 2, [2, 2], [2, 0])
    inverse = np.linalg.inv(a.T @ a + ridge * np.eye(6))
    model = arx(data, 2, [2, 2], [2, 0], ridge=ridge)
    assert model.covariance is not None
    assert np.allclose(model.values, inverse @ a.T @ b, rtol=1e-9)
    assert np.allclose(model.covariance, model.variance * inverse @ a.T @ a @ inverse, rtol=1e-7)


def test_errors_lie_within_the_covariance() -> None:
    true = np.array([-1.5, 0.7, 1.0, 0.5, 0.3, -0.2])
    squares = []
    for seed in range(40):
        model = arx(made(500, seed, noise=0.5), 2, [2, 2], [2, 0])
        assert model.covariance is not None
        d = model.values - true
        squares.append(d @ np.linalg.solve(model.covariance, d))
    assert 4.5 < np.mean(squares) < 7.8  # chi-square with 6 degrees: mean 6 +- 0.55


def test_one_order_too_many_without_noise_is_said() -> None:
    with pytest.warns(IdentificationWarning, match="depend on each other"):
        model = arx(made(500), 3, [3, 3], [2, 0])
    assert np.sqrt(np.mean(residuals(model, made(500)) ** 2)) < 1e-9


def test_a_wrong_call_is_one_clear_line() -> None:
    data = made(100)
    for call, said in (
        (lambda: arx(data, 2, [1, 1, 1]), "nb has 3 numbers and the data have 2 inputs"),
        (lambda: arx(data, 60, 30), "too few samples"),
        (lambda: arx(iddata(np.hstack([data.y, data.u]), data.u), 1, 1), "one output wanted"),
        (lambda: arx(data, -1, 1), "not negative"),
        (lambda: arx(data, 1, 1, ridge=-1.0), "ridge must not be negative"),
    ):
        with pytest.raises(ValueError, match=said):
            call()


def test_memory_stays_linear() -> None:
    data = made(400_000, noise=1.0)
    tracemalloc.start()
    arx(data, 10, 10)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 12 * 8 * data.n  # the matrix of regressors alone would be 31 columns


def test_several_outputs_as_one_model() -> None:
    rng = np.random.default_rng(3)
    a1 = np.array([[0.5, 0.3, 0.0], [-0.2, 0.4, 0.1], [0.0, 0.2, -0.3]])
    b1, d = rng.standard_normal((3, 2)), rng.standard_normal((3, 2))
    u, e, y = rng.standard_normal((400, 2)), 0.1 * rng.standard_normal((400, 3)), np.zeros((400, 3))
    for t in range(1, 400):
        y[t] = a1 @ y[t - 1] + b1 @ u[t - 1] + d @ u[t] + e[t]
    exact = y.copy()
    model = varx(iddata(exact, u), 1, 2, 0)
    assert np.abs(model.a[1] + a1).max() < 0.1 and np.abs(model.b[0] - d).max() < 0.1
    own = model.state_space
    said = prediction_error(own, iddata(exact, u), x0="zero")[2:]
    rows = [
        residuals(row, iddata(exact[:, [i]], np.hstack([np.delete(exact, i, 1), u])))
        for i, row in enumerate(model.rows)
    ]
    assert np.allclose(said[:, :], np.column_stack([r[-398:] for r in rows]), atol=1e-9)
    assert np.allclose(model.r, 0.01 * np.eye(3), atol=0.003)
    diagonal = varx(iddata(exact, u), 1, 2, 0, coupled=False)
    assert np.count_nonzero(diagonal.a[1]) == 3


@pytest.mark.parametrize("band_hz", [(0.0, 0.3), (1.0, 5.0)])
def test_a_model_of_a_band_scatters_as_it_says_and_its_variance_is_that_of_its_errors(
    band_hz: tuple[float, float],
) -> None:
    values, told = [], []
    for seed in range(60):
        u, e = np.random.default_rng(seed).standard_normal((2, 2000))
        data = iddata(lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.8], 0.5 * e), u, 0.1)
        model = arx(data, 1, 1, focus_hz=band_hz)
        values.append(model.values)
        told.append(list(model.deviations().values()))
        assert model.variance == pytest.approx(float(np.square(prediction_error(model, data)[1:]).mean()), rel=0.01)
    assert np.std(values, axis=0) == pytest.approx(np.sqrt(np.mean(np.square(told), axis=0)), rel=0.25)
