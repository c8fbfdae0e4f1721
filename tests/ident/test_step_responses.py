"""Responses to a step: the numbers, what the coefficients leave open, and what has none."""

from __future__ import annotations

import warnings

import control as ct
import numpy as np
import pytest

from hoopd.ident import (
    Data,
    Polynomials,
    arx,
    c2d,
    compare,
    d2c,
    d2d,
    delay,
    iddata,
    pem,
    simulate,
    srivc,
    step_response,
)
from hoopd.ident.doubts import IdentificationWarning

DT = 0.1
PLANT = Polynomials(DT, np.array([1.0, -1.5, 0.7]), (np.array([0.0, 1.0, 0.5]),), variance=0.09)


def data(seed: int, samples: int = 400) -> Data:
    u = np.sign(np.random.default_rng(seed).standard_normal(samples))
    return iddata(simulate(PLANT, iddata(u, u, DT), "zero", seed=seed + 1000), u, DT)


def test_it_is_python_control_s_of_the_same_system() -> None:
    model = arx(data(0), 2, 2)
    answer = step_response(model, 3.0)
    t, y = ct.step_response(model.system, T=answer.t)
    assert answer.t == pytest.approx(t) and answer.y[:, 0, 0] == pytest.approx(y)
    assert step_response(ct.tf([2.0], [0.5, 1.0]), 5.0).y[-1].item() == pytest.approx(2.0 * (1.0 - np.exp(-10.0)))


def test_its_deviation_is_the_spread_over_experiments() -> None:
    """Of ARX, whose structure the data have: 60 experiments; a spread of 60 has an error of 9 %."""
    answers = [step_response(arx(data(seed), 2, 2), 3.0) for seed in range(60)]
    spread = np.std([one.y[:, 0, 0] for one in answers], axis=0)
    claimed = np.mean([one.deviation[:, 0, 0] for one in answers if one.deviation is not None], axis=0)
    assert answers[0].y[0].item() == 0.0 and claimed[0] == pytest.approx(0.0, abs=1e-12)
    assert np.mean(claimed[2:] / spread[2:]) == pytest.approx(1.0, abs=0.2)


def test_of_a_continuous_model_with_a_dead_time_too() -> None:
    u = np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], 60), 6)
    y = simulate(ct.tf([2.0], [1.0, 0.6, 1.0]), iddata(u, u, DT), "zero")[:, 0]
    late = np.concatenate([np.zeros(5), y[:-5]]) + 0.1 * np.random.default_rng(2).standard_normal(len(u))
    with warnings.catch_warnings():
        warnings.simplefilter("error", IdentificationWarning)  # starting states that nobody asks for are no finding
        model = srivc(iddata(late, u, DT), poles=2, zeros=0)
    answer = step_response(model, 10.0)
    assert answer.deviation is not None
    true = np.interp(answer.t - 0.5, *ct.step_response(ct.tf([2.0], [1.0, 0.6, 1.0]), T=np.linspace(0.0, 10.0, 1001)))
    off = np.abs(answer.y[:, 0, 0] - true)[answer.t > 0.5] / answer.deviation[answer.t > 0.5, 0, 0]
    assert 0.2 < np.sqrt(np.mean(off**2)) < 2.5


def test_another_model_does_not_keep_the_errors_of_the_one_it_came_from() -> None:
    model = pem(data(0), 2)
    deviation = step_response(model, 2.0).deviation
    assert deviation is not None and deviation.max() > 0.0 and model.deviations()
    for other in (d2c(model), d2d(model, DT / 2)):
        assert not other.deviations() and other.covariance is None and other.report is None
        answer = step_response(other, 2.0)
        assert answer.deviation is None
        assert answer.y[-1] == pytest.approx(step_response(model, 2.0).y[-1], rel=1e-6)


def test_of_a_continuous_model_fast_modes_are_seen() -> None:
    calm = step_response(ct.tf([1e4], [1.0, 0.1, 1e4]))  # 100 rad/s, damped by 0.0005
    assert calm.y.max() == pytest.approx(1.998, abs=0.05)
    assert calm.y[-1].item() == pytest.approx(1.0, abs=0.02)
    integrating = step_response(ct.tf([1.0], [0.001, 1.0, 0.0]))
    assert integrating.t[-1] == pytest.approx(10.0 * 0.001 * np.log(100.0))
    assert step_response(PLANT, 0.01).t[-1] == DT  # at least one step
    assert step_response(d2c(ct.tf([2.0], [1.0], DT)), 1.0).y[-1].item() == 2.0


def test_what_has_none_is_said() -> None:
    with pytest.raises(ValueError, match=r"positive time in s, not -1"):
        step_response(PLANT, -1.0)
    with pytest.raises(ValueError, match="a model without inputs"):
        step_response(Polynomials(DT, np.array([1.0, -0.5]), ()))
    with pytest.raises(ValueError, match=r"poles=1, zeros=2: one pole at least, and fewer zeros than poles"):
        srivc(data(0), 1, 2)


def test_any_model_comes_to_continuous_time_and_back() -> None:
    model = arx(data(0), 2, 2)
    for one in (model, model.system):
        back = c2d(d2c(one), DT)
        assert back.system.poles() == pytest.approx(model.system.poles())
        assert step_response(back, 2.0).y == pytest.approx(step_response(model, 2.0).y)
    with pytest.raises(ValueError, match=r"sampled already, every 0.1 s: d2d"):
        c2d(model, DT)
    with pytest.raises(ValueError, match=r"a pole at zero \(a delay is one\)"):
        d2c(arx(data(0), 1, 1, 3).state_space)


def test_what_is_printed_is_one_line() -> None:
    assert repr(delay(data(0), longest=10)).startswith("1 sample (0.1 s), 95%: 1 to 1; models of order ")
    (one,) = compare(PLANT, data(0), horizons=5)
    assert list(one.percent) == [5]
