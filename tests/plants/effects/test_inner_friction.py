"""Frictions of a ball on the inner hoop: forces written by hand, and SciPy's integrator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.model_file import load_model
from hoopd.sim.plant import RigPlant
from tests.plants.effects.carried_over import changes_of

Array = NDArray[np.float64]
FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
V = {**FILE.values(), "bb": 0.0}
RI = 0.0445
TRACK = RI + V["Rb"]
INNER = (FoundEffect("ball.lift_off", {}), FoundEffect("ball.inner_hoop", {"radius": RI}))


def rig(x0: list[float], name: str, **numbers: float) -> RigPlant:
    effects = FoundEffects(FILE.structure, V, (*INNER, FoundEffect(name, numbers)))
    return RigPlant(effects, np.array(x0), inner=True)


def force(y: Array) -> float:
    return float(-V["mb"] * (TRACK * y[3] ** 2 + V["g"] * np.cos(y[2])))


def rolled(x0: list[float], until_s: float, torque: float, level: tuple[float, float]) -> Array:
    """theta, theta', psi, psi' by Lagrange: w = (R psi' - Ri theta')/Rb, and a torque of level + share N against the
    rolling, phi' = w - psi'."""
    a, b, i = -RI / V["Rb"], TRACK / V["Rb"], V["Ib"]
    mass = np.array([[V["Ih"] + i * a * a, i * a * b], [i * a * b, V["mb"] * TRACK**2 + i * b * b]])

    def rate(t: float, y: Array) -> list[float]:
        against = (level[0] + level[1] * force(y)) * np.sign(RI / V["Rb"] * (y[3] - y[1]))
        on_theta = torque - V["bh"] * y[1] + RI / V["Rb"] * against
        on_psi = -V["mb"] * V["g"] * TRACK * np.sin(y[2]) - RI / V["Rb"] * against
        theta2, psi2 = np.linalg.solve(mass, [on_theta, on_psi])
        return [y[1], theta2, y[3], psi2]

    return np.asarray(solve_ivp(rate, (0.0, until_s), x0, rtol=1e-11, atol=1e-12).y[:, -1])


def slid(x0: list[float], until_s: float, torque: float, mu: float) -> Array:
    """theta, theta', psi, psi', w of a ball on which the hoop slides ahead: mu N along, until the end."""
    spin = (TRACK * x0[3] - RI * x0[1]) / V["Rb"]

    def rate(t: float, y: Array) -> list[float]:
        f = mu * force(y)
        on_hoop = torque - V["bh"] * y[1] - RI * f
        along = -V["g"] * np.sin(y[2]) + f / V["mb"]
        return [y[1], on_hoop / V["Ih"], y[3], along / TRACK, -V["Rb"] * f / V["Ib"]]

    y = solve_ivp(rate, (0.0, until_s), [*x0, spin], rtol=1e-11, atol=1e-12).y
    slide = RI * y[1] - (TRACK * y[3] - V["Rb"] * y[4])
    assert slide[1:].min() > 0.0
    return np.asarray(y[:, -1])


@pytest.mark.parametrize(
    ("name", "numbers", "level"),
    [
        ("ball.coulomb_friction", {"Fc": 1e-3}, (1e-3, 0.0)),
        ("ball.rolling_resistance", {"r": 1e-3}, (0.0, 1e-3)),
        ("ball.coulomb_friction", {"Fc": 0.0}, (0.0, 0.0)),
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_dry_friction_acts_against_the_rolling_there(
    name: str, numbers: dict[str, float], level: tuple[float, float], side: float
) -> None:
    x0 = [0.0, 0.0, np.pi + 0.1 * side, 2.0 * side]
    plant = rig(x0, name, **numbers)
    for k in range(1, 6):
        plant.advance(0.02 * k, 0.02 * side)
    assert plant.ball_mode == "inner"
    assert plant.state == pytest.approx(tuple(rolled(x0, 0.1, 0.02 * side, level)), abs=1e-6)


@pytest.mark.parametrize(("name", "number"), [("ball.coulomb_friction", "Fc"), ("ball.rolling_resistance", "r")])
def test_a_ball_that_friction_holds_does_not_roll_and_goes_down_with_the_hoop(name: str, number: str) -> None:
    holds, rolls = (rig([0.0, 0.0, np.pi - 0.02, 0.0], name, **{number: size}) for size in (2e-3, 0.0))
    for one in (holds, rolls):
        one.advance(0.3, 0.0)
    assert holds.ball_mode == "inner" and holds.state[3] == pytest.approx(holds.state[1], abs=1e-4)
    assert abs(rolls.state[3] - rolls.state[1]) > 0.1


def test_a_ball_that_slips_is_left_behind_by_the_hoop() -> None:
    x0, torque, mu = [0.0, 0.0, np.pi + 0.05, 0.5], 0.3, 0.05
    plant = rig(x0, "ball.slip", mu=mu)
    for k in range(1, 5):
        plant.advance(0.02 * k, torque)
    assert plant.ball_mode == "inner"
    assert plant.state == pytest.approx(tuple(slid(x0, 0.08, torque, mu)[:4]), abs=1e-6)


def test_a_ball_that_grips_rolls_there_as_without_slip() -> None:
    x0 = [0.0, 0.0, np.pi + 0.1, 0.5]
    slips, rolls = rig(x0, "ball.slip", mu=1.5), rig(x0, "ball.coulomb_friction", Fc=0.0)
    for one in (slips, rolls):
        one.advance(0.1, 0.05)
    assert slips.state == pytest.approx(rolls.state, abs=1e-8)


@pytest.mark.parametrize("mu", [0.05, 0.3])
@pytest.mark.parametrize("torque_nm", [-0.5, 0.5])
def test_no_landing_of_a_ball_that_slips_makes_energy_or_momentum(mu: float, torque_nm: float) -> None:
    off = np.pi / 2 + 0.62
    thrown = np.array([0.0, 12.0, off, np.sqrt(-V["g"] * np.cos(off) / (V["Ro"] - V["Rb"]))])
    entries = (FoundEffect("ball.lift_off", {"restitution": 0.3}), INNER[1], FoundEffect("ball.slip", {"mu": mu}))
    changes = changes_of(FoundEffects(FILE.structure, {**V, "bh": 0.0}, entries), thrown, torque_nm, 1.0)
    assert {(one.source, one.target) for one in changes} >= {("air", "inner"), ("inner", "air")}
    for one in changes:
        assert one.momenta[1] == pytest.approx(one.momenta[0], abs=1e-9), one
        assert one.energies[1] <= one.energies[0] + 1e-9, one
