"""Frequency responses, coherence, spectra and correlations from data."""

from __future__ import annotations

import tracemalloc

import control as ct
import numpy as np
import pytest
from scipy import signal

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations, Polynomials
from hoopd.ident.resampling import c2d
from hoopd.ident.spectral import coherence, correlation, power_spectrum, tfest
from hoopd.ident.spectrogram import model_spectrum, noise_spectrum

POLES = [1.0, -1.2, 0.5]


def plant(seed: int, n: int = 20000, noise: float = 0.3) -> tuple[Data, ct.StateSpace]:
    rng = np.random.default_rng(seed)
    a = np.diag([0.6, -0.3, 0.2]) + 0.2 * rng.standard_normal((3, 3)) / 3.0
    system = ct.ss(a, rng.standard_normal((3, 2)), rng.standard_normal((2, 3)), np.zeros((2, 2)), 0.05)
    u = rng.standard_normal((n, 2)) @ np.array([[1.0, 0.6], [0.0, 0.8]])
    v = noise * signal.lfilter([1.0], [1.0, -0.5], rng.standard_normal((n, 2)), axis=0)
    return iddata(ct.forced_response(system, U=u.T).outputs.T + v, u, 0.05), system


@pytest.mark.parametrize("method", ["welch", "correlation"])
def test_inputs_that_move_together_in_part_are_told_apart(method: str) -> None:
    data, system = plant(0)
    options = {"segment": 200} if method == "welch" else {"width": 60.0}
    found = tfest(data, method, **options)  # type: ignore[arg-type]
    true = ct.FRD(system, found.w).frdata
    miss = np.abs(found.system.frdata - true)[:, :, 1:-1] / found.deviation[:, :, 1:-1]
    # half of the square of a complex error lies along the response
    assert 0.8 < np.mean(miss**2) / 2.0 < 1.35 and found.system.dt == 0.05
    spectrum = 0.3**2 * 0.05 / np.abs(1.0 - 0.5 * np.exp(-1j * found.w * 0.05)) ** 2
    level = found.noise.frdata[0, 0].real / spectrum
    assert np.mean(level[1:-1]) == pytest.approx(1.0, abs=0.06)
    assert found.coherence.min() > 0.3


def test_experiments_and_gaps_count_as_their_segments() -> None:
    data, _ = plant(1, 8000)
    y = data.y.copy()
    y[3000:3040] = np.nan
    holes = iddata(y, data.u, data.dt)
    one, several = tfest(holes, segment=400), tfest([holes[:3000], holes[3040:]], segment=400)
    assert np.allclose(one.system.frdata, several.system.frdata) and one.means == several.means
    with pytest.raises(ValueError, match="missing at sample 3000"):
        tfest(holes, "correlation")
    with pytest.raises(ValueError, match="without a gap"):
        tfest(holes, segment=5000)


def test_coherence_of_several_inputs_exceeds_that_of_each() -> None:
    data, _ = plant(2, noise=1.0)
    together, by_pairs = coherence(data, segment=256), coherence(data, segment=256, pairs=True)
    assert by_pairs.values.shape == (129, 2, 2)
    assert np.mean(together.values[:, :, None] >= by_pairs.values - 0.02) > 0.99
    rng = np.random.default_rng(3)
    unrelated = coherence(iddata(rng.standard_normal(20000), rng.standard_normal((20000, 2)), 1.0), segment=200)
    assert np.mean(unrelated.values > unrelated.chance) == pytest.approx(0.05, abs=0.06)


def test_a_spectrum_integrates_to_the_variance_within_its_interval() -> None:
    rng = np.random.default_rng(4)
    white = iddata(2.0 * rng.standard_normal(50000), None, 0.01)
    found = power_spectrum(white, segment=500)
    assert np.mean(found.density) == pytest.approx(4.0 * 0.01, rel=0.03)
    inside = (found.low[1:-1] < 0.04) & (found.high[1:-1] > 0.04)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.04)


def test_bounds_hold_where_the_transform_is_real_as_often_as_elsewhere() -> None:
    """At 0 and at half the sampling frequency: intervals hold the truth, and unrelated channels stay below chance."""
    count = 200
    held, below, by_pairs = np.zeros(51), np.zeros(51), np.zeros(51)
    for seed in range(count):
        y, u, other = np.random.default_rng(seed).standard_normal((3, 2000))
        found = power_spectrum(iddata(y, dt=1.0), segment=100)
        held += (found.low[:, 0] < 1.0) & (found.high[:, 0] > 1.0)
        two = iddata(y, np.column_stack([u, other]), 1.0)
        together, apart = coherence(two, segment=100), coherence(two, segment=100, pairs=True)
        below += (together.values < together.chance)[:, 0]
        by_pairs += (apart.values < apart.chance)[:, 0, 0]
    for share in (held, below, by_pairs):
        assert share[[0, -1]].mean() / count == pytest.approx(0.95, abs=0.025)
        assert share[2:-2].mean() / count == pytest.approx(0.95, abs=0.015)


def test_correlations_find_a_shift_and_stay_within_bounds_elsewhere() -> None:
    u = np.random.default_rng(5).standard_normal(4000)
    found = correlation(np.roll(u, 7), u, 40)
    values = found.values[:, 0, 0]
    assert found.lag[np.argmax(values)] == 7 and values.max() == pytest.approx(1.0, abs=0.01)
    assert np.mean(np.abs(np.delete(values, 47)) > found.bound) < 0.12
    assert correlation(u).values[50, 0, 0] == pytest.approx(1.0)


