"""The filter: late samples, gaps, gate, turns, poison, replay, time."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.records import CameraSample, DriverSample, Estimate
from hoopd.plants.hoop.plant import HoopPlant

DEVICE = {"mb": 0.0608, "Ro": 0.0957, "Rb": 0.0104, "g": 9.81, "Ib": 3.679e-6, "Ih": 1.518e-3, "bb": 2.6e-6, "bh": 7e-4}
PLANT = HoopPlant("rolling", DEVICE)
TICK, WIRE = 0.02, 8 * 10 / 115200


def driver(t: float, theta: float, dtheta: float) -> DriverSample:
    return DriverSample(t, 0, 1, 0, theta, dtheta, 0.0, 0)


def camera(t: float, psi: float) -> CameraSample:
    return CameraSample(0, t, t + 0.04, psi, 1.0, 0.0, 0.0)


class World:
    """Free plant with sensors; `tick` gives what a tick sees and the true state."""

    def __init__(self, psi: float = 0.4, age_s: float = 0.0463, noise: float = 1.0, seed: int = 0) -> None:
        self.rng, self.noise, self.age = np.random.default_rng(seed), noise, age_s
        self.k, self.u, self.applied = 0, 0.0, -TICK + WIRE
        self.history = [(-1.0, np.array([0, 0, psi, 0.0]), 0.0)]  # rests until t = 0: see `at`
        self.history.append((0.0, self.history[0][1], 0.0))
        self.answer: DriverSample | None = None

    def at(self, t: float) -> np.ndarray:
        if t <= 0.0:
            return self.history[0][1]
        start, x, u = next(row for row in reversed(self.history) if row[0] <= t)
        while start < t - 1e-12:
            piece = min(0.02, t - start)
            x, start = PLANT.advance(x, u, piece), start + piece
        return x

    def tick(self) -> tuple[float, float, float, DriverSample | None, CameraSample]:
        t = self.k * TICK
        seen = float(self.at(t - self.age)[2]) + self.noise * 0.002 * self.rng.normal()
        return t, self.u, self.applied, self.answer, camera(t - self.age, math.remainder(seen, math.tau))

    def torque(self, u: float) -> None:
        self.applied = self.k * TICK + WIRE
        x = self.at(self.applied)
        self.history.append((self.applied, x, u))
        dtheta = float(x[1]) + self.noise * 0.05 * self.rng.normal()
        self.answer = driver(self.applied, float(x[0]), dtheta)
        self.u, self.k = u, self.k + 1


def run(world: World, ekf: DelayedEkf, ticks: int, missing: range = range(0)) -> tuple[list[Estimate], np.ndarray]:
    estimates, truth = [], []
    for k in range(ticks):
        t, u, applied, answer, picture = world.tick()
        estimates.append(ekf.update(t, u, applied, answer, None if k in missing else picture))
        truth.append(world.at(t))
        world.torque(0.05 * math.sin(0.1 * k))
    return estimates, np.array(truth)


def test_exact_samples_give_the_exact_state_however_late_they_are() -> None:
    for age in (0.0, 0.0003, 0.02, 0.0463, 0.08, 0.15):
        estimates, truth = run(World(noise=0.0, age_s=age), DelayedEkf(PLANT.step_and_jacobian), 150)
        error = np.abs(np.array([e.x for e in estimates[60:]]) - truth[60:]).max(axis=0)
        assert (error < [1e-3, 1e-2, 1e-3, 1e-2]).all(), (age, error)


def test_noise_is_filtered() -> None:
    estimates, truth = run(World(), DelayedEkf(PLANT.step_and_jacobian), 300)
    error = (np.array([e.x for e in estimates[100:]]) - truth[100:]).std(axis=0)
    assert (error < [0.003, 0.07, 0.003, 0.02]).all(), error
    assert all(e.psi_accepted for e in estimates[100:])
    assert np.mean([e.nis for e in estimates[100:]]) < 1.5


def test_first_samples_initialise_and_ready_needs_both() -> None:
    ekf = DelayedEkf(PLANT.step_and_jacobian)
    assert not ekf.update(1.0, 0.0, 0.98, None, None).ready
    assert not ekf.update(1.02, 0.0, 1.0007, driver(1.0007, 500.0, 12.0), None).ready
    late = ekf.update(1.04, 0.0, 1.0207, driver(1.0207, 500.24, 12.0), camera(0.99, 0.3))
    assert late.ready and late.psi_accepted
    np.testing.assert_allclose(late.x, [500.47, 12.0, 0.26, -1.35], atol=0.2)  # it falls for 50 ms
    assert late.x[2] == pytest.approx(0.3, abs=0.1)
    ekf.reset()
    assert not ekf.update(1.06, 0.0, 1.0407, None, camera(1.0, 0.3)).ready


def test_a_gap_of_pictures_is_predicted_and_the_next_one_is_fused() -> None:
    estimates, truth = run(World(), DelayedEkf(PLANT.step_and_jacobian), 200, missing=range(100, 130))
    assert all(math.isnan(e.innovation_psi) and e.ready for e in estimates[100:130])
    error = np.abs(np.array([e.x[2] for e in estimates]) - truth[:, 2])
    assert error[100:].max() < 0.03
    assert estimates[130].psi_accepted


def test_lost_answers_are_predicted() -> None:
    world, ekf = World(), DelayedEkf(PLANT.step_and_jacobian)
    for k in range(200):
        t, u, applied, answer, picture = world.tick()
        estimate = ekf.update(t, u, applied, None if 100 <= k < 110 else answer, picture)
        if k > 60:
            np.testing.assert_allclose(estimate.x, world.at(t), atol=0.5)
        world.torque(0.03)


def test_an_answer_one_tick_late_is_fused_at_its_own_time() -> None:
    world, ekf, before = World(noise=0.0), DelayedEkf(PLANT.step_and_jacobian), None
    for _ in range(150):
        t, u, applied, answer, picture = world.tick()
        estimate = ekf.update(t, u, applied, before, picture)
        before = answer
        last, truth = estimate.x, world.at(t)
        world.torque(0.05)
    np.testing.assert_allclose(last, truth, atol=0.02)


def test_one_false_ball_is_refused_and_leaves_no_trace() -> None:
    clean, _ = run(World(), DelayedEkf(PLANT.step_and_jacobian), 150)
    world, ekf = World(), DelayedEkf(PLANT.step_and_jacobian)
    for k in range(150):
        t, u, applied, answer, picture = world.tick()
        if k == 120:
            picture = picture._replace(psi=picture.psi + 0.4)
        estimate = ekf.update(t, u, applied, answer, picture)
        if k == 120:
            assert not estimate.psi_accepted and estimate.nis > 25
        world.torque(0.05 * math.sin(0.1 * k))
    np.testing.assert_allclose(estimate.x, clean[-1].x, atol=2e-3)


def test_a_ball_that_was_moved_is_found_again_and_random_false_ones_are_not() -> None:
    rng = np.random.default_rng(3)
    for moved, expected in ((True, True), (False, False)):
        world, ekf, accepted = World(psi=0.05), DelayedEkf(PLANT.step_and_jacobian), []
        for k in range(130):
            t, u, applied, answer, picture = world.tick()
            if k >= 100:
                picture = picture._replace(
                    psi=2.0 + 0.01 * (k - 100) if moved else rng.uniform(1.0, 3.1) * rng.choice((-1, 1))
                )
            accepted.append(ekf.update(t, u, applied, answer, picture).psi_accepted)
            world.torque(0.0)
        assert any(accepted[100:106]) is expected
        assert not any(accepted[100:104])


def test_psi_counts_turns_where_the_ball_goes_round() -> None:
    """A ball driven round the hoop: the camera's angle wraps, the estimate does not."""
    world, ekf = World(psi=0.0), DelayedEkf(PLANT.step_and_jacobian)
    for k in range(100):
        t, u, applied, answer, picture = world.tick()
        estimate = ekf.update(t, u, applied, answer, picture)
        truth = world.at(t)
        world.torque(0.6 if 20 <= k < 50 else 0.0)
    assert abs(truth[2]) > 8 * math.pi
    assert estimate.x[2] == pytest.approx(truth[2], abs=0.03)
    assert estimate.x[3] == pytest.approx(truth[3], abs=0.3)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_no_number_poisons_the_state(bad: float) -> None:
    world, ekf = World(), DelayedEkf(PLANT.step_and_jacobian)
    for k in range(80):
        t, u, applied, answer, picture = world.tick()
        if k > 50:
            answer = answer and answer._replace(theta=bad if k % 2 else 0.0, dtheta=bad)
            picture = picture._replace(psi=bad, t=bad if k % 2 else picture.t)
            u = bad
        estimate = ekf.update(t, u, applied, answer, picture)
        assert np.isfinite(estimate.x).all()
        world.torque(0.0)
    assert estimate.ready and not estimate.psi_accepted and math.isnan(estimate.innovation_theta)


