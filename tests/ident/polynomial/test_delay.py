"""The delay and its interval: it covers the truth, widens with noise, and says when it looks too near."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.data import Data, iddata
from hoopd.ident.polynomial.delay import Delay, delay

SLOW = ([0.00491, 0.00483], [1.0, -1.94149, 0.95123])  # 1/(s^2 + 0.5 s + 1) sampled at 0.1 s
QUICK = ([1.0, 0.5], [1.0, -1.5, 0.7])


def made(system: tuple, d: int, n: int, noise: float, seed: int, colour: float = 0.0) -> Data:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    clean = lfilter(np.concatenate([np.zeros(d), system[0]]), system[1], u)
    coloured = lfilter([1.0], [1.0, -colour], e) * np.sqrt(1.0 - colour**2)
    return iddata(clean + noise * clean.std() * coloured, u, 0.1)


def found(*args: float, **more: float) -> Delay:
    return delay(made(*args), longest=15, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_a_clear_delay_is_exact(colour: float) -> None:
    own = delay(made(QUICK, 7, 600, 0.3, 0, colour), longest=15)
    assert own.samples == 7 and own.interval[0] >= 6 and own.interval[1] == 7 and own.order == 2
    assert own.seconds == pytest.approx(0.7)
    assert own.ratio.min() == 0.0 and own.ratio[0] > 20.0 and len(own.ratio) == 16


@pytest.mark.parametrize("noise", [0.0, 1e-13])
def test_data_without_noise_have_their_delay_and_not_that_of_the_rounding(noise: float) -> None:
    for seed in range(3):
        own = delay(made(([1.0], [1.0, -0.8]), 3, 600, noise, seed), longest=8)
        assert (own.samples, own.interval, own.order) == (3, (3, 3), 1)
    # of order 2 a delay of 2 fits as well, with a first coefficient of 0
    assert delay(made(([1.0], [1.0, -0.8]), 3, 600, noise, 0), longest=8, order=2).samples == 3


def test_the_interval_covers_a_system_that_rises_slowly() -> None:
    runs = [found(SLOW, 8, 800, 0.3, seed, order=2) for seed in range(10)]
    assert sum(own.interval[0] <= 8 <= own.interval[1] for own in runs) >= 9
    assert 0.0 < np.mean([own.interval[1] - own.interval[0] for own in runs]) < 6.0


def test_a_lower_level_is_narrower_and_more_data_are_too() -> None:
    wide, narrow = (found(SLOW, 8, 800, 0.5, 3, order=2, level=level) for level in (0.99, 0.5))
    assert wide.interval[0] <= narrow.interval[0] and narrow.interval[1] <= wide.interval[1]
    more = found(SLOW, 8, 4000, 0.5, 3, order=2)
    assert more.interval[1] - more.interval[0] <= wide.interval[1] - wide.interval[0]


def test_of_two_inputs_each_has_its_own() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1500, 2))
    y = lfilter([0.0] * 4 + [1.0], [1.0, -0.8], u[:, 0]) + lfilter([0.0] * 9 + [2.0, 1.0], [1.0, -0.5], u[:, 1])
    y = y + 0.3 * rng.standard_normal(1500)
    y[700:702] = np.nan
    data = iddata(y, u, inputs=("valve", "pump"))
    assert delay(data, channel="valve", longest=12).samples == 4
    assert delay(data, channel=1, longest=12).interval == (9, 9)


def test_a_delay_beyond_the_longest_is_said() -> None:
    with pytest.warns(IdentificationWarning, match="may be longer than the 5 samples"):
        delay(made(([1.0], [1.0, -0.5]), 9, 600, 0.1, 0), longest=5)


def test_wrong_calls() -> None:
    data = made(QUICK, 3, 200, 0.3, 0)
    with pytest.raises(ValueError, match="too few samples"):
        delay(data, longest=50)
    with pytest.raises(ValueError, match="level"):
        delay(data, level=1.0)
