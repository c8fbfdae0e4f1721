"""A plant that moves away by itself is simulated for a few times of its growth; its model is none that stands."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.diagnose.proof import window_lengths
from hoopd.diagnose.proof.simulation import windows_of
from hoopd.diagnose.proof.window_lengths import growth_of, growth_sentence, window_of
from hoopd.diagnose.proof.written_parameters import written_parameters
from hoopd.plants.declaration import Plant
from hoopd.plants.growth import growth
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.recorded_sizes import with_recorded_sizes
from hoopd.plants.registry import plant_named
from hoopd.recording.recording import from_signals

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
MAGNET = """
schema: hoopd.plant/1
name: magnet
coordinates: {z: {unit: m, usual: 0.01, usual_rate: 0.1}}
inputs: {i: {unit: A, limit: 3}}
parameters:
  m: {value: 0.06, unit: kg}
  C: {value: 6.5e-5, unit: N m2/A2}
  g: {value: 9.81, unit: m/s2, held: true}
equations:
  z: m*z'' = m*g - C*i^2/z^2
channels: {z: {reads: z, sensor: laser}}
sample_time_s: 0.002
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
        assert growth_of(plant) == 0.0 and growth_sentence([plant]) == ""
    assert window_of([hanging]) == pytest.approx(2.0 * 5.0)
    assert window_of([hanging, PLANT]) == window_of([PLANT])


def around(plant: Plant, place: float, force: float = 0.0) -> Plant:
    """As a diagnosis knows it of recordings about this place."""
    t, (q,), (given,) = np.arange(0.0, 8.0, 0.02), plant.coordinates, plant.inputs
    signals = {q: place + 1e-4 * np.sin(t)}, {given.name: np.full(t.size, force)}
    return with_recorded_sizes(plant, [from_signals(t, signals[1], signals[0])])


def test_it_is_looked_at_where_it_was_recorded() -> None:
    # upright at zero, and hanging in all recordings
    assert growth(around(PLANT, 0.0)) == pytest.approx(growth(PLANT), rel=1e-3)
    assert growth(around(PLANT, np.pi)) == 0.0 and growth_sentence([around(PLANT, np.pi)]) == ""
    # a ball under a magnet: nothing pulls without a current, and there is no place zero
    magnet = parse_plant(MAGNET, "magnet.yaml")
    held = 0.01 * np.sqrt(0.06 * 9.81 / 6.5e-5)
    assert growth(magnet) == 0.0
    assert growth(around(magnet, 0.01, held)) == pytest.approx(np.sqrt(2.0 * 9.81 / 0.01), rel=0.01)


@pytest.mark.parametrize("stiffness", [40.0, 2000.0, 2.0e5])
def test_no_window_is_too_short_to_see_anything(stiffness: float) -> None:
    fast = parse_plant(
        UPRIGHT.replace("k: {value: 0.7, unit: N m, bounds: [0, 100]}", f"k: {{value: {stiffness}, unit: N m}}"),
        "fast.yaml",
    )
    n = 501
    still = stretch_of("day", fast, np.arange(n) * 0.02, np.zeros(n - 1), {"a": (np.arange(n), np.zeros(n))})
    readings = np.isfinite(windows_of(still).y).sum(axis=(0, 1))
    assert readings.min() >= 7
    assert "sampled too rarely" in growth_sentence([fast]) and "too rarely" not in growth_sentence([PLANT])


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
    monkeypatch.setattr(window_lengths, "growth", lambda plant: 0.0)
    assert written_parameters(found, PLANT.values).fit.values["k"] > 2.0 * TRUE["k"]