def test_a_prediction_that_is_no_number_is_said_once_and_begun_anew() -> None:
    spoilt = False

    def step(x: Any, u: float, h: float) -> Any:
        ahead, f = PLANT.step_and_jacobian(x, u, h)
        return (ahead * math.nan, f) if spoilt else (ahead, f)

    world, ekf, ready = World(), DelayedEkf(step), []
    for k in range(80):
        t, u, applied, answer, picture = world.tick()
        spoilt = k == 50
        estimate = ekf.update(t, u, applied, answer, picture)
        ready.append(estimate.ready)
        assert np.isfinite(estimate.x).all() == (k != 50)
        world.torque(0.0)
    assert not ready[50] and ready[60]


def test_a_board_that_lost_its_count_does_not_shake_the_ball() -> None:
    world, ekf, shift = World(), DelayedEkf(PLANT.step_and_jacobian), 0.0
    for k in range(150):
        t, u, applied, answer, picture = world.tick()
        shift = 1000.0 if k >= 100 else 0.0
        estimate = ekf.update(t, u, applied, answer and answer._replace(theta=answer.theta + shift), picture)
        if k > 60:
            np.testing.assert_allclose(estimate.x - (shift, 0, 0, 0), world.at(t), atol=0.3)
        world.torque(0.02)


