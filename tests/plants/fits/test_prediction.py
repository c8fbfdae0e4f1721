"""The prediction-error fit: derivatives, the daemon's filter, recovery under disturbances, real recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.records import CameraSample, DriverSample
from hoopd.plants.fits.runs import ChannelSeries, Run
from hoopd.plants.fits.uncertainty import intervals, uncertainty
from hoopd.plants.hoop.fitting.filter_noise import NoiseModel, ekf_settings
from hoopd.plants.hoop.fitting.free_parameters import ENTRIES
from hoopd.plants.hoop.fitting.hoop_output_error import HoopSystem, fit_output_error
from hoopd.plants.hoop.fitting.hoop_prediction_error import fit_prediction_error
from hoopd.plants.hoop.recordings.fit_data import prepare
from hoopd.plants.likelihood.extended_filter import ExtendedKalmanFilter, samples_of
from hoopd.plants.likelihood.innovation_likelihood import LOSSES, Likelihood
from hoopd.plants.likelihood.innovation_tests import prediction_uncertainty
from hoopd.plants.likelihood.kalman_filter import LinearReference, gains, whitened
from hoopd.plants.likelihood.prediction_error import PredictionSolution
from hoopd.plants.model_file import load_model, plant_of
from hoopd.recording.formats import load
from tests.shared import shared_path

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[3]
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
    outliers: float = 0.0,
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
    y["psi"][rng.random(n + 1) < outliers] += 0.3
    nodes = {name: np.arange(n + 1) for name in channels}
    if psi_share < 1.0:
        nodes["psi"] = np.flatnonzero(rng.random(n + 1) < psi_share)
    series = {name: ChannelSeries(name, at, y[name][at]) for name, at in nodes.items()}
    return Run("simulated", "both", np.arange(n + 1) * tick, u, series, np.zeros(4), {})


def likelihood(runs: list[Run], loss: str = "linear", estimated: tuple[str, ...] | None = None) -> Likelihood:
    return Likelihood(HoopSystem("entries", VALUES), NAMES, runs, NoiseModel(estimated), loss=loss)


def filter_of(values: Mapping[str, float], channels: Sequence[str], rule: str = "density") -> ExtendedKalmanFilter:
    """Of the whole hoop, with nothing left free."""
    composite = HoopSystem("entries", values).composite("both", ())
    return ExtendedKalmanFilter(composite, {**composite.values, **values}, (), channels, rule=rule)


@pytest.mark.parametrize("loss", ["linear", "student"])
@pytest.mark.parametrize("channels", [("theta", "psi"), ("theta", "dtheta", "psi")])
def test_the_gradient_is_exact(channels: tuple[str, ...], loss: str) -> None:
    runs = [disturbed(2.0, 4.0, 0.5, seed, channels, psi_share=0.8) for seed in (1, 2)]
    problem = likelihood(runs, loss, ("q_theta", "q_dtheta", "q_psi", "q_dpsi", *(f"r_{name}" for name in channels)))
    rng = np.random.default_rng(3)
    v = problem.first() + 0.02 * rng.normal(size=problem.size) * np.where(np.arange(problem.size) < 15, 1.0, 0.01)
    found = problem.evaluate(v)
    assert found.value == pytest.approx(problem.value(v), rel=1e-12)
    back = problem.with_gradient(v)
    assert back.value == problem.value(v)
    assert back.gradient == pytest.approx(found.gradient, rel=1e-9, abs=1e-7)
    for index in range(problem.size):
        step = np.zeros(problem.size)
        step[index] = 1e-5

        def at(factor: float, step: Array = step) -> float:
            return problem.value(v + factor * step)

        # fourth-order central difference
        numeric = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * 1e-5)
        assert found.gradient[index] == pytest.approx(numeric, rel=1e-6, abs=1e-4)


def test_the_innovations_are_those_of_the_daemons_filter() -> None:
    """Same q and r, a plain record: after the start is forgotten both filters predict the same. (The daemon takes
    two Runge-Kutta steps a tick, the fit one.)"""
    run = disturbed(6.0, 4.0, 0.1, channels=("theta", "dtheta", "psi"))
    settings = EkfSettings(gate_nis=1e9)
    levels = {f"q_{n}": v for n, v in zip(("theta", "dtheta", "psi", "dpsi"), settings.q, strict=True)}
    levels |= {"r_theta": settings.r_theta, "r_dtheta": settings.r_dtheta, "r_psi": settings.r_psi}
    again = EkfSettings(**{**ekf_settings(levels), "gate_nis": 1e9})  # type: ignore[arg-type]
    assert again == settings
    order = ("theta", "dtheta", "psi")
    ours = filter_of({**VALUES, **levels}, order, "daemon")
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
    assert np.abs(found.e[late, 0] - theirs[late, 0]).max() < 3e-6
    assert np.abs(found.e[late, 2] - theirs[late, 1]).max() < 3e-6
    nis = found.e[:, 2] ** 2 / found.s[:, 2]
    assert nis[late] == pytest.approx(theirs[late, 2], rel=1e-3, abs=1e-3)


def test_the_process_noise_is_integrated_over_the_step() -> None:
    """A double integrator: var theta after h is q h^3 / 3, exactly."""
    run = disturbed(0.4)
    values = {**VALUES, **dict.fromkeys(("J11", "J12", "K1", "J21", "J22", "K2"), 0.0)}
    levels = {"q_theta": 0.0, "q_dtheta": 4.0, "q_psi": 0.0, "q_dpsi": 0.5, "r_theta": 1e-9, "r_psi": 1e-9}
    found = filter_of({**values, **levels}, ("theta", "psi"))
    s = found.run(np.zeros(0), np.zeros(4), samples_of(run, ("theta", "psi"))).s
    assert s[1] == pytest.approx(np.array([4.0, 0.5]) * 0.02**3 / 3 + 1e-9, rel=1e-9)


@dataclass(frozen=True)
class Densities:
    """The noise of the daemon's filter for `kalman_filter`, from a start that is known."""

    q: Array
    reading: Array

    def start(self, model: LinearReference) -> Array:
        return np.zeros((model.size, model.size))

    def transition(self, model: LinearReference) -> Array:
        return model.a

    def added(self, model: LinearReference) -> Array:
        ways = [(1 / 6, model.a), (4 / 6, (np.eye(model.size) + model.a) / 2), (1 / 6, np.eye(model.size)[None])]
        return sum(share * model.h[:, None, None] * (f * self.q) @ f.transpose(0, 2, 1) for share, f in ways)


