"""Frequency subspace, OKID, ERA, transforms, balancing, sampling: exact on exact data; bad arguments are refused."""

from __future__ import annotations

from typing import Any

import control as ct
import numpy as np
import pytest
from harness.identcriteria import realisation as criteria
from harness.identcriteria.statespacesets import made, mimo4, random_model, responses
from scipy.signal import lfilter

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.confidence import pole_spread, response_spread
from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import predict
from hoopd.ident.statespace import coordinates, sampling, similarity
from hoopd.ident.statespace.era import era, era_of_data
from hoopd.ident.statespace.frequencysubspace import frequency_subspace, from_response
from hoopd.ident.statespace.okid import okid
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.stabilise import bounded, stabilize
from hoopd.ident.statespace.subspace import subspaceid
from hoopd.ident.statespace.uncertainty import pole_covariance, response_covariance


@pytest.mark.parametrize("number", [20, 21, 22, 33, 34, 35, 36, 37, 41])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_criterion_holds(number: int, seed: int) -> None:
    found = getattr(criteria, f"criterion_{number}")(seed)
    assert all(value for value in found.values() if isinstance(value, bool | np.bool_)), found


def test_a_continuous_response_gives_a_continuous_model() -> None:
    truth = ct.ss([[-1.0, 2.0], [-2.0, -1.0]], [[1.0], [0.5]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [0.2]])
    w = np.geomspace(0.05, 40.0, 60)
    model = from_response(ct.frd(truth, w), order=2)
    assert model.dt == 0.0
    assert np.allclose(np.sort_complex(model.system.poles()), np.sort_complex(truth.poles()), atol=1e-8)
    assert np.allclose(model.system(1j * w), truth(1j * w), atol=1e-9)


def test_the_step_is_put_into_the_frequencies() -> None:
    truth = random_model(np.random.default_rng(0), 3, 2, 2, dt=0.02)
    w = np.linspace(0.1, np.pi, 80)
    model = frequency_subspace(w / 0.02, responses(truth, w), dt=0.02)
    assert model.nx == 3
    assert np.allclose(responses(model, w), responses(truth, w), atol=1e-9)
    with pytest.raises(ValueError, match="Nyquist"):
        frequency_subspace(w / 0.02, responses(truth, w), dt=0.04)


def test_an_order_beyond_exact_data_is_warned_of() -> None:
    truth = random_model(np.random.default_rng(0), 2, 1, 1)
    w = np.linspace(0.1, np.pi, 80)
    with pytest.warns(IdentificationWarning, match="too high"):
        frequency_subspace(w, responses(truth, w), dt=1.0, order=4)
    with pytest.warns(IdentificationWarning, match="too high"):
        era(criteria.markov(truth, 20), 4)


def test_okid_leaves_out_rows_with_gaps_and_era_takes_several_sets() -> None:
    rng = np.random.default_rng(0)
    truth = mimo4()
    data = made(truth, rng.standard_normal((400, 2)), np.zeros((400, 3)), rng.standard_normal(4))
    y = data.y.copy()
    y[[50, 200]] = np.nan
    assert np.abs(okid(iddata(y, data.u), 10) - criteria.markov(truth, 10)).max() < 1e-9
    model = era_of_data([data[:200], data[200:]], 4, lags=20)
    assert np.allclose(np.sort(np.abs(np.linalg.eigvals(model.a))), [0.85, 0.85, 0.95, 0.95], atol=1e-6)
    with pytest.raises(ValueError, match="rows for"):
        okid(data[:30], 20)
    with pytest.raises(ValueError, match="Markov parameters"):
        era(criteria.markov(truth, 4), 2, rows=4, columns=4)


def test_truncation_keeps_what_matters_and_refuses_unstable_models() -> None:
    a = np.diag([0.9, 0.5, 0.1])
    b = np.array([[1.0], [1.0], [1e-4]])
    model = Innovations(a, b, b.T, np.zeros((1, 1)), np.full((3, 1), 0.1), 1.0)
    w = np.linspace(0.1, 3.0, 10)
    small = similarity.reduce(model, 2)
    assert small.nx == 2
    assert np.abs(responses(small, w) - responses(model, w)).max() < 1e-6
    assert small.k.shape == (2, 1)
    unstable = Innovations(a + 0.2 * np.eye(3), model.b, model.c, model.d, model.k, 1.0)
    with pytest.raises(ValueError, match="stable"):
        similarity.balance(unstable)


def test_a_continuous_model_is_balanced_and_truncated_by_its_own_gramians() -> None:
    one = np.ones((1, 1))
    for rate in (0.5, 5.0):  # 1/(s + p): both gramians are 1/(2 p)
        assert similarity.balance(Innovations(-rate * one, one, one, 0.0 * one, 0.0 * one, 0.0))[1] == pytest.approx(
            [0.5 / rate]
        )
    a = np.array([[-1.0, 2.0, 0.3], [-2.0, -1.0, 0.1], [0.0, 0.2, -40.0]])
    b, c = np.array([[1.0], [0.5], [0.2]]), np.array([[1.0, 0.0, 0.3]])
    model = Innovations(a, b, c, np.zeros((1, 1)), np.zeros((3, 1)), 0.0)
    balanced, values = similarity.balance(model)
    t = np.linspace(0.0, 40.0, 400_001)
    w = np.geomspace(0.01, 100.0, 30)
    assert np.allclose(balanced.system(1j * w), model.system(1j * w))
    # the integral of exp(A t) B B' exp(A' t), by eigenvectors along the time
    poles, vectors = np.linalg.eig(balanced.a)
    x = (vectors @ (np.linalg.solve(vectors, balanced.b) * np.exp(np.outer(poles, t)))).real
    assert np.allclose(np.trapezoid(x[:, None] * x, t, axis=-1), np.diag(values), atol=1e-6)
    small = similarity.reduce(model, 2)
    error = np.abs(small.system(1j * w) - model.system(1j * w)).max()
    assert small.dt == 0.0 and error <= 2.0 * values[2] * (1.0 + 1e-6)
    with pytest.raises(ValueError, match="real part 1 1/s"):
        similarity.balance(Innovations(one, one, one, 0.0 * one, 0.0 * one, 0.0))


