"""What a registered plant leaves out is named: a plant file is all that the search is told."""

from __future__ import annotations

import numpy as np
import pytest
from samples import sampled

from hoopd.diagnose.curves.effect_force import missing_of
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.library import library
from hoopd.plants.free_run import FreeRun
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.registry import plant_named

NOISE = 1e-3  # of each reading's range
MOTOR = """
schema: hoopd.plant/1
name: motor
coordinates: {phi: {unit: rad, usual: 10, usual_rate: 50}}
states: {i: {unit: A, usual: 1}}
inputs: {V: {unit: V, limit: 24, usual: 10}}
parameters:
  J: 1e-3 kg m2
  b: 1e-3 N m s
  k: {value: 0.1, unit: N m/A, held: true}
  L: {value: 5e-3, unit: H, held: true}
  R: 1 ohm
equations:
  phi: J*phi'' = k*i - b*phi'
  i: L*i' = V - R*i - k*phi'
channels: {phi: phi, speed: "phi'", i: {reads: i, sensor: shunt}}
sample_time_s: 2e-3
"""


def recorded(plant: Plant, effect: str, values: dict[str, float], seed: int, size: float, count: int) -> Stretch:
    """Levels of the input held for 20 samples, and what the sensors show of a plant that has the effect."""
    random, t = np.random.default_rng(seed), np.arange(count) * plant.time_scale_s
    levels = random.choice([-1.0, -0.5, 0.0, 0.5, 1.0], (count // 20 + 1, len(plant.inputs)))
    u = size * np.repeat(levels, 20, axis=0)[: count - 1]
    keys = {f"{effect}.{name}": value for name, value in values.items()}
    if plant.name == "tanks":  # what fills them never flows back
        u = np.abs(u)
    if len(plant.inputs) == 1:
        u = u[:, 0]
    start = [0.5 * plant.scales.get(name, 0.0) if name in plant.first_order else 0.0 for name in plant.states]
    y = FreeRun(plant, (library(plant)[effect],), values=keys).run([], start, t, u).readings
    y = y + NOISE * np.ptp(y, axis=0) * random.normal(size=y.shape)
    return stretch_of("made", plant, t, u, {c: (np.arange(count), y[:, i]) for i, c in enumerate(plant.channels)})


def searched(plant: Plant, effect: str, values: dict[str, float], size: float, count: int) -> Named:
    train = [recorded(plant, effect, values, 1, size, count)]
    nominal = fit(train, (), dict(plant.values), move=False)
    base = fit(train, (), dict(plant.values), like=nominal, noise=nominal.noise)
    return name_effects(train, library(plant), nominal, base)


def test_dry_friction_of_the_axis_is_named() -> None:
    judge_axis("body.coulomb_friction", {"Fc": 10.0})


@pytest.mark.proof
def test_a_lag_of_the_axis_s_drive_is_named() -> None:
    judge_axis("actuator.lag", {"T": 0.01})


def judge_axis(effect: str, values: dict[str, float]) -> None:
    found = searched(plant_named("axis"), effect, values, 60.0, 2000)
    assert [one.effect.name for one in found.accepted] == [effect]
    for name, value in values.items():
        assert found.final.values[f"{effect}.{name}"] == pytest.approx(value, rel=0.05)
    assert found.final.values["M"] == pytest.approx(100.0, rel=0.02)


@pytest.mark.proof
def test_a_motor_with_its_current_is_searched() -> None:
    """A coordinate beside a first-order state: an odd number of states."""
    effect = "body.coulomb_friction"
    found = searched(parse_plant(MOTOR, "motor.yaml"), effect, {"Fc": 0.02}, 10.0, 600)
    assert effect in [one.effect.name for one in found.accepted]
    assert found.final.values[f"{effect}.Fc"] == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize(
    ("effect", "values"), [("h1_sensor.offset", {"d": 0.02}), ("h2_store.overflow", {"k": 0.05, "x0": 0.08})]
)
def test_what_the_tanks_leave_out_is_named(effect: str, values: dict[str, float]) -> None:
    judge_tanks(effect, values)


@pytest.mark.proof
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("h1_store.leak", {"k": 2e-3}),
        ("h1_store.varying_section", {"b": 1.0}),
        ("h2_store.constant_flow", {"c": -3e-4}),
        ("actuator.deadzone", {"d": 4e-6}),
    ],
)
def test_whatever_the_tanks_leave_out_is_named(effect: str, values: dict[str, float]) -> None:
    judge_tanks(effect, values)


def judge_tanks(effect: str, values: dict[str, float]) -> None:
    found = searched(plant_named("tanks"), effect, values, 1e-4, 400)
    assert [one.effect.name for one in found.accepted] == [effect]
    for name, value in values.items():
        assert found.final.values[f"{effect}.{name}"] == pytest.approx(value, rel=0.1)
    # what is drawn has the state's units, wherever the effect sits
    shown = missing_of(library(plant_named("tanks"))[effect], found.final, found.base.noise, "made")
    assert shown is not None and shown.unit == ("m" if "sensor" in effect else "m/s")
    assert {one.unit for one in shown.variables} <= {"m", "m3/s"}


def test_nothing_is_named_where_nothing_is_missing() -> None:
    found = searched(plant_named("tanks"), "h1_store.leak", {"k": 0.0}, 1e-4, 400)
    assert not found.accepted


@pytest.mark.parametrize("value", sampled([60.0, 0.0], [60.0]))
def test_a_coil_that_saturates_is_named_from_the_voltage_of_the_capacitor(value: float) -> None:
    """The current is a state that nobody reads."""
    effect = "i_store.inductor_saturation"
    found = searched(plant_named("circuit"), effect, {"b": value}, 8.0, 600)
    assert [one.effect.name for one in found.accepted] == [effect] * (value > 0.0)
    if value > 0.0:
        assert found.final.values[f"{effect}.b"] == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize("value", [0.01, 0.0])
def test_dry_friction_of_one_of_two_coupled_drives_is_named(value: float) -> None:
    """Two inputs; the angle of both together is read by nobody."""
    effect = "a_body.coulomb_friction"
    found = searched(plant_named("drives"), effect, {"Fc": value}, 0.2, 400)
    assert [one.effect.name for one in found.accepted] == [effect] * (value > 0.0)
    if value > 0.0:
        assert found.final.values[f"{effect}.Fc"] == pytest.approx(value, rel=0.1)