def test_the_filter_along_a_given_reference_has_the_same_likelihood() -> None:
    """A linear model about the extended filter's own estimates, with its noise, through `kalman_filter`."""
    run, channels = disturbed(6.0, 4.0, 0.5, psi_share=0.7), ("theta", "psi")
    levels = {"q_theta": 1e-6, "q_dtheta": 4.0, "q_psi": 1e-6, "q_dpsi": 0.5, "r_theta": 2e-7, "r_psi": 1.6e-5}
    extended, samples = filter_of({**VALUES, **levels}, channels), samples_of(run, channels)
    found = extended.run(np.zeros(0), np.zeros(4), samples)
    seen, n, c = samples.seen > 0.0, len(run.t), np.eye(4)[[0, 2]]
    # where the filter is before and after a node's samples
    before, lower, cov = found.run.before[:, :4], np.tril_indices(4), np.zeros((n, 4, 4))
    cov[:, lower[0], lower[1]] = cov[:, lower[1], lower[0]] = found.run.before[:, 4:]
    eps = np.where(seen, samples.y - before[:, [0, 2]], 0.0)
    r = np.where(seen, [levels["r_theta"], levels["r_psi"]], 1e12)
    gain = cov @ c.T @ np.linalg.inv(c @ cov @ c.T + r[:, :, None] * np.eye(2))
    after = before + (gain @ eps[:, :, None])[:, :, 0]
    composite, z = extended.composite, ca.SX.sym("z", 4)
    u, h, p = ca.SX.sym("u"), ca.SX.sym("h"), composite.vector(VALUES)
    moved = composite.step_function(z, u, np.zeros(composite.nw), h, 0.0, p)
    slope = ca.Function("slope", [z, u, h], [ca.jacobian(moved, z)])
    a = np.array([slope(x, u, h).full() for x, u, h in zip(after, run.u, np.diff(run.t), strict=False)])
    model = LinearReference(a, np.zeros((n - 1, 4, 0)), np.tile(c, (n, 1, 1)), np.diff(run.t), seen, 4, np.ones((n, 2)))
    noise = Densities(
        np.array([levels[f"q_{name}"] for name in composite.plant.states]), np.sqrt(r[seen.all(axis=1)][0])
    )
    f = (a @ (before - after)[:-1, :, None])[:, :, 0]
    gains_found = gains(model, noise)
    white = whitened(model, gains_found, f[:, :, None], eps[:, :, None])[:, :, 0]
    theirs = np.sum(white**2) + gains_found.logdet
    ours = np.sum((found.e**2 / found.s + np.log(found.s))[seen])
    assert theirs == pytest.approx(ours, rel=1e-10)
    assert white[seen] == pytest.approx((found.e / np.sqrt(found.s))[seen], abs=1e-6)


