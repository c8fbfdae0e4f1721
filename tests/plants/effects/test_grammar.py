"""The grammar of mechanisms: names, formulas, memories, and models that have them."""

from __future__ import annotations

import re
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hoopd.plants.effects.grammar.axes import CLOCK, INPUT, POSITION
from hoopd.plants.effects.grammar.mechanism import READING
from hoopd.plants.effects.grammar.mechanisms import NAMED, mechanism_named, mechanisms
from hoopd.plants.effects.grammar.memories import MEMORIES, ONE_WAY
from hoopd.plants.effects.grammar.memory_bodies import STOPS
from hoopd.plants.effects.grammar.memory_law import PARTS, MemoryLaw
from hoopd.plants.effects.grammar.shapes import LENS
from hoopd.plants.effects.grammar.textbook import ACTUATOR, BODY, COUPLED, PLACE, RATE, ROLLING
from hoopd.plants.effects.library import library
from hoopd.plants.effects.usual_sizes import state_unit
from hoopd.plants.free_run import run
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.registry import plant_named

PLANTS = ("hoop", "axis", "pendulum", "falling", "tanks")
CONSTANTS = {"xs": 0.2, "b": 0.15, "T": 0.3, "W": 0.8, "w": 12.0, "L": 0.05}
SAMPLE_S = 0.002


def sweep(t: np.ndarray) -> np.ndarray:
    """A way that goes to and fro."""
    return np.sin(2.0 * t) + 0.4 * np.sin(5.3 * t)


@pytest.mark.parametrize(
    "memory", [one for one in MEMORIES if not one.held], ids=lambda one: f"{one.name}-{one.kinds[0]}"
)
def test_memory_follows_its_rates(memory: MemoryLaw) -> None:
    """The recursion over samples is the law that the model integrates."""
    constants = {"zeta": 0.1, "w": STOPS[1] * PARTS / SAMPLE_S, memory.constant: CONSTANTS[memory.constant]}
    shortest = SAMPLE_S / PARTS
    # an input that turns back at other times than the way
    driven = memory.kinds == (INPUT,)
    v_of = (lambda t: np.cos(3.1 * t)) if driven else sweep

    def slope(t: float) -> float:
        return float((sweep(t + 1e-5) - sweep(t - 1e-5)) / 2e-5)

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        return np.array(memory.rates(np, z, float(v_of(t)), slope(t), constants, shortest), dtype=float)

    t = np.arange(0.0, 6.0, SAMPLE_S)
    begin = [float(v_of(0.0)), 0.0] if memory.name == "resonance" else [0.0] * memory.states
    if memory.is_body:
        begin[-1] = float(v_of(0.0))
    states = solve_ivp(rates, (0.0, t[-1]), begin, t_eval=t, max_step=SAMPLE_S, rtol=1e-6, atol=1e-8, method="LSODA").y
    expected = np.array([memory.value(np, states[:, k], float(v_of(t[k])), constants) for k in range(len(t))])
    found = memory.along(v_of(t), sweep(t), t, constants)
    # a reversal may fall a sample earlier or later
    assert np.quantile(np.abs(found - expected), 0.99) < 0.02 * max(1.0, float(np.ptp(expected)))
    assert np.ptp(expected) > 0.05


def means_until_the_next(
    memory: MemoryLaw, u: np.ndarray, constants: dict[str, float], h: float, begin: float, parts: int = 2000
) -> np.ndarray:
    """(n,) of an input that is held, what the model's one state makes of each sample, the mean until the next one."""
    z, means = begin, []
    for now in u:
        told = []
        for _ in range(parts):
            told.append(memory.value(np, [z], now, constants))
            (slope,) = memory.rates(np, [z], now, 0.0, constants, h / PARTS)
            z += h / parts * slope
        means.append(np.mean(told))
    return np.array(means)


