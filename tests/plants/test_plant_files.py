"""Plant files: what they become, what is refused in one line, and the plants that are registered."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.library import library
from hoopd.plants.free_run import FreeRun
from hoopd.plants.plant_check import Check, checks, free_run, state_rate, usual_state
from hoopd.plants.plant_file import load_plant, parse_plant
from hoopd.plants.registry import FOLDER, REGISTERED, plant_named, resolve_plant

AXIS = (FOLDER / "axis.yaml").read_text()
CART = """
schema: hoopd.plant/1
name: cart
coordinates: {x: m, a: rad}
inputs: {F: {unit: N, limit: 10}}
parameters:
  M: 2 kg
  m: 0.5 kg
  l: 0.3 m
  b: 0.1 N s/m
  g: {value: 9.81, unit: m/s2, held: true}
equations:
  x: (M + m)*x'' + m*l*cos(a)*a'' = F - b*x' + m*l*sin(a)*a'^2
  a: m*l*cos(a)*x'' + m*l^2*a'' = -m*g*l*sin(a)
"""
MOTOR = """
schema: hoopd.plant/1
name: motor
coordinates: {phi: rad}
states: {i: A}
inputs: {V: {unit: V, limit: 24}}
parameters: {J: 1e-4 kg m2, b: 1e-5 N m s, k: 0.05 N m/A, L: 1e-3 H, R: 1 ohm}
equations:
  phi: J*phi'' = k*i - b*phi'
  i: L*i' = V - R*i - k*phi'
channels: {phi: phi, speed: "phi'", i: i, power: {reads: "k*i*phi'", unit: W}}
sample_time_s: 1e-3
"""


def plant(text: str) -> Plant:
    return parse_plant(text, "plant.yaml")


def rate(made: Plant, x: list[float], u: list[float]) -> np.ndarray:
    return np.asarray(state_rate(made)(x, u, list(made.values.values()))).ravel()


def answers(made: Plant) -> dict[str, Check]:
    return {one.name: one for one in checks(made)}


# ---------------------------------------------------------------------------------------------- what they become


def test_an_axis_moves_as_its_equation_says() -> None:
    made = plant(AXIS)
    assert made.states == ("x", "dx") and made.driven == "x" and made.limit == 1000.0
    assert rate(made, [0.1, 0.2], [50.0]) == pytest.approx([0.2, (50.0 - 200.0 * 0.2) / 100.0])
    assert made.bounds == {"M": (1.0, 1000.0), "Fv": (0.0, np.inf)}
    assert made.units["Fv"] == "N s/m" and made.channels["x"].unit == "m"


def test_a_force_of_an_effect_meets_the_inertia() -> None:
    made = plant(CART)
    x, values = [0.1, 0.2, 0.6, -0.4], dict(made.values)
    point = made.point(ca.DM(x), values, 0.0)
    unforced, forced = (np.asarray(made.accelerations(point, ca.DM(f))).ravel() for f in ([0, 0], [3.0, -2.0]))
    m, l, cosine = 0.5, 0.3, np.cos(0.6)  # noqa: E741
    mass = np.array([[2.5, m * l * cosine], [m * l * cosine, m * l**2]])
    assert mass @ (forced - unforced) == pytest.approx([3.0, -2.0])
    assert made.driven == "x"
    # the drive is such a force itself
    assert mass @ (rate(made, x, [3.0]) - rate(made, x, [0.0]))[[1, 3]] == pytest.approx([3.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    "equation", ["M*x'' = F - Fv*x' - offset", "F - Fv*x' - offset = M*x''", "0 = F - Fv*x' - offset - M*x''"]
)
def test_an_equation_may_stand_either_way_round(equation: str) -> None:
    made = plant(AXIS.replace("M*x'' = F - Fv*x' - offset", equation))
    assert made.driven == "x"
    assert rate(made, [0.1, 0.2], [50.0]) == pytest.approx([0.2, 0.1])


def test_a_motor_has_a_current_beside_its_angle() -> None:
    made = plant(MOTOR)
    assert made.states == ("phi", "dphi", "i") and made.driven is None
    assert rate(made, [0.0, 10.0, 2.0], [5.0]) == pytest.approx([10.0, (0.1 - 1e-4) / 1e-4, (5.0 - 2.0 - 0.5) / 1e-3])
    reading = made.channels["power"].reading
    assert reading is not None
    assert float(reading(made.point(ca.DM([0.0, 10.0, 2.0]), made.values))) == pytest.approx(1.0)
    assert {name: one.unit for name, one in made.channels.items()} == {
        "phi": "rad", "speed": "rad/s", "i": "A", "power": "W",
    }  # fmt: skip


def test_the_mass_on_a_slide_of_the_pages_needs_few_lines() -> None:
    for name in REGISTERED:
        if name != "hoop":
            assert len((FOLDER / f"{name}.yaml").read_text().splitlines()) <= 25


def test_defaults_are_made_from_the_coordinates() -> None:
    made = plant(CART)
    assert list(made.slots) == [
        "actuator", "x_body", "x_external", "a_body", "a_external", "x_encoder", "a_encoder",
    ]  # fmt: skip
    assert made.slots["a_body"].turns and not made.slots["x_body"].turns
    viscous = made.slots["x_body"].viscous
    assert viscous is not None and viscous(made.point([0.0] * 4, {"b": 7.0})) == 7.0
    assert made.slots["a_body"].viscous is None


def test_a_coordinate_whose_name_stands_in_anothers_has_its_own_encoder() -> None:
    made = plant("""