def test_the_robust_loss_finds_the_variance_of_normal_samples() -> None:
    nodes, weights = np.polynomial.hermite_e.hermegauss(180)
    for loss in LOSSES.values():
        mean = weights @ (loss.weight(nodes) * nodes**2) / math.sqrt(2 * math.pi)
        assert mean == pytest.approx(1.0, abs=1e-6)


# ---------------------------------------------------------------------------------------------- recovery

OFF = {**VALUES, **{name: 1.2 * VALUES[name] for name in NAMES}}


def errors_in_sigma(solution: PredictionSolution, covariance: Array) -> Array:
    true = solution.scale.coordinates(np.array([VALUES[name] for name in solution.names]))
    return np.asarray((solution.z - true) / np.sqrt(np.diag(covariance)))


def test_disturbed_runs_give_the_parameters_back_where_output_error_is_sure_of_wrong_ones() -> None:
    ours, theirs = [], []
    for seed in (1, 4):
        run = disturbed(10.0, 4.0, 0.5, seed)
        found = fit_prediction_error("entries", OFF, NAMES, [run])
        known = prediction_uncertainty(found)
        assert found.converged
        ours.append(errors_in_sigma(found, known.model_based))
        assert 3.0 < found.q["dtheta"] < 5.0
        assert 0.35 < found.q["dpsi"] < 0.7
        assert found.r["psi"] == pytest.approx(R["psi"], rel=0.2)
        assert all(one.p_value > 1e-3 and 0.9 < one.mean_square < 1.1 for one in known.whiteness.values())
        ranges = intervals(found, known.parameters)
        assert all(ranges[name][0] < found.values[name] < ranges[name][1] for name in NAMES)
        assert known.noise["q_dtheta"][0] < 4.0 < known.noise["q_dtheta"][1]
        other = fit_output_error("entries", OFF, NAMES, [run])
        theirs.append(errors_in_sigma(other, uncertainty(other).covariance))  # type: ignore[arg-type]
    assert np.abs(ours).max() < 3.0
    assert min(np.abs(one).max() for one in theirs) > 5.0


def test_without_disturbance_the_process_noise_goes_to_its_floor_and_both_fits_agree() -> None:
    run = disturbed(10.0)
    found = fit_prediction_error("entries", OFF, NAMES, [run])
    assert {"q_dtheta", "q_dpsi", "r_theta"} <= set(found.at_floor)
    known = prediction_uncertainty(found)
    other = fit_output_error("entries", OFF, NAMES, [run])
    assert np.abs(found.z - other.z) / np.sqrt(np.diag(known.model_based)) == pytest.approx(0.0, abs=0.3)
    assert np.abs(errors_in_sigma(found, known.model_based)).max() < 3.5


