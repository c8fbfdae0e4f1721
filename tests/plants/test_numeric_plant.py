"""Any plant with numbers: its steps, linear models and energy against closed forms and differences."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from harness import effectcases
from scipy.linalg import expm

from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.library import library
from hoopd.plants.free_run import run
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.numeric_plant import NumericPlant
from hoopd.plants.plant_with_effects import Composite

# A DC motor: J q'' = k i - b q' + load,  L i' = v - R i - k q'.
MOTOR = Plant(
    name="motor",
    coordinates=("q",),
    accelerations=lambda s, force: (force + s.p["k"] * s.i - s.p["b"] * s.dq) / s.p["J"],
    first_order=("i",),
    rates=lambda s: (s.v - s.p["R"] * s.i - s.p["k"] * s.dq) / s.p["L"],
    inputs=(Input("v", "V", 24.0), Input("load", "N m", coordinate="q")),
    values={"J": 1e-3, "b": 1e-4, "k": 0.05, "R": 2.0, "L": 1e-2},
    channels={"q": Channel("q", "rad")},
    slots={"amplifier": Slot("actuator", "q"), "rotor": Slot("body", "q", turns=True)},
)
V = MOTOR.values
A = np.array([[0, 1, 0], [0, -V["b"] / V["J"], V["k"] / V["J"]], [0, -V["k"] / V["L"], -V["R"] / V["L"]]])
B = np.array([[0, 0], [0, 1 / V["J"]], [1 / V["L"], 0]])


def test_a_motor_with_two_inputs_is_its_linear_model() -> None:
    plant = NumericPlant(MOTOR)
    x, u = np.array([0.3, 20.0, 1.5]), np.array([12.0, -0.01])
    a, b = plant.linearize(x, u)
    np.testing.assert_allclose(a, A, rtol=1e-12)
    np.testing.assert_allclose(b, B, rtol=1e-12)
    np.testing.assert_allclose(plant.derivative(x, u), A @ x + B @ u, rtol=1e-12)
    held = expm(np.block([[A, B], [np.zeros((2, 5))]]) * 0.02)
    expected = held[:3, :3] @ x + held[:3, 3:] @ u
    np.testing.assert_allclose(plant.advance(x, u, 0.02), expected, rtol=1e-6)
    np.testing.assert_allclose(np.hstack(plant.discretize(0.02)), held[:3], rtol=1e-10, atol=1e-13)


def test_a_long_step_is_as_fine_as_several_short_ones() -> None:
    plant = NumericPlant(MOTOR)
    x, u = np.array([0.3, 20.0, 1.5]), np.array([12.0, -0.01])
    short = x
    for _ in range(5):
        short = plant.advance(short, u, 0.02)
    np.testing.assert_allclose(plant.advance(x, u, 0.1), short, rtol=1e-12)


def test_the_filters_jacobian_agrees_with_differences() -> None:
    effects = (library(MOTOR)["rotor.quadratic_drag"], library(MOTOR)["amplifier.lag"])
    plant = NumericPlant(MOTOR, effects, {"rotor.quadratic_drag.c": 1e-5, "amplifier.lag.T": 0.01})
    x, u = np.array([0.3, 20.0, 1.5, 5.0]), np.array([12.0, -0.01])
    _, jacobian = plant.step_and_jacobian(x, u, 0.01)
    step = np.eye(4) * 1e-4
    moved = [plant.step_and_jacobian(x + s, u, 0.01)[0] - plant.step_and_jacobian(x - s, u, 0.01)[0] for s in step]
    np.testing.assert_allclose(jacobian, np.array(moved).T / 2e-4, rtol=1e-6, atol=1e-7)


def test_what_follows_the_time_is_told_it() -> None:
    hum = Effect("rotor.hum", (EffectParameter("A", "N m", 0.0, 0.0, 1.0),), force=lambda s, e: {"q": e.A * s.t})
    plant = NumericPlant(MOTOR, (hum,), {"rotor.hum.A": 2e-3, "k": 0.0, "b": 0.0})
    # J q'' = A t:  q' = A (t^2 - t0^2) / 2 J
    after = plant.advance(np.zeros(3), np.zeros(2), 0.02, 1.0)
    assert after[1] == pytest.approx(2e-3 * (1.02**2 - 1.0) / 2e-3, rel=1e-9)
    assert plant.advance(np.zeros(3), np.zeros(2), 0.02)[1] == pytest.approx(2e-3 * 0.02**2 / 2e-3, rel=1e-9)


def test_the_steps_of_a_run_are_those_of_the_free_run() -> None:
    plant, t = NumericPlant(MOTOR), np.arange(6) * 0.02
    u = np.array([[6.0, 0.0], [6.0, 0.01], [-6.0, 0.01], [0.0, 0.0], [3.0, -0.02]])
    rows = [np.zeros(3)]
    for row in u:
        rows.append(plant.advance(rows[-1], row, 0.02))
    assert run(Composite(MOTOR, (), 20), {}, np.zeros(3), t, u) == pytest.approx(np.array(rows), abs=1e-12)


def test_a_plant_without_a_declared_energy_has_none() -> None:
    with pytest.raises(ValueError, match="motor: the plant declares no energy"):
        NumericPlant(MOTOR).energy([0.0, 0.0, 0.0])


@pytest.mark.parametrize("structure", ["rolling", "published", "entries"])
def test_the_empty_set_of_effects_adds_no_operation(structure: str) -> None:
    """The hoop from its declaration, and from effects at neutral values, in the same bits."""
    values = effectcases.VALUES.get(structure, effectcases.VALUES["rolling"])
    plain, random = HoopPlant(structure, values), np.random.default_rng(1)
    declared = NumericPlant(hoop_plant(structure, values))
    neutral = NumericPlant(hoop_plant(structure, values), (library(hoop_plant(structure, values))["frame.tilt"],))
    for _ in range(50):
        x, u, h = random.normal(size=4) * [3.0, 20.0, 1.5, 10.0], random.uniform(-0.7, 0.7), random.uniform(0.0, 0.02)
        for other in (declared, neutral):
            for one, two in zip(plain.step_and_jacobian(x, u, h), other.step_and_jacobian(x, u, h), strict=True):
                assert one.tobytes() == two.tobytes()
            assert plain.advance(x, u, h).tobytes() == other.advance(x, u, h).tobytes()


def test_a_hoop_is_copied_with_what_it_is() -> None:
    plant: Any = HoopPlant("rolling", effectcases.VALUES["rolling"])
    again = pickle.loads(pickle.dumps(plant.with_parameters(mb=0.03)))
    assert isinstance(again, HoopPlant) and again.parameters["mb"] == 0.03 and again.structure == "rolling"
