"""The plant against a second derivation by hand, the thesis's figures, energy and convergence."""

from __future__ import annotations

import pickle
import time

import casadi as ca
import numpy as np
import pytest

from hoopd.plants.hoop.equations import Symbols, mobility, rate, runge_kutta, symbols
from hoopd.plants.hoop.parameters import ParameterError
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.numeric_plant import ADVANCE_STEPS, FILTER_STEPS

GEOMETRY = {"mb": 0.0608, "Ro": 0.0957, "Rb": 0.0104, "g": 9.81}
DEVICE = {**GEOMETRY, "Ib": 3.679e-6, "Ih": 1.518e-3, "bb": 2.6e-6, "bh": 7e-4}
TABLE = {
    **GEOMETRY,
    "Ib": 2.4963218878738077e-6,
    "Ih": 1.5000089046344925e-3,
    "bb": 2.5737738382893808e-6,
    "bh": 7.499999947648515e-3,
}
THESIS = {
    **GEOMETRY,
    "J11": -0.4818896328354544,
    "J12": 0.06769766279210704,
    "K1": -5.119508012862879,
    "L1": 586.3694971455833,
    "J21": -0.0032686776857956444,
    "J22": -0.33509889971201284,
    "K2": -73.63359905056758,
    "L2": 210.1200001949957,
}
STATE = np.array([3.0, 5.0, 0.7, -4.0])


def by_hand(kinematics: str, p: dict[str, float], x: np.ndarray, u: float) -> np.ndarray:
    """q'' = M^-1 (D u - Q q' - C sin psi): w = a theta' + b psi', phi' = n (theta' - psi')."""
    n, r = p["Ro"] / p["Rb"], p["Ro"] - p["Rb"]
    a, b = (n, 1 - n) if kinematics == "rolling" else (n + 1, -n)
    mass = np.array(
        [[p["Ih"] + p["Ib"] * a * a, p["Ib"] * a * b], [p["Ib"] * a * b, p["mb"] * r * r + p["Ib"] * b * b]]
    )
    damping = p["bb"] * n * n * np.array([[1, -1], [-1, 1]]) + np.diag([p["bh"], 0])
    gravity = np.array([0, p["mb"] * p["g"] * r * np.sin(x[2])])
    acceleration = np.linalg.solve(mass, np.array([u, 0]) - damping @ x[[1, 3]] - gravity)
    return np.array([x[1], acceleration[0], x[3], acceleration[1]])


@pytest.mark.parametrize("kinematics", ["rolling", "published"])
def test_euler_lagrange_agrees_with_the_derivation_by_hand(kinematics: str) -> None:
    rng = np.random.default_rng(0)
    plant = HoopPlant(kinematics, DEVICE)
    for _ in range(20):
        x, u = rng.normal(size=4) * (1, 30, 1, 5), rng.normal()
        np.testing.assert_allclose(plant.derivative(x, u), by_hand(kinematics, DEVICE, x, u), rtol=1e-11)


def test_table_of_the_thesis_gives_the_entries_of_its_own_matrices() -> None:
    a, b = HoopPlant("published", TABLE).linearize()
    got = [a[1, 1], a[3, 1], a[1, 2], a[3, 2], b[1, 0], b[3, 0]]
    np.testing.assert_allclose(got, [-4.56, -1.30, -10.9, -81.7, 597, 214], rtol=3e-3)


def test_thesis_entries_have_the_printed_poles_and_zeros() -> None:
    a, b = HoopPlant("entries", THESIS).linearize()
    poles = sorted(np.linalg.eigvals(a), key=lambda s: (s.real, s.imag))
    want = [-0.4816611437370447, -0.167663694405211 - 8.579375019784992j, -0.167663694405211 + 8.579375019784992j, 0]
    np.testing.assert_allclose(poles, want, atol=1e-12)
    # zeros of psi: det [[sI - A, -B], [C, 0]] = 0
    c = np.array([[0, 0, 1, 0.0]])
    import scipy.linalg

    zeros = scipy.linalg.eigvals(np.block([[a, b], [c, np.zeros((1, 1))]]), np.diag([1.0, 1, 1, 1, 0]))
    finite = np.sort(zeros[np.abs(zeros) < 1e3].real)
    np.testing.assert_allclose(finite, [-0.4727679267190814, 0], atol=1e-10)


