"""What effects have in common: friction takes energy, what sticks stays, classes are one, half the step is no news."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from harness.effectcases import NAMES, VALUES, composite, sizes, two_level

from hoopd.plants.effects.library import library
from hoopd.plants.free_run import readings, run
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.entries import entries_of
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.plant_with_effects import Composite

T, U = two_level(1.0)
X0 = np.array([0.2, -1.0, 0.5, 2.0])
PASSIVE = [
    *(f"hoop.{name}" for name in ("coulomb_friction", "stribeck_friction", "quadratic_drag")),
    *(f"ball.{name}" for name in ("coulomb_friction", "rolling_resistance", "quadratic_drag")),
]
# the base's own friction would hide what an effect feeds in
LOSSLESS = {"bb": 0.0, "bh": 0.0}


def energy(z: np.ndarray) -> np.ndarray:
    plant = HoopPlant("rolling", {**VALUES["rolling"], **LOSSLESS})
    return np.array([plant.energy(x[:4]) for x in z])


@pytest.mark.parametrize("name", PASSIVE)
def test_friction_takes_energy_away_at_every_step(name: str) -> None:
    still = np.zeros(100)
    t = np.arange(101) * 0.02
    start = np.array([0.0, 8.0, 1.0, 3.0])
    z = run(composite("rolling", name, **LOSSLESS), sizes(name), start, t, still)
    kept = run(composite("rolling", **LOSSLESS), {}, start, t, still)
    loss = -np.diff(energy(z))
    # of Runge-Kutta's steps the base alone changes its energy by 1e-8 of it
    assert loss.min() > -1e-9
    assert np.abs(np.diff(energy(kept))).max() < 1e-9
    assert energy(z)[0] - energy(z)[-1] > 1e-4


def test_friction_drift_follows_the_sign_of_its_size() -> None:
    t, still = np.arange(101) * 0.02, np.zeros(100)
    c = composite("rolling", "hoop.friction_drift", moving="hoop")
    speed = [run(c, {"hoop.friction_drift.a": a, "hoop.friction_drift.T": 0.5}, [0, 5.0], t, still)[-1, 1]
             for a in (-0.5, 0.0, 1.0)]  # fmt: skip
    assert speed[0] > speed[1] > speed[2] > 0.0


def test_a_slipping_ball_loses_energy() -> None:
    t, still = np.arange(401) * 0.02, np.zeros(400)
    c = composite("rolling", "ball.slip", **LOSSLESS)
    start = np.array([0.0, 8.0, 1.0, 3.0, 0.0, 60.0])
    z = run(c, {"ball.slip.mu": 0.05}, start, t, still)
    # T of hoop, path and spin, whose rate is the rolling one's less the slip
    v = VALUES["rolling"]
    ratio, path = v["Ro"] / v["Rb"], v["Ro"] - v["Rb"]
    spin = ratio * z[:, 1] - (ratio - 1) * z[:, 3] - z[:, 5]
    kinetic = (v["Ih"] * z[:, 1] ** 2 + v["mb"] * (path * z[:, 3]) ** 2 + v["Ib"] * spin**2) / 2
    total = kinetic - v["mb"] * v["g"] * path * np.cos(z[:, 2])
    assert np.diff(total).max() < 1e-8
    assert total[0] - total[-1] > 1e-3
    # it comes to roll
    assert (z[:50, 5] == 0.0).sum() < 5
    assert (z[-50:, 5] == 0.0).sum() > 10


@pytest.mark.parametrize("structure", ["rolling", "published", "entries"])
def test_a_ball_with_grip_rolls(structure: str) -> None:
    z = run(composite(structure, "ball.slip"), {"ball.slip.mu": 5.0}, [0.0, 0.0, 0.2, 0.0], T, U)
    base = run(composite(structure, substeps=5), {}, [0.0, 0.0, 0.2, 0.0], T, U)
    assert np.array_equal(z[:, :4], base)
    assert not z[:, 5].any()


# ---------------------------------------------------------------------------------------------- sticking


def test_what_rests_under_less_than_the_level_stays_to_the_last_bit() -> None:
    c = composite("rolling", "hoop.coulomb_friction", moving="hoop")
    for share in (0.3, 0.6, 0.99, -0.99):
        z = run(c, {"hoop.coulomb_friction.Fc": 0.01}, [1.0, 0.0], T, np.full(len(U), share * 0.01))
        assert np.abs(z - [1.0, 0.0]).max() < 1e-15
    z = run(c, {"hoop.coulomb_friction.Fc": 0.01}, [1.0, 0.0], T, np.full(len(U), 0.0101))
    assert z[-1, 0] > 1.01


@pytest.mark.parametrize("structure", ["rolling", "entries"])
def test_a_ball_on_a_slope_and_its_hoop_hold_each_other(structure: str) -> None:
    names = ("hoop.coulomb_friction", "ball.coulomb_friction")
    c = composite(structure, *names)
    # gravity on the ball 1e-3 N m: the rolling friction of 9.2 times its torque holds it, the hoop's holds both
    values = {"hoop.coulomb_friction.Fc": 0.004, "ball.coulomb_friction.Fc": 3e-4}
    z = run(c, values, [0.0, 0.0, 0.02, 0.0], T, np.zeros(len(U)))
    assert np.abs(z - [0.0, 0.0, 0.02, 0.0]).max() < 1e-8
    # without the hoop's, both go
    free = run(c, {**values, "hoop.coulomb_friction.Fc": 0.0}, [0.0, 0.0, 0.02, 0.0], T, np.zeros(len(U)))
    assert np.abs(free[-1, 0]) > 1e-3
    # stuck to each other they roll no more: what holds them follows the motion substep by substep
    assert np.abs(free[:, 1] - free[:, 3]).max() < 1e-4
    assert np.abs(free[:, 0] - free[:, 2] + 0.02).max() < 2e-5


def test_two_frictions_on_one_body_add_up() -> None:
    names = ("hoop.coulomb_friction", "hoop.stribeck_friction")
    two = {"hoop.coulomb_friction.Fc": 0.004, "hoop.stribeck_friction.Fc": 0.003, "hoop.stribeck_friction.Fs": 0.0}
    sum_ = run(composite("rolling", names[0], substeps=10), {"hoop.coulomb_friction.Fc": 0.007}, X0, T, U)
    assert np.abs(run(composite("rolling", *names), two, X0, T, U) - sum_).max() < 2e-3


# ---------------------------------------------------------------------------------------------- classes


def seen(c: object, values: dict[str, float], x0: np.ndarray, u: np.ndarray = U) -> np.ndarray:
    return np.stack(list(readings(c, values, x0, T, u).values()))  # type: ignore[arg-type]


@pytest.mark.parametrize("structure", ["rolling", "entries"])
def test_a_tilted_frame_is_a_camera_turned(structure: str) -> None:
    tilted = seen(composite(structure, "frame.tilt"), {"frame.tilt.d": 0.07}, X0 + np.array([0, 0, 0.07, 0]))
    turned = seen(composite(structure, "camera.angle_offset"), {"camera.angle_offset.d": 0.07}, X0)
    assert np.abs(tilted - turned).max() < 1e-12


def test_imbalance_is_the_first_harmonic_of_cogging() -> None:
    a = {"hoop.imbalance.A": 0.01, "hoop.imbalance.phi": 0.3}
    b = {"actuator.cogging.A": 0.01, "actuator.cogging.n": 1.0, "actuator.cogging.phi": 0.3 + pi}
    one = run(composite("rolling", "hoop.imbalance", substeps=10), a, X0, T, U)
    assert np.abs(run(composite("rolling", "actuator.cogging"), b, X0, T, U) - one).max() < 1e-12


def test_everything_late_is_a_late_torque() -> None:
    late, u = 0.043, np.concatenate([np.zeros(5), U[:-5]])
    delayed = seen(composite("rolling", "actuator.delay"), {"actuator.delay.d": late}, np.zeros(4), u)
    names = ("camera.latency", "encoder.latency")
    values = {f"{name}.d": late for name in names}
    sensed = seen(composite("rolling", *names, substeps=8), values, np.zeros(4), u)
    assert np.abs(sensed[[0, 2]] - delayed[[0, 2]]).max() < 2e-4
    assert np.abs(sensed).max() > 1.0


def test_stribeck_without_its_peak_is_coulomb() -> None:
    one = run(composite("rolling", "hoop.coulomb_friction", substeps=10), {"hoop.coulomb_friction.Fc": 0.005}, X0, T, U)
    two = run(composite("rolling", "hoop.stribeck_friction"), {"hoop.stribeck_friction.Fc": 0.005}, X0, T, U)
    assert np.array_equal(one, two)


def test_with_a_single_size_of_torque_dead_zone_saturation_and_gain_are_one() -> None:
    u = 0.1 * np.sign(U)
    runs = [
        run(composite("rolling", "actuator.deadzone"), {"actuator.deadzone.d": 0.02}, X0, T, u),
        run(composite("rolling", "actuator.saturation"), {"actuator.saturation.s": 0.08}, X0, T, u),
        run(composite("rolling", "actuator.torque_gain"), {"actuator.torque_gain.k": 0.8}, X0, T, u),
    ]
    assert max(np.abs(one - runs[0]).max() for one in runs) < 1e-12


def test_entries_of_a_rolling_ball_take_every_effect_as_the_rolling_ball_does() -> None:
    values = VALUES["rolling"]
    own = {**{k: values[k] for k in ("mb", "Ro", "Rb", "g")}, **entries_of("rolling", values)}
    for name in NAMES:
        declared = hoop_plant("entries", own)
        z = run(Composite(declared, [library(declared)[name]]), sizes(name), X0, T, U)
        assert np.abs(z - run(composite("rolling", name), sizes(name), X0, T, U)).max() < 1e-7, name


# ---------------------------------------------------------------------------------------------- steps


@pytest.mark.parametrize("structure", ["rolling", "entries"])
def test_halving_the_step_moves_no_angle_by_the_encoder_s_step(structure: str) -> None:
    for name in NAMES:
        c = composite(structure, name)
        z = run(c, sizes(name), X0, T, U)
        fine = run(composite(structure, name, substeps=2 * c.substeps), sizes(name), X0, T, U)
        assert np.abs(z - fine)[:, [0, 2]].max() < 3e-4, name  # the encoder: 1.5e-3
        assert np.abs(z - fine)[:, [1, 3]].max() < 6e-3, name
