"""A ball of the rig that leaves the hoop: when, where it flies and lands, by an integrator of its own; what is seen."""

from __future__ import annotations

from math import hypot, isnan
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hoopd.core.records import CameraSample
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.model_file import load_model
from hoopd.shell import config as configuration
from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import Vision
from hoopd.sim import parts
from hoopd.sim.faults import FaultScript
from hoopd.sim.plant import RigPlant
from hoopd.sim.scene import Scene, SceneSettings
from hoopd.sim.watchers import SEEN_SHARE, DirectWatcher
from tests.plants.maneuver.independent import accelerations

Array = NDArray[np.float64]
FILE = load_model(Path(__file__).resolve().parents[2] / "config" / "models" / "hoop.yaml")
V = FILE.values()
R = V["Ro"] - V["Rb"]
# fast enough to pass the axis, too slow for the top
THROWN = np.array([0.0, 17.0 * R / V["Ro"], 0.0, 17.0])


def rig(x0: Array, *names: str) -> RigPlant:
    entries = tuple(FoundEffect(name, {}) for name in names)
    return RigPlant(FoundEffects(FILE.structure, V, entries), x0)


def rate(t: float, x: Array) -> list[float]:
    theta2, psi2 = accelerations(x, 0.0, V)
    return [x[1], theta2, x[3], psi2]


def pressed(t: float, x: Array) -> float:
    return float(R * x[3] ** 2 + V["g"] * np.cos(x[2]))


pressed.terminal = True  # type: ignore[attr-defined]


def test_it_takes_off_flies_and_lands_when_an_integrator_of_its_own_says() -> None:
    off = solve_ivp(rate, (0.0, 1.0), THROWN, events=pressed, rtol=1e-10, atol=1e-12)
    begin, x = float(off.t_events[0][0]), off.y_events[0][0]
    # in the plane, x across and y up: a parabola, until it is as far from the axis as it was
    place, speed = np.array([np.sin(x[2]), -np.cos(x[2])]) * R, np.array([np.cos(x[2]), np.sin(x[2])]) * R * x[3]

    def flown(s: float) -> Array:
        return np.asarray(place + speed * s - np.array([0.0, V["g"] * s**2 / 2]))

    times = np.linspace(1e-3, 0.5, 200_000)
    away = np.hypot(place[0] + speed[0] * times, place[1] + speed[1] * times - V["g"] * times**2 / 2)
    end = begin + float(times[np.argmax(away >= R)])
    plant = rig(THROWN, "ball.lift_off")
    for k in range(1, 300):
        t = 0.002 * k
        plant.advance(t, 0.0)
        if begin + 0.003 < t < end - 0.002:
            across, up = flown(t - begin)
            assert plant.state[2] == pytest.approx(np.arctan2(across, -up), abs=0.03)
            assert plant.distance == pytest.approx(hypot(across, up) / R, abs=0.01)
    # a start is found within a step of 1 ms
    (flight, *_) = plant.flights
    assert flight[0] == pytest.approx(begin, abs=1.1e-3) and flight[1] == pytest.approx(end, abs=4e-3)
    assert plant.distance == 1.0


def test_a_ball_that_is_pressed_on_moves_as_it_did() -> None:
    one, other = rig(np.array([0.0, 0.0, 0.4, 0.0]), "ball.lift_off"), rig(np.array([0.0, 0.0, 0.4, 0.0]))
    for k in range(1, 100):
        for plant in (one, other):
            plant.advance(0.01 * k, 0.05 * (-1) ** (k // 9))
    assert one.flights == [] and one.state == pytest.approx(other.state, abs=1e-7)


def test_off_its_track_it_is_not_seen() -> None:
    plant, seen = rig(THROWN, "ball.lift_off"), []
    watcher = DirectWatcher(FaultScript([], 0), 0, noise_rad=0.0, offset_rad=0.0, centre_px=(240, 240), radius_px=182)
    for k in range(1, 40):
        plant.advance(0.01 * k, 0.0)
        sample: CameraSample = watcher.see(k, 0.01 * k, plant.shown, plant.shown_distance)
        off = abs(plant.distance - 1.0) > SEEN_SHARE
        assert isnan(sample.psi) == off and sample.confidence == (0.0 if off else 1.0)
        assert hypot(sample.x_px - 240, sample.y_px - 240) == pytest.approx(182 * plant.distance)
        seen.append(off)
    assert any(seen) and not seen[-1]


def test_the_configuration_switches_it_on() -> None:
    config = configuration.load(None, sim=True, overrides=["sim.effects=[{name: ball.lift_off}]"])
    assert parts.plant_arguments(config, FILE)["effects"] == {"ball.lift_off": {"restitution": 0.0, "grip": 1e3}}


def test_a_flying_ball_is_drawn_where_it_is_and_found_near_its_track() -> None:
    scene, analyser = Scene(SceneSettings()), Analyser(Vision(), 0.3)
    for distance in (1.0, 0.93):
        sample = analyser.bgr(1, 0.0, 0.0, scene.render(1, (0.0, 0.0, 2.6, 0.0), distance=distance))
        assert sample.psi == pytest.approx(2.6, abs=0.01)
        assert hypot(sample.x_px - 240, sample.y_px - 240) == pytest.approx(182 * distance, abs=0.7)
    analyser.reset()
    assert isnan(analyser.bgr(1, 0.0, 0.0, scene.render(1, (0.0, 0.0, 2.6, 0.0), distance=0.75)).psi)


def test_the_rig_draws_the_inner_hoop_and_a_ball_on_it_is_seen() -> None:
    state, settings = (0.3, 0.0, np.pi, 0.0), SceneSettings(inner_radius=94.0)
    picture = Scene(settings).render(1, state, distance=117.0 / 182.0)
    without = Scene(SceneSettings()).render(1, state)
    assert abs(float(picture[240, 150].mean()) - float(without[240, 150].mean())) > 10
    inner = Vision(inner_px=117.0)
    sample = Analyser(inner, 0.3).bgr(1, 0.0, 0.0, picture)
    assert sample.psi == sample.direction and abs(sample.psi) == pytest.approx(np.pi, abs=0.01)
    assert sample.distance == pytest.approx(117.0 / 182.0, abs=0.005)
    # between both it flies: its place is known, but it is no ball on a hoop
    between = Scene(settings).render(1, (0.3, 0.0, 2.6, 0.0), distance=0.8)
    flying = Analyser(inner, 0.3).bgr(1, 0.0, 0.0, between)
    assert isnan(flying.psi) and flying.direction == pytest.approx(2.6, abs=0.01)