@pytest.mark.parametrize("kinematics", ["rolling", "published"])
def test_energy_is_kept_without_dissipation_and_falls_with_it(kinematics: str) -> None:
    x0 = np.array([0.0, 20.0, 1.0, -3.0])
    for damping, kept in ((0.0, True), (1.0, False)):
        plant = HoopPlant(kinematics, {**DEVICE, "bb": damping * DEVICE["bb"], "bh": damping * DEVICE["bh"]})
        x, before = x0, plant.energy(x0)
        for _ in range(100):
            x = plant.advance(x, 0.0, 0.02)
        change = (plant.energy(x) - before) / before
        assert abs(change) < 1e-8 if kept else change < -0.1


def test_torque_does_the_work_that_the_energy_gains() -> None:
    plant = HoopPlant("rolling", {**DEVICE, "bb": 0.0, "bh": 0.0})
    x = np.zeros(4)
    for _ in range(20):
        x = plant.advance(x, 0.05, 0.02)
    assert plant.energy(x) - plant.energy(np.zeros(4)) == pytest.approx(0.05 * x[0], rel=1e-8)


def test_a_ball_in_a_resting_hoop_turns_as_rolling_demands() -> None:
    """Kinetic energy of the spin alone tells w: (Ro-Rb)/Rb times psi' when rolling, Ro/Rb in the papers."""
    for kinematics, ratio in (("rolling", (0.0957 - 0.0104) / 0.0104), ("published", 0.0957 / 0.0104)):
        speed, ib = 2.0, DEVICE["Ib"]
        x, rest = np.array([0, 0, 0, speed]), np.zeros(4)
        plant = HoopPlant(kinematics, DEVICE)
        kinetic = plant.energy(x) - plant.energy(rest)
        spin = kinetic - DEVICE["mb"] * ((0.0957 - 0.0104) * speed) ** 2 / 2
        assert np.sqrt(2 * spin / ib) == pytest.approx(ratio * speed, rel=1e-9)


@pytest.mark.parametrize(("structure", "p"), [("rolling", DEVICE), ("published", TABLE), ("entries", THESIS)])
def test_positive_torque_turns_hoop_and_ball_the_positive_way(structure: str, p: dict[str, float]) -> None:
    x = HoopPlant(structure, p).advance(np.zeros(4), 0.1, 0.02)
    assert (x > 0).all()


def test_steps_converge_with_fourth_order_and_the_filters_step_is_fine_enough() -> None:
    p = {name: ca.SX(value) for name, value in DEVICE.items()}
    start, u = np.array([0.0, 60, 0.4, -3]), 0.3

    def after(steps: int) -> np.ndarray:
        x = ca.SX.sym("x", 4)
        end = runge_kutta(lambda z: rate("rolling", z, ca.SX(u), p), x, ca.SX(0.02), steps)
        return ca.Function("f", [x], [end])(start).full().ravel()

    exact = after(160)
    errors = [np.abs(after(n) - exact).max() for n in (1, 2, 4, 8)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4.0, atol=0.1)
    plant = HoopPlant("rolling", DEVICE)
    assert np.abs(plant.advance(start, u, 0.02) - exact).max() < 1e-9
    assert abs(plant.step_and_jacobian(start, u, 0.02)[0][2] - exact[2]) < 3e-8
    assert FILTER_STEPS < ADVANCE_STEPS


def test_segments_add_up() -> None:
    plant = HoopPlant("rolling", DEVICE)
    parts = plant.advance(plant.advance(STATE, 0.1, 0.0007), 0.1, 0.0193)
    np.testing.assert_allclose(parts, plant.advance(STATE, 0.1, 0.02), atol=1e-9)
    np.testing.assert_array_equal(plant.advance(STATE, 0.1, 0.0), STATE)


def test_jacobians_agree_with_differences() -> None:
    plant = HoopPlant("rolling", DEVICE)
    x1, f = plant.step_and_jacobian(STATE, 0.2, 0.02)
    a, b = plant.linearize(STATE, 0.2)
    d = 1e-6
    for i in range(4):
        up, down = STATE + d * np.eye(4)[i], STATE - d * np.eye(4)[i]
        step = plant.step_and_jacobian(up, 0.2, 0.02)[0] - plant.step_and_jacobian(down, 0.2, 0.02)[0]
        np.testing.assert_allclose(f[:, i], step / (2 * d), atol=1e-6)
        slope = plant.derivative(up, 0.2) - plant.derivative(down, 0.2)
        np.testing.assert_allclose(a[:, i], slope / (2 * d), atol=1e-5)
    np.testing.assert_allclose(
        b[:, 0], plant.derivative(STATE, 1.2) - plant.derivative(STATE, 0.2), rtol=1e-9, atol=1e-9
    )
    assert np.isfinite(x1).all()


