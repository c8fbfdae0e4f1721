"""The design: gains, margins, ARX, and that the shipped files are what the code makes."""

from __future__ import annotations

from pathlib import Path

import control
import numpy as np
import pytest
import yaml

from hoopd.core.estimator import EkfSettings
from hoopd.design.arx import arx_lqg, fit_arx, state_space
from hoopd.design.defaults import (
    LEAD_A,
    LEAD_B,
    PID_A,
    PID_B,
    TICK_S,
    experiment,
    fitted,
    make_defaults,
    write_defaults,
)
from hoopd.design.delay import sample_delay
from hoopd.design.lqg import (
    Weights,
    feedback,
    hold,
    kalman_gain,
    lqg_gains,
    lqg_loop,
    lqr,
    observer_law,
    reduced_model,
    seen_plant,
)
from hoopd.design.margins import closed_loop_poles, margins
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import load_model, plant_of

CONFIG = Path(__file__).resolve().parents[2] / "config"
HOOP = plant_of(load_model(CONFIG / "models" / "hoop.yaml"))
THESIS = plant_of(load_model(CONFIG / "models" / "thesis.yaml"))


def test_riccati_gains_agree_with_an_independent_iteration() -> None:
    a, b = reduced_model(HOOP, TICK_S)
    q, r, p = np.diag([1.0, 2.0, 3.0]), np.array([[4.0]]), np.eye(3)
    for _ in range(20000):
        p = q + a.T @ p @ a - a.T @ p @ b @ np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    np.testing.assert_allclose(lqr(a, b, q, r), np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a), rtol=1e-6)
    c, n = np.eye(3)[:2], np.diag([0.1, 0.2])
    p = np.eye(3)
    for _ in range(20000):
        m = p @ c.T @ np.linalg.inv(c @ p @ c.T + n)
        p = a @ (p - m @ c @ p) @ a.T + q
    np.testing.assert_allclose(kalman_gain(a, c, q, n), m, rtol=1e-6)


@pytest.mark.parametrize("plant", [HOOP, THESIS], ids=["rolling", "thesis"])
def test_the_held_reference_is_an_exact_motion_of_the_plant(plant: HoopPlant) -> None:
    h, r = hold(plant), 0.2
    for w in (0.0, 10.0):
        u = h["torque_per_sin"] * np.sin(r) + h["torque_per_speed"] * w
        rate = plant.derivative([0, w, r, 0], u)
        assert rate[3] == pytest.approx(0.0, abs=1e-9)
        assert rate[1] == pytest.approx(h["hold_rate"] * (h["speed_per_sin"] * np.sin(r) - w), rel=1e-9)


@pytest.mark.parametrize("plant", [HOOP, THESIS], ids=["rolling", "thesis"])
@pytest.mark.parametrize("delay", [2, 3, 4])
def test_default_law_has_wide_margins(plant: HoopPlant, delay: int) -> None:
    """The shipped gains (made for `hoop`) with a filter on `hoop`, on either device."""
    loop = lqg_loop(plant, HOOP, feedback(HOOP, Weights(), TICK_S), EkfSettings(), h=TICK_S, delay_ticks=delay)
    assert closed_loop_radius(loop) < 1.0
    found = margins(loop)
    assert found.phase_rad > np.deg2rad(50)
    assert found.delay_s > 0.06
    assert found.gain_up > 2.5 and found.gain_down < 0.4
    assert found.peak_sensitivity < 1.8


def test_margins_tell_where_stability_ends() -> None:
    k = feedback(HOOP, Weights(), TICK_S)
    loop = lqg_loop(HOOP, HOOP, k, EkfSettings(), h=TICK_S, delay_ticks=3)
    found = margins(loop)
    for factor, stable in ((0.97, True), (1.03, False)):
        assert (closed_loop_radius(factor * found.gain_up * loop) < 1.0) is stable
    for ticks, stable in ((int(found.delay_s / TICK_S), True), (int(found.delay_s / TICK_S) + 1, False)):
        assert (closed_loop_radius(loop * control.ss(sample_delay(ticks, TICK_S))) < 1.0) is stable


@pytest.mark.parametrize("scale", [0.8, 1.2])
@pytest.mark.parametrize("name", ["mb", "Ro", "Rb", "Ib", "Ih", "bb", "bh"])
def test_default_law_bears_a_fifth_of_error_in_each_parameter(name: str, scale: float) -> None:
    true = HOOP.with_parameters(**{name: scale * HOOP.parameters[name]})
    loop = lqg_loop(true, HOOP, feedback(HOOP, Weights(), TICK_S), EkfSettings(), h=TICK_S, delay_ticks=3)
    assert closed_loop_radius(loop) < 0.99
    assert margins(loop).delay_s > 0.05


