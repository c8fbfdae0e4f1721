"""Free runs with effects: against the model's own free run, uneven nodes, held torques and what a run takes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from harness.effectcases import SIZES, VALUES, composite, sizes, two_level

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.free_run import FreeRun, readings, run
from hoopd.plants.held_input import mean_torque
from hoopd.plants.hoop.simulate import STEP_S, HoopModel

X0 = np.array([0.2, -1.0, 0.5, 2.0])


def test_without_effects_it_is_the_model_s_free_run() -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(np.concatenate([[3.0], rng.uniform(0.002, 0.09, 120)]))
    u = rng.normal(size=120) * 0.1
    expected = HoopModel("rolling", VALUES["rolling"], step_s=0.005).run([], X0, t, u)
    assert np.abs(run(composite("rolling"), {}, X0, t, u) - expected).max() < 1e-4


def model_with(name: str, **changes: float) -> HoopModel:
    found = FoundEffects("entries", VALUES["entries"], (FoundEffect(name, {**SIZES[name], **changes}),))
    return HoopModel.with_effects(found)


def test_an_effect_that_needs_no_shorter_steps_has_those_of_the_plant() -> None:
    base = HoopModel("entries", VALUES["entries"])
    plain = (
        "actuator.torque_gain", "actuator.delay", "actuator.lag", "hoop.quadratic_drag", "encoder.harmonic",
        "camera.latency",
    )  # fmt: skip
    for name in plain:
        assert model_with(name).step_s == base.step_s == STEP_S, name
    for name in ("hoop.coulomb_friction", "actuator.cogging", "external.disturbance"):
        assert model_with(name).step_s <= STEP_S / 2, name


def test_a_harmonic_has_steps_for_as_often_as_it_comes_back() -> None:
    steps = {n: model_with("actuator.cogging", n=float(n)).step_s for n in (3, 20, 36)}
    assert steps[3] == pytest.approx(0.005) and steps[36] == pytest.approx(0.002)
    assert 0.002 < steps[20] < 0.005
    # told to each run anew, it may be any
    c = composite("entries", "actuator.cogging")
    told = FreeRun(c.declared, c.effects, ("actuator.cogging.n",), values=sizes("actuator.cogging"))
    assert told.step_s == pytest.approx(0.002)


@pytest.mark.parametrize("time_s", [0.0, 0.002, 0.03])
def test_a_lag_moves_rate_and_position_exactly_whatever_the_step(time_s: float) -> None:
    t, u = two_level(4.0)
    found = FoundEffects("entries", VALUES["entries"], (FoundEffect("actuator.lag", {"T": time_s}),))
    own, fine = (HoopModel.with_effects(found, step_s=step) for step in (STEP_S, STEP_S / 40.0))
    # with the mean torque of each step alone it was 4e-3
    assert np.abs(own.run([], X0, t, u) - fine.run([], X0, t, u))[:, [0, 2]].max() < 5e-5


def test_an_effect_of_nothing_leaves_the_plant_s_own_run() -> None:
    t, u = two_level(2.0)
    base = HoopModel("entries", VALUES["entries"]).run([], X0, t, u)
    assert np.array_equal(model_with("actuator.torque_gain", k=1.0).run([], X0, t, u), base)


def test_several_steps_at_once_are_the_same_steps() -> None:
    # an interval of another length leaves rows of steps with lengths of their own
    t, u = two_level(1.0)
    uneven_t, uneven_u = np.append(t, t[-1] + 0.033), np.append(u, 0.05)
    for name in ("hoop.coulomb_friction", "frame.vibration", "actuator.lag"):
        c, values = composite("rolling", name), sizes(name)
        assert np.abs(run(c, values, X0, uneven_t, uneven_u)[:-1] - run(c, values, X0, t, u)).max() < 1e-12, name


def test_more_nodes_change_nothing() -> None:
    names = ("actuator.delay", "actuator.lag", "encoder.speed_lag", "frame.vibration")
    c, values = composite("rolling", *names), sizes(*names)
    t, u = two_level(1.0)
    fine_t, fine_u = np.arange(4 * len(u) + 1) * 0.005, np.repeat(u, 4)
    coarse, fine = run(c, values, X0, t, u), run(c, values, X0, fine_t, fine_u)
    assert coarse.shape == (51, c.nz) == (51, 6)
    assert np.abs(coarse - fine[::4])[:, [0, 2]].max() < 3e-4


def test_a_run_goes_on_from_a_whole_state() -> None:
    names = ("actuator.lag", "encoder.speed_lag")
    c, values, (t, u) = composite("entries", *names), sizes(*names), two_level(1.0)
    whole = run(c, values, X0, t, u)
    rest = run(c, values, whole[20], t[20:], u[20:])
    assert np.abs(rest - whole[20:]).max() < 1e-9


def test_the_first_readings_of_a_late_sensor_are_those_before_the_start() -> None:
    names = ("camera.latency", "encoder.latency")
    c, values = composite("rolling", *names), {f"{name}.d": 0.05 for name in names}
    t, u = two_level(1.0)
    whole = run(composite("rolling"), {}, X0, np.arange(-10, 51) * 0.01, np.full(60, u[0]))
    y = readings(c, values, whole[10], t, u)
    for channel, index in (("theta", 0), ("dtheta", 1), ("psi", 2)):
        # at 0, 0.02 and 0.04 s: the states of -0.05, -0.03 and -0.01 s
        assert y[channel][:3] == pytest.approx(whole[[5, 7, 9], index], abs=1e-5)


# ---------------------------------------------------------------------------------------------- held torques


def test_mean_torque_of_the_hold_is_the_torque_itself() -> None:
    t, u = np.array([0.0, 0.02, 0.04, 0.07]), np.array([0.1, -0.2, 0.3])
    edges = np.concatenate([np.linspace(a, b, 8)[:-1] for a, b in pairwise(t)] + [t[-1:]])
    assert np.array_equal(mean_torque(edges, t, u), np.repeat(u, 7))


def test_mean_torque_of_a_delay_is_the_integral() -> None:
    t, u = np.array([0.0, 0.02, 0.04, 0.06]), np.array([1.0, 2.0, 4.0])
    assert mean_torque([0.02, 0.03], t, u, 0.005) == pytest.approx([(0.005 * 1 + 0.005 * 2) / 0.01])
    # before the first node the first torque, after the last one the last
    assert mean_torque([-0.3, 0.01, 0.02, 0.9], t, u) == pytest.approx([1.0, 1.0, (0.02 * 2 + 0.86 * 4) / 0.88])
    assert mean_torque([[0.0, 0.04], [0.01, 0.05]], t, u) == pytest.approx(
        np.array([[1.5], [0.01 * (1 + 4 + 4) / 0.04]])
    )
