"""Limits are looked for where the recordings reach them, and fitted from there and from a little farther out."""

from __future__ import annotations

import numpy as np
import pytest
from diagnose.madeup import NOISE, shipped_plant, stretch_with

from hoopd.diagnose.search.candidates import MILDER, Judge, Settings, _milder
from hoopd.diagnose.search.screen import Screen, touched_grids
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.stretches import Stretch

PLANT = shipped_plant()
LIBRARY = library(PLANT)
SLIP = LIBRARY["ball.slip"]
MU = 0.18


def test_a_ball_that_slips_is_found_by_the_grip_that_its_recording_needs() -> None:
    quiet = Noise(np.append(NOISE.force, 0.0), np.append(NOISE.time_s, 0.1), NOISE.reading)
    made = stretch_with(PLANT, "a", 3, 14.0, [SLIP], {"ball.slip.mu": MU}, torque=0.2, noise=quiet)
    train = [Stretch("a", PLANT, made.t, made.u, made.y)]
    base = fit(train, (), PLANT.values)
    tried = touched_grids(SLIP, base)["mu"]
    assert len(tried) > 8 and tried[0] < MU / 2.0 and tried[-1] > 2.0 * MU
    found = [Judge(train, LIBRARY, Settings()).tried(base, one) for one in Screen(base, [SLIP]).scores()]
    assert found[0].gain > 100.0
    assert found[0].fit.values["ball.slip.mu"] == pytest.approx(MU, rel=0.1)


def test_a_contact_needs_no_more_than_the_ball_s_weight_lets_it() -> None:
    """Of a hoop and a ball at rest nothing is needed; under torque it is in proportion."""
    mu = SLIP.parameter("mu").touched
    assert mu is not None

    def grip(u: float) -> float:
        point = PLANT.point([0.0, 0.0, 0.0, 0.0], dict(PLANT.values), u, 0.0)
        return float(mu(point))

    assert grip(0.0) == pytest.approx(0.0, abs=1e-9)
    assert grip(0.2) == pytest.approx(2.0 * grip(0.1), rel=1e-6) and 0.01 < grip(0.1) < 1.0


def test_a_limit_is_begun_a_little_farther_out_too_and_nothing_else_is() -> None:
    assert _milder(SLIP, {"ball.slip.mu": 0.2, "J": 1.0}) == {"ball.slip.mu": pytest.approx(0.2 * MILDER)}
    assert MILDER > 1.0
    assert _milder(LIBRARY["hoop.coulomb_friction"], {"hoop.coulomb_friction.Fc": 1e-3}) == {}
