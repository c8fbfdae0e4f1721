"""Found effects with numbers: their plant, their free runs, their cancellation; the checks of their entries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hoopd.core.estimator import EkfSettings
from hoopd.plants.compensation import demand_of, in_order
from hoopd.plants.found_effects import EffectError, FoundEffect, FoundEffects, check_region, checked, weak_end
from hoopd.plants.free_run import readings
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.recordings.sensor_correction import correction
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.plants.model_file import load_model
from hoopd.plants.plant_with_effects import Composite

FILE = load_model(Path(__file__).resolve().parents[2] / "config" / "models" / "hoop.yaml")
BASE = HoopPlant(FILE.structure, FILE.values())
FREE = ("Ih", "bh", "Ib")


def found(**effects: dict[str, float]) -> FoundEffects:
    entries = tuple(FoundEffect(name.replace("__", "."), values) for name, values in effects.items())
    return FoundEffects(FILE.structure, FILE.values(), entries)


CANCELLED = {
    "friction": found(hoop__coulomb_friction={"Fc": 0.008}),
    "stribeck": found(hoop__stribeck_friction={"Fc": 0.004, "Fs": 0.004, "vs": 2.0}),
    "drag": found(hoop__quadratic_drag={"c": 1e-4}),
    "imbalance": found(hoop__imbalance={"A": 0.008, "phi": 0.5}),
    "cogging": found(actuator__cogging={"A": 0.007, "n": 7.0, "phi": 0.4}),
    "ripple": found(actuator__ripple={"a": 0.3, "n": 3.0, "phi": 0.4}),
    "bias": found(actuator__torque_bias={"b": 0.006}),
    "gain": found(actuator__torque_gain={"k": 0.6}),
    "deadzone": found(actuator__deadzone={"d": 0.006}),
    "three": found(
        hoop__coulomb_friction={"Fc": 0.008},
        actuator__torque_gain={"k": 0.6},
        actuator__cogging={"A": 0.007, "n": 7.0, "phi": 0.4},
    ),
}
MOVING = np.array([0.7, 3.0, 0.2, 1.0])


@pytest.mark.parametrize("name", CANCELLED)
@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_feed_forward_leaves_the_base(name: str, direction: float) -> None:
    """Over a tick the hoop moves as the base under the wanted torque; without it is five times as far off."""
    plant, wanted, x = HoopPlant.with_effects(CANCELLED[name]), 0.05 * direction, MOVING * (1.0, direction, 1.0, 1.0)
    torque = demand_of(CANCELLED[name], 0.02, 0.0, 0.05)(x, wanted, (1.0,) * len(CANCELLED[name].entries))
    aim = BASE.advance(x, wanted, 0.02)
    off, without = (abs(plant.advance(x, u, 0.02)[1] - aim[1]) for u in (torque, wanted))
    assert off < 0.2 * without


def test_every_part_acts_by_its_own_flag_and_against_the_signal_path() -> None:
    names = [effect.name for effect in in_order(CANCELLED["three"])]
    assert names == ["hoop.coulomb_friction", "actuator.cogging", "actuator.torque_gain"]
    demand = demand_of(CANCELLED["three"], 0.02, 0.0, 0.05)
    assert demand(MOVING, 0.05, (0.0, 0.0, 0.0)) == 0.05
    assert demand(MOVING, 0.05, (0.0, 0.0, 1.0)) == pytest.approx(0.05 / 0.6)
    assert demand(MOVING, 0.05, (1.0, 0.0, 1.0)) == pytest.approx(0.058 / 0.6)


def test_friction_at_rest_goes_with_the_torque() -> None:
    whole = demand_of(CANCELLED["friction"], 0.02, 0.0, 0.05)

    def demand(x: np.ndarray, wanted: float) -> float:
        return whole(x, wanted, (1.0,))

    rest = np.zeros(4)
    assert demand(rest, 0.0) == 0.0
    assert demand(rest, 0.02) == pytest.approx(0.028, rel=1e-3) and demand(rest, -0.02) == pytest.approx(
        -0.028, rel=1e-3
    )
    # the noise of the speed at rest is no motion
    noise = [demand(np.array([0.0, w, 0.0, 0.0]), 0.0) for w in np.random.default_rng(1).normal(0.0, 0.05, 200)]
    assert np.std(noise) < 0.4 * 0.008


def test_what_no_torque_on_the_hoop_can_undo_is_left() -> None:
    left = found(ball__coulomb_friction={"Fc": 1e-4}, frame__tilt={"d": 0.03}, camera__latency={"d": 0.04})
    assert in_order(left) == ()


def test_no_effects_are_the_base_bit_for_bit() -> None:
    plant = HoopPlant.with_effects(found())
    assert (
        plant.step_and_jacobian(MOVING, 0.1, 0.02)[0].tobytes()
        == BASE.step_and_jacobian(MOVING, 0.1, 0.02)[0].tobytes()
    )
    np.testing.assert_array_equal(plant.linearize(MOVING, 0.1)[0], BASE.linearize(MOVING, 0.1)[0])


def test_dry_friction_holds_the_hoop() -> None:
    plant, x = HoopPlant.with_effects(CANCELLED["friction"]), np.zeros(4)
    for _ in range(50):
        x, _ = plant.step_and_jacobian(x, 0.007, 0.02)
    assert abs(x[0]) < 1e-9 and abs(x[1]) < 1e-9
    assert plant.advance(x, 0.02, 0.02)[1] > 0.1


@pytest.mark.parametrize("pieces", [(0.01, 0.01), (0.0199, 0.0001), (0.001,) * 20])
def test_what_a_filter_expects_of_a_held_hoop_does_not_follow_how_its_interval_is_cut(
    pieces: tuple[float, ...],
) -> None:
    """Ticks jitter: a node more between two readings must change no expectation."""
    plant, noise = HoopPlant.with_effects(CANCELLED["friction"]), np.diag(EkfSettings().q)

    def expected(*steps: float) -> np.ndarray:
        x, p = np.array([0.3, 0.0, 0.01, 0.1]), np.diag([1e-7, 0.0025, 1e-5, 0.01])
        for h in steps:
            x, f = plant.step_and_jacobian(x, 0.003, h)
            p = f @ p @ f.T + noise * h
        assert abs(x[1]) < 1e-3  # held
        return p

    np.testing.assert_allclose(expected(*pieces)[1, 1], expected(0.02)[1, 1], rtol=0.05)


def test_in_motion_the_derivative_of_the_step_has_the_friction_s_own() -> None:
    plant = HoopPlant.with_effects(CANCELLED["stribeck"])
    x, f = MOVING, plant.step_and_jacobian(MOVING, 0.1, 0.02)[1]
    moved = [
        plant.step_and_jacobian(x + s, 0.1, 0.02)[0] - plant.step_and_jacobian(x - s, 0.1, 0.02)[0]
        for s in 1e-4 * np.eye(4)
    ]
    np.testing.assert_allclose(f, np.array(moved).T / 2e-4, rtol=1e-5, atol=1e-6)


# ------------------------------------------------------------------------------------------ free runs

RUNS = {
    "friction": CANCELLED["friction"],
    "late": found(camera__latency={"d": 0.023}, actuator__delay={"d": 0.013}),
    "lags": found(encoder__speed_lag={"T": 0.03}, actuator__lag={"T": 0.02}),
    "wrong": found(encoder__eccentricity={"a": 0.05, "phi": 0.3, "follows": 1.0}, frame__tilt={"d": 0.03}),
}


def experiment() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    t = np.sort(np.concatenate([np.arange(0.0, 3.0, 0.02), np.arange(0.0, 2.9, 0.02) + 0.0067]))
    return t, np.repeat(0.05 * rng.choice((-1.0, 1.0), len(t)), 3)[: len(t) - 1], np.array([0.1, 0.5, 0.3, 0.0])


@pytest.mark.parametrize("name", RUNS)
def test_a_run_reads_what_the_sensors_read_and_its_derivatives_are_exact(name: str) -> None:
    t, u, x0 = experiment()
    model, p = HoopModel.with_effects(RUNS[name], FREE), np.array([FILE.values()[one] for one in FREE])
    ran, composite = model.run(p, x0, t, u), model.composite
    # with every parameter free, and in steps of a millisecond
    free, fine = (Composite(composite.declared, composite.effects, substeps) for substeps in (None, 20))
    reads, converged = (readings(one, RUNS[name].values, x0, t, u) for one in (free, fine))
    for column, channel in enumerate(("theta", "dtheta", "psi")):
        np.testing.assert_allclose(ran[:, column], reads[channel], atol=3e-4)
        # rad and rad/s
        np.testing.assert_allclose(ran[:, column], converged[channel], atol=1e-3 if channel == "dtheta" else 3e-4)
    made = model.run_with_sensitivity(p, x0, t, u)
    np.testing.assert_allclose(made.x, ran, atol=1e-9)
    for index, size in ((0, 1e-5 * p[0]), (2, 1e-5 * p[2])):
        bump = np.eye(3)[index] * size
        numeric = (model.run(p + bump, x0, t, u) - model.run(p - bump, x0, t, u)) / (2 * size)
        np.testing.assert_allclose(made.by_parameters[:, :, index], numeric, atol=1e-4 * np.abs(numeric).max())
    bump = np.array([0.0, 0.0, 1e-5, 0.0])
    numeric = (model.run(p, x0 + bump, t, u) - model.run(p, x0 - bump, t, u)) / 2e-5
    np.testing.assert_allclose(made.by_start[:, :, 2], numeric, atol=1e-4 * np.abs(numeric).max())


def test_no_effects_run_as_the_base() -> None:
    t, u, x0 = experiment()
    base = HoopModel(FILE.structure, FILE.values()).run((), x0, t, u)
    np.testing.assert_allclose(HoopModel.with_effects(found()).run((), x0, t, u), base, atol=1e-5)


def test_readings_are_put_right() -> None:
    wrong = found(
        encoder__eccentricity={"a": 0.1, "phi": 0.3, "follows": 1.0},
        camera__center_offset={"dx": 0.05, "dy": -0.04},
        camera__angle_offset={"d": 0.02},
    )
    corrected = correction(wrong)
    assert corrected is not None and correction(CANCELLED["friction"]) is None
    theta, dtheta, psi = 1.3, 4.0, 0.7
    read = (
        theta + 0.1 * np.sin(theta + 0.3),
        dtheta * (1.0 + 0.1 * np.cos(theta + 0.3)),
        np.arctan2(np.sin(psi) + 0.05, np.cos(psi) - 0.04) + 0.02,
    )
    assert corrected(*map(float, read)) == pytest.approx((theta, dtheta, psi), abs=1e-6)


# ------------------------------------------------------------------------------------------ entries


@pytest.mark.parametrize(
    ("name", "parameters", "key", "reason"),
    [
        ("hoop.coulomb", {"Fc": 0.01}, "name", "unknown effect"),
        ("hoop.coulomb_friction", {"F": 0.01}, "parameters.F", "unknown parameter"),
        ("hoop.coulomb_friction", {}, "parameters", "lacks Fc"),
        ("hoop.coulomb_friction", {"Fc": -0.01}, "parameters.Fc", "must be 0 to"),
        ("actuator.cogging", {"A": 0.01, "n": 2.5}, "parameters.n", "must be one of"),
        ("actuator.cogging", {"A": 0.01}, "parameters", "lacks n"),
        ("camera.latency", {"d": float("nan")}, "parameters.d", "must be"),
    ],
)
def test_an_entry_that_cannot_be_meant(name: str, parameters: dict[str, float], key: str, reason: str) -> None:
    with pytest.raises(EffectError, match=reason) as raised:
        checked(found().plant, name, parameters)
    assert raised.value.key == key


def test_phases_and_switches_have_a_natural_zero() -> None:
    assert checked(found().plant, "actuator.cogging", {"A": 0.01, "n": 7.0})["phi"] == 0.0


@pytest.mark.parametrize("valid", [{"speed": (0.0, 1.0)}, {"dtheta": (1.0, 1.0)}, {"dtheta": (1.0,)}])
def test_a_region_that_cannot_be_meant(valid: dict[str, tuple[float, ...]]) -> None:
    with pytest.raises(EffectError):
        check_region(valid)


@pytest.mark.parametrize(
    ("name", "value", "ci95", "least"),
    [
        ("hoop.coulomb_friction.Fc", 0.008, (0.006, 0.010), 0.006),
        ("hoop.coulomb_friction.Fc", 0.008, None, 0.008),
        ("actuator.torque_bias.b", -0.004, (-0.006, -0.002), -0.002),
        ("actuator.torque_bias.b", -0.004, (-0.009, 0.001), 0.0),
        ("actuator.torque_gain.k", 0.8, (0.7, 0.9), 0.9),
        ("actuator.cogging.n", 7.0, (6.9, 7.1), 7.0),
        ("actuator.deadzone.d", 0.006, (0.004, 0.008), 0.004),
        ("hoop.stribeck_friction.vs", 2.0, (1.5, 2.5), 2.0),
    ],
)
def test_no_more_is_fed_forward_than_is_sure(
    name: str, value: float, ci95: tuple[float, float] | None, least: float
) -> None:
    effect, _, parameter = name.rpartition(".")
    one = next(e for e in found(**{effect.replace(".", "__"): {}}).effects() if e.name == effect)
    assert weak_end(one.parameter(parameter), value, ci95) == least