def test_arx_fit_finds_a_known_model_and_skips_missing_rows() -> None:
    rng = np.random.default_rng(1)
    a = np.array([[[0.5, 0.1], [0.0, 0.6]], [[-0.1, 0.0], [0.05, 0.2]]])
    b = np.array([[1.0, 0.2], [0.3, -0.4], [0.0, 0.1]])
    u, y = rng.normal(size=400), np.zeros((400, 2))
    for k in range(3, 400):
        y[k] = sum(a[i] @ y[k - 1 - i] for i in range(2)) + sum(b[j] * u[k - 1 - j] for j in range(3))
    holes = y.copy()
    holes[50::37, 1] = np.nan
    model = fit_arx(u, holes, 2, 3)
    np.testing.assert_allclose(model.a, a, atol=1e-9)
    np.testing.assert_allclose(model.b, b, atol=1e-9)
    # the state-space form repeats the record
    sa, sb, sc = state_space(model)
    x = np.concatenate([y[2], y[1], u[1::-1]])
    for k in range(3, 400):
        x = sa @ x + sb * u[k - 1]
        np.testing.assert_allclose(sc @ x, y[k], atol=1e-7)
    with pytest.raises(ValueError, match="too few"):
        fit_arx(u[:30], y[:30], 4, 6)


def test_arx_law_is_stable_on_its_own_model() -> None:
    gains = arx_lqg(fitted(HOOP), Weights(), TICK_S)
    loop = gains.a - np.outer(gains.b, gains.feedback)
    assert np.abs(np.linalg.eigvals(loop)).max() < 0.99


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_arx_law_has_margins_whatever_the_experiment(seed: int) -> None:
    gains = arx_lqg(fit_arx(*experiment(HOOP, seed=seed)), Weights(), TICK_S)
    model = control.ss(gains.a, gains.b[:, None], gains.c, 0, TICK_S)
    law = observer_law(model, gains.filter_gain, gains.feedback[None, :])
    found = margins(law * seen_plant(HOOP, TICK_S, 3))
    assert found.stable and np.rad2deg(found.phase_rad) > 50 and found.delay_s > 0.06


def test_experiment_is_the_time_line_of_the_daemon() -> None:
    u, y = experiment(HOOP, ticks=50)
    first = int(np.flatnonzero(u)[0])
    assert first == 0 and np.abs(y[1, 0]) < 0.3  # u_0 acts after the sample that tick 1 sees
    assert np.abs(y[2, 0]) > 0.4


def test_printed_coefficients_are_the_tustin_forms() -> None:
    from scipy.signal import cont2discrete

    kp, ti, td = 0.16425557639727875, 0.03906614150888865, 0.3930283441920987
    tf = td / 15
    num = [kp * (td + tf), kp * (1 + tf / ti), kp / ti]  # Kp (1 + 1/(Ti s) + Td s/(1 + Tf s)), over s (1 + Tf s)
    b, a, _ = cont2discrete((num, [tf, 1.0, 0.0]), TICK_S, "bilinear")
    np.testing.assert_allclose(b[0], PID_B, rtol=1e-9)
    np.testing.assert_allclose(a, PID_A, rtol=1e-9)
    b, a, _ = cont2discrete(([0.02795084971874737, 1.0], [0.005590169943749474, 1.0]), TICK_S, "bilinear")
    np.testing.assert_allclose(b[0], LEAD_B, rtol=1e-12)
    np.testing.assert_allclose(a, LEAD_A, rtol=1e-12)


def assert_same(one: object, two: object, where: str) -> None:
    if isinstance(one, dict) and isinstance(two, dict):
        assert one.keys() == two.keys(), where
        for key in one:
            assert_same(one[key], two[key], f"{where}.{key}")
    elif isinstance(one, str) or one is None:
        assert one == two, where
    else:
        np.testing.assert_allclose(one, two, rtol=1e-5, atol=1e-9, err_msg=where)


def test_shipped_controllers_are_what_the_code_makes(tmp_path: Path) -> None:
    made = make_defaults(CONFIG)
    assert {path.stem for path in (CONFIG / "controllers").glob("*.yaml")} == made.keys()
    write_defaults(CONFIG, tmp_path)
    for name in made:
        shipped = yaml.safe_load((CONFIG / "controllers" / f"{name}.yaml").read_text())
        assert_same(shipped, yaml.safe_load((tmp_path / f"{name}.yaml").read_text()), name)


def test_gains_are_those_of_the_model() -> None:
    gains = lqg_gains(HOOP, Weights(), TICK_S)
    np.testing.assert_allclose([gains.k_dtheta, gains.k_psi, gains.k_dpsi], feedback(HOOP, Weights(), TICK_S))


def closed_loop_radius(loop: control.StateSpace) -> float:
    """Largest |pole| of the loop closed: below 1 is stable."""
    return float(np.abs(closed_loop_poles(loop)).max())