def test_what_is_held_is_late_by_its_mean_until_the_next_sample() -> None:
    """A small input is later than a large one, and the lateness is that of the states that the model integrates."""
    (memory,) = [one for one in MEMORIES if one.name == "hesitation"]
    u = np.array([0.0, 0.02, -0.02, 0.5, 0.5, -0.5])
    constants, h = {"v0": 0.1}, 0.02
    means = means_until_the_next(memory, u, constants, h, begin=u[0])
    found = memory.along(u, u, np.arange(len(u)) * h, constants)
    assert found == pytest.approx(means, abs=0.02 * np.abs(means).max())
    assert abs(found[1]) / 0.02 > 50.0 * abs(found[5]) / 1.0


@pytest.mark.parametrize("name", ["rise", "fall", "up", "down"])
@pytest.mark.parametrize("time_s", [0.005, 0.03])
def test_what_is_late_in_one_direction_is_so_by_its_mean_until_the_next_sample(name: str, time_s: float) -> None:
    """The recursion is the mean of what the model integrates, also where a large step goes through zero."""
    (memory,) = [one for one in MEMORIES if one.name == name]
    u = np.array([0.03, 0.02, 0.04, -0.03, -0.01, -0.01, 0.05, 0.0, 0.5, -0.1, 0.0])
    constants, h = {"T": time_s}, 0.02
    means = means_until_the_next(memory, u, constants, h, begin=0.0, parts=4000)
    found = memory.along(u, u, np.arange(len(u)) * h, constants)
    assert found[:-1] == pytest.approx(means[:-1], abs=2e-3 * np.abs(means).max())
    assert np.ptp(found) > 1e-3
    late = {other.name: other.along(u, u, np.arange(len(u)) * h, constants) for other in ONE_WAY}
    # each is late or its opposite is
    assert late["rise"] + late["fall"] == pytest.approx(late["up"] + late["down"], abs=1e-12)


def test_what_is_late_in_one_direction_loses_as_much_of_a_step_however_fast_the_samples_come() -> None:
    """A unit step of an amplitude of 1 s loses 1 s of it, in the model as in the screen, also of a time that is shorter
    than a model can follow."""
    mechanism = mechanisms(plant_named("axis"))["actuator.up_of_f"]
    for h in (0.02, 0.001):
        t = h * np.arange(round(3.0 / h))
        u = np.where(t > 0.5, 1.0, 0.0)
        lost = mechanism.along(u, u, t, {"T": 0.25 * h})
        assert np.sum(lost) * h == pytest.approx(-1.0, rel=1e-3), h
    told = mechanism._told(np, {"T": 1e-6})["T"]
    assert told == plant_named("axis").time_scale_s / 5


def test_a_loose_part_is_felt_as_the_mean_of_its_blows() -> None:
    """Of a sample each, and as the states are that the model integrates; it moves along at first."""
    (memory,) = [one for one in MEMORIES if one.name == "loose"]
    t, h = np.arange(0.0, 4.0, 0.02), 0.02
    v, constants = 2.0 + 3.0 * np.sin(3.0 * t), {"b": 0.1, "w": STOPS[1] * PARTS / h}
    z, told = [0.0, v[0]], []
    for before, after in pairwise(v):
        sums = 0.0
        for part in range(200):
            rate = before + (after - before) * part / 200
            sums += memory.value(np, z, rate, constants) / 200
            slopes = memory.rates(np, z, rate, 0.0, constants, h / PARTS)
            z = [one + h / 200 * slope for one, slope in zip(z, slopes, strict=True)]
        told.append(sums)
    found = memory.along(v, v, t, constants)[:-1]
    assert found[:3] == pytest.approx(0.0, abs=1e-9)
    assert np.corrcoef(found, told)[0, 1] > 0.95
    # what it takes along in all is its own speed
    assert np.sum(told) * h * constants["w"] == pytest.approx(z[1] - v[0], rel=0.02)