def test_correlations_leave_out_what_is_missing() -> None:
    u = np.random.default_rng(3).standard_normal(400)
    y = np.concatenate([np.zeros(7), u[:-7]])
    y[50:60] = np.nan
    found = correlation(y, u, 20)
    assert found.lag[np.argmax(found.values[:, 0, 0])] == 7
    assert found.pairs[20, 0, 0] == 390 and found.pairs[27, 0, 0] == 400 - 7 - 10
    # the mean of the products that are known, and the weight that keeps the correlations definite
    a, b = (one - np.nanmean(one) for one in (y, u))
    mean = np.nanmean(a[3:] * b[:-3]) / np.sqrt(np.nanmean(a**2) * np.mean(b**2))
    assert found.values[23, 0, 0] == pytest.approx(mean * 397 / 400)
    for wrong, why in ((np.full(50, 0.1), "constant"), (np.full(50, np.nan), "no number")):
        with pytest.raises(ValueError, match=why):
            correlation(wrong)


def test_data_that_cannot_tell_are_refused() -> None:
    u = np.random.default_rng(6).standard_normal(500)
    with (
        pytest.raises(ValueError, match="move together"),
        pytest.warns(IdentificationWarning, match="excite order 20 and 40"),
    ):
        tfest(iddata(u, np.column_stack([u, 2.0 * u])))
    with pytest.raises(ValueError, match="input u is constant"):
        tfest(iddata(u, np.zeros(500)))
    with pytest.raises(ValueError, match="no input"):
        tfest(iddata(u))
    with pytest.raises(ValueError, match="shorter segments"):
        tfest(iddata(u, u[::-1]), segment=500)
    with pytest.raises(ValueError, match="no width"):
        tfest(iddata(u, u[::-1]), width=3.0)


def least_squares(piece: Data, order: int = 4) -> Polynomials:
    past = np.column_stack([piece.y[order - k : piece.n - k, 0] for k in range(1, order + 1)])
    a, rest, *_ = np.linalg.lstsq(past, piece.y[order:, 0], rcond=None)
    return Polynomials(piece.dt, a=np.concatenate([[1.0], -a]), variance=float(rest[0] / len(past)))


def test_a_model_of_each_piece_follows_a_tone_that_moves() -> None:
    t = 0.1 * np.arange(4000)
    y = np.where(t < 200.0, np.sin(2.0 * t), np.sin(9.0 * t)) + 0.1 * np.random.default_rng(7).standard_normal(4000)
    found = model_spectrum(iddata(y, None, 0.1), least_squares, 200)
    peaks = found.w[np.argmax(found.density, axis=1)]
    assert np.abs(peaks[found.t < 190.0] - 2.0).max() < 0.3 and np.abs(peaks[found.t > 210.0] - 9.0).max() < 0.3


def test_the_spectrum_of_a_model_is_that_of_its_samples() -> None:
    model = Polynomials(0.05, a=np.array(POLES), c=np.array([1.0, 0.4]), variance=0.7)
    e = np.sqrt(0.7) * np.random.default_rng(8).standard_normal(200000)
    found = power_spectrum(iddata(signal.lfilter([1.0, 0.4], POLES, e), None, 0.05), segment=400)
    ratio = found.density[2:, 0] / noise_spectrum(model, found.w[2:])[:, 0, 0].real
    assert np.abs(ratio - 1.0).max() < 0.25 and np.mean(ratio) == pytest.approx(1.0, abs=0.02)


def test_the_error_of_a_gain_is_the_spread_of_many_estimates() -> None:
    gains, claimed = [], []
    for seed in range(150):
        u, e = np.random.default_rng(seed).standard_normal((2, 2000))
        found = tfest(iddata(signal.lfilter([0.0, 1.0], [1.0, -0.5], u) + 0.5 * e, u), segment=100)
        gains.append(np.abs(found.system.frdata[0, 0]))
        claimed.append(found.deviation[0, 0])
    ratio = np.sqrt(np.mean(np.square(claimed), axis=0)) / np.std(gains, axis=0)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.07)
    # at 0 and at half the sampling frequency the whole error lies along the gain
    assert ratio[[0, -1]] == pytest.approx([1.0, 1.0], abs=0.25)


def test_segments_are_not_stacked_in_memory() -> None:
    u, e = np.random.default_rng(0).standard_normal((2, 50_000))
    data = iddata(u + e, u)
    tfest(data[:5000], segment=100)  # modules are loaded
    tracemalloc.start()
    tfest(data, segment=100)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # the record twice or thrice, not once for each of its thousand segments
    assert peak < 8 * (data.nu + data.ny) * data.n * 5


def test_a_continuous_model_has_the_spectrum_that_its_samples_have_far_below_their_rate() -> None:
    one = np.ones((1, 1))
    lag = Innovations(-2.0 * one, one, one, 0.0 * one, 3.0 * one, 0.0, r=0.1 * one)
    w = np.array([0.1, 1.0, 10.0])
    found = noise_spectrum(lag, w)[:, 0, 0]
    assert np.allclose(found, 0.1 * np.abs((1j * w + 5.0) / (1j * w + 2.0)) ** 2)
    assert np.allclose(noise_spectrum(c2d(lag, 1e-3), w)[:, 0, 0], found, rtol=0.01)
