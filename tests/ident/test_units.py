"""What is estimated, and how well it is known, does not depend on the units of parameters and signals."""

from __future__ import annotations

from collections.abc import Callable

import control as ct
import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from hoopd.ident.confidence import pole_spread, response_spread
from hoopd.ident.continuous_transfer import srivc
from hoopd.ident.data import experiments, iddata
from hoopd.ident.polynomial.pem import bj
from hoopd.ident.prediction import simulate
from hoopd.ident.statespace.hammersteinwiener import hammerstein_wiener
from hoopd.ident.statespace.nonlinear import nonlinear_pem
from hoopd.ident.statespace.step_sizes import variable_sizes
from hoopd.ident.statespace.structured import structured_pem
from hoopd.ident.uncertain import possible_models


def steps(n: int, seed: int = 0) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], n // 6), 6)


def low_pass(unit: float) -> Callable[[np.ndarray], ct.StateSpace]:
    """A capacity p[0] (in `unit` farad) that leaks p[1] (in 1e-4 S), behind 10 kOhm."""

    def built(p: np.ndarray) -> ct.StateSpace:
        c = p[0] * unit
        return ct.ss([[-1.0 / (1e4 * c) - 1e-4 * p[1] / c]], [[1.0 / (1e4 * c)]], [[1.0]], [[0.0]])

    return built


@pytest.mark.parametrize("start", [[2.0, 0.3], [2.0, 0.0]])
def test_a_capacity_in_farad_is_fitted_as_one_in_nanofarad(start: list[float]) -> None:
    u, e = steps(300), np.random.default_rng(1).standard_normal(300)
    y = simulate(low_pass(1e-9)(np.array([1.0, 0.5])), iddata(u, u, 1e-6), "zero")[:, 0] + 0.02 * e
    found = []
    for unit in (1e-9, 1.0):
        own = 1e-9 / unit
        model = structured_pem(
            iddata(y, u, 1e-6),
            low_pass(unit),
            [start[0] * own, start[1]],
            bounds=([1e-3 * own, 0.0], [1e3 * own, 10.0]),
        )
        spread = response_spread(model, [1e5])
        assert spread is not None
        values, sd = np.array(list(model.parameters.values())), np.array(list(model.deviations().values()))
        found.append([*values / [own, 1.0], *sd / [own, 1.0], spread.gain.item()])
    assert found[1] == pytest.approx(found[0], rel=1e-5)
    assert abs(np.array(found[0][:2]) - [1.0, 0.5]) == pytest.approx(np.zeros(2), abs=4.0 * max(found[0][2:4]))


def test_a_friction_that_starts_at_nothing_is_found_in_si_units() -> None:
    """J w' = -(b + k k/R) w + k/R u of a coreless motor, J = 2e-8 kg m2 and b = 3e-7 N m s."""

    def motor(p: np.ndarray) -> ct.StateSpace:
        return ct.ss([[-(p[1] + 8e-7) / p[0]]], [[4e-4 / p[0]]], [[1.0]], [[0.0]])

    u, e = 0.5 * steps(600), np.random.default_rng(1).standard_normal(600)
    y = simulate(motor(np.array([2e-8, 3e-7])), iddata(u, u, 1e-3), "zero")[:, 0] + 5.0 * e
    model = structured_pem(iddata(y, u, 1e-3), motor, [3e-8, 0.0])
    off = np.array(list(model.parameters.values())) - [2e-8, 3e-7]
    sd = np.array(list(model.deviations().values()))
    assert (np.abs(off) < 4.0 * sd).all() and (sd < [2e-10, 1e-8]).all()


def test_a_transfer_function_is_as_well_known_in_milliseconds_as_in_minutes() -> None:
    u, e = steps(300), np.random.default_rng(3).standard_normal(300)
    y = simulate(ct.tf([0.06], [1.0, 0.5, 0.06]), iddata(u, u, 1.0), "zero")[:, 0] + 0.05 * e
    found = []
    for unit in (1.0, 6e4):
        model = srivc(iddata(y, u, unit), 2, 0, delay=0.0)
        pole, response = pole_spread(model), response_spread(model, [0.1 / unit])
        assert pole is not None and response is not None
        sd = np.array([model.deviations()[name] for name in ("b0", "a1", "a2")]) * [unit**2, unit, unit**2]
        found.append([*sd, *np.sqrt(pole.covariances[:, 0, 0]) * unit, response.gain.item()])
    assert found[1] == pytest.approx(found[0], rel=1e-4)