def test_a_contact_is_older_where_it_rests_and_its_way_renews_it() -> None:
    (memory,) = [one for one in MEMORIES if one.name == "age"]
    t = np.arange(0.0, 10.0, SAMPLE_S)
    x = 2.0 * np.clip(t - 4.0, 0.0, 3.0)
    found = memory.along(x, x, t, {"L": 0.1})
    # at rest the age is the time, in samples; at 2 m/s it is L/v
    assert found[t.searchsorted(4.0)] == pytest.approx(np.log1p(4.0 / SAMPLE_S), rel=1e-3)
    assert found[t.searchsorted(6.9)] == pytest.approx(np.log1p(0.05 / SAMPLE_S), rel=0.02)
    assert found[-1] == pytest.approx(np.log1p(3.05 / SAMPLE_S), rel=1e-3)


@pytest.mark.parametrize("plant", PLANTS)
def test_names_are_of_one_form_and_give_the_same_effect_again(plant: str) -> None:
    declared = plant_named(plant)
    every = mechanisms(declared)
    assert not set(every) & set(library(declared))
    for name, one in every.items():
        slot, _, law = name.partition(".")
        assert slot in declared.slots
        assert "_of_" in law
        assert one.effect.formula
        assert "{" not in one.effect.formula
    for name in [*every][::25]:
        again = mechanism_named(declared, name)
        assert again is not None
        assert (again.name, again.parameters) == (every[name].effect.name, every[name].effect.parameters)
    assert mechanism_named(declared, "hoop.nothing_of_theta") is None


@pytest.mark.parametrize("plant", ["hoop", "axis", "pendulum"])
def test_a_mechanism_of_no_size_leaves_the_model_as_it_is(plant: str) -> None:
    declared = plant_named(plant)
    t = np.arange(8) * declared.time_scale_s
    start = [0.2 * (i % 2 + 0.5) for i in range(len(declared.states))]
    inputs = max(1, len(declared.inputs))
    u = np.full(7, 0.1 * declared.usual_input) if inputs == 1 else np.zeros((7, inputs))
    # one of each law, memory and way of acting
    kinds = {
        (m.site.acts, m.site.slot, (m.shape or m.memory), bool(m.factor)): m for m in mechanisms(declared).values()
    }
    for one in [*kinds.values()][::5]:
        effect = one.effect
        with_it = Composite(declared, (effect,))
        plain = Composite(declared, (), with_it.substeps)
        z = run(with_it, {}, start, t, u)[:, : len(declared.states)]
        assert np.array_equal(z, run(plain, {}, start, t, u)), one.name
        sizes = {effect.key("A"): 1e-3 * declared.usual_input}
        assert np.isfinite(run(with_it, sizes, start, t, u)).all(), one.name


def test_what_takes_energy_never_gives_any() -> None:
    """Mechanisms that say so act against the motion; their amplitude has no other sign."""
    plant = plant_named("axis")
    x = np.linspace(-0.4, 0.4, 41)
    for one in mechanisms(plant).values():
        if not one.dissipates or one.memory is not None or one.site.acts == READING:
            continue
        assert one.effect.parameter("A").low == 0.0
        constants = dict.fromkeys(one.constants, 0.1)
        point = plant.point([np.full(41, 0.05), x], dict(plant.values), 0.0, 0.0)
        law = np.asarray(one.shape.of(np, np.asarray(one.axis.of(point), dtype=float), constants))  # type: ignore[union-attr]
        factor = 1.0 if one.factor is None else np.asarray(one.factor.of(point))
        if one.dry is not None:
            assert np.all(one.along(np.asarray(one.axis.of(point), dtype=float), x, x, constants) >= 0.0), one.name
            factor = np.sign(x)
            law = np.maximum(law, 0.0)
        assert np.all(one.sign * law * factor * x <= 1e-12), one.name


def test_symbols_and_arrays_get_the_same_formula() -> None:
    plant = plant_named("hoop")
    v = np.linspace(-2.0, 2.0, 31)
    for one in mechanisms(plant).values():
        if one.shape is None:
            continue
        constants = dict.fromkeys(one.constants, 0.7) | ({"phi": 0.3} if one.shape.phased else {})
        x = ca.SX.sym("x")
        symbolic = ca.Function("f", [x], [one.shape.of(ca, x, constants)])
        found = np.array([float(symbolic(value)) for value in v[::6]])
        assert np.allclose(found, one.shape.of(np, v[::6], constants), atol=1e-12), one.name


