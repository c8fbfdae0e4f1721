"""Dead times: beside the continuous model, between samples too, and back to the sampled model that it came from."""

from __future__ import annotations

import warnings

import control as ct
import numpy as np
import pytest

from hoopd.ident import (
    Data,
    DelayedModel,
    Innovations,
    Polynomials,
    arx,
    c2d,
    d2c,
    d2d,
    iddata,
    oe,
    pole_spread,
    simulate,
    srivc,
    step_response,
)
from hoopd.plots import bode, pzmap, step

DT = 0.1
PLANT = Polynomials(DT, np.array([1.0, -1.5, 0.7]), (np.array([0.0, 0.0, 0.0, 1.0, 0.5]),), variance=0.01)


def data(model: Polynomials = PLANT, samples: int = 400) -> Data:
    u = np.sign(np.random.default_rng(0).standard_normal((samples, model.nu)))
    return iddata(simulate(model, iddata(u, u, DT), "zero", seed=1), u, DT)


@pytest.mark.parametrize("fit", [lambda d: arx(d, 2, 2, 3), lambda d: oe(d, 2, 2, 3), lambda d: oe(d, 2, 2, 3).system])
def test_whole_steps_stand_beside_and_come_back(fit: object) -> None:
    model = fit(data())  # type: ignore[operator]
    continuous = d2c(model)
    assert isinstance(continuous, DelayedModel)
    assert continuous.delays == pytest.approx((2 * DT,)) and continuous.undelayed.nx == 2
    back = c2d(continuous, DT)
    assert step_response(back, 4.0).y == pytest.approx(step_response(model, 4.0).y, abs=1e-9)
    own = data()
    assert continuous.simulate(own, "zero") == pytest.approx(simulate(model, own, "zero"), abs=1e-8)
    assert "dead time: u 0.2 s" in repr(continuous) or "dead time: u[0] 0.2 s" in repr(continuous)


def test_each_input_has_its_own() -> None:
    two = Polynomials(DT, np.array([1.0, -0.8]), (np.array([0.0, 0.0, 1.0]), np.array([0.0, 2.0])), inputs=("u", "v"))
    continuous = d2c(two)
    assert isinstance(continuous, DelayedModel) and continuous.delays == pytest.approx((DT, 0.0))
    finer = step_response(c2d(continuous, DT / 4), 3.0).y[::4]
    assert finer == pytest.approx(step_response(two, 3.0).y, abs=1e-9)


def test_another_step_splits_what_comes_between_two_samples() -> None:
    """A dead time of 0.2 s every 0.16 s: the same response as by fine steps, looked at where the samples are."""
    coarse = step_response(d2d(PLANT, 0.16), 3.2).y[:, 0, 0]
    fine = step_response(d2d(PLANT, 0.01), 3.2).y[::16, 0, 0]
    assert coarse == pytest.approx(fine, abs=1e-9) and fine.max() > 5.0


def test_a_direct_term_is_late_too() -> None:
    one = np.ones((1, 1))
    late = DelayedModel(Innovations(-one, one, one, 2.0 * one, 0.0 * one, 0.0), (0.25,))
    fine, coarse = step_response(late.sampled(0.05), 2.0), step_response(late.sampled(0.1), 2.0)
    true = np.where(coarse.t >= 0.25, 3.0 - np.exp(-(coarse.t - 0.25)), 0.0)
    assert coarse.y[:, 0, 0] == pytest.approx(true) and fine.y[::2, 0, 0] == pytest.approx(true)
    w = np.array([0.3, 2.0])
    assert late.response(w)[:, 0, 0] == pytest.approx((2.0 + 1.0 / (1j * w + 1.0)) * np.exp(-0.25j * w))


def test_a_continuous_transfer_function_is_sampled_and_has_its_roots_in_s() -> None:
    plant, u = ct.tf([2.0], [1.0, 0.6, 1.0]), np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], 60), 6)
    y = simulate(plant, iddata(u, u, DT), "zero")[:, 0]
    noise = 0.05 * np.random.default_rng(2).standard_normal(len(u))
    model = srivc(iddata(np.concatenate([np.zeros(5), y[:-5]]) + noise, u, DT), poles=2, zeros=0)
    spread = pole_spread(model)
    assert spread is not None and spread.roots.real == pytest.approx([-0.3, -0.3], abs=0.05)
    off = np.abs(spread.roots - plant.poles()) / np.sqrt(np.trace(spread.covariances, axis1=1, axis2=2))
    assert off.max() < 4.0
    assert "|s|" in repr(model)
    again = c2d(model, DT)
    assert step_response(again, 8.0).y == pytest.approx(step_response(model, 8.0).y, abs=1e-6)
    assert pzmap(model).axes[0].get_xlabel().lower().startswith("re")
    for draw in (step, bode):
        assert draw({"fit": model, "continuous": d2c(model)}).axes


def test_what_has_no_place_is_said() -> None:
    late = d2c(PLANT)
    with pytest.raises(TypeError, match=r"no finite state space: c2d\(model, dt\)"):
        _ = late.state_space
    with pytest.raises(ValueError, match="continuous already"):
        d2c(late)
    with pytest.raises(TypeError, match="whose step it takes"):
        late.simulate(np.zeros(5))
    with pytest.raises(ValueError, match=r"a pole at zero \(a delay is one\)"):
        d2c(PLANT.state_space)  # a delay among the states cannot be told from dynamics
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not isinstance(d2c(Polynomials(DT, np.array([1.0, -0.8]), (np.array([0.0, 1.0]),))), DelayedModel)