def test_discrete_model_is_the_matrix_exponential() -> None:
    from scipy.signal import cont2discrete

    plant = HoopPlant("entries", THESIS)
    a, b = plant.linearize()
    want_a, want_b, *_ = cont2discrete((a, b, np.eye(4), np.zeros((4, 1))), 0.02)
    got_a, got_b = plant.discretize(0.02)
    np.testing.assert_allclose(got_a, want_a, atol=1e-13)
    np.testing.assert_allclose(got_b, want_b, atol=1e-12)


def test_results_do_not_share_memory() -> None:
    plant = HoopPlant("rolling", DEVICE)
    first = plant.advance(STATE, 0.0, 0.02)
    kept = first.copy()
    plant.advance(-STATE, 0.0, 0.02)
    np.testing.assert_array_equal(first, kept)
    _, f = plant.step_and_jacobian(STATE, 0.0, 0.02)
    kept = f.copy()
    plant.step_and_jacobian(-2 * STATE, 0.0, 0.01)
    np.testing.assert_array_equal(f, kept)


def test_extra_force_enters_like_a_generalised_force() -> None:
    def spring(s: Symbols) -> tuple[ca.SX, float]:
        return -s.p["k"] * s.theta, 0.01

    plain = HoopPlant("rolling", DEVICE)
    plant = HoopPlant("rolling", {**DEVICE, "k": 0.5}, (spring,), ("k",))
    push = plant.derivative(STATE, 0.0) - plain.derivative(STATE, 0.0)
    s = symbols(ca.SX.sym("x", 4), ca.SX(0), {name: ca.SX(value) for name, value in DEVICE.items()})
    inverse = ca.DM(mobility("rolling", s)).full()
    np.testing.assert_allclose(push[[1, 3]], inverse @ [-0.5 * STATE[0], 0.01], rtol=1e-9)


def test_mobility_of_the_entries_has_the_contracts_form() -> None:
    s = symbols(ca.SX.sym("x", 4), ca.SX(0), {name: ca.SX(value) for name, value in THESIS.items()})
    got = ca.DM(mobility("entries", s)).full()
    corner = -THESIS["K2"] / (0.0608 * 9.81 * (0.0957 - 0.0104))
    np.testing.assert_allclose(got, [[THESIS["L1"], THESIS["L2"]], [THESIS["L2"], corner]], rtol=1e-12)


@pytest.mark.parametrize(
    ("structure", "change", "name"),
    [
        ("rolling", {"mb": -1.0}, "mb"),
        ("rolling", {"bb": -1e-6}, "bb"),
        ("rolling", {"Ih": float("nan")}, "Ih"),
        ("rolling", {"L1": 1.0}, "L1"),
        ("rolling", {"Rb": 0.2}, "Rb"),
        ("sliding", {}, "structure"),
    ],
)
def test_impossible_parameters_are_refused_by_name(structure: str, change: dict[str, float], name: str) -> None:
    with pytest.raises(ParameterError) as error:
        HoopPlant(structure, {**DEVICE, **change})
    assert error.value.name == name


def test_missing_parameter_is_named() -> None:
    with pytest.raises(ParameterError, match="Ih: missing"):
        HoopPlant("rolling", {name: value for name, value in DEVICE.items() if name != "Ih"})


def test_parameters_are_read_only_and_a_plant_can_be_copied() -> None:
    plant = HoopPlant("rolling", DEVICE)
    with pytest.raises(TypeError):
        plant.parameters["mb"] = 1.0  # type: ignore[index]
    again = pickle.loads(pickle.dumps(plant))
    np.testing.assert_array_equal(again.advance(STATE, 0.1, 0.02), plant.advance(STATE, 0.1, 0.02))
    assert plant.with_parameters(mb=0.03).parameters["mb"] == 0.03


def test_calls_take_microseconds() -> None:
    """Aim 15 and 8 us on an idle machine; the bound leaves room for a busy one."""
    plant = HoopPlant("rolling", DEVICE)
    for call in (plant.advance, plant.step_and_jacobian):
        times = []
        for _ in range(300):
            start = time.perf_counter()
            call(STATE, 0.1, 0.02)
            times.append(time.perf_counter() - start)
        assert np.median(times) < 60e-6


def test_steps_of_plants_with_the_same_numbers_are_written_out_once() -> None:
    plants = [HoopPlant("entries", {**THESIS, "J12": value}) for value in (1.0, 1.0, 2.0)]
    first, again, other = (plant._stepped("step", 2, jacobian=True) for plant in plants)
    assert first is again and first is not other
