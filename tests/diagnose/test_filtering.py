"""The filter, its smoother and its likelihood against one big Gaussian, and the noise levels' gradient."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from diagnose.madeup import NOISE, shipped_plant, stretch_with
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.kalman_filter import (
    RATE_FLOOR,
    START_POSITION,
    START_RATE,
    Array,
    Lagged,
    LinearReference,
    Noise,
    gains,
    smoothed,
    whitened,
)
from hoopd.plants.likelihood.noise_levels import Criterion
from hoopd.plants.likelihood.noise_tuning import quiet_readings, roughness, tuned
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.likelihood.whitening_blocks import BLOCK, FEW

N, NZ, NQ, NC, FOLLOWED, OFF = 40, 5, 2, 3, 3, 0.7
LEVELS = Noise(np.array([0.3, 0.05]), np.array([0.1, 0.3]), np.array([0.02, 0.1, 0.05]))


class Dense(NamedTuple):
    """All deviations as one linear map of what is drawn at random, written down without any recursion of the filter."""

    state: Array  # (n size, n size): covariance of all deviations
    eps: Array  # (seen, seen): covariance of what was read
    cross: Array  # (n size, seen)
    of_f: Array  # (n size, (n-1) nz): deviations by additions to the one-step map
    c: Array  # (seen, n size)
    rows: Array  # (n, nc) whether read


def model(seed: int = 1, n: int = N) -> LinearReference:
    random = np.random.default_rng(seed)
    a = np.eye(NZ) + 0.1 * random.normal(size=(n - 1, NZ, NZ))
    # a stable model: the whole stretch stays of one size
    a *= 0.95 / np.maximum(0.95, np.abs(np.linalg.eigvals(a)).max(axis=1))[:, None, None]
    seen = random.random((n, NC)) > 0.2
    h = random.uniform(0.01, 0.03, n - 1)
    return LinearReference(
        a,
        0.3 * random.normal(size=(n - 1, NZ, NQ)),
        random.normal(size=(n, NC, NZ)),
        h,
        seen,
        4,
        random.uniform(0.5, 2.0, (n, NC)),
        (Lagged(FOLLOWED, OFF),),
    )


def data(m: LinearReference, columns: int, seed: int = 2) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    n = len(m.c)
    return 0.01 * random.normal(size=(n - 1, NZ, columns)), 0.3 * random.normal(size=(n, NC, columns))


def dense(m: LinearReference, noise: Noise) -> Dense:
    n, size = len(m.c), NZ + NQ
    phi = [
        np.block([[a, w], [np.zeros((NQ, NZ)), np.diag(np.exp(-h / noise.time_s))]])
        for a, w, h in zip(m.a, m.w, m.h, strict=True)
    ]
    # d_k = phi_k-1 ... phi_j v_j summed over j <= k, with v_0 the start and v_j+1 what step j adds
    reach = np.zeros((n * size, n * size))
    for j in range(n):
        block = np.eye(size)
        for k in range(j, n):
            reach[k * size : (k + 1) * size, j * size : (j + 1) * size] = block
            block = phi[k] @ block if k < n - 1 else block
    # the last state, behind a lag, follows one of the others, and is off by something
    start, settled = [START_POSITION, START_RATE, START_POSITION, START_RATE, OFF, *noise.force], np.eye(size)
    settled[NZ - 1, FOLLOWED] = 1.0
    floor = [0.0, RATE_FLOOR, 0.0, RATE_FLOOR, 0.0]
    displaced = np.zeros((n - 1, NZ)) if m.displaced is None else m.displaced
    added = [
        np.diag([*(np.square(floor) + jump**2), *(noise.force**2 * (1 - np.exp(-2 * h / noise.time_s)))])
        for h, jump in zip(m.h, displaced, strict=True)
    ]
    state = reach @ block_diag(settled @ np.diag(np.square(start)) @ settled.T, *added) @ reach.T
    rows = m.seen.ravel()
    c = block_diag(*(np.hstack([one, np.zeros((NC, NQ))]) for one in m.c))[rows]
    unknown = 0.0 if m.unresolved is None else m.unresolved**2
    eps = c @ state @ c.T + np.diag(((noise.reading * m.scatter) ** 2 + unknown).ravel()[rows])
    columns = [(k + 1) * size + i for k in range(n - 1) for i in range(NZ)]
    return Dense(state, eps, state @ c.T, reach[:, columns], c, m.seen)


def observed(big: Dense, f: Array, eps: Array) -> Array:
    """(seen, m) what the readings miss, freed of what f does to them."""
    m = f.shape[2]
    return eps.reshape(-1, m)[big.rows.ravel()] - big.c @ big.of_f @ f.reshape(-1, m)


def with_unknown_inputs(m: LinearReference) -> LinearReference:
    random = np.random.default_rng(9)
    return m._replace(
        unresolved=random.uniform(0.0, 0.3, m.seen.shape), displaced=random.uniform(0.0, 0.2, m.a.shape[:2])
    )


MODELS = pytest.mark.parametrize("m", [model(), with_unknown_inputs(model())], ids=["known", "unknown"])


@MODELS
def test_whitened_columns_have_the_gram_matrix_of_generalised_least_squares(m: LinearReference) -> None:
    f, eps = data(m, 4)
    white = whitened(m, gains(m, LEVELS), f, eps).reshape(-1, 4)
    big = dense(m, LEVELS)
    y = observed(big, f, eps)
    expected = y.T @ np.linalg.solve(big.eps, y)
    assert np.abs(white.T @ white - expected).max() < 1e-8 * np.abs(expected).max()


def test_what_was_not_read_does_not_matter() -> None:
    m = model()
    f, eps = data(m, 2)
    found = gains(m, LEVELS)
    white = whitened(m, found, f, eps)
    other = whitened(m, found, f, np.where(m.seen[:, :, None], eps, 1e3))
    assert np.array_equal(white, other) and not white[~m.seen].any()


@MODELS
def test_the_criterion_is_the_gaussian_log_likelihood(m: LinearReference) -> None:
    f, eps = data(m, 1)
    big = dense(m, LEVELS)
    y = observed(big, f, eps)[:, 0]
    expected = multivariate_normal.logpdf(y, cov=big.eps, allow_singular=False)
    value = Criterion(m, f[:, :, 0], eps[:, :, 0]).value(LEVELS)
    assert -value - len(y) / 2 * np.log(2 * np.pi) == pytest.approx(expected, rel=1e-9)


def test_the_smoother_is_the_conditional_mean() -> None:
    m = model()
    f, eps = data(m, 1)
    big = dense(m, LEVELS)
    y = observed(big, f, eps)
    expected = (big.of_f @ f.reshape(-1, 1) + big.cross @ np.linalg.solve(big.eps, y)).reshape(N, -1)
    found = smoothed(m, gains(m, LEVELS), f[:, :, 0], eps[:, :, 0])
    assert np.abs(found.d - expected).max() < 1e-8 * np.abs(expected).max()


def test_filtered_and_predicted_states_know_no_later_reading() -> None:
    m = model()
    f, eps = data(m, 1)
    whole = smoothed(m, gains(m, LEVELS), f[:, :, 0], eps[:, :, 0])
    for k in (1, 17):
        part = LinearReference(
            m.a[:k], m.w[:k], m.c[: k + 1], m.h[:k], m.seen[: k + 1].copy(), m.nx, m.scatter[: k + 1], m.lagged
        )
        last = smoothed(part, gains(part, LEVELS), f[:k, :, 0], eps[: k + 1, :, 0])
        assert np.allclose(whole.filtered[k], last.d[k])
        part.seen[k] = False
        assert np.allclose(
            whole.predicted[k], smoothed(part, gains(part, LEVELS), f[:k, :, 0], eps[: k + 1, :, 0]).d[k]
        )


def test_push_is_the_derivative_of_the_log_likelihood() -> None:
    m = model()
    f, eps = data(m, 1)
    criterion = lambda f: Criterion(m, f[:, :, 0], eps[:, :, 0]).value(LEVELS)  # noqa: E731
    push = smoothed(m, gains(m, LEVELS), f[:, :, 0], eps[:, :, 0]).push
    for k, i in ((0, 0), (7, 1), (20, 4), (N - 2, 3)):
        more, less = f.copy(), f.copy()
        more[k, i], less[k, i] = f[k, i] + 1e-4, f[k, i] - 1e-4
        assert push[k, i] == pytest.approx((criterion(less) - criterion(more)) / 2e-4, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("m", [model(3, 2), model(3, 40), model(3, 130), with_unknown_inputs(model(3, 40))])
def test_the_gradient_by_the_noise_levels(m: LinearReference) -> None:
    f, eps = data(m, 1)
    criterion = Criterion(m, f[:, :, 0], eps[:, :, 0])
    value, slope = criterion.gradient(LEVELS)
    assert value == pytest.approx(criterion.value(LEVELS), rel=1e-12)
    for i in range(len(slope)):
        step = np.zeros(len(slope))
        step[i] = 1e-5
        ends = [np.exp(np.log(np.concatenate(LEVELS)) + sign * step) for sign in (1, -1)]
        high, low = (criterion.value(Noise(v[:NQ], v[NQ : 2 * NQ], v[2 * NQ :])) for v in ends)
        assert slope[i] == pytest.approx((high - low) / 2e-5, rel=1e-5, abs=1e-4)


def test_levels_are_recovered_from_far_and_from_near() -> None:
    m = model(4, 900)
    random = np.random.default_rng(5)
    d, eps = np.zeros(NZ + NQ), np.zeros((900, NC))
    found = gains(m, LEVELS)
    for k in range(900):
        eps[k] = m.c[k] @ d[:NZ] + LEVELS.reading * m.scatter[k] * random.normal(size=NC)
        if k < 899:
            d = found.phi[k] @ d
            d[NZ:] += LEVELS.force * np.sqrt(1 - np.exp(-2 * m.h[k] / LEVELS.time_s)) * random.normal(size=NQ)
    criterion = Criterion(m, np.zeros((899, NZ)), eps)
    first = Noise(LEVELS.force * 8, np.full(NQ, 0.15), LEVELS.reading * 2)
    far = tuned([criterion], first, first).noise
    near = tuned([criterion], far, first, near=True).noise
    # seven fitted numbers gain some chi2_7 / 2 over the true ones: above 12 nats once in a thousand
    assert 0.0 <= criterion.value(LEVELS) - criterion.value(far) < 12.0
    assert criterion.value(near) == pytest.approx(criterion.value(far), abs=0.02)
    assert np.allclose(np.log(near.force), np.log(LEVELS.force), atol=0.3)
    assert np.allclose(near.reading, LEVELS.reading, rtol=0.2)


def test_levels_stay_within_their_bounds() -> None:
    m = model(6, 200)
    criterion = Criterion(m, np.zeros((199, NZ)), np.zeros((200, NC)))
    first = Noise(np.ones(NQ), np.full(NQ, 0.15), np.ones(NC))
    found = tuned([criterion], first, first).noise
    # nothing is left to explain: every level goes to its lowest
    assert np.allclose(found.reading, 0.4) and np.all(found.force < 0.1)


def test_roughness_is_the_noise_of_a_smooth_reading() -> None:
    t, random = np.arange(2000) * 0.02, np.random.default_rng(1)
    assert roughness([np.sin(t) + 0.01 * random.normal(size=2000)]) == pytest.approx(0.01, rel=0.1)
    count = 2 * np.pi / 4096
    slow = np.round(0.001 * np.arange(2000) / count) * count
    assert roughness([slow]) >= 0.99 * count / np.sqrt(12.0)


@pytest.mark.parametrize("name", ["actuator.lag", "encoder.speed_lag"])
def test_a_lag_of_no_time_costs_nothing_at_the_start_of_a_stretch(name: str) -> None:
    """What is behind it is no further unknown."""
    plant = shipped_plant()
    lag, made = library(plant)[name], stretch_with(plant, "a", 3, 8.0)
    # from rest, and from the midst of a motion
    for part in (made, Stretch("a", plant, made.t[100:], made.u[100:], made.y[100:])):
        base = fit([part], (), plant.values, noise={"a": NOISE}, free=(), tune_noise=False)
        for like in (None, base):
            found = fit([part], (lag,), plant.values, noise={"a": NOISE}, free=(), tune_noise=False, like=like)
            assert found.gains[0].logdet == pytest.approx(base.gains[0].logdet, abs=1e-3)
            assert found.criterion == pytest.approx(base.criterion, abs=0.1)
        # beside a fit that has a lag already
        again = fit([part], (lag,), plant.values, noise={"a": NOISE}, free=(), tune_noise=False, like=found)
        assert again.criterion == pytest.approx(base.criterion, abs=0.1)


@pytest.mark.parametrize("name", ["actuator.lag", "encoder.speed_lag"])
def test_the_start_of_a_stretch_in_motion_is_as_likely_as_the_rest_of_it(name: str) -> None:
    """Where it begins the torque was another one before, and a reading that lags is not the rate."""
    plant, key = shipped_plant(), f"{name}.T"
    lag, off = library(plant)[name], []
    for seed in range(4):
        made = stretch_with(plant, "a", seed, 8.0, [lag], {key: 0.03})
        switch = 100 + int(np.argmax(np.diff(made.u[100:]) != 0.0)) + 1
        part = Stretch("a", plant, made.t[switch:], made.u[switch:], made.y[switch:])
        found = fit([part], (lag,), {**plant.values, key: 0.03}, noise={"a": NOISE}, free=(), tune_noise=False)
        off.append(np.sum(found.rows[0][:15, 0] ** 2) / 15.0)
    assert np.mean(off) < 2.0


def test_a_lag_that_is_there_is_not_behind_a_delay_of_the_same_time() -> None:
    """Of a millisecond they are nearly the same: chance decides by some tenths of a nat about one recording."""
    plant, ahead = shipped_plant(), []
    library_of = library(plant)
    for seed in range(3, 7):
        made = stretch_with(plant, "a", seed, 20.0, [library_of["actuator.lag"]], {"actuator.lag.T": 1.2e-3})
        found = {
            name: fit([made], (library_of[name],), {**plant.values, f"{name}.{key}": 1e-3}, noise={"a": NOISE},
                      tune_noise=False).criterion
            for name, key in (("actuator.lag", "T"), ("actuator.delay", "d"))
        }  # fmt: skip
        ahead.append(found["actuator.delay"] - found["actuator.lag"])
    assert np.mean(ahead) > 0.0


@pytest.mark.parametrize("n", [N, 41, 7])
def test_many_columns_are_whitened_as_one_after_the_other(n: int) -> None:
    m, columns = model(n=n), 2 * FEW + 1
    found, (f, eps) = gains(m, LEVELS), data(m, columns)
    white = whitened(m, found, f, eps)
    assert white.shape == (n, NC, columns)
    each = np.concatenate([whitened(m, found, f[:, :, [i]], eps[:, :, [i]]) for i in range(columns)], axis=2)
    np.testing.assert_allclose(white, each, rtol=1e-9, atol=1e-9)


def test_a_column_that_is_put_in_by_a_matrix_is_whitened_like_its_changes() -> None:
    m = model()
    blocks, random = gains(m, LEVELS).blocks, np.random.default_rng(3)
    count = len(blocks.begin)
    direction, inputs = random.normal(size=NZ), random.normal(size=(2, count * BLOCK))
    inputs[:, N - 1 :] = 0.0
    by = np.ascontiguousarray((blocks.step @ direction).transpose(0, 2, 1))
    rows = blocks.rows(inputs.reshape(2, count, BLOCK).transpose(1, 0, 2), by)
    f = inputs[:, : N - 1].T[:, None, :] * direction[:, None]
    expected = whitened(m, gains(m, LEVELS), f, np.zeros((N, NC, 2)))
    np.testing.assert_allclose(rows, expected.reshape(-1, 2).T, rtol=1e-9, atol=1e-9)


def two_level(seed: int, seconds: float = 20.0) -> Stretch:
    """The hoop under a torque of two levels, a new one at every sample."""
    u = 0.1 * np.random.default_rng([seed, 7]).choice([-1.0, 1.0], round(seconds / 0.02))
    return stretch_with(shipped_plant(), f"fast {seed}", seed, seconds, u=u)


def test_what_a_fast_input_does_is_no_noise_of_the_readings() -> None:
    """Its steps make readings rougher than their noise; the level that is found is the noise alone."""
    fast = two_level(1)
    rough = np.array([roughness([fast.y[:, column]]) for column in range(3)])
    assert rough[0] > 3.0 * NOISE.reading[0] and rough[1] > 3.0 * NOISE.reading[1]
    assert quiet_readings([fast]) == pytest.approx(NOISE.reading, rel=0.3)
    found = fit([fast], [], shipped_plant().values)
    assert found.noise["fast 1"].reading == pytest.approx(NOISE.reading, rel=0.1)


def test_readings_with_those_of_another_sensor_between_are_as_quiet() -> None:
    """Encoder and camera take turns, and the encoder is silent for a while: its evenly following readings count."""
    u = 0.1 * np.repeat(np.random.default_rng(7).choice([-1.0, 1.0], 1000), 2)
    fast = stretch_with(shipped_plant(), "turns", 3, 0.0, u=u)
    y = fast.y.copy()
    y[1::2, :2] = y[::2, 2] = np.nan
    y[400:500, :2] = np.nan
    turns = replace(fast, y=y, every=y)
    rough = np.array([roughness([y[:, column]]) for column in range(2)])
    assert (rough > 5.0 * NOISE.reading[:2]).all()
    assert quiet_readings([turns])[:2] == pytest.approx(NOISE.reading[:2], rel=0.3)


def test_where_no_input_is_or_readings_have_gaps_the_least_is_their_roughness() -> None:
    smooth = two_level(2, 4.0)
    still = replace(smooth, u=0.0 * smooth.u)
    gaps = replace(
        smooth, y=np.where(np.arange(len(smooth.t))[:, None] % 3 == 0, np.nan, smooth.y), every=smooth.every[:0]
    )
    for one in (still, gaps):
        rough = [roughness([one.every[:, column]]) for column in range(3)]
        assert quiet_readings([one]) == pytest.approx(rough, rel=0.05)
