"""What stops an estimate, what warns of it, and what is left in peace."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.checks import (
    IdentificationWarning,
    Orders,
    check,
    check_determined,
    check_regressors,
    dependent,
    excitation,
)
from hoopd.ident.data import Data, iddata
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.loopchecks import answers, check_feedback
from hoopd.ident.modelchecks import check_model, wald
from hoopd.ident.models import Polynomials, innovations, state_space as realised

ORDERS = Orders(parameters=4, lags=3, lost=2)


def random(n: int = 200, seed: int = 0) -> Data:
    rng = np.random.default_rng(seed)
    return iddata(rng.standard_normal(n), rng.standard_normal((n, 2)))


def quiet(call: Callable[[], None]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        call()


@pytest.mark.parametrize(
    ("lags", "first"),
    [
        ((range(4), range(2, 8)), 9),
        ((range(6), range(3, 6)), 5),  # the longest reach into the first samples, which the shorter do not
        ((range(5, 5), range(1, 2)), 1),
        ((range(7, 8), range(12)), 11),
    ],
)
@pytest.mark.parametrize(("pairs", "n"), [(1, 40), (2, 40), (2, 9000)])
def test_gram_of_lags_equals_the_matrix_of_lags(lags: tuple[range, range], first: int, pairs: int, n: int) -> None:
    signals, spans = list(np.random.default_rng(1).standard_normal((2 * pairs, n))), lags * pairs
    columns = np.stack([s[first - k : n - k] for s, span in zip(signals, spans, strict=True) for k in span], axis=1)
    assert np.allclose(lagged_gram(signals, spans, first), columns.T @ columns, atol=1e-10)


def test_lags_before_the_data_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        lagged_gram([np.ones(40)], [range(4)], 2)


def test_good_data_are_left_in_peace() -> None:
    quiet(lambda: check([random(), random(seed=1)], orders=ORDERS))


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [(0, 3.0, "constant"), (0, np.nan, "missing"), (1, -1.0, "constant")],
)
def test_a_dead_channel_is_named(column: int, value: float, said: str) -> None:
    good = random()
    y, u = good.y.copy(), good.u.copy()
    (y if column == 0 else u)[:, 0] = value
    with pytest.raises(ValueError, match=f"{'output y' if column == 0 else 'input u1'} is {said}"):
        check(iddata(y, u), orders=ORDERS)


def test_an_infinite_sample_is_named() -> None:
    y = random().y.copy()
    y[3] = np.inf
    with pytest.raises(ValueError, match="not finite"):
        check(Data(y, random().u, 1.0, outputs=("y",), inputs=("a", "b")), orders=ORDERS)


def test_few_samples_stop() -> None:
    with pytest.raises(ValueError, match="too few samples: 6 give 4 equations for 4 parameters"):
        check(random(6), orders=ORDERS)


def test_a_sine_excites_order_two() -> None:
    t = np.arange(300)
    u = np.sin(0.3 * t)[:, None]
    assert excitation(u, 4) == 2
    with pytest.warns(IdentificationWarning, match="excite order 2 and 4 is wanted"):
        check(iddata(random(300).y, u), orders=Orders(4, 4, 4))
    quiet(lambda: check(iddata(random(300).y, u), orders=Orders(4, 2, 4)))


def test_two_equal_inputs_are_not_told_apart() -> None:
    u = random().u[:, [0, 0]]
    with pytest.warns(IdentificationWarning, match="excite order 3 and 6"):
        check(iddata(random().y, u), orders=ORDERS)


def test_dependent_regressors_are_named() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((50, 3))
    columns[:, 2] = columns[:, 0]
    assert list(dependent(columns)) == [0, 2]
    with pytest.warns(IdentificationWarning, match="of a, c depend"):
        check_regressors(columns, ["a", "b", "c"])


@pytest.mark.parametrize("seed", range(3))
def test_feedback_is_seen_and_its_absence_too(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 1000
    e, r = rng.standard_normal((2, n))
    y, u = np.zeros(n), np.zeros(n)
    for t in range(1, n):
        y[t] = 0.9 * y[t - 1] + u[t - 1] + e[t]
        u[t] = r[t] - 0.3 * y[t]
    assert answers(e, u)
    slow = lfilter([1.0], [1.0, -0.95], r)
    assert not answers(e, slow)
    # what the model missed of the input is no feedback, however slow the input is
    assert not answers(e + lfilter([0.0, 1.0], [1.0, -0.5], slow), slow)
    with pytest.warns(IdentificationWarning, match="input torque follows"):
        check_feedback(e, u[:, None], ["torque"])


@pytest.mark.parametrize(("input_mean", "error_mean"), [(1.0, 1.0), (300.0, 2.0), (0.0, 3.0)])
def test_means_of_input_and_error_are_no_feedback(input_mean: float, error_mean: float) -> None:
    said = 0
    for seed in range(40):
        e, u = np.random.default_rng(seed).standard_normal((2, 1000))
        e[::9] = np.nan
        said += answers(e + error_mean, u + input_mean)
    assert said == 0


def test_of_several_inputs_the_one_in_the_loop_is_named() -> None:
    e, r = np.random.default_rng(0).standard_normal((2, 3, 1000))
    closed = r[1] + 0.5 * np.roll(e[2], 2)
    with pytest.warns(IdentificationWarning) as said:
        check_feedback(e.T, np.stack([r[0], closed], axis=1), ["gate", "torque"])
    assert [str(one.message).split(" follows")[0] for one in said] == ["feedback suspected: input torque"]


def test_a_sine_answers_nobody() -> None:
    t = np.arange(500)
    assert not answers(np.random.default_rng(0).standard_normal(500), np.sin(0.2 * t))


def test_an_integrator_is_said_in_both_forms() -> None:
    model = Polynomials(0.1, a=np.array([1.0, -1.0]), b=(np.array([0.0, 1.0]),))
    for one in (model, realised(model), innovations(realised(model).system)):
        with pytest.warns(IdentificationWarning, match="cannot be told from 1 by 500"):
            check_model(one, 500)
    slow = Polynomials(0.1, a=np.array([1.0, -0.9]), b=(np.array([0.0, 1.0]),))
    quiet(lambda: check_model(slow, 500))


def test_cancelling_roots_are_said() -> None:
    f = np.convolve([1.0, -0.5], [1.0, -0.8])
    model = Polynomials(1.0, b=(np.array([0.0, 2.0, -1.6]),), f=(f,))
    with pytest.warns(IdentificationWarning, match=r"B and F of input 1 nearly share the root 0\.8"):
        check_model(model, 100)


def test_an_unknown_coefficient_is_said() -> None:
    model = Polynomials(
        1.0, b=(np.array([0.0, 1.0]),), f=(np.array([1.0, 0.2]),), names=("b1", "f1"), values=np.array([1.0, 0.2]),
        covariance=np.diag([0.01, 1.0]),
    )  # fmt: skip
    with pytest.warns(IdentificationWarning, match=r"f1 is known to \+-1"):
        check_model(model, 100)


def test_a_coefficient_without_a_spread_counts_as_nothing_and_others_by_theirs() -> None:
    """As many at once do: what a fit held fixed is no evidence."""
    model = Polynomials(
        1.0, a=np.array([1.0, -0.5, 0.2]), b=(np.array([0.0, 1.0]),), names=("a1", "a2", "b1"),
        values=np.array([-0.5, 0.2, 1.0]), covariance=np.diag([0.0, 0.04, 0.25]),
    )  # fmt: skip
    assert wald(model, ["a1"]) == (0.0, 1)
    assert wald(model, ["a2"]) == (pytest.approx(1.0), 1)
    assert wald(model, ["a1", "a2", "b1"]) == (pytest.approx(5.0), 3)


def test_a_combination_of_many_parameters_is_loose_however_evenly_it_is_spread() -> None:
    """Of 150 parameters each has a twelfth of the direction; starting states alone are no finding."""
    count = 150
    even = np.ones(count) / np.sqrt(count)
    names = [f"p{k}" for k in range(count)]
    with pytest.warns(IdentificationWarning, match=r"do not determine a combination of p0, p1, .*p149"):
        check_determined(np.eye(count) - np.outer(even, even), names)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_determined(np.diag([1.0] * count + [0.0]), names)
