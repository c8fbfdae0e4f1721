"""What a filter's innovations are while the device is as its model says."""

from __future__ import annotations

from hoopd.core.estimator import EkfSettings
from hoopd.design.innovation_levels import innovation_levels
from hoopd.files.shipped import defaults_folder
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.loop.writeback import filter_plant
from hoopd.plants.model_file import load_model

MODEL = load_model(defaults_folder() / "models" / "hoop.yaml")


def levels(*effects: FoundEffect) -> dict[str, list[float]]:
    plant = filter_plant(FoundEffects(MODEL.structure, MODEL.values(), effects))
    return innovation_levels(plant, EkfSettings(), 0.05, 0.02)


def test_a_hoop_that_is_held_leaves_white_innovations_no_larger_than_those_of_motion() -> None:
    moving, held = levels(), levels(FoundEffect("hoop.coulomb_friction", {"Fc": 0.006}))
    assert 0.9 < held["dtheta"][0] / moving["dtheta"][0] < 1.1
    # differences of noise while it moves, the noise itself while it rests
    assert 1.5 < held["dtheta"][1] / moving["dtheta"][1] < 2.5
