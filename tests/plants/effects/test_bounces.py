"""Bounces: times, speeds, momentum and energy of flights and touches against an integrator of its own, in the plane."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects.contact_modes import LEAST_REBOUND_M_S
from hoopd.plants.model_file import load_model
from hoopd.sim.plant import RigPlant
from tests.plants.effects.carried_over import changes_of
from tests.plants.maneuver.independent import accelerations

Array = NDArray[np.float64]
FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
V = {**FILE.values(), "bh": 0.0, "bb": 0.0}
R = V["Ro"] - V["Rb"]
THROWN = np.array([0.0, 17.0 * R / V["Ro"], 0.0, 17.0])
UNTIL_S = 1.2


class Course(NamedTuple):
    """States at the end, and times of taking off and touching."""

    rolling: Array  # theta, dtheta, psi, dpsi
    left: list[float]
    touched: list[float]
    energies: list[float]  # right before and after each touch


def energy(dtheta: float, spin: float, place: Array, speed: Array) -> float:
    kinetic = V["Ih"] * dtheta**2 + V["Ib"] * spin**2 + V["mb"] * float(speed @ speed)
    return kinetic / 2 + V["mb"] * V["g"] * float(place[1])


def independent(e: float, mu: float) -> Course:
    """Rolling by the test's own equations; flights by parabolas in the plane; touches by impulses along and across."""
    t, x = 0.0, THROWN.copy()
    left, touched, energies = [], [], []

    def pressed(t: float, x: Array) -> float:
        return float(R * x[3] ** 2 + V["g"] * np.cos(x[2]))

    pressed.terminal, pressed.direction = True, -1  # type: ignore[attr-defined]

    def rate(t: float, x: Array) -> list[float]:
        theta2, psi2 = accelerations(x, 0.0, V)
        return [x[1], theta2, x[3], psi2]

    while True:
        run = solve_ivp(rate, (t, UNTIL_S), x, events=pressed, rtol=1e-11, atol=1e-12)
        if not run.t_events[0].size:
            return Course(run.y[:, -1], left, touched, energies)
        t, x = float(run.t_events[0][0]), run.y_events[0][0]
        left.append(t)
        # across and up; spin counts as the angles do
        place = R * np.array([np.sin(x[2]), -np.cos(x[2])])
        speed = R * x[3] * np.array([np.cos(x[2]), np.sin(x[2])])
        spin = (V["Ro"] * x[1] - R * x[3]) / V["Rb"]
        theta, dtheta, turns = x[0], x[1], x[2]
        while True:
            gravity = np.array([0.0, -V["g"]])
            # |place + speed s + gravity s^2 / 2|^2 = R^2, without the root at zero
            c = np.array([gravity @ gravity / 4, speed @ gravity, speed @ speed + place @ gravity, 2 * place @ speed])
            s = min(root.real for root in np.roots(c) if abs(root.imag) < 1e-9 and root.real > 1e-6)
            t, theta = t + s, theta + dtheta * s
            place, speed = place + speed * s + gravity * s**2 / 2, speed + gravity * s
            touched.append(t)
            energies.append(energy(dtheta, spin, place, speed))
            out = place / R
            along = np.array([-out[1], out[0]])
            across = float(speed @ out)
            back = e * across if e * across > LEAST_REBOUND_M_S else 0.0
            # J along on the ball; on the hoop -J Ro, on the spin -J Rb: the surface of both then moves alike
            slide = V["Ro"] * dtheta - V["Rb"] * spin - float(speed @ along)
            most = mu * V["mb"] * (across + back)
            j = np.clip(slide / (1 / V["mb"] + V["Ro"] ** 2 / V["Ih"] + V["Rb"] ** 2 / V["Ib"]), -most, most)
            speed = along * (speed @ along + j / V["mb"]) - out * back
            dtheta, spin = dtheta - j * V["Ro"] / V["Ih"], spin + j * V["Rb"] / V["Ib"]
            energies.append(energy(dtheta, spin, place, speed))
            if back == 0.0:
                break
            left.append(t)
        psi = np.arctan2(place[0], -place[1])
        psi += 2 * np.pi * round((turns - psi) / (2 * np.pi))
        x = np.array([theta, dtheta, psi, float(speed @ along) / R])


