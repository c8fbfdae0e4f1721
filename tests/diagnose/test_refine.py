"""Parameters that simulate best: found from afar, and through a long run that forgives no error on its way."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.diagnose.proof.fit_tables import nrmse
from hoopd.diagnose.proof.free_run_refinement import refine
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.reference_track import Track
from tests.diagnose.madeup import NOISE, shipped_plant, stretch_with

PLANT = shipped_plant()
LIBRARY = library(PLANT)
QUIET = Noise(0.05 * NOISE.force, NOISE.time_s, NOISE.reading)
FREE = PLANT.free


def test_the_base_is_found_from_wrong_parameters() -> None:
    true = {**PLANT.values, "L1": 640.0, "K2": -66.0, "J11": -0.3}
    stretch = stretch_with(PLANT, "a", 5, 12.0, (), true, torque=0.05, noise=QUIET)
    found = refine([stretch], [Track(stretch).z], (), PLANT.values, FREE)
    assert found.values["L1"] == pytest.approx(640.0, rel=0.02)
    assert found.values["K2"] == pytest.approx(-66.0, rel=0.02)
    assert len(found.runs) == 1 and found.runs[0].start.shape[1] == 1  # one run over the whole
    assert nrmse(found.runs)["psi"] > 95.0


@pytest.mark.proof
def test_effects_are_found_in_one_long_run() -> None:
    effects = [LIBRARY["hoop.coulomb_friction"], LIBRARY["camera.latency"]]
    true = {**PLANT.values, "hoop.coulomb_friction.Fc": 0.006, "camera.latency.d": 0.03}
    stretch = stretch_with(PLANT, "a", 6, 12.0, effects[:1], true, torque=0.05, noise=QUIET)
    start = {**PLANT.values, "hoop.coulomb_friction.Fc": 0.002, "camera.latency.d": 0.01}
    free = (*FREE, "hoop.coulomb_friction.Fc", "camera.latency.d")
    found = refine([stretch], [Track(stretch).z], effects, start, free)
    assert found.values["hoop.coulomb_friction.Fc"] == pytest.approx(0.006, abs=0.001)
    assert found.values["camera.latency.d"] == pytest.approx(0.0, abs=0.002)  # there is none
    base = refine([stretch], [Track(stretch).z], (), PLANT.values, FREE)
    assert found.cost < 0.5 * base.cost


def test_frozen_parameters_stay() -> None:
    stretch = stretch_with(PLANT, "a", 7, 6.0)
    found = refine([stretch], [Track(stretch).z], (), PLANT.values, ())
    assert found.values == dict(PLANT.values)
    assert np.isfinite(found.cost)