def test_a_tilted_axis_has_both_positions_and_their_difference() -> None:
    names = mechanisms(plant_named("hoop"))
    for wanted in (
        "hoop.detent_of_theta", "ball.cubic_of_psi", "ball.dahl_of_psi_less_theta_pair", "hoop.dahl_of_theta",
        "actuator.reversal_of_u_on_u", "actuator.heat_of_u_squared_on_u", "encoder.play_of_theta_in_theta",
        "ball.well_of_phi", "ball.square_of_load", "hoop.wear_of_theta_on_dtheta", "camera.quadratic_of_dpsi_in_psi",
    ):  # fmt: skip
        assert wanted in names, wanted
    assert names["hoop.dahl_of_theta"].axis.kind == POSITION


def test_textbooks_laws_are_names_of_the_grammar() -> None:
    """A misspelt one would be no law's: of all plants together every one is somewhere."""
    plants = [plant_named(name) for name in ("hoop", "axis", "pendulum", "falling", "drives")]
    laws = {law for table in (BODY, COUPLED, ROLLING, ACTUATOR, PLACE, RATE) for law in table}
    every = [(plant, mechanisms(plant)) for plant in plants]
    there = {
        law
        for plant, names in every
        for slot in plant.slots
        for q in plant.coordinates
        for o in (plant.coordinates if len(plant.coordinates) > 1 else ("",))
        for law in laws
        if names.get(f"{slot}.{law.format(q=q, o=o, u=plant.inputs[0].name if plant.inputs else '')}".lower())
    }
    assert there == laws
    hoop = mechanisms(plant_named("hoop"))
    known = sum(one.textbook for one in hoop.values())
    # as many as a library has names, or a few more
    assert NAMED <= known < 1.5 * NAMED < len(hoop) / 5


@pytest.mark.parametrize("law", ["well", "detent", "wave"])
def test_what_follows_a_turning_angle_is_the_same_after_a_turn(law: str) -> None:
    """And the pull of a magnet is the slope of its potential, exp((cos(v - v0) - 1)/w^2)."""
    one = mechanisms(plant_named("hoop"))[f"ball.{law}_of_psi_less_theta_pair"]
    assert one.shape is not None
    v, constants = np.linspace(-3.0, 3.0, 601), {"v0": 0.4, "w": 0.3, "n": 3.0, "phi": 0.2}
    found = one.shape.of(np, v, constants)
    assert one.shape.of(np, v + 2.0 * np.pi, constants) == pytest.approx(found, abs=1e-9)
    if law == "detent":
        slope = np.gradient(np.exp((np.cos(v - 0.4) - 1.0) / 0.09), v)
        assert np.corrcoef(found, slope)[0, 1] > 0.9999


def test_friction_of_one_direction_lets_the_other_one_go() -> None:
    one = mechanisms(plant_named("hoop"))["hoop.well_of_theta_on_backward_dtheta"]
    assert one.side_of(np.array([-2.0, 0.0, 3.0])).tolist() == [-1.0, 0.0, 0.0]
    assert "backward" in one.sentence and "< 0" in one.formula


def test_a_lens_on_the_axis_turns_nothing_and_one_beside_it_bends() -> None:
    """Brown's radial distortion, of a point on the unit circle, is what the law says of its angle."""
    v, k, e, v0 = np.linspace(-1.0, 1.0, 9), 1e-4, 0.6, 0.4
    x, c = np.array([np.sin(v), np.cos(v)]), e * np.array([[np.sin(v0)], [np.cos(v0)]])
    seen = c + (x - c) * (1.0 + k * np.sum((x - c) ** 2, axis=0))
    turned = np.arctan2(seen[0], seen[1]) - v
    assert turned == pytest.approx(k * e * LENS.of(np, v, {"v0": v0, "e": e}), rel=1e-3)


def test_an_encoder_has_no_lens() -> None:
    assert "camera.lens_of_psi_in_psi" in mechanisms(plant_named("hoop"))
    for plant in ("hoop", "pendulum"):
        assert not any(name.startswith("encoder.lens") for name in mechanisms(plant_named(plant)))