schema: hoopd.plant/1
name: two
coordinates: {a: m, a2: m}
parameters: {m: 1 kg, k: 10 N/m, l: 1 m}
equations: {a: "m*a'' = k*(a2 - a)", a2: "m*a2'' = k*(a - a2)"}
channels: {first: a, second: a2, bent: {reads: tanh(a2/l), unit: "-"}}
""")
    assert [one.sensor for one in made.channels.values()] == ["a_encoder", "a2_encoder", "a2_encoder"]
    assert made.slots["a2_encoder"].coordinate == "a2"


@pytest.mark.parametrize("name", list(REGISTERED))
def test_a_registered_plant_is_sound(name: str) -> None:
    made = plant_named(name)
    assert [one for one in checks(made) if one.good is False] == []
    names = [*library(made)]
    assert len(names) == len(set(names)) and (names or not made.slots)


@pytest.mark.parametrize(
    ("name", "effect", "unit"),
    [
        ("axis", "body.coulomb_friction", "N"),
        ("pendulum", "body.quadratic_drag", "N m s2"),
        ("falling", "body.quadratic_drag", "N s2/m2"),
    ],
)
def test_effects_come_in_the_units_of_the_coordinate(name: str, effect: str, unit: str) -> None:
    assert library(plant_named(name))[effect].parameters[0].unit == unit


def test_effects_take_the_sizes_of_what_they_act_on() -> None:
    """Units by the coordinate and the input; without an input, sizes by the plant's own forces."""
    cart, tanks = library(plant(CART)), library(plant_named("tanks"))
    assert cart["x_body.coulomb_friction"].parameters[0].unit == "N"
    assert cart["a_body.coulomb_friction"].parameters[0].unit == "N m"
    assert tanks["actuator.torque_bias"].parameters[0].unit == "m3/s"
    assert tanks["h1_sensor.offset"].parameters[0].unit == "m" and "actuator.back_emf_limit" not in tanks
    weight = 0.024 * 9.81 * 0.0806 * np.sin(0.5) + 1e-5 * 5.0
    assert plant_named("pendulum").usual_input == pytest.approx(weight)
    assert plant_named("axis").usual_input == 1000.0


def test_what_the_pump_does_wrong_fills_the_tanks() -> None:
    made = plant_named("tanks")
    bias = library(made)["actuator.torque_bias"]
    t, u = np.arange(3.0), np.full(2, 5e-5)
    runs = [
        FreeRun(made, (bias,), values={"actuator.torque_bias.b": b}).run([], [0.2, 0.2], t, u).readings[-1, 0]
        for b in (0.0, 1e-6)
    ]
    # 1e-6 m3/s over 2 s into 0.015 m2, less what runs out of it meanwhile
    assert runs[1] - runs[0] == pytest.approx(2e-6 / 0.015, rel=0.01)