def drag(unit: float) -> Callable[..., np.ndarray]:
    def f(x: np.ndarray, u: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
        return np.asarray(x + 0.3 * (u - p[0] * unit * x * abs(x)))

    return f


def test_a_drag_is_fitted_alike_in_every_unit() -> None:
    u, e = np.random.default_rng(0).standard_normal((2, 150))
    x = [np.array([1.0])]
    for one in u[1:]:
        x.append(drag(1.0)(x[-1], one + 1.0, np.array([0.8]), 0.0))
    data = iddata(np.array(x) + 0.05 * e[:, None], np.concatenate([u[1:], [0.0]]) + 1.0)
    found = []
    for unit in (1.0, 1e10):
        model = nonlinear_pem(
            data, drag(unit), lambda x, u, p, t: x, [0.5 / unit], [1.5], process=1e-6, measurement=2.5e-3
        )
        found.append([model.p[0] * unit, *np.sqrt(np.diag(model.covariance)) * [unit, 1.0]])
    assert found[1] == pytest.approx(found[0], rel=1e-5)
    assert abs(found[0][0] - 0.8) < 4.0 * found[0][1]


def test_a_map_is_fitted_alike_in_every_unit() -> None:
    u, e = np.random.default_rng(0).standard_normal((2, 300))
    y = lfilter([0.0, 1.0], [1.0, -0.7], np.sign(u) * np.maximum(np.abs(u) - 0.5, 0.0)) + 0.01 * e
    found = []
    for unit in (1.0, 1e-12):
        model = hammerstein_wiener(
            iddata(y, u * unit), 1, [0.2 * unit],
            input_map=lambda u, p: np.sign(u) * np.maximum(np.abs(u) - p[0], 0.0), starts=1,
        )  # fmt: skip
        found.append([model.parameters["p1"] / unit, model.deviations()["p1"] / unit])
    assert found[1] == pytest.approx(found[0], rel=1e-4)
    assert abs(found[0][0] - 0.5) < 4.0 * found[0][1] < 0.1


def test_short_steps_are_told_apart() -> None:
    with pytest.raises(ValueError, match="a step of 3e-08 s, the first one of 2e-08 s"):
        experiments([iddata(np.zeros(5), dt=2e-8), iddata(np.zeros(5), dt=3e-8)])


def test_the_size_of_a_zero_is_what_changes_everything() -> None:
    low, high = np.array([-1.0, 0.0, 0.0, 0.0]), np.array([0.0, 9.0, np.inf, 1e-12])

    def share(sets: np.ndarray) -> np.ndarray:
        assert ((sets >= low[:, None]) & (sets <= high[:, None])).all()
        return np.asarray(np.abs(sets[0] / 3e-9) + np.abs(sets[1] - 2.0) + np.abs(sets[2] / 4e5) + 0.0 * sets[3])

    found = variable_sizes(share, np.array([0.0, 2.0, 1e-12, 0.0]), (low, high))
    assert found == pytest.approx([3e-9, 2.0, 4e5, 1e-12], rel=1e-3)


@pytest.mark.parametrize("unit", [1.0, 1e8])
def test_possible_models_reach_as_far_in_every_unit_of_the_input(unit: float) -> None:
    u, e = np.random.default_rng(0).standard_normal((2, 300))
    y = lfilter([0.0, 2.0], [1.0], u) + lfilter([1.0, 0.5], [1.0, -0.7], 0.5 * e)
    model = bj(iddata(y, u * unit, 0.1), 1, 1, 1, 0)
    gains = np.array([one.system.dcgain().item() for one in possible_models(model, count=20)])
    # the gain is one of the coefficients: the ellipsoid holds it within so many of its deviations
    reach = np.sqrt(stats.chi2.ppf(0.95, len(model.names))) * model.deviations()["b1"]
    assert 0.9 * reach < np.abs(gains - model.b[0][1]).max() < 1.001 * reach