def test_missing_pictures_and_runs_without_a_ball() -> None:
    sparse, alone = disturbed(6.0, 4.0, 0.5, 2, psi_share=0.3), disturbed(4.0, 4.0, 0.0, 3)
    hoop = Run("alone", "hoop", alone.t, alone.u, {"theta": alone.series["theta"]}, np.zeros(4), {})
    found = fit_prediction_error("entries", OFF, NAMES, [sparse])
    assert np.abs(errors_in_sigma(found, prediction_uncertainty(found).model_based)).max() < 3.5
    bare = fit_prediction_error("entries", OFF, ("J11", "L1"), [hoop])
    assert set(bare.noise_names) == {"q_dtheta", "r_theta"}
    assert set(bare.r) == {"theta"}
    both = fit_prediction_error("entries", found.values, NAMES, [sparse, hoop], starts=[*found.starts, *bare.starts])
    assert both.samples == found.samples + bare.samples


def test_outliers_pull_the_robust_fit_less() -> None:
    run = disturbed(5.0, 4.0, 0.5, outliers=0.03)
    plain = fit_prediction_error("entries", VALUES, NAMES, [run])
    robust = fit_prediction_error("entries", VALUES, NAMES, [run], loss="student")
    assert plain.r["psi"] > 50 * R["psi"]
    assert robust.r["psi"] < 3 * R["psi"]
    assert abs(robust.values["K2"] / VALUES["K2"] - 1) < 0.05


def test_noise_alone_gives_the_filter_of_a_given_model() -> None:
    """No parameter moves: q and r that suit the model. The daemon's filter is consistent with them."""
    run = disturbed(10.0, 4.0, 0.5)
    found = fit_prediction_error("entries", VALUES, (), [run])
    assert dict(found.values) == VALUES
    settings = EkfSettings(**ekf_settings(found.levels, tuple(found.r)))  # type: ignore[arg-type]
    assert settings.q == (0.0, found.q["dtheta"], 0.0, found.q["dpsi"])
    assert (settings.r_theta, settings.r_psi) == (found.r["theta"], found.r["psi"])
    assert settings.r_dtheta == EkfSettings().r_dtheta
    daemon = filter_of({**VALUES, **found.levels}, ("theta", "psi"), "daemon")
    out = daemon.run(np.zeros(0), found.starts[0], samples_of(run, ("theta", "psi")))
    nis = np.mean(out.e[5:] ** 2 / out.s[5:], axis=0)
    # all of the noise at the end of a step: a little too much of it for the encoder (0.62 in the limit r = 0)
    assert 0.55 < nis[0] < 1.1
    assert 0.9 < nis[1] < 1.1


def test_what_the_filter_cannot_take_is_refused() -> None:
    run = disturbed(1.0)
    rate = ChannelSeries("theta_rate", run.series["theta"].nodes, run.series["theta"].values)
    wrong = Run("x", "both", run.t, run.u, {"theta_rate": rate}, np.zeros(4), {})
    with pytest.raises(ValueError, match="theta_rate"):
        fit_prediction_error("entries", VALUES, NAMES, [wrong])
    with pytest.raises(ValueError, match="q_phi"):
        NoiseModel(("q_phi",))
    with pytest.raises(ValueError, match="r_psi"):
        NoiseModel(start={"r_psi": 0.0})
    with pytest.raises(ValueError, match="cauchy"):
        fit_prediction_error("entries", VALUES, NAMES, [run], loss="cauchy")


# ---------------------------------------------------------------------------------------------- real recordings


@pytest.mark.parametrize("name", ["meas_hoopAndBall2_01", "meas_hoop01_prbs"])
def test_a_real_recording_is_predicted_better_than_with_the_given_model(name: str) -> None:
    recording = load(shared_path(f"recordings/{name}.mat"))
    runs = prepare([recording], ("theta", "psi"), window_s=6.0)[:1]
    given = fit_prediction_error("entries", VALUES, (), runs)
    found = fit_prediction_error("entries", VALUES, NAMES, runs, starts=given.starts)
    assert found.converged
    assert found.log_likelihood > given.log_likelihood + 10.0
    # what a fit by free runs of the raw encoder cannot do: it stays near the device
    assert found.values["L1"] == pytest.approx(VALUES["L1"], rel=0.25)
    assert found.values["K2"] == pytest.approx(VALUES["K2"], rel=0.25)
    known = prediction_uncertainty(found)
    assert all(0.9 < one.mean_square < 1.1 for one in known.whiteness.values())


# ---------------------------------------------------------------------------------------------- delay
