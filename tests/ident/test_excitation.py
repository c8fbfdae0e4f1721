"""Inputs for experiments off line."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.ident.excitation import excitation, linear_chirp, low_crest, step, two_levels
from hoopd.ident.signals import coverage, crest_factor, multisine, prbs, spectrum


@pytest.mark.parametrize(("count", "most"), [(5, 1.55), (31, 1.42), (200, 1.42)])
def test_sines_of_ones_own_choice_have_a_low_crest(count: int, most: float) -> None:
    lines = np.arange(1, count + 1) / 40.0
    u = low_crest(4000, 0.01, lines.tolist())
    power = spectrum(u, 0.01)[1]
    assert crest_factor(u) < most and np.abs(u).max() == pytest.approx(1.0)
    assert np.allclose(power[1 : count + 1], power[1], rtol=1e-9) and power[count + 1 :].max() < 1e-20
    assert crest_factor(u) < crest_factor(multisine(4000, 0.01, lines[0], lines[-1])) - 0.05


def test_sines_have_the_amplitudes_asked_for() -> None:
    amplitudes = np.array([1.0, 0.5, 2.0])
    frequency, power = spectrum(low_crest(1000, 0.01, [0.3, 2.0, 7.0], amplitudes), 0.01)
    found = np.sqrt(power[np.searchsorted(frequency, [0.299, 1.999, 6.999])])
    assert np.allclose(found / found[0], amplitudes)
    for wrong, word in (([0.33], "multiples"), ([2.0, 1.0], "rise"), ([50.0], "between"), ([], "rise")):
        with pytest.raises(ValueError, match=word):
            low_crest(1000, 0.01, wrong)


def test_a_linear_chirp_covers_its_band_evenly() -> None:
    u = linear_chirp(20000, 0.001, 5.0, 100.0)
    low, high = coverage(u, 0.001, 0.5)
    assert (low, high) == pytest.approx((5.0 + 0.25 * 95.0, 5.0 + 0.75 * 95.0), rel=0.05)
    assert len(linear_chirp(0, 0.1, 1.0, 2.0)) == 0 and linear_chirp(1, 0.1, 1.0, 2.0).tolist() == [0.0]
    with pytest.raises(ValueError, match="0 < low < high"):
        linear_chirp(10, 0.1, 1.0, 6.0)


def test_two_levels_begin_a_sequence_of_maximal_length() -> None:
    u = two_levels(300, 2, -1.0, 3.0, seed=4)
    assert set(u.tolist()) == {-1.0, 3.0} and np.array_equal(u, 1.0 + 2.0 * prbs(8, 2, 4)[:300])
    assert len(two_levels(0)) == 0 and len(two_levels(1)) == 1


def test_a_step_stands_where_it_was_asked_for() -> None:
    assert step(5, 0.1, 0.2, 2.0, 1.0).tolist() == [1.0, 1.0, 3.0, 3.0, 3.0]
    assert len(step(0, 0.1, 0.0)) == 0
    with pytest.raises(ValueError, match="not within"):
        step(5, 0.1, 0.5)


def test_how_much_a_signal_excites() -> None:
    t = np.arange(2000)
    assert excitation(np.ones(100)).order == 1
    assert excitation(np.sin(0.3 * t)).order == 2 and excitation(np.sin(0.3 * t) + np.sin(0.7 * t)).order == 4
    assert excitation(np.tile(prbs(4), 20)).order == 15 and excitation(prbs(11)).order == 50
    assert excitation(np.zeros(10)).order == 0 and excitation(np.zeros(0)).order == 0
    assert excitation(prbs(11)).condition < 1.5
