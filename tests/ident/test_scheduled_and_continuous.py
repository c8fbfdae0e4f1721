"""Transfer functions with a dead time, models that follow a schedule, the causal filter, uncertain models."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.design.worst_case import models_about, worst_case
from hoopd.ident import (
    arx,
    fit_percent,
    iddata,
    innovations,
    lpv_arx,
    lpv_pem,
    oe,
    possible_models,
    predict,
    simulate,
    smooth,
    srivc,
    state_filter,
    subspaceid,
)
from hoopd.ident.continuous_transfer import sampled
from hoopd.ident.data import Data
from hoopd.ident.uncertain import matrix_spread


def late(delay: float, seed: int, noise: float = 0.05) -> Data:
    """(s + 2) / (s^2 + 0.6 s + 1) behind a dead time in hundredths of a second, sampled at 0.1 s."""
    rng = np.random.default_rng(seed)
    fine = np.repeat(rng.choice([-1.0, 1.0], 150), 60)
    y = simulate(control.tf([1.0, 2.0], [1.0, 0.6, 1.0]), iddata(fine, fine, 0.01), "zero")[:, 0]
    shift = round(delay / 0.01)
    y = np.concatenate([np.zeros(shift), y[: len(y) - shift]])[::10]
    return iddata(y + noise * rng.standard_normal(len(y)), fine[::10], 0.1)


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.37])
def test_a_hold_and_any_dead_time_are_sampled_exactly(delay: float) -> None:
    data = late(delay, 0, noise=0.0)
    model = sampled(np.array([1.0, 2.0]), np.array([0.6, 1.0]), delay, 0.1, 0.5)
    assert np.allclose(simulate(model, data, "zero"), data.y, atol=1e-9)


def test_a_continuous_transfer_function_and_its_dead_time_are_found_within_their_errors() -> None:
    found = srivc(late(0.53, 1), poles=2, zeros=1)
    misses = (found.values - [1.0, 2.0, 0.6, 1.0, 0.53]) / np.array(list(found.deviations().values()))
    assert found.names == ("b0", "b1", "a1", "a2", "delay")
    assert (np.abs(misses) < 3.5).all() and found.deviations()["delay"] < 0.02
    assert float(fit_percent(late(0.53, 2).y, simulate(found, late(0.53, 2)))[0]) > 93.0


def test_a_dead_time_that_is_known_is_kept() -> None:
    found = srivc(late(0.3, 1), poles=2, zeros=1, delay=0.3)
    assert found.delay == 0.3 and "delay" not in found.names
    assert np.allclose(found.den, [1.0, 0.6, 1.0], atol=0.05)
    with pytest.raises(ValueError, match="fewer zeros than poles"):
        srivc(late(0.3, 1), poles=2, zeros=2)


def scheduled(seed: int, n: int = 900) -> tuple[Data, np.ndarray]:
    rng = np.random.default_rng(seed)
    p = np.sin(0.02 * np.arange(n)) + 0.2 * rng.standard_normal(n)
    u, x, y = rng.standard_normal(n), np.zeros(2), np.zeros(n)
    for t in range(n):
        y[t] = x[0] + 0.05 * rng.standard_normal()
        x = np.array([[1.2 + 0.2 * p[t], 1.0], [-0.6 - 0.1 * p[t], 0.0]]) @ x + np.array([1.0, 0.3 * p[t]]) * u[t]
    return iddata(y, u), p


def test_a_state_space_follows_its_schedule() -> None:
    data, p = scheduled(0)
    model = lpv_pem(data, p, order=2)
    for at in (-0.8, 0.8):
        assert np.allclose(np.poly(model.frozen([at]).a)[1:], [-1.2 - 0.2 * at, 0.6 + 0.1 * at], atol=0.04)
    new, other = scheduled(1)
    assert float(fit_percent(new.y, model.simulate(new, other))[0]) > 90.0
    plain = predict(model.frozen([0.0]), new, np.inf)
    assert float(fit_percent(new.y, plain)[0]) < 85.0


def test_an_arx_model_follows_its_schedule_with_true_errors() -> None:
    misses = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        u, p, y = rng.standard_normal(400), np.sin(0.05 * np.arange(400)), np.zeros(400)
        for t in range(1, 400):
            y[t] = (0.6 + 0.3 * p[t]) * y[t - 1] + (1.0 - 0.5 * p[t]) * u[t - 1] + 0.2 * rng.standard_normal()
        model = lpv_arx(iddata(y, u), p, 1, 1)
        misses.append((model.values - [-0.6, -0.3, 1.0, -0.5]) / np.array(list(model.deviations().values())))
    assert model.names == ("a1", "a1*p1", "b1", "b1*p1")
    assert 0.75 < np.sqrt(np.mean(np.square(misses))) < 1.25
    assert float(fit_percent(y[1:], model.simulate(iddata(y, u), p)[1:])[0]) > 50.0
    with pytest.raises(ValueError, match="does not move"):
        lpv_arx(iddata(y, u), np.ones(400), 1, 1)
    with pytest.raises(ValueError, match="400 rows"):
        lpv_arx(iddata(y, u), p[:100], 1, 1)


def test_a_filter_knows_nothing_of_what_comes() -> None:
    rng = np.random.default_rng(0)
    model = innovations(control.ss([[0.95]], [[1.0]], [[1.0]], [[0.0]], 1.0))
    u, y = rng.standard_normal((2, 200))
    data, noise = iddata(y, u), ([[0.1]], [[1.0]])
    whole, half = (state_filter(model, one, "zero", noise=noise) for one in (data, data[:100]))
    assert np.allclose(whole.states[:100], half.states)
    assert np.allclose(whole.states[-1], smooth(model, data, "zero", noise=noise).states[-1])
    # of an estimate, with its own noise
    assert np.isfinite(state_filter(arx(data, 1, 1), data).states).all()


def test_models_on_the_ellipsoid_hold_the_margins_of_the_truth() -> None:
    margin = 1.8 / 0.8  # 4 0.2 / (z - 0.8) at z = -1
    inside = 0
    for seed in range(20):
        u, e = np.random.default_rng(seed).standard_normal((2, 300))
        data = iddata(lfilter([0.0, 0.2], [1.0, -0.8], u) + 0.1 * e, u, 0.1)
        found = worst_case(oe(data, 1, 1), law=4.0, count=30)
        inside += found.gain_up <= margin
    assert inside >= 18 and found.gain_up > 0.8 * margin
    assert found.stable and found.models == 31
    with pytest.raises(ValueError, match="no covariance"):
        possible_models(innovations(control.ss([[0.8]], [[0.2]], [[1.0]], [[0.0]], 0.1)))
    untold = oe(data, 1, 1)
    with pytest.raises(ValueError, match="no finite number"):
        possible_models(replace(untold, covariance=np.diag([np.nan, 1e-6])))


@pytest.mark.parametrize("fit", [lambda d: arx(d, 2, 2), lambda d: subspaceid(d, 2)], ids=["arx", "subspace"])
def test_what_a_file_keeps_of_a_model_gives_the_same_models_that_may_be_true(fit: Any) -> None:
    """To first order: where the matrices are no straight lines of the coefficients the ends differ a little."""
    u, e = np.random.default_rng(0).standard_normal((2, 2000))
    model = fit(iddata(lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + 0.1 * e, u, 0.1))
    own = model.state_space
    sizes = np.cumsum([getattr(own, name).size for name in "abcdk"])[:-1]
    moves = [
        {name: part.reshape(getattr(own, name).shape) for name, part in zip("abcdk", np.split(row, sizes), strict=True)}
        for row in matrix_spread(model)
    ]
    said = models_about({name: getattr(own, name) for name in "abcd"}, moves, 0.1, 20)
    for one, other in zip(said, possible_models(model, 20), strict=True):
        assert one.dcgain() == pytest.approx(other.system.dcgain(), rel=2e-3)


def test_a_law_that_loses_a_possible_model_is_told() -> None:
    u, e = np.random.default_rng(0).standard_normal((2, 60))
    data = iddata(lfilter([0.0, 0.2], [1.0, -0.8], u) + 0.3 * e, u, 0.1)
    found = worst_case(oe(data, 1, 1), law=9.0)
    assert not found.stable and 0.0 < found.stable_share < 1.0


def test_an_exactly_known_model_is_possible_as_it_is() -> None:
    u = np.random.default_rng(3).choice([-1.0, 1.0], 200)
    found = possible_models(arx(iddata(np.append(0.0, u[:-1]), u, 0.1), 1, 1, 1), count=5)
    assert len({one.b.tobytes() for one in found}) == 1 and found[0].b[0, 0] * found[0].c[0, 0] == pytest.approx(1.0)
