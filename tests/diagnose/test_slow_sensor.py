"""A thermometer that follows what it measures with a time constant: found as that, not as a reading that is late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.diagnose.proof.simulation import Simulator, fitted_starts, windows_of
from hoopd.diagnose.search.naming import name_effects
from hoopd.plants.effects.library import library
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.fits.plant_simulation import simulate_plant
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant
from hoopd.recording.recording import Signal, from_signals

Array = NDArray[np.float64]

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


HEATER = parse_plant(
    """
schema: hoopd.plant/1
name: heater
states: {T: {unit: degC, usual: 50}}
inputs: {duty: {unit: "%", limit: 100}}
parameters:
  C: {value: 100, unit: J/K, bounds: [1, 1000]}
  h: {value: 0.8, unit: W/K, bounds: [0.01, 10]}
  P: {value: 0.8, unit: "W/%", held: true}
  Ta: {value: 22.5, unit: degC, held: true}
equations:
  T: C*T' = P*duty - h*(T - Ta)
sample_time_s: 4
""",
    "heater.yaml",
)
TRUTH = {"C": 120.0, "h": 0.9, "P": 0.8, "Ta": 22.5, "t_sensor.lag.T": 20.0}
SPREAD = 0.085  # degC, of the noise and the steps of 0.1


def heated(seed: int, n: int = 900, lag_s: float = 20.0) -> tuple[Array, Array, Array]:
    """t, duty and readings of a warm-up by levels, exact between the rows: two first-order lags in a row."""
    random = np.random.default_rng(seed)
    t, a, b = np.arange(n) * 4.0, TRUTH["h"] / TRUTH["C"], 1.0 / lag_s
    duty = np.repeat(random.choice([0.0, 20.0, 40.0, 60.0, 80.0, 100.0], n // 45 + 1), 45)[:n]
    warm, shown, out = 23.0, 23.0, []
    for level in duty:
        out.append(shown)
        rest = TRUTH["Ta"] + TRUTH["P"] * level / TRUTH["h"]
        off, slow, fast = warm - rest, np.exp(-4.0 * a), np.exp(-4.0 * b)
        shown = rest + (shown - rest) * fast + off * b / (b - a) * (slow - fast)
        warm = rest + off * slow
    return t, duty, np.round(np.array(out) + 0.08 * random.normal(size=n), 1)


def heated_stretch(seed: int) -> Stretch:
    t, duty, y = heated(seed)
    return stretch_of(f"day{seed}", HEATER, t, duty[:-1], {"T": (np.arange(len(t)), y)})


def test_a_drives_lag_that_does_nearly_the_same_is_tried_beside_the_sensors() -> None:
    train = [heated_stretch(104), heated_stretch(204)]
    nominal = fit(train, (), HEATER.values, move=False)
    base = fit(train, (), HEATER.values, like=nominal, noise=nominal.noise)
    found = name_effects(train, library(HEATER), nominal, base)
    assert {"t_sensor.lag", "actuator.lag"} <= {one.effect.name for one in found.tried}
    assert found.final.names == ("t_sensor.lag",)
    assert found.final.values["t_sensor.lag.T"] == pytest.approx(20.0, rel=0.01)


def test_a_run_that_begins_while_a_sensor_lags_is_as_good_as_its_noise() -> None:
    effect = library(HEATER)["t_sensor.lag"]
    t, duty, y = heated(1)
    part = slice(200, 320)
    recording = from_signals(
        t[part], {"duty": Signal(duty[part], t[part], "%")}, {"T": Signal(y[part], t[part], "degC")}, source="part"
    )
    run = simulate_plant(PlantSystem(HEATER, (effect,), TRUTH), recording)
    assert run.percent["T"].rmse < 1.1 * SPREAD
    stretch = heated_stretch(1)
    z = Track(stretch).z
    windows = fitted_starts(windows_of(stretch, 2.0), (effect,), TRUTH, z, np.array([SPREAD]))
    assert len(windows.windows.first) > 5
    assert np.sqrt(np.nanmean((windows.y - windows.windows.y)[:, 0] ** 2)) < 1.1 * SPREAD


def test_a_lag_begins_where_its_sensor_reads_less_what_is_added_to_that() -> None:
    effects = [library(HEATER)[name] for name in ("t_sensor.lag", "t_sensor.offset")]
    values = {**TRUTH, effects[1].key(effects[1].parameters[0].name): 5.0}
    stretch = heated_stretch(1)
    shifted = replace(stretch, y=stretch.y + 5.0, every=stretch.y + 5.0)
    windows = fitted_starts(windows_of(shifted, 2.0), effects, values, Track(stretch).z, np.array([SPREAD]))
    assert np.sqrt(np.nanmean((windows.y - windows.windows.y)[:, 0] ** 2)) < 1.1 * SPREAD


@pytest.mark.parametrize("name", ["", "actuator.torque_gain"])
def test_what_lags_behind_a_drive_begins_a_window_with_the_demands_before(name: str) -> None:
    effect = [library(HEATER)["actuator.lag"], *([library(HEATER)[name]] if name else [])]
    stretch = heated_stretch(1)
    values = {**TRUTH, "actuator.lag.T": 100.0}
    if name:
        values[effect[1].key(effect[1].parameters[0].name)] = 0.7
    simulator = Simulator(windows_of(stretch, 2.0), effect)
    whole = Simulator(windows_of(stretch, None), effect)
    along = whole.run(values, np.full((1, 1, 1), 23.0))[:, 1, 0, 0]
    begun = simulator.run(values, np.full((1, len(simulator.windows.first), 1), 23.0))[0, 1, :, 0]
    np.testing.assert_allclose(begun, along[simulator.windows.first], atol=1e-9)