def noisy(seed: int = 0) -> Data:
    """Two poles, one input, 600 samples."""
    u, e = np.random.default_rng(seed).standard_normal((2, 600))
    return iddata(lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + 0.3 * e, u, 0.1)


@pytest.mark.parametrize("fit", [pem, subspaceid])
def test_what_is_known_of_a_response_does_not_depend_on_the_states(fit: Any) -> None:
    model, w = fit(noisy(), 2), [0.5, 3.0, 10.0]
    others = (model.transformed(np.array([[10.0, 3.0], [0.0, 0.2]])), similarity.balance(model)[0])
    sure = response_covariance(model, w)
    poles = pole_covariance(model)
    for other in others:
        assert np.allclose(response_covariance(other, w), sure, rtol=1e-6)
        order = [int(np.abs(poles[0] - one).argmin()) for one in pole_covariance(other)[0]]
        assert np.allclose(pole_covariance(other)[1], poles[1][order], rtol=1e-6)
        assert not len(other.values) or np.array_equal(other.values, coordinates.values(other))


def test_a_truncated_model_is_no_estimate_of_the_data() -> None:
    small = similarity.reduce(pem(noisy(), 2), 1)
    assert small.covariance is None and small.names == () and small.report is None and not small.deviations()


def test_channels_of_a_model_are_its_part() -> None:
    model = mimo4()
    w = np.linspace(0.1, 3.0, 5)
    assert np.allclose(responses(similarity.channels(model, [2, 0], [1]), w), responses(model, w)[:, [2, 0]][:, :, [1]])


def two_outputs() -> Data:
    """One input that moves both outputs, and one that moves nothing."""
    rng = np.random.default_rng(0)
    u, e = rng.standard_normal((600, 2)), rng.standard_normal((600, 2))
    slow, fast = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u[:, 0]), lfilter([0.0, 1.0], [1.0, -0.5], u[:, 0])
    return iddata(np.column_stack([slow + 0.3 * e[:, 0], fast + 0.1 * e[:, 1]]), u, 0.1)


def test_a_part_of_an_estimate_is_as_well_known_as_in_the_whole() -> None:
    model, w = pem(two_outputs(), 3), [0.5, 3.0]
    known = response_covariance(model, w)
    for outputs, inputs in (([0], [0]), ([1, 0], [0, 1]), ([1], [1])):
        part = similarity.channels(model, outputs, inputs)
        assert np.allclose(response_covariance(part, w), known[:, outputs][:, :, inputs], rtol=1e-9)
        assert np.allclose(pole_covariance(part)[1], pole_covariance(model)[1], rtol=1e-9)
        assert part.report is None and set(part.deviations()) == set(coordinates.names(part)) and str(part)


def test_outputs_in_another_order_keep_their_gain() -> None:
    model, data = pem(two_outputs(), 3), two_outputs()
    turned = similarity.channels(model, [1, 0], [0, 1])
    assert np.allclose(predict(turned, data.channels([1, 0], [0, 1])), predict(model, data)[:, [1, 0]])


def test_a_part_of_a_subspace_estimate_has_no_covariance_of_other_channels() -> None:
    part = similarity.channels(subspaceid(two_outputs(), 3), [0], [0])
    assert pole_spread(part) is None and response_spread(part, [0.5]) is None and "pole" in str(part)


def test_a_pole_without_a_logarithm_is_refused() -> None:
    one = np.ones((1, 1))
    with pytest.raises(ValueError, match="negative real axis"):
        sampling.continuous_form(Innovations(-0.5 * one, one, one, one, one, 1.0))


@pytest.mark.parametrize("fast", [50.0, 500.0, 1e4])
def test_noise_and_cost_of_a_pole_that_is_fast_beside_the_step_are_their_integrals(fast: float) -> None:
    t, poles, dt = np.array([[1.0, 2.0], [3.0, 5.0]]), np.array([-1.0, -fast]), 0.1
    inverse = np.linalg.inv(t)
    # by eigenvectors: the integral of exp((p_i + p_j) t) is (exp((p_i + p_j) dt) - 1)/(p_i + p_j)
    pairs = poles[:, None] + poles
    shares = np.expm1(pairs * dt) / pairs
    a, b, zero = t @ np.diag(poles) @ inverse, np.ones((2, 1)), np.zeros((2, 1))
    noise = t @ (shares * (inverse @ inverse.T)) @ t.T
    form = sampling.sampled_form(Innovations(a, b, b.T, np.zeros((1, 1)), zero, 0.0, q=np.eye(2)), dt)
    assert form.q is not None and np.allclose(form.q, noise, rtol=1e-8)
    cost = inverse.T @ (shares * (t.T @ t)) @ inverse
    assert np.allclose(sampling.sampled_cost(a, b, np.eye(2), np.eye(1), dt)[0], cost, rtol=1e-8)


def test_poles_inside_stay_where_they_are() -> None:
    a = np.diag([0.5, 0.9])
    assert np.array_equal(stabilize(a), a)
    turn = 1.2 * np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert np.allclose(np.sort_complex(np.linalg.eigvals(bounded(turn, 0.7))), [-0.7j, 0.7j])
