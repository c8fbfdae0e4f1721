"""Test signals: the properties that identification relies on."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from hoopd.ident.signals import (
    TAPS,
    balance,
    chirp,
    coverage,
    crest_factor,
    kicks,
    multisine,
    prbs,
    prbs_order,
    spectrum,
    steps,
)

STEP_S = 0.02


@pytest.mark.parametrize("order", TAPS)
def test_prbs_has_the_maximal_length(order: int) -> None:
    """Every state but zero once a period: the values sum to one, and the autocorrelation has two values."""
    u = prbs(order)
    n = 2**order - 1
    assert len(u) == n and set(np.unique(u)) == {-1.0, 1.0}
    assert abs(u.sum()) == 1.0
    correlation = np.fft.ifft(np.abs(np.fft.fft(u)) ** 2).real
    assert correlation[0] == pytest.approx(n)
    assert np.allclose(correlation[1:], -1.0, atol=1e-6)


def test_prbs_is_held_for_its_clock_and_begins_where_the_seed_says() -> None:
    slow = prbs(6, clock_ticks=3, seed=5)
    assert np.array_equal(slow, np.repeat(prbs(6, seed=5), 3))
    starts = {prbs(9, seed=seed)[:20].tobytes() for seed in range(30)}
    assert len(starts) > 20
    assert any(np.array_equal(prbs(6, seed=5), np.roll(prbs(6, seed=1), k)) for k in range(63))


def test_prbs_power_falls_with_its_clock() -> None:
    """(sin(pi f T) / (pi f T))^2: flat below a third of 1/T, empty at 1/T."""
    frequency, power = spectrum(np.tile(prbs(10, clock_ticks=5, seed=1), 1), STEP_S)
    lines = power[1:]
    low = lines[frequency[1:] < 1.0].mean()
    assert lines[np.abs(frequency[1:] - 10.0) < 0.05].max() < 1e-2 * low
    assert lines[np.abs(frequency[1:] - 5.0) < 0.5].mean() == pytest.approx(low * (2 / np.pi) ** 2, rel=0.1)


@pytest.mark.parametrize(("samples", "clock", "order"), [(7, 1, 3), (8, 1, 4), (1000, 1, 10), (1000, 4, 8)])
def test_the_order_is_the_smallest_that_lasts(samples: int, clock: int, order: int) -> None:
    assert prbs_order(samples, clock) == order


def test_chirp_spends_as_long_on_every_octave() -> None:
    u = chirp(4000, STEP_S, 0.5, 8.0)
    assert np.abs(u).max() == pytest.approx(1.0, abs=1e-3) and crest_factor(u) == pytest.approx(sqrt(2.0), rel=0.02)
    frequency, power = spectrum(u, STEP_S)
    octaves = [power[(frequency >= f) & (frequency < 2 * f)].sum() for f in (0.5, 1.0, 2.0, 4.0)]
    assert min(octaves) > 0.8 * max(octaves)
    low, high = coverage(u, STEP_S)
    assert 0.5 < low < 0.7 and 6.0 < high < 8.0
    assert np.array_equal(chirp(100, STEP_S, 0.5, 8.0, seed=3), -chirp(100, STEP_S, 0.5, 8.0))


@pytest.mark.parametrize("samples", [0, 1, 5])
def test_a_multisine_without_a_line_in_its_band_is_refused(samples: int) -> None:
    with pytest.raises(ValueError, match="have no line between"):
        multisine(samples, STEP_S, 0.3, 5.0)


def test_multisine_has_equal_lines_in_its_band_and_nothing_else() -> None:
    u = multisine(1000, STEP_S, 0.3, 5.0, seed=2)
    frequency, power = spectrum(u, STEP_S)
    inside = (frequency > 0.3 - 1e-9) & (frequency < 5.0 + 1e-9)
    assert power[inside].min() == pytest.approx(power[inside].max(), rel=1e-9)
    assert power[~inside].max() < 1e-12 * power[inside].max()
    assert abs(u.mean()) < 1e-12 and np.abs(u).max() == pytest.approx(1.0)


@pytest.mark.parametrize("high_hz", [2.0, 5.0, 10.0, 20.0])
def test_schroeder_keeps_the_crest_low(high_hz: float) -> None:
    u = multisine(2000, STEP_S, 0.2, high_hz)
    assert crest_factor(u) < 2.0
    lines = np.zeros(1001, complex)
    lines[8 : int(high_hz * 40) + 1] = np.exp(2j * np.pi * np.random.default_rng(1).random(int(high_hz * 40) - 7))
    assert crest_factor(u) < 0.8 * crest_factor(np.fft.irfft(lines))
    assert crest_factor(multisine(2000, STEP_S, 0.2, high_hz, seed=9)) == pytest.approx(crest_factor(u))


def test_steps_bring_an_integrator_back() -> None:
    u = steps(1000, 20, seed=4)
    assert len(u) == 1000 and set(np.abs(np.unique(u))) == {0.0, 0.5, 0.75, 1.0}
    assert balance(u) == 0.0 and abs(np.cumsum(u)[79::80]).max() == 0.0


def test_kicks_turn_and_rest() -> None:
    u = kicks(250, 10, 90)
    assert list(np.flatnonzero(np.diff(u, prepend=0.0))) == [0, 10, 100, 110]
    assert u[0] == 1.0 and u[100] == -1.0 and not u[200:].any()
    assert kicks(250, 10, 90, seed=1)[0] == -1.0


@pytest.mark.parametrize("refused", [
    lambda: prbs(2),
    lambda: prbs(5, 0),
    lambda: prbs_order(10**6, 1),
    lambda: chirp(100, STEP_S, 0.0, 5.0),
    lambda: chirp(100, STEP_S, 5.0, 1.0),
    lambda: chirp(100, STEP_S, 1.0, 26.0),
    lambda: multisine(100, STEP_S, 0.6, 0.9),
    lambda: steps(79, 20),
    lambda: steps(79, 0),
    lambda: kicks(99, 10, 90),
])  # fmt: skip
def test_what_makes_no_signal_is_refused(refused) -> None:
    with pytest.raises(ValueError, match=r".+"):
        refused()


def test_measures_of_known_signals() -> None:
    t = np.arange(1000) * STEP_S
    sine = 2.0 * np.sin(2 * np.pi * 1.0 * t)
    frequency, power = spectrum(sine, STEP_S)
    assert power[np.argmin(np.abs(frequency - 1.0))] == pytest.approx(2.0)
    assert coverage(sine, STEP_S) == pytest.approx((1.0, 1.0))
    assert crest_factor(sine) == pytest.approx(sqrt(2.0), rel=3e-3)  # no sample stands on the peak
    assert balance([1.0, 1.0, -2.0]) == 0.0 and balance([1.0, 1.0]) == 1.0 and balance([0.0]) == 0.0
    assert np.isnan(crest_factor([0.0, 0.0])) and np.isnan(coverage([0.0] * 8, STEP_S)).all()


@settings(max_examples=30, deadline=None)
@given(n=st.integers(2, 300), seed=st.integers(0, 1000))
def test_powers_add_up_to_the_mean_square(n: int, seed: int) -> None:
    u = np.random.default_rng(seed).standard_normal(n)
    assert spectrum(u, STEP_S)[1].sum() == pytest.approx(float(np.mean(u**2)))
