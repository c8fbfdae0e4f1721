"""On top of the inner hoop: the regulator, the filter behind it, and the region from which a ball is held."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
import pytest

from hoopd.core.records import Estimate
from hoopd.files.controller import load_controller, settings_of
from hoopd.files.model import InnerHoop
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.loop.closed_loop import FreeBall, Scenario, simulate
from hoopd.plants.hoop.loop.writeback import estimator_with
from hoopd.plants.hoop.maneuver.balance import Balance, BalanceRegion, TopLaw
from hoopd.plants.hoop.maneuver.inner_model import TOP, InnerModel
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel
from hoopd.plants.model_file import effects_of, load_model

HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")
DEVICE = msgspec.structs.replace(HOOP.device, inner=InnerHoop(0.0445))
SETTINGS = settings_of(load_controller(defaults_folder() / "controllers" / "lqg.yaml"))


@cache
def balance() -> Balance:
    model = InnerModel(PlanningModel(effects_of(msgspec.structs.replace(HOOP, device=DEVICE))))
    return Balance(model, SETTINGS, DEVICE.torque_limit_nm)


def test_a_model_without_an_inner_hoop_has_no_top() -> None:
    with pytest.raises(ValueError, match=r"device\.inner"):
        InnerModel(PlanningModel(effects_of(HOOP)))


def test_the_top_falls_by_itself_and_the_regulator_makes_it_stable() -> None:
    _, a, b = (one.full() for one in balance().model.step(0.02)(TOP, 0.0))
    _, gains = balance().regulator
    assert max(abs(np.linalg.eigvals(a))) > 1.2  # e^(10.7 x 0.02)
    closed = (a - b @ gains[None, :])[1:, 1:]  # the hoop's own angle is free
    assert max(abs(np.linalg.eigvals(closed))) < 1.0


def test_a_ball_that_is_let_go_beside_the_top_is_held_by_what_the_camera_tells() -> None:
    run = balance().run(np.array([5.0, 0.15, -0.5]), 4.0)
    assert np.abs(run.psi[100:] - np.pi).max() < 0.1 and np.abs(run.dtheta[150:]).max() < 5.0
    assert np.abs(run.u).max() <= DEVICE.torque_limit_nm
    # too far: nothing holds it, and it falls
    assert not balance().holds(np.array([0.0, 1.4, 0.0]), 1.0)


def test_the_filter_knows_that_it_is_on_the_inner_hoop_and_that_it_fell() -> None:
    from hoopd.core.limits import Limiter

    found = balance().model.found
    seen: list[tuple[float, Estimate, str]] = []
    ball = FreeBall(found, inner=True)
    law = TopLaw(0.0 * balance().regulator[1])  # no torque: it rolls down, flies, and lands on the outer hoop
    scenario = Scenario(duration_s=1.2, psi0_rad=np.pi + 0.1)
    simulate(
        ball,
        law,
        estimator_with(found, SETTINGS),
        Limiter(0.7, 0.7),
        scenario,
        watch=lambda t, e: seen.append((t, e, ball.mode)),
    )
    told = [(estimate.ball.mode, mode) for _, estimate, mode in seen if estimate.ball is not None]
    assert {mode for _, mode in told} == {"inner", "air", "rolling"}
    assert told[0] == ("inner", "inner")
    assert np.mean([estimated == true for estimated, true in told]) > 0.85


def test_the_region_is_held_and_grows_with_its_level() -> None:
    region = balance().region(directions=8)
    assert region.half_widths[1] > 0.1
    assert all(balance().holds(one, 4.0, 100 + k) for k, one in enumerate(region.drawn(8, 1)))
    edge = region.drawn(50, 2, on_its_edge=True)
    assert [one @ region.p @ one for one in edge] == pytest.approx([region.level] * 50)
    inside = region.drawn(50, 2)
    assert all(one @ region.p @ one < region.level for one in inside)
    assert BalanceRegion(region.p, 4 * region.level).half_widths == pytest.approx(2 * region.half_widths)
