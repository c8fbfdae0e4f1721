"""Models in both forms, and what they say of data: simulation, prediction, initial states, missing samples."""

from __future__ import annotations

from dataclasses import replace

import control as ct
import numpy as np
import pytest
from scipy import linalg

from hoopd.ident.data import Data, experiments, iddata, runs
from hoopd.ident.models import Innovations, Polynomials, innovations, state_space
from hoopd.ident.prediction import estimate_x0, predict, prediction_error, simulate
from hoopd.ident.predictor_systems import error_system, predictor_system

BJ = Polynomials(
    0.1, a=np.array([1.0, -0.4]), b=(np.array([0.0, 1.0, 0.5]), np.array([0.3])), c=np.array([1.0, 0.4]),
    d=np.array([1.0, -0.7]), f=(np.array([1.0, -1.5, 0.7]), np.array([1.0, 0.2])), inputs=("left", "right"),
)  # fmt: skip


def random_model(seed: int, nx: int = 4, ny: int = 3, nu: int = 2) -> Innovations:
    rng = np.random.default_rng(seed)
    a = 0.9 * np.linalg.qr(rng.standard_normal((nx, nx)))[0]
    b, c, d = (rng.standard_normal(shape) for shape in ((nx, nu), (ny, nx), (ny, nu)))
    p = linalg.solve_discrete_are(a.T, c.T, 0.1 * np.eye(nx), np.eye(ny))
    k = a @ p @ c.T @ np.linalg.inv(c @ p @ c.T + np.eye(ny))
    return Innovations(a, b, c, d, k, 0.1)


def made(model: Innovations, n: int, seed: int, noise: float = 0.0) -> tuple[Data, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((n, model.nu)), noise * rng.standard_normal((n, model.ny))
    x, x0 = rng.standard_normal(model.nx), None
    x0, y = x.copy(), np.empty((n, model.ny))
    for i in range(n):
        y[i] = model.c @ x + model.d @ u[i] + e[i]
        x = model.a @ x + model.b @ u[i] + model.k @ e[i]
    return iddata(y, u, model.dt), e, x0


def test_both_forms_of_a_model_are_one() -> None:
    w, own = np.linspace(0.1, 30.0, 12), state_space(BJ)
    for one, other in ((BJ.system, own.system), (BJ.noise, own.noise)):
        assert np.allclose(ct.frequency_response(one, w).frdata, ct.frequency_response(other, w).frdata, atol=1e-12)
    assert BJ.system.input_labels == ["left", "right"]
    assert sorted(np.abs(np.linalg.eigvals(own.a - own.k @ own.c))) == pytest.approx(
        [0.0, *sorted(np.abs(np.roots(np.convolve([1.0, 0.4], np.convolve(BJ.f[0], BJ.f[1])))))], abs=1e-9
    )


def test_an_unstable_a_has_a_stable_predictor() -> None:
    arx = Polynomials(1.0, a=np.array([1.0, -1.2]), b=(np.array([0.0, 1.0]),))
    own = state_space(arx)
    assert own.nx == 1 and abs(np.linalg.eigvals(own.a - own.k @ own.c)).max() < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_the_true_model_leaves_its_innovations(seed: int) -> None:
    model = random_model(seed)
    data, e, x0 = made(model, 200, seed, noise=0.2)
    assert np.allclose(prediction_error(model, data, x0=x0), e, atol=1e-10)
    # h steps ahead: sum of the last h impulse responses of the noise on e
    h, error = 3, prediction_error(model, data, 3, x0)
    powers = [np.eye(3), model.c @ model.k, model.c @ model.a @ model.k]
    wanted = sum(e[h - 1 - j : len(e) - j] @ power.T for j, power in enumerate(powers))
    assert np.allclose(error[h - 1 :], wanted, atol=1e-9)
    assert np.allclose(predict(model, data, np.inf, x0), simulate(model, data, x0))


@pytest.mark.parametrize("seed", range(4))
def test_the_initial_state_is_found(seed: int) -> None:
    model = random_model(seed)
    data, _, x0 = made(model, 100, seed)
    assert np.allclose(estimate_x0(model, data, samples=8), x0, rtol=1e-9)
    assert np.allclose(simulate(model, data), data.y, atol=1e-9)


def test_states_that_are_known_stay_as_they_are() -> None:
    model = random_model(2)
    data, _, x0 = made(model, 100, 2)
    wrong = np.array([np.nan, x0[1] + 1.0, np.nan, np.nan])
    given = wrong.copy()
    found = estimate_x0(model, data, simulation=True, fixed=wrong)
    assert np.array_equal(wrong, given, equal_nan=True)  # the caller's own stays
    assert found[1] == x0[1] + 1.0
    right = np.array([np.nan, x0[1], np.nan, x0[3]])
    assert np.allclose(estimate_x0(model, data, samples=2, fixed=right), x0, atol=1e-9)
    # least squares: no change of the others makes the errors less
    best = np.sum((data.y - simulate(model, data, found)) ** 2)
    for i in (0, 2, 3):
        for step in (1e-3, -1e-3):
            assert np.sum((data.y - simulate(model, data, found + step * np.eye(4)[i])) ** 2) > best
    with pytest.raises(ValueError, match="fixed has 3 numbers"):
        estimate_x0(model, data, fixed=np.zeros(3))


def test_noise_is_drawn_as_the_model_believes() -> None:
    model = random_model(3)
    assert model.r is None
    data, _, _ = made(model, 20000, 3)
    with pytest.raises(ValueError, match="no noise to draw"):
        simulate(model, data, "zero", seed=1)
    r = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.2], [0.0, 0.2, 0.5]])
    noisy = replace(model, r=r)
    said = simulate(noisy, data, "zero", seed=1)
    assert np.array_equal(said, simulate(noisy, data, "zero", seed=1))
    assert not np.array_equal(said, simulate(noisy, data, "zero", seed=2))
    # a one-step predictor of what was drawn leaves white errors of that covariance
    left = prediction_error(noisy, iddata(said, data.u, data.dt), x0="zero")
    assert np.allclose(left.T @ left / len(left), r, atol=0.06)
    assert np.allclose(left[1:].T @ left[:-1] / len(left), 0.0, atol=0.06)