def test_a_camera_on_a_length_has_no_angle_offset() -> None:
    names = [one for one in library(plant_named("falling")) if one.startswith("camera.")]
    assert "camera.latency" in names and "camera.angle_offset" not in names and "camera.center_offset" not in names


def test_the_falling_body_falls() -> None:
    t, x = free_run(plant_named("falling"))
    assert x[:, 0] == pytest.approx(5.0 - 9.81 * t**2 / 2)


def test_the_tanks_stay_at_their_equilibrium_and_hold_water() -> None:
    made = plant_named("tanks")
    # q = a sqrt(2 g h)
    level = (5e-5 / (2.5e-5 * np.sqrt(2 * 9.81))) ** 2
    assert rate(made, [level, level], [5e-5]) == pytest.approx([0.0, 0.0], abs=1e-15)
    assert rate(made, [0.0, 0.0], [0.0]) == pytest.approx([0.0, 0.0])


# ---------------------------------------------------------------------------------------------- checks


def test_a_friction_with_the_wrong_sign_is_seen() -> None:
    text = (FOLDER / "pendulum.yaml").read_text()
    turned = plant(text.replace("- c*alpha'", "+ c*alpha'"))
    assert answers(turned)["power"].good is False
    assert answers(plant(text.replace("- m*g*l*cos", "+ m*g*l*cos")))["energy"].good is False


@pytest.mark.parametrize(
    ("energy", "equation", "good"),
    [
        ("J/2*phi'^2 + L/2*i^2", "L*i' = V - R*i - k*phi'", True),
        ("J/2*phi'^2 + L/2*i^2", "L*i' = V + R*i - k*phi'", False),
        ("J/2*phi'^2 + L/2*i^2", "L*i' = V - R*i + k*phi'", False),
        ("J/2*phi'^2", "L*i' = V - R*i - k*phi'", False),  # the current drives it
    ],
)
def test_an_energy_in_a_body_and_a_current_never_grows(energy: str, equation: str, good: bool) -> None:
    text = MOTOR.replace("L*i' = V - R*i - k*phi'", equation).replace(
        "name: motor\n", f"name: motor\nenergy: {energy}\n"
    )
    assert answers(plant(text))["energy"].good is good


def test_an_energy_beside_surroundings_is_not_judged() -> None:
    text = """
schema: hoopd.plant/1
name: block
states: {T: {unit: K, usual: 300}}
inputs: {q: {unit: W, limit: 10}}
parameters: {C: 100 J/K, U: 2 W/K, T0: 295 K}
equations: {T: "C*T' = q - U*(T - T0)"}
energy: C*T
"""
    assert answers(plant(text))["energy"].good is None


def test_an_inertia_that_no_body_has_is_seen() -> None:
    assert answers(plant(CART))["inertia"].good
    scaled = CART.replace(
        "a: m*l*cos(a)*x'' + m*l^2*a'' = -m*g*l*sin(a)", "a: 2*m*l*cos(a)*x'' + m*l^2*a'' = -m*g*l*sin(a)"
    )
    assert answers(plant(scaled))["inertia"].good is False


def test_a_step_that_is_too_long_is_seen() -> None:
    stiff = MOTOR.replace("L: 1e-3 H", "L: 1e-6 H")
    assert answers(plant(MOTOR))["free run"].good
    assert answers(plant(stiff))["free run"].good is False


def test_derivatives_that_are_not_finite_are_seen() -> None:
    made = Plant(
        name="corner",
        first_order=("h",),
        rates=lambda s: ca.vertcat(-ca.sqrt(ca.fmin(s.h, 0.0))),
        channels={},
    )
    assert answers(made)["derivatives"].good is False


