"""Data made ready: trends, scales, ramps, gaps, pieces, bands and rates."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

import hoopd.ident as cond
from hoopd.ident.data import Data, iddata
from hoopd.ident.filtering import idfilt, prefilter, resample, resample_covariance, resample_system


def noise(n: int = 200, ny: int = 2, nu: int = 1, seed: int = 0) -> Data:
    rng = np.random.default_rng(seed)
    return iddata(rng.standard_normal((n, ny)), rng.standard_normal((n, nu)), 0.1, t0=3.0)


@pytest.mark.parametrize("order", [0, 1, 3])
def test_a_trend_is_found_between_gaps_and_put_on_again(order: int) -> None:
    t = 3.0 + 0.1 * np.arange(200)
    shape = np.polyval([0.02, -0.3, 1.0, 5.0][-(order + 1) :], t)
    y = np.column_stack([shape, -2.0 * shape])
    y[20:50, 0] = np.nan
    data = iddata(y, shape, 0.1, t0=3.0)
    rest = cond.detrend(data, order)
    assert np.nanmax(np.abs(rest.y)) < 1e-9 * np.nanmax(np.abs(y)) and np.abs(rest.u).max() < 1e-9 * shape.max()
    found = cond.trend(data[:150], order)
    again = found.restored(found.removed(data))
    assert np.allclose(again.y, data.y, equal_nan=True) and np.isnan(rest.y[30, 0])
    assert np.nanmax(np.abs(found.removed(data[150:]).y)) < 1e-6 * np.nanmax(np.abs(y))


def test_the_mean_alone_leaves_a_slope() -> None:
    data = iddata(np.arange(50.0), np.ones(50))
    assert cond.detrend(data).y[0, 0] == pytest.approx(-24.5)
    with pytest.raises(ValueError, match=r"too few for a trend of 3"):
        cond.trend(data[:2], 2)


def test_ramps_fade_every_channel_and_one_sample_does_nothing() -> None:
    data = noise()
    both = cond.ramp_out(cond.ramp_in(data, 11), 21)
    assert np.allclose(both.y[:11], data.y[:11] * np.linspace(0, 1, 11)[:, None])
    assert np.allclose(both.u[-21:], data.u[-21:] * np.linspace(1, 0, 21)[:, None])
    assert np.array_equal(both.y[11:-21], data.y[11:-21]) and cond.ramp_in(data, 1) is data
    for ramp, start in ((cond.ramp_in, 0), (cond.ramp_out, -1)):
        assert ramp(data, data.n).y[start] == pytest.approx(0.0)
        with pytest.raises(ValueError, match=f"a ramp over {data.n + 1} samples is longer than the data"):
            ramp(data, data.n + 1)


def test_scales_and_functions() -> None:
    data = noise()
    mixed = cond.scale(data, [[1.0, 2.0], [0.0, 3.0]], 4.0)
    assert np.allclose(mixed.y[:, 0], data.y[:, 0] + 2.0 * data.y[:, 1]) and np.allclose(mixed.u, 4.0 * data.u)
    unit = cond.normalize(data)
    assert np.allclose(unit.data.y.std(axis=0), 1.0) and np.allclose(unit.data.u * unit.u, data.u)
    every = cond.apply(data, lambda v: v[::2], lambda v: v[::2], dt=0.2)
    assert np.array_equal(every.y, data[::2].y) and every.dt == 0.2 and every.outputs == data.outputs
    with pytest.raises(ValueError, match="u is constant"):
        cond.normalize(iddata(np.arange(5.0), np.ones(5)))
    with pytest.raises(ValueError, match="2 channels want"):
        cond.scale(data, [1.0, 2.0, 3.0])


def test_pieces_in_time_and_separate_experiments() -> None:
    data = noise()
    whole = cond.concatenate(data[:80], data[80:])
    assert np.array_equal(whole.y, data.y) and whole.t0 == data.t0
    assert [one.n for one in cond.merge(data, [data[:30], data[30:]])] == [200, 30, 170]
    with pytest.raises(ValueError, match="step"):
        cond.merge(data, data[::2])
    assert cond.predictor_data(data).nu == 3


def test_gaps_are_filled_and_declared() -> None:
    y = np.arange(20.0)
    gaps = y.copy()
    gaps[[0, 5, 6, 10, 11, 12, 13, 14, 19]] = np.nan
    data = iddata(gaps, None, 0.5)
    for method in ("linear", "pchip"):
        done = cond.fill_gaps(data, method, longest_s=2.0)  # type: ignore[arg-type]
        assert np.flatnonzero(done.filled[:, 0]).tolist() == [5, 6] and np.allclose(done.data.y[5:7, 0], y[5:7])
        assert np.flatnonzero(np.isnan(done.data.y[:, 0])).tolist() == [0, 10, 11, 12, 13, 14, 19]
    with pytest.raises(ValueError, match="missing at sample 0"):
        prefilter(data, (0.0, 0.5))


def test_a_filter_leaves_the_dynamics_between_input_and_output() -> None:
    system = ct.TransferFunction([0.5], [1.0, -0.8], 0.1)
    u = np.random.default_rng(1).standard_normal(3000)
    y = ct.forced_response(system, U=u).outputs
    for done in (prefilter(iddata(y, u, 0.1), (0.5, 2.0)), idfilt(iddata(y, u, 0.1), [1.0, -0.5], [1.0, 0.3])):
        again = ct.forced_response(system, U=done.u[:, 0]).outputs
        assert np.abs(again - done.y[:, 0])[100:-300].max() < 1e-4


def test_several_bands_pass_together_and_stop_is_the_rest() -> None:
    t = 0.01 * np.arange(6000)
    tones = [np.sin(2 * np.pi * f * t) for f in (1.0, 5.0, 20.0)]
    data = iddata(sum(tones), None, 0.01)
    kept, left = (prefilter(data, (0.5, 2.0), (12.0, 30.0), (25.0, 33.0), stop=stop).y[:, 0] for stop in (False, True))
    assert np.abs(kept - tones[0] - tones[2])[800:-800].max() < 0.03
    assert np.allclose(kept + left, data.y[:, 0])
    with pytest.raises(ValueError, match="low < high"):
        prefilter(data, (60.0, 70.0))
    with pytest.raises(ValueError, match="too few"):
        prefilter(data[:9], (0.0, 1.0))


def test_a_rate_changes_without_aliases() -> None:
    t = 0.01 * np.arange(4000)
    slow = np.sin(2 * np.pi * 0.7 * t)
    data = iddata(np.column_stack([slow + 3.0, np.sin(2 * np.pi * 19.0 * t)]), slow, 0.01, outputs=["a", "b"])
    less = resample(data, 0.1)
    assert (less.n, less.dt, less.outputs) == (400, pytest.approx(0.1), ("a", "b"))
    assert np.abs(less.y[20:-20, 0] - 3.0 - slow[::10][20:-20]).max() < 2e-3
    assert np.abs(less.y[20:-20, 1]).max() < 1e-2
    more = resample(data, 1.5)
    assert more.n == 6000 and np.abs(more.u[50:-50, 0] - np.sin(2 * np.pi * 0.7 * more.t)[50:-50]).max() < 1e-3
    with pytest.raises(ValueError, match="fraction"):
        resample(data, np.pi / 3)


def test_a_model_at_another_rate_is_the_same_continuous_system() -> None:
    plant = ct.ss(ct.TransferFunction([1.0, 2.0], [1.0, 0.6, 4.0]))
    moved = resample_system(ct.c2d(plant, 0.1), 0.03)
    again = ct.c2d(plant, 0.03)
    assert np.allclose(ct.frequency_response(moved, [0.1, 3.0]).frdata, ct.frequency_response(again, [0.1, 3.0]).frdata)
    with pytest.raises(ValueError, match="at or left of 0"):
        resample_system(ct.TransferFunction([1.0], [1.0, 0.5], 0.1), 0.2)
    in_seconds = resample_system(ct.ss([[0.81]], [[1.9]], [[1.0]], [[0.0]], 1), 2)
    assert in_seconds.dt == 2.0 and np.allclose(in_seconds.A, 0.81**2)
    for step in (True, 0):
        with pytest.raises(ValueError, match="needs a discrete system with a sample time"):
            resample_system(ct.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], step), 2.0)


def test_a_covariance_over_two_steps_is_that_of_two_steps() -> None:
    a, q = np.array([[0.9, 0.1], [-0.2, 0.8]]), np.array([[2.0, 0.3], [0.3, 1.0]])
    assert np.allclose(resample_covariance(a, q, 0.1, 0.2), a @ q @ a.T + q)
    assert np.allclose(resample_covariance(a @ a, a @ q @ a.T + q, 0.2, 0.1), q)


@pytest.mark.parametrize("steps", [2, 10, 20, 100])
def test_a_covariance_over_many_steps_of_a_fast_pole_is_the_sum_over_them(steps: int) -> None:
    a, q = np.array([[0.9, 0.3], [0.0, 0.01]]), np.array([[1.0, 0.2], [0.2, 0.5]])
    powers = [np.linalg.matrix_power(a, i) for i in range(steps)]
    total = np.sum([power @ q @ power.T for power in powers], axis=0)
    assert np.allclose(resample_covariance(a, q, 0.1, 0.1 * steps), total, rtol=1e-9)