@pytest.mark.parametrize("horizon", [1, 2, 5, np.inf])
def test_a_predictor_is_a_system_too(horizon: float) -> None:
    for model in (random_model(4), state_space(BJ)):
        data, _, _ = made(model, 80, 4, noise=0.3)
        both = np.hstack([data.u, data.y]).T
        said = ct.forced_response(predictor_system(model, horizon), inputs=both).outputs.reshape(model.ny, -1).T
        assert np.allclose(said, predict(model, data, horizon, "zero"), atol=1e-9)
        error = ct.forced_response(error_system(model, horizon), inputs=both).outputs.reshape(model.ny, -1).T
        assert np.allclose(error, data.y - said, atol=1e-9)
    assert predictor_system(BJ, 3).nstates == state_space(BJ).nx + 2
    with pytest.raises(ValueError, match="whole number"):
        predictor_system(BJ, 0)
    continuous = ct.tf([1.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="in samples and a continuous model has none"):
        predictor_system(continuous)
    assert predictor_system(continuous, np.inf).dt == 0.0


def test_missing_outputs_correct_nothing_and_stay_missing() -> None:
    model = random_model(1)
    data, e, x0 = made(model, 60, 5, noise=0.1)
    y = data.y.copy()
    y[20:25, 1] = np.nan
    holed = iddata(y, data.u, data.dt)
    error = prediction_error(model, holed, x0=x0)
    assert np.isnan(error[20:25, 1]).all() and np.isfinite(predict(model, holed, x0=x0)).all()
    assert np.allclose(error[:20], e[:20]) and not np.allclose(error[26], e[26], atol=1e-6)
    assert [len(one.y) for one in runs(holed)] == [20, 35]


def test_a_shorter_step_or_other_channels_are_refused() -> None:
    model = random_model(0)
    data, _, _ = made(model, 30, 0)
    with pytest.raises(ValueError, match="resample"):
        simulate(model, iddata(data.y, data.u, 0.2))
    with pytest.raises(ValueError, match="3 outputs and 2 inputs"):
        simulate(model, data.channels([0]))
    with pytest.raises(ValueError, match="continuous"):
        innovations(ct.ss(-1.0, 1.0, 1.0, 0.0))
    with pytest.raises(ValueError, match="whole number"):
        predict(model, data, 1.5)
    with pytest.raises(ValueError, match="4 states"):
        simulate(model, data, np.zeros(3))


def test_data_are_sliced_by_samples_seconds_and_names() -> None:
    data = iddata(np.arange(20.0), np.arange(20.0), 0.5, t0=1.0, outputs=["theta"])
    assert data.seconds(2.0, 4.0).y[:, 0].tolist() == [2.0, 3.0, 4.0, 5.0]
    part = data[2::4]
    assert part.dt == 2.0 and part.t.tolist() == [2.0, 4.0, 6.0, 8.0, 10.0]
    assert data.channels(["theta"], []).nu == 0
    with pytest.raises(ValueError, match="no channel 'psi'"):
        data.channels(["psi"])
    with pytest.raises(ValueError, match="forwards"):
        data[::-1]


@pytest.mark.parametrize(
    ("y", "u", "dt", "why"),
    [
        (np.ones(5), np.ones(4), 1.0, "4 samples"),
        (np.ones(3), np.array([1.0, np.nan, 1.0]), 1.0, "sample 1"),
        (np.array([1.0, np.inf, 1.0]), None, 1.0, "infinite at sample 1"),
        (np.ones(3), None, 0.0, "positive number of seconds"),
        (np.ones((2, 2, 2)), None, 1.0, "channels"),
    ],
)
def test_what_is_no_data_is_refused_with_its_cause(y: np.ndarray, u: np.ndarray | None, dt: float, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        iddata(y, u, dt)


def test_experiments_have_the_same_channels_and_step() -> None:
    one = iddata(np.ones(4), np.ones(4), 0.1)
    assert len(experiments(one)) == 1 and len(experiments([one, one])) == 2
    with pytest.raises(ValueError, match="experiment 1 has a step"):
        experiments([one, iddata(np.ones(4), np.ones(4), 0.2)])
    with pytest.raises(ValueError, match="experiment 1 has 1 outputs and 0 inputs"):
        experiments([one, iddata(np.ones(4), dt=0.1)])
    given = np.ones(4)
    held = iddata(given)
    given[0] = 7.0
    assert held.y[0, 0] == 1.0