@pytest.mark.parametrize("restitution", [0.0, 0.2, 0.4])
def test_times_and_states_are_those_of_another_integrator(restitution: float) -> None:
    wanted = independent(restitution, 1e3)
    lift_off = FoundEffect("ball.lift_off", {"restitution": restitution, "grip": 1e3})
    plant = RigPlant(FoundEffects(FILE.structure, V, (lift_off,)), THROWN)
    for k in range(1, round(UNTIL_S / 0.02) + 1):
        plant.advance(0.02 * k, 0.0)
    begins, ends = zip(*plant.flights, strict=True)
    assert list(begins) == pytest.approx(wanted.left, abs=1e-6)
    assert list(ends) == pytest.approx(wanted.touched, abs=1e-6)
    assert len(ends) > (3 if restitution else 0)
    _, dtheta, psi, dpsi = plant.state
    assert np.mod(psi - wanted.rolling[2] + 1, 2 * np.pi) - 1 == pytest.approx(0.0, abs=1e-4)
    assert (dtheta, dpsi) == pytest.approx((wanted.rolling[1], wanted.rolling[3]), abs=1e-2)
    assert np.all(np.diff(wanted.energies)[::2] <= 1e-12)


TOUCHES = [(0.3, 1e3), (0.3, 0.3), (0.0, 0.3), (0.3, 0.1), (0.0, 0.1)]


@pytest.mark.parametrize(("restitution", "mu"), TOUCHES)
@pytest.mark.parametrize("torque_nm", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("slip", [False, True])
def test_no_change_of_mode_makes_energy_or_momentum(
    restitution: float, mu: float, torque_nm: float, slip: bool
) -> None:
    """A hoop that is driven in the first flight, so that the ball slides where it lands."""
    lift_off = FoundEffect("ball.lift_off", {"restitution": restitution, "grip": mu})
    slips = (FoundEffect("ball.slip", {"mu": mu}),) if slip else ()
    found = FoundEffects(FILE.structure, V, (lift_off, *slips))
    changes = changes_of(found, THROWN, torque_nm, UNTIL_S)
    assert {(one.source, one.target) for one in changes} >= {("rolling", "air"), ("air", "rolling")}
    for one in changes:
        assert one.momenta[1] == pytest.approx(one.momenta[0], abs=1e-9), one
        assert one.energies[1] <= one.energies[0] + 1e-9, one
        if one.source == "rolling":
            assert one.energies[1] == pytest.approx(one.energies[0], abs=1e-7)


def test_a_touch_with_little_friction_leaves_the_ball_slipping_and_keeps_the_rest() -> None:
    wanted = independent(0.3, 0.05)
    lift_off = FoundEffect("ball.lift_off", {"restitution": 0.3, "grip": 0.05})
    plant = RigPlant(FoundEffects(FILE.structure, V, (lift_off,)), THROWN)
    first = wanted.touched[0]
    plant.advance(wanted.touched[1] - 0.01, 0.0)
    assert plant.flights[0][1] == pytest.approx(first, abs=1e-6)
    assert plant.flights[1][0] == pytest.approx(first, abs=1e-6)
    # a smaller impulse along turns the hoop less than rolling would
    grips = RigPlant(FoundEffects(FILE.structure, V, (FoundEffect("ball.lift_off", {"restitution": 0.3}),)), THROWN)
    grips.advance(first - 1e-3, 0.0)
    before = grips.state[1]
    grips.advance(first + 1e-3, 0.0)
    assert abs(plant.state[1] - before) < 0.5 * abs(grips.state[1] - before)