def test_the_first_input_may_be_called_as_laws_call_it() -> None:
    told, called = plant(MOTOR), plant(MOTOR.replace("V: {unit: V", "u: {unit: V").replace("= V - R", "= u - R"))
    assert called.inputs[0].name == "u"
    np.testing.assert_array_equal(rate(called, [0.3, 2.0, 1.0], [5.0]), rate(told, [0.3, 2.0, 1.0], [5.0]))
    assert all(one.good for one in checks(called))
    dead = library(called)["actuator.deadzone"]
    assert dead.torque is not None
    given = [
        dead.torque(made.point([0.3, 2.0, 1.0], {}, 5.0), dead.values({"actuator.deadzone.d": 1.0}))
        for made in (called, told)
    ]
    assert [float(one) for one in given] == [4.0, 4.0]


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("V: {unit: V, limit: 24}}", "V: {unit: V, limit: 24}, u: N m}", "inputs.u"),
        ("R: 1 ohm", "u: 1 ohm", "parameters.u"),
        ("states: {i: A}", "states: {u: A}", "states.u"),
    ],
)
def test_nothing_else_may(old: str, new: str, key: str) -> None:
    with pytest.raises(InputError, match="first input of any plant") as error:
        plant(MOTOR.replace(old, new))
    assert error.value.key == key


