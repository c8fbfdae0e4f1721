"""Free runs of many windows and many parameters at once, against one run at a time."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hoopd.diagnose.proof import simulation
from hoopd.diagnose.proof.fit_tables import channel_source, nrmse, start_weights
from hoopd.diagnose.proof.simulation import Simulator, Windows, bounded, fitted_starts, windows_of
from hoopd.diagnose.proof.window_comparison import channel_weights
from hoopd.diagnose.proof.worse_channels import lowered
from hoopd.diagnose.quality.sensor_samples import _constant
from hoopd.diagnose.search.screen import orthonormal
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.grammar.mechanisms import mechanism_named
from hoopd.plants.effects.library import library
from hoopd.plants.free_run import FreeRun
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.plant_file import parse_plant
from tests.diagnose.madeup import shipped_plant, stretch_with

PLANT = shipped_plant()
EFFECTS = [library(PLANT)[name] for name in ("camera.latency", "actuator.delay", "hoop.coulomb_friction")]
VALUES = {**PLANT.values, "camera.latency.d": 0.03, "actuator.delay.d": 0.004, "hoop.coulomb_friction.Fc": 0.004}
OTHER = {**VALUES, "camera.latency.d": 0.011, "actuator.delay.d": 0.009, "L1": 500.0}


def test_each_column_has_its_own_parameters() -> None:
    windows = windows_of(stretch_with(PLANT, "a", 1, 6.0), 2.0)
    simulator, start = Simulator(windows, EFFECTS), np.zeros((4, 3, 2))
    start[2] = 0.3
    both = simulator.run([VALUES, OTHER], start)
    seen = simulator.readings([VALUES, OTHER], both)
    for column, values in enumerate((VALUES, OTHER)):
        alone = simulator.run(values, start[:, :, :1])
        np.testing.assert_allclose(both[..., column], alone[..., 0], atol=1e-12)
        np.testing.assert_allclose(seen[..., column], simulator.readings(values, alone)[..., 0], atol=1e-12)
    assert np.max(np.abs(seen[..., 0] - seen[..., 1])) > 0.01


def test_windows_hold_every_reading_once() -> None:
    stretch = stretch_with(PLANT, "a", 2, 7.3)
    for length in (2.0, None):
        windows = windows_of(stretch, length)
        assert np.isfinite(windows.y).sum() == np.isfinite(stretch.y).sum()


def test_the_true_model_repeats_its_own_data() -> None:
    friction, values = EFFECTS[2:], {**PLANT.values, "hoop.coulomb_friction.Fc": 0.006}
    stretch = stretch_with(PLANT, "a", 3, 8.0, friction, values, torque=0.05)
    run = fitted_starts(windows_of(stretch), friction, values, Track(stretch).z, start_weights(stretch))
    without = fitted_starts(windows_of(stretch), (), PLANT.values, Track(stretch).z, start_weights(stretch))
    assert nrmse([run])["theta_rate"] > nrmse([without])["theta_rate"] + 5.0
    assert nrmse([run])["psi"] > 90.0


def test_what_a_mechanism_remembers_begins_a_window_as_it_is_and_is_not_fitted() -> None:
    effect = mechanism_named(PLANT, "actuator.hesitation_of_u")
    assert effect is not None
    values = {**PLANT.values, effect.key("A"): 0.8, effect.key("v0"): 0.05}
    stretch = stretch_with(PLANT, "a", 3, 4.0)
    reference = np.column_stack([Track(stretch).z, 0.01 * np.arange(len(stretch.t))])
    windows = windows_of(stretch)
    found = fitted_starts(windows, (effect,), values, reference, start_weights(stretch))
    assert np.array_equal(found.start[4], reference[windows.first, 4])
    assert not np.array_equal(found.start[:4], reference[windows.first, :4].T)


def test_a_slipping_ball_begins_a_window_as_the_readings_have_it() -> None:
    slip = library(PLANT)["ball.slip"]
    values = {**PLANT.values, slip.key("mu"): 0.05}
    stretch = stretch_with(PLANT, "a", 3, 4.0, torque=0.05)
    still = np.zeros((len(stretch.t), 2))
    reference = np.column_stack([Track(stretch).z[:, :4], still])
    found = fitted_starts(windows_of(stretch), (slip,), values, reference, start_weights(stretch))
    assert np.any(found.start[4:])


class Bent:
    """One state that is read as its arc tangent: a full step from beyond 1.4 leads further away."""

    def __init__(self, windows: Windows, effects: object) -> None:
        self.composite = SimpleNamespace(nx=1, plant=Plant("bent", first_order=("x",), rates=lambda s: s.x))

    def run(self, values: object, start: np.ndarray) -> np.ndarray:
        return start[None]

    def readings(self, values: object, states: np.ndarray) -> np.ndarray:
        return np.arctan(states)


def test_a_step_that_led_away_is_halved_from_the_best_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation, "Simulator", Bent)
    windows = Windows(stretch_with(PLANT, "a", 1, 1.0), np.array([0, 1]), np.array([1, 1]), np.zeros((1, 1, 2)))
    reference = np.array([[1.5], [0.5]])  # the second window's step does not lead away
    found = fitted_starts(windows, (), PLANT.values, reference, np.ones(1))
    assert np.abs(found.start).max() < 0.01


VESSEL = """
schema: hoopd.plant/1
name: vessel
states: {P: {unit: Pa}}
inputs: {q: {unit: Pa/s}}
parameters: {k: 0.2 1/s}
equations: {P: P' = q - k*P}
sample_time_s: 0.1
"""


@pytest.mark.parametrize("size", [1.0, 3e6, 1e-12])
def test_the_true_model_of_a_vessel_repeats_its_data_however_large_its_numbers_are(size: float) -> None:
    """A few million pascal are a vessel like others, and a few picoampere a current."""
    plant, t = parse_plant(VESSEL, "vessel.yaml"), 0.1 * np.arange(300)
    inflow = size * np.repeat(np.random.default_rng(1).uniform(0.0, 1.0, 15), 20)[:-1]
    y = FreeRun(plant).run([], [0.0], t, inflow).readings
    stretch = Stretch("a", plant, t, inflow, y)
    run = fitted_starts(windows_of(stretch), (), plant.values, y.copy(), start_weights(stretch))
    assert nrmse([run])["P"] == pytest.approx(100.0, abs=1e-3)
    assert channel_weights([stretch])[0] > 0.0
    base: Any = SimpleNamespace(by_recording=lambda: {"a": [run]})
    worse: Any = SimpleNamespace(by_recording=lambda: {"a": [replace(run, y=run.y + 0.1 * size)]})
    gone: Any = SimpleNamespace(by_recording=lambda: {"a": [replace(run, y=np.full_like(run.y, np.nan))]})
    assert lowered(base, base) == {} and lowered(base, worse)["P"] > 1.0
    assert lowered(base, gone)["P"] > 1e6  # what is no number any more is no better than what is wrong
    assert not _constant(y[:, 0]) and _constant(np.full(9, 3.0 * size)) and _constant(np.zeros(9))


def test_numbers_of_a_simulation_are_bounded_by_what_moves() -> None:
    y = np.array([[1e9, np.nan, -np.inf, 2.0]])
    assert np.array_equal(bounded(y, np.ones((1, 1))), [[1e6, 1e3, -1e6, 2.0]])
    assert np.array_equal(bounded(y, np.full((1, 1), 1e4)), [[1e9, 1e7, -1e10, 2.0]])


def test_what_is_known_of_parameters_does_not_depend_on_their_units() -> None:
    x = np.random.default_rng(0).normal(size=(50, 2)) * [1.0, 1e-12]
    assert orthonormal(x).shape[1] == 2 and orthonormal(x * [1.0, 0.0]).shape[1] == 1


def test_a_rate_that_is_no_rate_is_said_to_be_replaced() -> None:
    stretch = stretch_with(PLANT, "a", 4, 3.0)
    assert channel_source([stretch]) == {}
    blind = stretch.without(np.ones(len(stretch.t), bool), ["dtheta"])
    assert list(channel_source([blind])) == ["dtheta"]