def test_the_scale_of_an_angle_that_is_not_known_is_searched_without_gaps() -> None:
    phi = mechanisms(plant_named("hoop"))["ball.wave_of_phi_pair"]
    v = np.linspace(0.0, 300.0, 400)
    tried = np.array([one["n"] for one in phi.grid(v, v)])
    assert (tried[0], tried[-1]) == pytest.approx((0.8, 1.2))
    # half a turn over the whole reach, at most
    assert np.diff(tried).max() * 300.0 <= np.pi
    assert not phi.effect.parameter("n").discrete


CART = """
schema: hoopd.plant/1
name: cart
coordinates: {x: m, a: rad}
inputs: {V: {unit: V, limit: 12}}
parameters: {M: 1 kg, m: 0.2 kg, l: 0.3 m, g: {value: 9.81, unit: m/s2}, k: 2 N/V}
equations:
  x: (M + m)*x'' + m*l*cos(a)*a'' = k*V + m*l*sin(a)*a'^2
  a: m*l*cos(a)*x'' + m*l^2*a'' = -m*g*l*sin(a)
"""


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("a_body.cubic_of_da", "N m s3"),
        ("a_body.linear_of_dx", "N s"),
        ("a_body.linear_of_dx_on_da", "N s2"),
        ("x_body.cubic_of_dx", "N s3/m3"),
        ("x_body.heat_of_v_squared_on_dx", "N s/(V2 m)"),
        ("x_encoder.cubic_of_dx_in_x", "s3/m2"),
    ],
)
def test_amplitudes_are_in_the_units_of_what_they_act_on(name: str, unit: str) -> None:
    """A force moves a length and a torque an angle, whatever the drive gives; a power is of the whole unit."""
    cart = parse_plant(CART, "cart.yaml")
    found = mechanism_named(cart, name)
    assert found is not None and found.parameters[0].unit == unit
    assert (cart.disturbance_unit("x"), cart.disturbance_unit("a"), state_unit(cart, "da")) == ("N", "N m", "rad/s")


def test_every_law_of_every_place_is_told_in_a_sentence_and_no_letter_stands_for_two_things() -> None:
    for one in mechanisms(plant_named("hoop")).values():
        said = one.sentence
        assert not re.search(r"(force|torque|reading|factor) that (friction|play)\b|smaller it is: the", said), said
        if "phi" in {p.name for p in one.effect.parameters}:
            assert "phi" not in one.axis.text, one.formula


@pytest.mark.parametrize("plant", PLANTS)
def test_every_law_says_what_recording_shows_it(plant: str) -> None:
    every = {one.name: one.effect.best_experiment for one in mechanisms(plant_named(plant)).values()}
    assert all(every.values())
    if plant == "pendulum":
        well = every["body.well_of_alpha_on_backward_dalpha"]
        assert well == "alpha and the speed of alpha over all that they can be"


def test_waves_are_looked_for_half_a_wave_apart_where_no_coloured_force_passes_for_one() -> None:
    """Over a length and in what flows into a store; forces in waves over the time at few frequencies."""
    t = np.linspace(0.0, 10.0, 100)

    def counts(plant: str, name: str) -> list[float]:
        law = mechanisms(plant_named(plant))[name]
        assert law.shape is not None
        return [one["n"] * 10.0 / (2.0 * np.pi) for one in law.shape.grid(law.axis, t)]

    assert np.diff(counts("tanks", "h1_store.wave_of_t")) == pytest.approx(0.5)
    assert np.diff(counts("axis", "body.wave_of_x")) == pytest.approx(0.5)
    assert max(np.diff(counts("axis", "body.wave_of_t"))) >= 2.0
    assert mechanisms(plant_named("axis"))["body.wave_of_t"].axis is CLOCK
    # a size and a phase, wherever it acts
    for plant, name in (("tanks", "h1_store.wave_of_t"), ("axis", "body.wave_of_x")):
        assert mechanisms(plant_named(plant))[name].effect.parameters[0].low == 0.0