# ---------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("old", "new", "key", "reason"),
    [
        ("- Fv*x'", "- Fw*x'", "equations.x", "column 13: unknown name 'Fw'; did you mean F or Fv?"),
        ("- Fv*x'", "- Fv*x", "equations.x", "column 13: this is in kg m/s"),
        ("- Fv*x'", "- Fv*dx", "equations.x", "the rate of x is written x'"),
        ("- offset", "- offset*x''^2", "equations.x", "column"),
        ("M*x''", "M*x''*x''", "equations.x", "this is in N, the left side in kg m2/s4"),
        ("M*x'' = F - Fv*x' - offset", "F - Fv*x' = offset", "equations.x", "x'' does not stand in it"),
        ("M*x'' = F - Fv*x' - offset", "x'' = (F - Fv*x' - offset)/M", "equations.x", "write inertia times"),
        ("M*x'' = F - Fv*x' - offset", "M*x'' = -Fv*x' - offset", "inputs.F", "stands in no equation"),
        ("offset: 0 N", "offset: 0 furlong", "parameters.offset", "unknown unit 'furlong'"),
        ("offset: 0 N", "offset: N", "parameters.offset", "expected a number and its unit"),
        ("offset: 0 N", "offset: 1e999 N", "parameters.offset", "finite"),
        ("offset: 0 N", "F: 0 N", "parameters.F", "is taken"),
        ("offset: 0 N", "dx: 0 N", "parameters.dx", "is taken"),
        ("offset: 0 N", "offset: 0 N\n  Ti: 3 degC\n  To: 4 K", "parameters.To", "is in K and parameters.Ti in degC"),
        ("offset: 0 N", "offset: {value: [0], unit: N}", "parameters.offset.value", "Expected `float`, got `array`"),
        ("hoopd.plant/1", "hoopd.plant/2", "schema", "write schema: hoopd.plant/1"),
        ("schema: hoopd.plant/1\n", "", "", "missing required field `schema`; write schema: hoopd.plant/1"),
        ("offset: 0 N", "sin: 0 N", "parameters.sin", "sin is a function of equations: it needs another name"),
        ("offset: 0 N", "__import__: 0 N", "parameters.__import__", "a name begins with a letter"),
        ("bounds: [1, 1000]", "bounds: [200, 1000]", "parameters.M.bounds", "do not hold the value 100"),
        ("bounds: [1, 1000]", "bounds: [.nan, 1000]", "parameters.M.bounds", "do not hold"),
        ("bounds: [1, 1000]", "bound: [1, 1000]", "parameters.M.bound", "did you mean bounds"),
        ("unit: m,", "unit: mm,", "coordinates.x", "must be in m or rad, not 'mm' (--columns converts readings)"),
        ("unit: m,", "unit: C,", "coordinates.x", "(what has no acceleration stands under states)"),
        ("offset: 0 N", "offset: 0 mNm", "parameters.offset", "unknown unit 'mNm': is it 'mN m'?"),
        ("offset: 0 N", "offset: 0 mN", "equations.x", "(equations convert no prefixes: give it in plain units)"),
        ("limit: 1000", "limit: -1", "inputs.F.limit", "above 0"),
        ("reads: x,", "reads: y,", "channels.x.reads", "unknown name 'y'"),
        ("reads: x,", "reads: x, unit: s,", "channels.x.unit", "is wrong: it reads m"),
        ("sample_time_s: 0.001", "sample_time_s: 0", "sample_time_s", "above 2e-06"),
        ("equations:\n  x:", "equations:\n  y:", "equations.x", "is missing"),
        ("hoopd.plant/1", "hoopd.plant/2", "schema", "Invalid enum value"),
        ("name: axis", "name: axis\nenergy: M*x'", "energy", "must be in J"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_with_its_key(old: str, new: str, key: str, reason: str) -> None:
    assert old in AXIS
    with pytest.raises(InputError) as error:
        plant(AXIS.replace(old, new))
    assert error.value.key == key
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[" * 1000,
        "schema: hoopd.plant/1\nname: a\nequations: {}",
        "schema: hoopd.plant/1\nname: a\ncoordinates: {x: m}\nequations: {x: 3}",
        "schema: hoopd.plant/1\nname: a\ncoordinates: [x]\nequations: {x: a}",
        "schema: hoopd.plant/1\nname: a\nstates: {" + ", ".join(f"s{i}: m" for i in range(50)) + "}\nequations: {}",
        "schema: hoopd.plant/1\nname: a\ncoordinates: {x: m}\nequations: {x: \"" + "(" * 1900 + "\"}",
        "schema: hoopd.plant/1\nname: a\ncoordinates: {x: m}\nequations: {x: \"x'' = __import__('os').system('a')\"}",
        "schema: hoopd.plant/1\nname: a\ncoordinates: {x: m}\nequations: {x: \"x'' = 9**9**9\"}",
        "schema: hoopd.plant/1\nname: a\ncoordinates: {х: m}\nequations: {х: \"х'' = 0\"}",
        "schema: hoopd.plant/1\nname: !!python/object/apply:os.system ['true']\nequations: {}",
    ],
)  # fmt: skip
def test_hostile_text_is_one_line(text: str) -> None:
    with pytest.raises(InputError) as error:
        plant(text)
    assert "\n" not in str(error.value)


# ---------------------------------------------------------------------------------------------- Python, names


PYTHON = """
import casadi as ca
from hoopd.plants.declaration import Channel, Input, Plant, Slot

PLANT = Plant(
    name="slide",
    coordinates=("x",),
    accelerations=lambda s, force: (force - s.p["b"] * ca.atan(s.dx)) / s.p["m"],
    inputs=(Input("F", "N", 20.0, "x"),),
    values={"m": 2.0, "b": 3.0},
    free=("m", "b"),
    channels={"x": Channel("x", "m")},
)
"""


def test_a_python_file_says_what_a_grammar_cannot(tmp_path: Path) -> None:
    file = tmp_path / "slide.py"
    file.write_text(PYTHON)
    assert rate(load_plant(file), [0.0, 1.0], [5.0]) == pytest.approx([1.0, (5.0 - 3.0 * np.arctan(1.0)) / 2.0])
    file.write_text(PYTHON.replace("PLANT = Plant(", "def plant(): return Plant("))
    assert resolve_plant(str(file)).name == "slide"
    for text, line in (
        ("PLANT = 3", "a Plant is expected"),
        ("x = 1", "neither PLANT"),
        ("a = (", "line 1"),
        ("\n1/0", "line 2"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=line):
            load_plant(file)
    file.write_text(PYTHON.replace('Channel("x", "m")', 'Channel("y", "m")'))
    with pytest.raises(InputError, match=r"line 5.*which is no state"):
        load_plant(file)


def test_a_name_that_is_no_plant_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean pendulum"):
        resolve_plant("pendulm")
    with pytest.raises(InputError, match="no such file"):
        resolve_plant(str(tmp_path / "none.yaml"))
    assert usual_state(resolve_plant("pendulum")) == pytest.approx([0.5, 0.0])
