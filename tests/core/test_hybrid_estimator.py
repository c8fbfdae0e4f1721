"""The filter of a ball that may leave the hoop: poison, a flight nobody planned, one that the pictures contradict."""

from __future__ import annotations

from math import atan2, hypot, inf, nan

import numpy as np
import pytest

from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.hybrid_estimator import HybridEkf
from hoopd.core.records import CameraSample, DriverSample, Estimate
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.loop.writeback import estimator_with
from hoopd.plants.model_file import effects_of, load_model

MODELS = defaults_folder() / "models"
TICK, AGE = 0.02, 0.05


def made(model: str = "inner_hoop") -> HybridEkf:
    found = estimator_with(effects_of(load_model(MODELS / f"{model}.yaml")), EkfSettings())
    assert isinstance(found, HybridEkf)
    return found


def picture(t: float, direction: float, distance: float = 1.0) -> CameraSample:
    psi = direction if abs(distance - 1.0) < 0.08 else nan
    return CameraSample(0, t - AGE, t, psi, 1.0, 0.0, 0.0, 0, direction, distance)


def ticked(ekf: DelayedEkf, k: int, camera: CameraSample | None, *, may_fly: bool = True) -> Estimate:
    t = TICK * k
    hoop = DriverSample(t - TICK + 7e-4, k, 1, 0, 0.0, 0.0, 0.0, 0)
    return ekf.update(t, 0.0, t - TICK + 7e-4, hoop, camera, may_fly=may_fly)


def at_rest(ekf: DelayedEkf, ticks: int = 30, *, may_fly: bool = True) -> Estimate:
    for k in range(ticks):
        estimate = ticked(ekf, k, picture(TICK * k, 0.0), may_fly=may_fly)
    return estimate


def test_a_ball_at_the_bottom_surely_rolls_and_where_it_may_not_fly_nothing_is_said() -> None:
    ball = at_rest(made()).ball
    assert ball is not None and ball.mode == "rolling" and ball.probability > 0.999 and ball.distance == 1.0
    assert at_rest(made(), may_fly=False).ball is None


def test_a_picture_off_the_track_makes_it_fly_at_once_and_it_falls() -> None:
    ekf = made()
    at_rest(ekf)
    estimate = ticked(ekf, 30, picture(TICK * 30, 2.5, 0.8))
    assert estimate.ball is not None and estimate.ball.mode == "air"
    assert ekf.covariance.shape == (4, 4)
    before = estimate.ball.distance
    for k in range(31, 80):
        estimate = ticked(ekf, k, None)
    assert estimate.ball is not None and estimate.ball.mode != "air" and before < 1.0


def test_one_wrong_picture_of_a_flight_is_refused_and_two_begin_it_anew() -> None:
    ekf = made("hoop")
    at_rest(ekf)
    for k in range(30, 37):  # let go from half of the radius across and 0.6 of it up
        up = 0.6 - 0.5 * 9.81 * (TICK * (k - 30)) ** 2 / 0.0853
        told = ticked(ekf, k, picture(TICK * k, atan2(0.5, -up), hypot(0.5, up)))
    assert told.psi_accepted and told.ball is not None and abs(told.ball.surprise) < 3.0
    wrong = ticked(ekf, 37, picture(TICK * 37, 3.0, 0.8))
    assert not wrong.psi_accepted and wrong.nis > 30.0
    again = ticked(ekf, 38, picture(TICK * 38, 3.0, 0.8))
    assert again.psi_accepted and again.ball is not None and again.ball.mode == "air"


def test_a_flight_that_may_no_longer_be_one_rolls() -> None:
    ekf = made()
    at_rest(ekf)
    ticked(ekf, 30, picture(TICK * 30, 2.5, 0.8))
    estimate = ticked(ekf, 31, None, may_fly=False)
    assert estimate.ball is None and np.isfinite(estimate.x).all()


@pytest.mark.parametrize("poison", [nan, inf])
def test_poison_ends_in_a_filter_that_begins_anew(poison: float) -> None:
    ekf = made()
    at_rest(ekf)
    ticked(ekf, 30, picture(TICK * 30, 2.5, 0.8))
    spoiled = DriverSample(TICK * 30.5, 0, 1, 0, poison, poison, 0.0, 0)
    for k in (31, 32):
        ekf.update(TICK * k, poison, TICK * (k - 1), spoiled, picture(TICK * k, poison, poison), may_fly=True)
    for k in range(33, 70):
        estimate = ticked(ekf, k, picture(TICK * k, 0.0))
    assert estimate.ready and abs(estimate.x[2]) < 0.05 and estimate.ball is not None
    assert estimate.ball.mode == "rolling"


def test_filters_of_one_model_share_no_buffers_and_give_the_same_bits() -> None:
    alone, one, other = made(), made(), made()
    for k in range(60):
        seen = picture(TICK * k, 0.3 * np.sin(0.3 * k)) if k < 40 else picture(TICK * k, 2.0, 0.8 - 0.01 * (k - 40))
        wanted = ticked(alone, k, seen).x.tolist()
        assert ticked(one, k, seen).x.tolist() == wanted
        ticked(other, k, picture(TICK * k, -0.2))
