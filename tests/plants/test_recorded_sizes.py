"""Usual sizes that a declaration leaves out are those of the recordings, in whatever unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.library import library
from hoopd.plants.fingerprint import fingerprint
from hoopd.plants.found_effects import EffectError, checked
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.recorded_sizes import undeclared_sizes, with_recorded_sizes
from hoopd.plants.registry import plant_named
from hoopd.plants.scales import motion_scale
from hoopd.recording.recording import Recording, from_signals

CART = """
schema: hoopd.plant/1
name: cart
coordinates: {x: {unit: m}}
states: {T: {unit: K}}
inputs: {F: {unit: N}}
parameters: {m: 2 kg, k: 0.1 1/s}
equations: {x: "m*x'' = F", T: "T' = -k*T"}
channels: {x: {reads: x, sensor: ruler}, T: {reads: T, sensor: probe}}
sample_time_s: 0.02
"""
PLANT = parse_plant(CART, "cart.yaml")


def recorded(by: float = 1.0, noise: float = 0.0, seconds: float = 20.0) -> Recording:
    """3 sin 4t and a level of 40, both times `by`."""
    t, random = np.arange(0.0, seconds, 0.02), np.random.default_rng(1)
    x = 3.0 * np.sin(4.0 * t) + noise * random.normal(size=t.size)
    return from_signals(t, {"F": by * np.sign(np.sin(t))}, {"x": by * x, "T": np.full(t.size, 40.0 * by)})


@pytest.mark.parametrize("by", [1e-9, 1.0, 1e6])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_sizes_and_rates_are_those_of_the_motion_and_noise_is_no_motion(by: float, noise: float) -> None:
    found = with_recorded_sizes(PLANT, [recorded(by, noise)])
    assert undeclared_sizes(PLANT) == ("F", "x", "T") and undeclared_sizes(found) == ()
    expected = {"F": by, "x": 3.0 * by, "T": 40.0 * by, "dx": 12.0 * by}
    assert found.scales == pytest.approx(expected, rel=0.15)
    assert found.recorded == {*expected} and not PLANT.recorded
    assert {one.speed for one in found.slots.values() if one.coordinate == "x"} == {found.scales["dx"]}
    assert motion_scale(found) == pytest.approx(2.5, rel=0.15)  # a radian of the sine in 0.25 s


def test_the_largest_of_several_recordings_counts_and_what_is_missing_does_not() -> None:
    small, large = recorded(0.1), recorded()
    holes = large.channels["x"].values.copy()
    holes[::3] = np.nan
    found = with_recorded_sizes(PLANT, [small, large.replaced(x=holes)])
    assert found.scales["x"] == pytest.approx(3.0, rel=0.05) and found.scales["dx"] == pytest.approx(12.0, rel=0.15)


def test_what_is_declared_stays_and_what_never_moves_says_nothing() -> None:
    said = replace(PLANT, scales={"x": 0.5, "T": 7.0, "F": 2.0})
    assert fingerprint(with_recorded_sizes(said, [recorded()])) == fingerprint(said)
    still = from_signals(np.arange(9) * 0.02, {"F": np.zeros(9)}, {"x": np.full(9, 2.0), "T": np.zeros(9)})
    assert fingerprint(with_recorded_sizes(PLANT, [still])) == fingerprint(PLANT)
    assert with_recorded_sizes(PLANT, [still]).middles == {"F": 0.0, "x": 2.0, "T": 0.0}
    for name in ("hoop", "pendulum", "axis", "tanks", "falling", "circuit", "drives"):
        assert undeclared_sizes(plant_named(name)) == ()


def test_an_angle_that_goes_round_is_usual_at_a_radian() -> None:
    turning = parse_plant(
        CART.replace("unit: m}", "unit: rad}").replace("unit: N}", "unit: N m}").replace("2 kg", "2 kg m2"),
        "turns.yaml",
    )
    t = np.arange(0.0, 20.0, 0.02)
    found = with_recorded_sizes(turning, [from_signals(t, {"F": np.ones(t.size)}, {"x": 5.0 * t, "T": t})])
    assert found.scales["x"] == 1.0 and found.scales["dx"] == pytest.approx(5.0 * np.pi / 2, rel=0.05)


def test_a_number_beyond_ranges_that_nobody_declared_is_refused_by_its_sign_alone() -> None:
    name, size = "x_body.coulomb_friction", 1e5
    name = name if name in library(PLANT) else "body.coulomb_friction"
    assert checked(PLANT, name, {"Fc": size}) == {"Fc": size}
    with pytest.raises(EffectError, match="0 to inf"):
        checked(PLANT, name, {"Fc": -1.0})
    declared: Plant = replace(PLANT, scales={"x": 3.0, "dx": 12.0, "T": 40.0, "F": 1.0})
    with pytest.raises(EffectError, match="must be"):
        checked(declared, name, {"Fc": size})
