"""A plant that moves away by itself is simulated for a few times of its growth; its model is none that stands."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.diagnose.proof.simulation import windows_of
from hoopd.diagnose.proof.written_parameters import written_parameters
from hoopd.plants import growth as growth_module
from hoopd.plants.growth import growth, growth_sentence, window_of
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.registry import plant_named

UPRIGHT = """
schema: hoopd.plant/1
name: upright
coordinates: {a: {unit: rad, usual: 0.1, usual_rate: 0.2}}
inputs: {T: {unit: N m, limit: 5}}
parameters:
  I: {value: 0.02, unit: kg m2, bounds: [1.0e-4, 1]}
  k: {value: 0.7, unit: N m, bounds: [0, 100]}
  c: {value: 0.01, unit: N m s, bounds: [0, .inf]}
equations:
  a: I*a'' = T + k*sin(a) - c*a'
channels: {a: {reads: a, sensor: encoder}}
sample_time_s: 0.02
"""
PLANT = parse_plant(UPRIGHT, "upright.yaml")
TRUE = {"I": 0.021, "k": 0.66, "c": 0.012}
PARTS = 20


def recorded(seed: int) -> Stretch:
    """Held upright by a state feedback with a small delay's worth of noise, and shaken."""
    random, n = np.random.default_rng(seed), 1001
    t, h = np.arange(n) * 0.02, 0.02 / PARTS
    u, y = np.zeros(n - 1), np.zeros(n)
    a = v = push = 0.0
    for k in range(n - 1):
        if k % 20 == 0:
            push = float(random.uniform(-0.15, 0.15))
        u[k] = push - 2.0 * y[k] - 0.25 * v
        for _ in range(PARTS):
            force = 2e-3 * float(random.normal()) / np.sqrt(h / 0.02)
            middle = v + h / 2.0 * (u[k] + force + TRUE["k"] * np.sin(a) - TRUE["c"] * v) / TRUE["I"]
            half = a + h / 2.0 * v
            a, v = a + h * middle, v + h * (u[k] + force + TRUE["k"] * np.sin(half) - TRUE["c"] * middle) / TRUE["I"]
        y[k + 1] = a + 1e-3 * float(random.normal())
    return stretch_of(f"day{seed}", PLANT, t, u, {"a": (np.arange(n), y)})


def test_the_fastest_motion_that_grows_is_that_of_the_linear_plant() -> None:
    inertia, stiffness, drag = 0.02, 0.7, 0.01
    root = (-drag + np.sqrt(drag**2 + 4.0 * inertia * stiffness)) / (2.0 * inertia)
    assert growth(PLANT) == pytest.approx(root, rel=1e-9)
    assert window_of([PLANT]) == pytest.approx(3.0 / root)
    assert f"every {1.0 / root:.2g} s" in growth_sentence([PLANT])


def test_what_hangs_or_hardly_moves_away_has_windows_of_its_motion() -> None:
    hanging = parse_plant(UPRIGHT.replace("T + k*sin(a)", "T - k*sin(a)"), "hanging.yaml")
    slowly = parse_plant(UPRIGHT.replace("k: {value: 0.7", "k: {value: 1.0e-7"), "slowly.yaml")
    for plant in (hanging, slowly, *(plant_named(name) for name in ("hoop", "pendulum", "axis", "falling", "tanks"))):
        assert growth(plant) == 0.0 and growth_sentence([plant]) == ""
    assert window_of([hanging]) == pytest.approx(2.0 * 5.0)
    assert window_of([hanging, PLANT]) == window_of([PLANT])


def test_windows_of_a_recording_are_as_long_as_is_said() -> None:
    windows = windows_of(recorded(1))
    assert windows.length == pytest.approx(1 + window_of([PLANT]) / 0.02, abs=2)


def test_a_model_of_what_falls_is_written_with_its_own_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    train = [recorded(1), recorded(2)]
    found = fit(train, (), dict(PLANT.values))
    written = written_parameters(found, PLANT.values).fit.values
    for name in ("I", "k"):
        assert written[name] == pytest.approx(TRUE[name], rel=0.1)
    # in windows of many times of its growth what simulates best is a plant that stands
    monkeypatch.setattr(growth_module, "growth", lambda plant: 0.0)
    assert written_parameters(found, PLANT.values).fit.values["k"] > 2.0 * TRUE["k"]
