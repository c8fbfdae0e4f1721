"""A frame that leans or shakes under a ball that flies: gravity and beginning turned by one angle give the same motion,
turned; a shaken frame against an integrator in its plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects.flight import FlightRun
from hoopd.plants.model_file import load_model
from hoopd.sim.plant import RigPlant
from tests.plants.maneuver.independent import accelerations

Array = NDArray[np.float64]

FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
V = FILE.values()
LIFT_OFF = FoundEffect("ball.lift_off", {"restitution": 0.3, "grip": 0.2})
INNER = FoundEffect("ball.inner_hoop", {"radius": 0.0445})


def found(lean: float, *more: FoundEffect) -> FoundEffects:
    tilt = (FoundEffect("frame.tilt", {"d": lean}),) if lean else ()
    return FoundEffects(FILE.structure, V, (LIFT_OFF, *more, *tilt))


def thrown(lean: float, *more: FoundEffect) -> RigPlant:
    plant = RigPlant(found(lean, *more), np.array([0.0, 0.0, 2.2 + lean, 9.5]))
    for k in range(1, 16):
        plant.advance(0.02 * k, 0.05)
    return plant


@pytest.mark.parametrize("lean", [-0.3, 0.1, 0.5])
@pytest.mark.parametrize("more", [(), (INNER,)])
def test_turned_gravity_turns_the_motion_and_nothing_else(lean: float, more: tuple[FoundEffect, ...]) -> None:
    upright, leaning = thrown(0.0, *more), thrown(lean, *more)
    assert leaning.flights == [pytest.approx(one, abs=1e-9) for one in upright.flights]
    assert np.array(leaning.state) - [0.0, 0.0, lean, 0.0] == pytest.approx(np.array(upright.state), abs=1e-6)
    assert leaning.ball_mode == upright.ball_mode and leaning.distance == pytest.approx(upright.distance, abs=1e-9)


def test_a_free_run_lets_the_ball_go_where_leaning_gravity_does() -> None:
    t = np.arange(0.0, 0.3, 0.02)
    runs = []
    for lean in (0.0, 0.2):
        one = found(lean)
        run = FlightRun(one.plant, one.effects(), values=one.values)
        run.run([], np.array([0.0, 0.0, 2.2 + lean, 9.5]), t, np.full(len(t) - 1, 0.05))
        runs.append(run.flights)
    assert runs[1] == [pytest.approx(one, abs=1e-9) for one in runs[0]] and runs[0]


SHAKE_M_S2, SHAKE_RAD_S = 2.0, 5.0
R = V["Ro"] - V["Rb"]


def shaken(across_m_s2: float, rad_s: float, *more: FoundEffect) -> FoundEffects:
    shakes = FoundEffect("frame.vibration", {"A": across_m_s2, "w": rad_s, "phi": np.pi / 2})
    return FoundEffects(FILE.structure, V, (LIFT_OFF, shakes, *more))


@pytest.mark.parametrize("more", [(), (INNER,)])
def test_a_frame_that_is_pushed_steadily_is_one_that_leans_under_more_gravity(more: tuple[FoundEffect, ...]) -> None:
    """sqrt(g^2 + a^2), leaning by atan(a/g): rolling, in the air, at every touch and on the inner hoop."""
    lean, heavy = np.arctan(SHAKE_M_S2 / V["g"]), {**V, "g": float(np.hypot(V["g"], SHAKE_M_S2))}
    tilted = FoundEffects(FILE.structure, heavy, (LIFT_OFF, FoundEffect("frame.tilt", {"d": lean}), *more))
    plants = [RigPlant(one, np.array([0.0, 0.0, 2.4, 9.5])) for one in (shaken(SHAKE_M_S2, 1e-9, *more), tilted)]
    modes = set()
    for k in range(1, 16):
        for plant in plants:
            plant.advance(0.02 * k, 0.05)
        modes.add(plants[0].ball_mode)
        assert plants[0].ball_mode == plants[1].ball_mode
        assert plants[0].state == pytest.approx(plants[1].state, abs=1e-5)
    assert plants[0].flights == [pytest.approx(one, abs=1e-7) for one in plants[1].flights]
    assert modes >= ({"air", "inner"} if more else {"air"})


def test_a_shaken_frame_lets_the_ball_go_and_fall_as_another_integrator_says() -> None:
    """N/m = r psi'^2 + g cos psi + a sin psi; in the plane of the frame a ball in the air feels a across, g down."""

    def across(t: float) -> float:
        return float(SHAKE_M_S2 * np.cos(SHAKE_RAD_S * t))

    def rolling(t: float, x: Array) -> list[float]:
        theta2, psi2 = accelerations(x, 0.0, V, lambda x: np.array([0.0, V["mb"] * R * across(t) * np.cos(x[2])]))
        return [x[1], theta2, x[3], psi2]

    def pressed(t: float, x: Array) -> float:
        return float(R * x[3] ** 2 + V["g"] * np.cos(x[2]) + across(t) * np.sin(x[2]))

    pressed.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(rolling, (0.0, 0.1), [0.0, 0.0, 2.2, 9.5], events=pressed, rtol=1e-11, atol=1e-12)
    off, (_, _, psi, rate) = float(run.t[-1]), run.y[:, -1]
    place = R * np.array([np.sin(psi), -np.cos(psi)])
    speed = R * rate * np.array([np.cos(psi), np.sin(psi)])
    fall = solve_ivp(
        lambda t, y: [y[2], y[3], across(t), -V["g"]], (off, 0.16), [*place, *speed], rtol=1e-11, atol=1e-13
    )
    x, y = fall.y[:2, -1]
    plant = RigPlant(shaken(SHAKE_M_S2, SHAKE_RAD_S), np.array([0.0, 0.0, 2.2, 9.5]))
    for k in range(1, 9):
        plant.advance(0.02 * k, 0.0)
    assert plant.ball_mode == "air" and plant.flights[0][0] == pytest.approx(off, abs=1e-6)
    assert plant.distance == pytest.approx(np.hypot(x, y) / R, abs=1e-5)
    assert np.mod(plant.state[2], 2 * np.pi) == pytest.approx(np.mod(np.arctan2(x, -y), 2 * np.pi), abs=1e-5)


def test_a_free_run_looks_at_the_shaken_force_ahead() -> None:
    t, one = np.arange(0.0, 0.3, 0.02), shaken(SHAKE_M_S2, SHAKE_RAD_S)
    run = FlightRun(one.plant, one.effects(), values=one.values)
    run.run([], np.array([0.0, 0.0, 2.2, 9.5]), t, np.zeros(len(t) - 1))
    plant = RigPlant(one, np.array([0.0, 0.0, 2.2, 9.5]))
    plant.advance(0.02, 0.0)
    assert run.flights[0][0] == pytest.approx(plant.flights[0][0], abs=1e-6)
