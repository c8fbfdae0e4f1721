"""A ball that falls past the axis, where its direction turns without bound: against its parabola in the plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects import contact_modes
from hoopd.plants.hoop.effects.contact_modes import AIR, ContactCourse, ContactModes
from hoopd.plants.hoop.effects.flight import FlightRun
from hoopd.plants.model_file import load_model
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]
FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
V = FILE.values()
R = V["Ro"] - V["Rb"]
LIFT_OFF = FoundEffect("ball.lift_off", {"restitution": 0.3, "grip": 0.2})
FRICTION = FoundEffect("hoop.coulomb_friction", {"Fc": 0.01})
# psi and psi' of a ball that is let go on the top, or beside it
LET_GO = [(np.pi, 0.0), (np.pi, 1e-9), (np.pi, 1e-3), (np.pi, -0.05), (np.pi - 0.01, 0.3), (np.pi - 0.3, 2.5)]


def course_of(psi: float, dpsi: float, *more: FoundEffect) -> ContactCourse:
    found = FoundEffects(FILE.structure, V, (LIFT_OFF, *more))
    modes = ContactModes(found.plant, found.effects())
    return ContactCourse(modes, found.values, modes.rolling.beginning(np.array([0.0, 3.0, psi, dpsi])))


def plane(z: Array) -> tuple[Array, Array]:
    """Place and speed, m and m/s, of a state in the air: theta, theta', psi, psi', spin, spin', r, r', ..."""
    out, along = np.array([np.sin(z[2]), -np.cos(z[2])]), np.array([np.cos(z[2]), np.sin(z[2])])
    return z[6] * out, z[7] * out + z[6] * z[3] * along


def energy(z: Array) -> float:
    """Of the ball's way, in its weight times the track."""
    place, speed = plane(z)
    return float(speed @ speed / 2 + V["g"] * place[1]) / (V["g"] * R)


@pytest.mark.parametrize(("psi", "dpsi"), LET_GO)
@pytest.mark.parametrize("more", [(), (FRICTION,)])
@pytest.mark.parametrize("h", [0.02, 0.005])
def test_it_keeps_its_energy_and_its_parabola(psi: float, dpsi: float, more: tuple[FoundEffect, ...], h: float) -> None:
    course = course_of(psi, dpsi, *more)
    course.advance(0.05, 1e-3, 0.0)
    assert course.mode == AIR
    z, t = course.z, 1e-3
    (place, speed), before, nearest, psis = plane(z), energy(z), 1.0, [z[2]]
    while t + h < 0.18:
        course.advance(0.05, h, t)
        t += h
        s = t - 1e-3
        # within 2e-6 of the track: what a step far from the axis errs by
        assert plane(course.z)[0] == pytest.approx(place + speed * s - [0.0, V["g"] * s * s / 2], abs=2e-6 * R)
        assert energy(course.z) == pytest.approx(before, abs=1e-6)
        nearest = min(nearest, course.distance)
        psis.append(course.z[2])
    assert course.mode == AIR and nearest < 0.25
    # seen on, from above the axis to below: no turn more
    assert abs(psis[-1] - psis[0]) < 4.0 and np.isfinite(course.z).all()


@pytest.mark.parametrize("dpsi", [0.0, 1e-9, 0.05])
def test_it_lands_below_and_a_free_run_goes_on(dpsi: float) -> None:
    found = FoundEffects(FILE.structure, V, (LIFT_OFF,))
    run = FlightRun(found.plant, found.effects(), values=found.values)
    t = np.arange(0.0, 0.6, 0.02)
    x = run.run([], np.array([0.0, 0.0, np.pi, dpsi]), t, np.zeros(len(t) - 1)).states
    # 2 R of a free fall
    assert run.flights[0][1] == pytest.approx(np.sqrt(4.0 * R / V["g"]), abs=1e-4)
    assert np.isfinite(x).all() and abs(np.sin(x[-1, 2])) < 0.2 and np.cos(x[-1, 2]) > 0.9


STARTS = [(2.57, 9.5), (2.5, 8.5), (2.2, 9.5), (0.0, 17.0), (-2.4, -9.0)]


@pytest.mark.parametrize(("psi", "dpsi"), STARTS)
def test_a_flight_far_from_the_axis_is_as_it_was(psi: float, dpsi: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit by the flying plant's own equations, until it comes within 12 mm."""
    runs = []
    for made in (contact_modes.FlyingComposite, Composite):
        monkeypatch.setattr(contact_modes, "FlyingComposite", made)
        course, rows = course_of(psi, dpsi, FRICTION), []
        for k in range(350):
            course.advance(0.05, 1e-3, k * 1e-3)
            rows.append([*course.seen(), course.distance])
        runs.append(np.array(rows))
    near = np.flatnonzero(runs[0][:, -1] < 0.012 / R)
    until = int(near[0]) if near.size else None
    assert np.array_equal(*(one[:until] for one in runs)) and runs[0][:until, -1].min() < 0.8


def test_a_drag_in_the_air_is_the_same_in_steps_of_any_length() -> None:
    """And takes what it takes of a ball as fast on its track: c (v/R)^2 at the lever R."""
    drag, ends = FoundEffect("ball.quadratic_drag", {"c": 2e-5}), []
    for h in (2e-3, 5e-4):
        course = course_of(2.75, 5.0, drag)
        for k in range(round(0.14 / h)):
            course.advance(0.0, h, k * h)
        assert course.mode == AIR and course.distance < 0.4
        ends.append(course.z)
    assert ends[0] == pytest.approx(ends[1], rel=1e-3)
    course = course_of(2.75, 5.0, drag)
    course.advance(0.0, 1e-3, 0.0)
    z, energies = course.z, [energy(course.z)]
    course.advance(0.0, 1e-4, 1e-3)
    energies.append(energy(course.z))
    across = z[6] * z[3] / R
    power = -drag.parameters["c"] * abs(across) ** 3 / (V["mb"] * V["g"] * R)
    assert (energies[1] - energies[0]) / 1e-4 == pytest.approx(power, rel=0.02)


def test_forces_in_the_plane_are_those_of_the_flying_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaning, shaken and with friction, all in the plane: the same as in its own coordinates, in small steps."""
    tilt = FoundEffect("frame.tilt", {"d": 0.2})
    shakes = FoundEffect("frame.vibration", {"A": 2.0, "w": 25.0, "phi": 0.3})
    lag = FoundEffect("actuator.lag", {"T": 0.03})
    ends = []
    for steps in (1e9, 0.0):
        monkeypatch.setattr("hoopd.plants.hoop.effects.flight_motion.NEAR_STEPS", steps)
        course = course_of(2.57, 9.5, FRICTION, tilt, shakes, lag)
        for k in range(140):
            course.advance(0.1, 1e-3, k * 1e-3)
        assert course.mode == AIR
        ends.append(course.z)
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)
