"""A drive's gain is looked for where no parameter of the plant does the same: it explains what a scale does."""

from __future__ import annotations

import numpy as np
import pytest
from diagnose.madeup import shipped_plant

from hoopd.diagnose.search.screen import Screen
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.library import library
from hoopd.plants.free_run import FreeRun
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant

# A converter whose input is the share of the time that it is on; with the coil's current and the output's voltage read.
CONVERTER = """
schema: hoopd.plant/1
name: converter
states: {i: {unit: A, usual: 3}, v: {unit: V, usual: 12}}
inputs: {d: {unit: "-", limit: 1}}
parameters:
  V: {value: 24, unit: V, held: true}
  L: {value: 2.2e-4, unit: H}
  C: {value: 1.0e-4, unit: F}
  R: {value: 5, unit: ohm}
  r: {value: 0.15, unit: ohm, bounds: [0, 10]}
equations:
  i: L*i' = d*V - r*i - v
  v: C*v' = i - v/R
channels: {i: CURRENT, v: {reads: v, sensor: voltmeter}}
sample_time_s: 2.0e-5
"""
GAIN, SCALE = "actuator.torque_gain", "voltmeter.scale"


def converter(current: str) -> Plant:
    return parse_plant(CONVERTER.replace("i: CURRENT, ", current), "converter.yaml")


def recorded(plant: Plant, gain: float) -> Stretch:
    random, n = np.random.default_rng(5), 1200
    t, d = np.arange(n) * 2e-5, np.repeat(random.choice([0.3, 0.4, 0.5, 0.6, 0.7], n // 50), 50)
    y = FreeRun(plant, values=plant.values).run([], [0.0, 0.0], t, gain * d[:-1]).readings
    y = y + 0.01 * random.normal(size=y.shape)
    return stretch_of("one", plant, t, d[:-1], {c: (np.arange(n), y[:, k]) for k, c in enumerate(plant.channels)})


def gains(plant: Plant, gain: float) -> dict[str, float]:
    """Nats of the drive's gain and of the voltmeter's scale beside the re-fitted plant."""
    every = library(plant)
    found = fit([recorded(plant, gain)], (), plant.values, free=("L", "C", "R", "r"))
    scores = Screen(found, [every[name] for name in (GAIN, SCALE)]).scores()
    return {one.member.effect.name: one.gain for one in scores}


def test_it_is_no_name_of_a_plant_that_has_it_among_its_parameters() -> None:
    assert library(shipped_plant())[GAIN].found_by == "base"
    assert library(converter("i: i, "))[GAIN].found_by == "screen"


def test_where_two_sensors_tell_it_it_explains_what_a_scale_does() -> None:
    found = gains(converter("i: i, "), 1.03)
    assert found[GAIN] > 50.0
    assert found[GAIN] == pytest.approx(found[SCALE], rel=0.02)
    assert max(gains(converter("i: i, "), 1.0).values()) < 5.0


def test_where_parameters_do_the_same_it_explains_nothing() -> None:
    assert gains(converter(""), 1.03)[GAIN] < 5.0