def test_samples_from_the_future_or_older_than_the_memory_are_refused() -> None:
    world, ekf = World(), DelayedEkf(PLANT.step_and_jacobian)
    for _ in range(50):
        t, u, applied, answer, picture = world.tick()
        ekf.update(t, u, applied, answer, picture)
        world.torque(0.0)
    t, u, applied, answer, picture = world.tick()
    for wrong in (t + 0.1, t - 0.4):
        estimate = ekf.update(t + (1e-6 if wrong < t else 0.0), u, applied, answer, picture._replace(t=wrong))
        assert not estimate.psi_accepted and math.isnan(estimate.innovation_psi)


def test_after_a_long_stop_it_starts_again() -> None:
    world, ekf = World(), DelayedEkf(PLANT.step_and_jacobian)
    run(world, ekf, 50)
    assert not ekf.update(5.0, 0.0, 4.9, None, None).ready


def test_the_same_calls_give_the_same_bits_and_a_symmetric_covariance() -> None:
    filters = [DelayedEkf(PLANT.step_and_jacobian) for _ in range(2)]
    results = [run(World(), ekf, 120, missing=range(40, 50))[0] for ekf in filters]
    for one, two in zip(*results, strict=True):
        assert one.x.tobytes() == two.x.tobytes()
    p = filters[0].covariance
    assert (p == p.T).all() and (np.linalg.eigvalsh(p) > 0).all()


def test_the_memory_is_bounded() -> None:
    ekf = DelayedEkf(PLANT.step_and_jacobian)
    run(World(), ekf, 300)
    assert len(ekf._nodes) < 40


@pytest.mark.parametrize(
    "change",
    [
        {"r_psi": 0.0},
        {"gate_nis": math.nan},
        {"q": (0.0, -1.0, 0.0, 0.0)},
    ],
)
def test_impossible_settings_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="must be"):
        EkfSettings(**change)  # type: ignore[arg-type]


def test_a_tick_takes_little_time() -> None:
    """Aim 150 us on an idle machine; the bound leaves room for a busy one."""
    world, ekf, times = World(), DelayedEkf(PLANT.step_and_jacobian), []
    for _ in range(200):
        arguments = world.tick()
        start = time.perf_counter()
        ekf.update(*arguments)
        times.append(time.perf_counter() - start)
        world.torque(0.0)
    assert np.median(times) < 600e-6


def test_a_fast_motion_may_leave_its_model_and_is_followed_all_the_same() -> None:
    """A ball that falls a fifth faster than the model: what is told to be expected keeps its pictures believed."""

    def worst(unmodelled: float) -> float:
        slow = HoopPlant("rolling", {**DEVICE, "g": 0.8 * DEVICE["g"]})
        ekf, world = DelayedEkf(slow.step_and_jacobian, EkfSettings()), World(psi=2.5)
        errors = []
        for k in range(60):
            t, u, applied, answer, seen = world.tick()
            estimate = ekf.update(t, u, applied, answer, seen, unmodelled=unmodelled)
            errors.append(abs(float(estimate.x[2] - world.at(t)[2])) if k > 20 else 0.0)
            world.torque(0.0)
        return max(errors)

    assert worst(20.0) < 0.15 < worst(0.0)


def test_nothing_more_expected_changes_nothing() -> None:
    one, other, world = (DelayedEkf(PLANT.step_and_jacobian), DelayedEkf(PLANT.step_and_jacobian), World())
    for _ in range(20):
        told = world.tick()
        assert one.update(*told).x.tolist() == other.update(*told, unmodelled=0.0).x.tolist()
        world.torque(0.01)
