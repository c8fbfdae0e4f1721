"""Free runs from node to node: against the plant's own stepping, step-halving, finite differences; the limits of a
device without ball or with a held hoop."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.equations import rate
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.simulate import STEP_S, HoopModel
from hoopd.plants.model_file import load_model

HOOP = load_model(defaults_folder() / "models/hoop.yaml")
THESIS = load_model(defaults_folder() / "models/thesis.yaml")
CASES = [("rolling", HOOP.values()), ("published", HOOP.values()), ("entries", THESIS.values())]
FREE = {"rolling": ("mb", "Ib", "bh"), "published": ("Ih", "bb"), "entries": ("J11", "K1", "L2", "J22")}
X0 = np.array([0.3, -1.0, 0.4, 2.0])


def axis(n: int = 200, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = np.cumsum(np.concatenate([[0.0], rng.uniform(0.002, 0.02, n)]))
    return t, 0.1 * rng.choice([-1.0, 1.0], n)


@pytest.mark.parametrize(("structure", "values"), CASES)
def test_a_run_is_the_plant_s_own_stepping(structure: str, values: dict[str, float]) -> None:
    t, u = axis()
    plant, x, rows = HoopPlant(structure, values), X0, [X0]
    for k, h in enumerate(np.diff(t)):
        x = plant.advance(x, u[k], h)
        rows.append(x)
    run = HoopModel(structure, values, FREE[structure]).run([values[n] for n in FREE[structure]], X0, t, u)
    assert run.shape == (len(t), 4)
    # steps of 10 ms against 1 ms: speeds of 10 rad/s within 1e-6 of them
    assert np.abs(run - np.array(rows)).max() < 1e-5


@pytest.mark.parametrize(("structure", "values"), CASES)
def test_halving_the_step_changes_sixteen_times_less_than_the_step_did(
    structure: str, values: dict[str, float]
) -> None:
    t = np.arange(0.0, 10.0, 0.02)
    u = 0.02 * np.sign(np.sin(3.0 * t[:-1]))
    x = [HoopModel(structure, values, (), step_s=STEP_S / k).run([], X0, t, u) for k in (1, 2, 4)]
    first, second = np.abs(x[0] - x[1]).max(), np.abs(x[1] - x[2]).max()
    assert 11.0 < first / second < 22.0  # order four
    assert first < 1e-4


@pytest.mark.parametrize(("structure", "values"), CASES)
@pytest.mark.parametrize("moving", ["both", "hoop", "ball"])
def test_sensitivities_are_the_derivatives_of_the_run(structure: str, values: dict[str, float], moving: str) -> None:
    t, u = axis(60)
    free = FREE[structure]
    model = HoopModel(structure, values, free, moving=moving)
    p0 = np.array([values[n] for n in free])
    found = model.run_with_sensitivity(p0, X0, t, u)
    assert np.array_equal(found.x, model.run(p0, X0, t, u))
    for index, p in enumerate(p0):
        d = np.zeros(len(p0))
        d[index] = 1e-6 * abs(p)
        slope = (model.run(p0 + d, X0, t, u) - model.run(p0 - d, X0, t, u)) / (2 * d[index])
        size = max(np.abs(slope).max(), 1.0)
        assert np.abs(found.by_parameters[:, :, index] - slope).max() < 1e-5 * size
    for index in range(4):
        d = np.eye(4)[index] * 1e-6
        slope = (model.run(p0, X0 + d, t, u) - model.run(p0, X0 - d, t, u)) / 2e-6
        assert np.abs(found.by_start[:, :, index] - slope).max() < 1e-5 * max(np.abs(slope).max(), 1.0)


def acceleration(structure: str, values: dict[str, float], moving: str, x: list[float], u: float) -> np.ndarray:
    p = {name: ca.SX(value) for name, value in values.items()}
    return np.array(ca.DM(rate(structure, ca.SX(x), ca.SX(u), p, (), moving))).ravel()[[1, 3]]


@pytest.mark.parametrize("structure", ["rolling", "published"])
def test_without_a_ball_is_the_limit_of_a_light_ball(structure: str) -> None:
    light = {**HOOP.values(), "mb": 1e-12, "Ib": 1e-18, "bb": 1e-18}
    bare = acceleration(structure, HOOP.values(), "hoop", [0.0, 2.0, 0.0, 0.0], 0.1)
    assert bare[0] == pytest.approx(acceleration(structure, light, "both", [0.0, 2.0, 0.3, 1.0], 0.1)[0], rel=1e-8)
    assert bare[1] == 0.0


@pytest.mark.parametrize("structure", ["rolling", "published"])
def test_a_held_hoop_is_the_limit_of_a_heavy_hoop(structure: str) -> None:
    heavy = {**HOOP.values(), "Ih": 1e12}
    held = acceleration(structure, HOOP.values(), "ball", [0.0, 0.0, 0.3, 1.0], 0.0)
    assert held[1] == pytest.approx(acceleration(structure, heavy, "both", [0.0, 0.0, 0.3, 1.0], 0.0)[1], rel=1e-8)
    assert held[0] == 0.0


def test_the_held_hoop_of_entries_takes_the_torque_that_holds_it() -> None:
    e = THESIS.values()
    # psi'' = J22 psi' + K2 sin psi + L2 r with r from 0 = J12 psi' + K1 sin psi + L1 r
    r = -(e["J12"] * 1.0 + e["K1"] * np.sin(0.3)) / e["L1"]
    expected = e["J22"] * 1.0 + e["K2"] * np.sin(0.3) + e["L2"] * r
    assert acceleration("entries", e, "ball", [0.0, 5.0, 0.3, 1.0], 0.0)[1] == pytest.approx(expected, rel=1e-12)


def test_a_small_undamped_swing_has_the_pendulum_s_period() -> None:
    values = {**HOOP.values(), "bb": 0.0, "bh": 0.0}
    m, r, ro, rb = values["mb"], values["Ro"] - values["Rb"], values["Ro"], values["Rb"]
    # hoop held: (m r^2 + Ib (r/Rb)^2) psi'' = -m g r psi with w = -(r/Rb) psi' by rolling
    w = np.sqrt(m * values["g"] * r / (m * r**2 + values["Ib"] * (r / rb) ** 2))
    t = np.arange(0.0, 10.0, 0.01)
    psi = HoopModel("rolling", values, (), moving="ball").run([], [0, 0, 1e-3, 0], t, np.zeros(len(t) - 1))[:, 2]
    assert np.abs(psi - 1e-3 * np.cos(w * t)).max() < 1e-6
    assert ro > rb


def test_an_axis_that_does_not_fit_is_refused() -> None:
    model = HoopModel("rolling", HOOP.values())
    with pytest.raises(ValueError, match="n nodes"):
        model.run([], X0, [0.0, 0.02], [0.1, 0.1])
    with pytest.raises(ValueError, match="increase"):
        model.run([], X0, [0.0, 0.0, 0.02], [0.1, 0.1])
    with pytest.raises(ValueError, match="unknown parameters"):
        HoopModel("rolling", HOOP.values(), ("J11",))
