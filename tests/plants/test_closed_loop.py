"""Closed loops on the plant alone, in the daemon's time-line: the figures of the thesis and of the default law."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoopd.core.controllers import Controller
from hoopd.core.estimator import DelayedEkf
from hoopd.files.controller import controller_of, limiter_of, load_controller, settings_of
from hoopd.plants.hoop.loop.closed_loop import ClosedLoopRun, Scenario, simulate
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import load_model, plant_of

CONFIG = Path(__file__).resolve().parents[2] / "config"
HOOP = plant_of(load_model(CONFIG / "models" / "hoop.yaml"))
THESIS = plant_of(load_model(CONFIG / "models" / "thesis.yaml"))
DEVICES = pytest.mark.parametrize("true", [HOOP, THESIS], ids=["rolling", "thesis"])
LQGS = pytest.mark.parametrize("name", ["lqg", "arx"])
DEGREE = math.radians(1.0)


def run(name: str, true: HoopPlant, scenario: Scenario, *, model: HoopPlant = HOOP, gate: bool = True) -> ClosedLoopRun:
    """A shipped controller on a plant; its filter knows `model`."""
    file = load_controller(CONFIG / "controllers" / f"{name}.yaml")
    settings = settings_of(file) if gate else replace(settings_of(file), gate_nis=1e12)
    law: Controller = controller_of(file)
    return simulate(true, law, DelayedEkf(model.step_and_jacobian, settings), limiter_of(file), scenario)


def settles(result: ClosedLoopRun) -> bool:
    """psi inside 0.05 rad within 1.5 s for good, the hoop below 1 rad/s within 5 s for good."""
    return result.settled_s(result.psi, 0.05) <= 1.5 and result.settled_s(result.dtheta, 1.0) <= 5.0


@DEVICES
@LQGS
@pytest.mark.parametrize("phase", [0.0005, 0.006, 0.0195])
def test_released_ball_comes_to_rest_and_so_does_the_hoop(name: str, true: HoopPlant, phase: float) -> None:
    result = run(name, true, Scenario(psi0_rad=0.4, phase_s=phase))
    assert settles(result)
    assert np.abs(result.u).max() <= 0.7


@DEVICES
@LQGS
@pytest.mark.parametrize("gate", [True, False])
def test_one_sample_of_disturbance(name: str, true: HoopPlant, gate: bool) -> None:
    """The thesis's test; the gate refuses such a sample, without it the law has to settle again."""
    result = run(name, true, Scenario(disturbance_rad=0.4, disturbance_at_s=0.0), gate=gate)
    assert settles(result)
    assert (np.abs(result.u).max() > 0.03) is not gate


@DEVICES
@LQGS
def test_a_fifth_of_error_in_all_parameters_at_once(name: str, true: HoopPlant) -> None:
    rng = np.random.default_rng(2)
    changeable = [key for key in true.parameters if key not in ("g", "mb", "Ro", "Rb")] if true is THESIS else None
    for _ in range(6):
        names = changeable or [key for key in true.parameters if key != "g"]
        device = true.with_parameters(**{key: true.parameters[key] * rng.choice((0.8, 1.2)) for key in names})
        result = run(name, device, Scenario(psi0_rad=0.4, phase_s=0.0195))
        assert settles(result)


@LQGS
def test_a_late_or_failing_camera(name: str) -> None:
    for scenario in (
        Scenario(psi0_rad=0.4, delay_frames=3),
        Scenario(psi0_rad=0.4, psi_missing=lambda t: 0.3 < t < 0.5),
        Scenario(psi0_rad=0.4, psi_missing=lambda t: int(t * 50) % 3 == 0),
        Scenario(psi0_rad=0.4, hoop_missing=lambda t: int(t * 50) % 4 == 0),
    ):
        assert settles(run(name, HOOP, scenario))


@DEVICES
@LQGS
def test_a_zero_angle_error_leaves_the_hoop_slow(name: str, true: HoopPlant) -> None:
    for degrees in (-1.0, 1.0):
        result = run(name, true, Scenario(duration_s=15.0, delay_frames=1, angle_offset_rad=degrees * DEGREE))
        assert np.abs(result.dtheta).max() < 2.0


