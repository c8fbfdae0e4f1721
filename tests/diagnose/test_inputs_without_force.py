"""Laws of a drive whose input is no force on a coordinate: a current, a voltage, a flow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import name_effects
from hoopd.files.reading import InputError
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.registry import plant_named

MOTOR = parse_plant(
    """
schema: hoopd.plant/1
name: motor
coordinates: {th: {unit: rad, usual: 20, usual_rate: 30}}
inputs: {i: {unit: A, limit: 2}}
parameters:
  J: {value: 2.0e-4, unit: kg m2, bounds: [1.0e-6, 1.0e-2]}
  b: {value: 1.0e-3, unit: N m s, bounds: [0, .inf]}
  kt: {value: 0.05, unit: N m/A, held: true}
equations:
  th: J*th'' = kt*i - b*th'
channels: {th: {reads: th, sensor: encoder}, w: {reads: th', sensor: tacho}}
sample_time_s: 0.01
""",
    "motor.yaml",
)
J, B, KT = 1.94e-4, 1.05e-3, 0.05
FADES, WARMS_S = 0.3, 6.0  # 1/A^2, s
HEAT = "actuator.heat_of_i_squared_on_i"
PARTS = 10


def recorded(name: str, seed: int, seconds: float = 20.0) -> Stretch:
    """Levels of a current through a winding that warms up, by the midpoint rule."""
    random, n = np.random.default_rng(seed), round(seconds / 0.01) + 1
    t, h = np.arange(n) * 0.01, 0.01 / PARTS
    u = np.repeat(random.choice([-1.2, -0.4, 0.4, 1.2], n // 30 + 1), 30)[: n - 1]
    state, shown = np.zeros(3), np.zeros((n, 2))  # th, th', heat

    def rates(x: np.ndarray, current: float) -> np.ndarray:
        moment = KT * current * (1.0 - FADES * x[2]) - B * x[1]
        return np.array([x[1], moment / J, (current**2 - x[2]) / WARMS_S])

    for k in range(n - 1):
        for _ in range(PARTS):
            half = state + h / 2.0 * rates(state, u[k])
            state = state + h * rates(half, u[k])
        shown[k + 1] = state[:2]
    shown += random.normal(size=shown.shape) * (1e-3, 0.1)
    rows = np.arange(n)
    return stretch_of(name, MOTOR, t, u, {"th": (rows, shown[:, 0]), "w": (rows, shown[:, 1])})


def test_a_winding_that_warms_up_is_found_in_the_drive() -> None:
    train, known = [recorded("day1", 1), recorded("day2", 2)], library(MOTOR)
    nominal = fit(train, (), MOTOR.values, move=False)
    base = fit(train, (), MOTOR.values, like=nominal, noise=nominal.noise)
    found = name_effects(train, known, nominal, base, Settings())
    name_mechanisms(found, Judge(train, known, Settings()), [*mechanisms(MOTOR).values()])
    assert found.final.names == (HEAT,)
    assert -found.final.values[f"{HEAT}.A"] == pytest.approx(FADES, rel=0.1)
    assert found.final.values[f"{HEAT}.T"] == pytest.approx(WARMS_S, rel=0.1)
    assert found.final.values["J"] == pytest.approx(J, rel=0.01)


@pytest.mark.parametrize("limit_a", [2.0, 1.2])
def test_what_the_input_moves_is_weighed_as_the_whole_model_has_it(limit_a: float) -> None:
    """A screen's column goes through the model's own derivative by the input, behind its limit, at which the largest
    levels are in the second case; a fit of the amplitude alone is exact."""
    motor = replace(MOTOR, inputs=(MOTOR.inputs[0]._replace(limit=limit_a),))
    train = [replace(recorded("day1", 1), plant=motor)]
    base = fit(train, (), motor.values)
    law = mechanisms(motor)["actuator.square_of_t_on_i"]
    proposed = MechanismScreen(base, [law], level=False).proposals[0]
    with_it = fit(
        train, (law.effect,), {**base.values, **proposed.start}, like=base, noise=base.noise, tune_noise=False
    )
    assert base.criterion - with_it.criterion == pytest.approx(proposed.gain, rel=0.1)


def test_of_two_things_that_move_nobody_knows_which_the_input_does() -> None:
    tanks = plant_named("tanks")
    assert MOTOR.moved_by(MOTOR.slots["actuator"]) == "th"
    assert tanks.moved_by(tanks.slots["actuator"]) == ""
    u = tanks.inputs[0].name.lower()
    names = {name for name in mechanisms(tanks) if name.startswith("actuator.")}
    assert {f"actuator.lag_of_{u}", f"actuator.heat_of_{u}_squared_on_{u}"} <= names
    assert not any("reversal" in name or "drawn" in name for name in names)


TWO_ROTORS = """
schema: hoopd.plant/1
name: rotors
coordinates: {a: {unit: rad, usual: 1, usual_rate: 10}, b: {unit: rad, usual: 1, usual_rate: 10}}
inputs: {i: {unit: A, limit: 2}}
parameters: {J: 1e-3 kg m2, k: 2 N m, kt: 0.05 N m/A}
equations:
  a: J*a'' = kt*i - k*(a - b)
  b: J*b'' = k*(a - b)
channels: {a: {reads: a, sensor: encoder}, b: {reads: b, sensor: encoder}}
sample_time_s: 0.01
"""


def test_a_drive_whose_slot_says_what_it_moves_has_the_laws_of_that_motion() -> None:
    rotors = parse_plant(TWO_ROTORS + "slots: {drive: {kind: actuator, coordinate: a}}", "rotors.yaml")
    names = mechanisms(rotors)
    assert {"drive.reversal_of_a_on_i", "drive.linear_of_da_on_i"} <= {*names}
    assert names["drive.linear_of_da_on_i"].textbook is False and names["drive.lag_of_drawn_i_da_on_i"].textbook
    assert not any(name.startswith("drive.") and "db" in name for name in names)


def test_only_bodies_that_move_each_other_are_joined() -> None:
    rotors = parse_plant(TWO_ROTORS, "rotors.yaml")
    law = mechanisms(rotors)["a_body.cubic_of_a_less_b_pair"]
    assert law.textbook and law.sentence.startswith("a torque between a and b")
    apart = parse_plant(TWO_ROTORS.replace("k*(a - b)", "k*b").replace("- k*b", "- k*a"), "apart.yaml")
    assert not any(name.endswith("_pair") for name in mechanisms(apart))


def test_there_is_one_actuator_that_of_the_first_input() -> None:
    two = "slots: {left: {kind: actuator, coordinate: a}, right: {kind: actuator, coordinate: b}}"
    with pytest.raises(InputError, match=r"slots.right: left is the actuator, and there is one"):
        parse_plant(TWO_ROTORS + two, "rotors.yaml")
    one = plant_named("axis")
    drive = next(slot for slot in one.slots.values() if slot.kind == "actuator")
    with pytest.raises(ValueError, match="actuators; there is one"):
        replace(one, slots={**one.slots, "other": drive})


def test_bodies_are_joined_by_a_coupling_that_is_believed_to_be_nothing() -> None:
    loose = parse_plant(TWO_ROTORS.replace("k: 2 N m", "k: {value: 0, unit: N m, bounds: [0, 10]}"), "loose.yaml")
    whole = parse_plant(TWO_ROTORS, "rotors.yaml")
    assert [*mechanisms(loose)] == [*mechanisms(whole)]


def test_a_slow_sensor_is_found_however_finely_it_is_recorded() -> None:
    tanks = plant_named("tanks")
    for sample_s in (2.0, 0.1):
        fine = replace(tanks, time_scale_s=sample_s)
        slow = [one for name, one in library(fine).items() if name.endswith(".lag") and "actuator" not in name]
        (t,) = slow[0].parameters
        assert t.high >= 1000.0 * sample_s and max(t.grid) >= 500.0 * sample_s
