"""A thermometer that follows what it measures with a time constant: found as that, not as a reading that is late."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.diagnose.search.naming import name_effects
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant

PLATE = parse_plant(
    """
schema: hoopd.plant/1
name: plate
states: {T: {unit: K, usual: 60}}
inputs: {P: {unit: W, limit: 120}}
parameters:
  C: {value: 200, unit: J/K, bounds: [10, 5000]}
  h: {value: 0.5, unit: W/K, bounds: [0, 50]}
equations:
  T: C*T' = P - h*T
channels: {T: {reads: T, sensor: tc}}
sample_time_s: 2
""",
    "plate.yaml",
)
C, H, LAG_S, NOISE = 212.0, 0.54, 30.0, 0.05  # J/K, W/K, s, K
PARTS = 20


def recorded(seed: int) -> Stretch:
    """Powers of random levels, by small steps of both equations."""
    random, n = np.random.default_rng(seed), 600
    t, h = np.arange(n) * 2.0, 2.0 / PARTS
    u = np.repeat(random.uniform(0.0, 80.0, n // 40 + 1), 40)[: n - 1]
    warm = shown = 0.0
    y = np.zeros(n)
    for k in range(n - 1):
        for _ in range(PARTS):
            middle = warm + h / 2.0 * (u[k] - H * warm) / C
            shown += h * (middle - shown - h / 2.0 * (middle - shown) / LAG_S) / LAG_S
            warm += h * (u[k] - H * middle) / C
        y[k + 1] = shown
    return stretch_of(f"day{seed}", PLATE, t, u, {"T": (np.arange(n), y + NOISE * random.normal(size=n))})


def test_a_thermometer_that_follows_slowly_is_found_with_its_time() -> None:
    train = [recorded(1), recorded(2)]
    nominal = fit(train, (), PLATE.values, move=False)
    base = fit(train, (), PLATE.values, like=nominal, noise=nominal.noise)
    found = name_effects(train, library(PLATE), nominal, base)
    assert found.final.names == ("tc.lag",)
    assert found.final.values["tc.lag.T"] == pytest.approx(LAG_S, rel=0.03)
    assert found.final.values["C"] == pytest.approx(C, rel=0.02)


def test_a_slow_sensor_of_several_states_is_slow_in_all_of_them() -> None:
    text = """
schema: hoopd.plant/1
name: plates
states: {T1: {unit: K, usual: 60}, T2: {unit: K, usual: 40}}
inputs: {P: {unit: W, limit: 120}}
parameters: {C: 200 J/K, h: 0.5 W/K}
equations: {T1: C*T1' = P - h*(T1 - T2), T2: C*T2' = h*(T1 - T2)}
channels: {T1: {reads: T1, sensor: tc}, T2: {reads: T2, sensor: tc}}
sample_time_s: 2
"""
    assert library(parse_plant(text, "plates.yaml"))["tc.lag"].sensor_lag == {"T1": "T", "T2": "T"}