def test_a_reference_is_tracked_with_the_hoop_speed_it_demands() -> None:
    result = run("lqg", HOOP, Scenario(duration_s=12.0, reference=lambda t: 0.1 if 1.0 < t < 9.0 else 0.0))
    held = (result.t > 2.0) & (result.t < 9.0)
    np.testing.assert_allclose(result.psi[held], 0.1, atol=0.01)
    assert result.dtheta[held][-1] == pytest.approx(23.0, abs=1.0)
    assert result.psi[result.t > 9.0].min() > -0.06  # the hoop stopped at once: -0.25 rad
    after = result.t > 11.0
    assert (
        np.abs(result.psi[after]).max() < 0.02 and np.abs(result.dtheta[after]).max() < 5.0
    )  # it slows down by itself


def test_a_reference_that_changes_sides_takes_the_ball_along_and_not_far_beyond() -> None:
    result = run("lqg", HOOP, Scenario(duration_s=12.0, reference=lambda t: -0.06 if t < 6.0 else 0.06))
    assert result.dtheta[(result.t > 5.0) & (result.t < 6.0)].mean() == pytest.approx(-14.0, abs=1.0)
    after = result.t > 6.0
    assert result.psi[after].max() < 0.06 + 0.5 * 0.12  # the hoop turned round at once: 0.25 rad
    np.testing.assert_allclose(result.psi[result.t > 6.7], 0.06, atol=0.01)
    assert result.dtheta[-50:].mean() == pytest.approx(14.0, abs=1.0)
    assert np.abs(result.u[after]).max() < 0.08


def test_a_reference_beyond_the_hoop_speed_limit_falls_back() -> None:
    result = run("lqg", HOOP, Scenario(duration_s=12.0, reference=lambda _t: 0.3))
    assert result.psi[(result.t > 0.2) & (result.t < 0.7)].mean() == pytest.approx(
        0.3, abs=0.08
    )  # 30 rad/s come in 0.55 s
    assert np.abs(result.dtheta).max() < 33.0
    assert result.psi[-50:].mean() == pytest.approx(30 / 231, abs=0.01)


# -------------------------------------------------------------------- the thesis's laws on the thesis's device


def thesis(name: str, **keys: object) -> ClosedLoopRun:
    scenario = Scenario(duration_s=20.0, phase_s=0.0, **keys)  # type: ignore[arg-type]
    return run(name, THESIS, scenario, model=THESIS, gate=False)


def test_pid_lets_the_hoop_run_with_a_zero_angle_error_and_only_then() -> None:
    wrong = thesis("pid", delay_frames=1, angle_offset_rad=DEGREE)
    end = wrong.t > 15.0
    assert wrong.dtheta[end].mean() == pytest.approx(-7.4, abs=0.15)
    assert abs(wrong.psi_measured[end].mean()) < 1e-3
    assert wrong.psi[end].mean() == pytest.approx(-DEGREE, abs=1e-3)
    right = thesis("pid", delay_frames=1, psi0_rad=0.4)
    assert np.abs(right.dtheta).max() > 5.0
    assert np.abs(right.dtheta[right.t > 15.0]).max() < 0.4


def test_pid_and_lead_settle_without_delay_as_in_the_thesis() -> None:
    for name, bound_s in (("pid", 1.8), ("lead", 1.5)):
        result = thesis(name, delay_frames=0, disturbance_rad=0.4, disturbance_at_s=0.0)
        assert result.settled_s(result.psi, 0.05) < bound_s, name


def test_pid_is_a_limit_cycle_with_two_frames_and_the_tick_phase() -> None:
    result = run("pid", THESIS, Scenario(duration_s=20.0, delay_frames=2, phase_s=0.01), model=THESIS, gate=False)
    end = result.t > 15.0
    assert np.abs(result.u[end]).max() == 0.7 and result.u[end].min() == -0.7
    assert 0.5 < np.abs(result.psi[end]).max() < 2.0  # neither dies nor goes round
    assert np.ptp(result.dtheta[end]) > 30.0


@pytest.mark.parametrize("delay", [1, 2])
def test_lead_fails_on_the_device(delay: int) -> None:
    """It saturates and throws the ball round the hoop, turn after turn."""
    result = thesis("lead", delay_frames=delay)
    end = result.t > 15.0
    assert (np.abs(result.u[end]) == 0.7).mean() > 0.7
    assert np.abs(result.psi[end]).max() > 10 * math.tau


def test_the_same_seed_gives_the_same_bits() -> None:
    one, two = (run("lqg", HOOP, Scenario(duration_s=1.0, psi0_rad=0.4)) for _ in range(2))
    assert one.x.tobytes() == two.x.tobytes() and one.u.tobytes() == two.u.tobytes()
