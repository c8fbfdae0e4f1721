"""The prediction-error fit: derivatives, the daemon's filter, recovery under disturbances, real recordings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.records import CameraSample, DriverSample
from hoopd.ident.experiments import Run, Series
from hoopd.ident.innovations import InnovationsFilter, samples_of
from hoopd.ident.noise import NoiseModel, ekf_settings
from hoopd.ident.parameters import ENTRIES, scale_of
from hoopd.ident.prediction import Likelihood
from hoopd.modelfiles import load_model, plant_of

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[2]
MODEL = load_model(ROOT / "config" / "models" / "thesis.yaml")
VALUES = MODEL.values()
NAMES = ENTRIES["both"]
R = {"theta": (2 * math.pi / 4096) ** 2 / 12, "dtheta": 0.05**2, "psi": 0.004**2}


def disturbed(
    seconds: float = 10.0,
    q_dtheta: float = 0.0,
    q_dpsi: float = 0.0,
    seed: int = 1,
    channels: tuple[str, ...] = ("theta", "psi"),
    psi_share: float = 1.0,
) -> Run:
    """A run of the thesis's plant at 50 Hz with random accelerations at 1 ms, encoder counts and camera noise."""
    rng, plant, fine, tick = np.random.default_rng(seed), plant_of(MODEL), 20, 0.02
    n = int(seconds / tick)
    u = np.repeat(rng.choice((-0.06, 0.06), size=n // 4 + 1), 4)[:n]
    x = np.zeros((n + 1, 4))
    for k in range(n):
        z = x[k]
        for _ in range(fine):
            z = plant.step_and_jacobian(z, u[k], tick / fine)[0]
            z[[1, 3]] += rng.normal(size=2) * np.sqrt(np.array([q_dtheta, q_dpsi]) * tick / fine)
        x[k + 1] = z
    count = 2 * math.pi / 4096
    y = {
        "theta": np.round(x[:, 0] / count) * count,
        "dtheta": x[:, 1] + rng.normal(size=n + 1) * math.sqrt(R["dtheta"]),
        "psi": x[:, 2] + rng.normal(size=n + 1) * math.sqrt(R["psi"]),
    }
    nodes = {name: np.arange(n + 1) for name in channels}
    if psi_share < 1.0:
        nodes["psi"] = np.flatnonzero(rng.random(n + 1) < psi_share)
    series = {name: Series(name, at, y[name][at]) for name, at in nodes.items()}
    return Run("simulated", "both", np.arange(n + 1) * tick, u, series, np.zeros(4), {})


def likelihood(runs: list[Run], huber: float = math.inf, estimated: tuple[str, ...] | None = None) -> Likelihood:
    scale = scale_of("entries", NAMES, VALUES)
    return Likelihood("entries", VALUES, runs, scale, {}, NoiseModel(estimated), (), huber)


@pytest.mark.parametrize("huber", [math.inf, 1.345])
@pytest.mark.parametrize("channels", [("theta", "psi"), ("theta", "dtheta", "psi")])
def test_the_gradient_is_exact(channels: tuple[str, ...], huber: float) -> None:
    runs = [disturbed(2.0, 4.0, 0.5, seed, channels, psi_share=0.8) for seed in (1, 2)]
    problem = likelihood(runs, huber, ("q_theta", "q_dtheta", "q_psi", "q_dpsi", *(f"r_{name}" for name in channels)))
    rng = np.random.default_rng(3)
    v = problem.first() + 0.02 * rng.normal(size=problem.size) * np.where(np.arange(problem.size) < 15, 1.0, 0.01)
    found = problem.evaluate(v)
    assert found.value == pytest.approx(problem.value(v), rel=1e-12)
    for index in range(problem.size):
        step = np.zeros(problem.size)
        step[index] = 1e-5

        def at(factor: float, step: Array = step) -> float:
            return problem.value(v + factor * step)

        # fourth-order central difference
        numeric = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * 1e-5)
        assert found.gradient[index] == pytest.approx(numeric, rel=1e-6, abs=1e-4)


def test_the_innovations_are_those_of_the_daemons_filter() -> None:
    """Same q and r, a plain record: after the start is forgotten both filters predict the same."""
    run = disturbed(6.0, 4.0, 0.1, channels=("theta", "dtheta", "psi"))
    settings = EkfSettings(gate_nis=1e9)
    levels = {f"q_{n}": v for n, v in zip(("theta", "dtheta", "psi", "dpsi"), settings.q, strict=True)}
    levels |= {"r_theta": settings.r_theta, "r_dtheta": settings.r_dtheta, "r_psi": settings.r_psi}
    again = EkfSettings(**{**ekf_settings(levels), "gate_nis": 1e9})  # type: ignore[arg-type]
    assert again == settings
    order = ("theta", "dtheta", "psi")
    ours = InnovationsFilter("entries", {**VALUES, **levels}, (), order, noise_rule="daemon")
    found = ours.run(np.zeros(0), np.zeros(4), samples_of(run, order))
    daemon = DelayedEkf(plant_of(MODEL).step_and_jacobian, settings)
    theta, dtheta, psi = (run.series[name].values for name in order)
    theirs = np.zeros((len(run.t), 3))
    for k, t in enumerate(run.t):
        before = max(k - 1, 0)
        torque = run.u[before] if k else 0.0
        driver = DriverSample(t, k, 0, 0, theta[k], dtheta[k], 0.0, 0)
        camera = CameraSample(k, t, t, psi[k], 1.0, math.nan, math.nan)
        answer = daemon.update(t, torque, run.t[before], driver, camera)
        theirs[k] = answer.innovation_theta, answer.innovation_psi, answer.nis
    late = run.t > 3.0
    assert np.abs(found.e[late, 0] - theirs[late, 0]).max() < 1e-8
    assert np.abs(found.e[late, 2] - theirs[late, 1]).max() < 1e-8
    nis = found.e[:, 2] ** 2 / found.s[:, 2]
    assert nis[late] == pytest.approx(theirs[late, 2], rel=1e-5)
