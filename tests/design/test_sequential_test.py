"""A test that may be looked at after every pair: how often equal laws are called different; what its interval holds."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.design.alternation import LEAST_PAIRS
from hoopd.design.sequential_test import evidence, interval

ALPHA = 0.05
PAIRS = 20
Noise = Callable[[np.random.Generator], NDArray[np.float64]]
# What a pair's difference may be like when there is none: normal; with outliers; of two costs, each with a long tail.
NOISES: dict[str, Noise] = {
    "normal": lambda rng: rng.standard_normal(PAIRS),
    "student, three degrees": lambda rng: rng.standard_t(3, PAIRS),
    "two log-normal costs": lambda rng: rng.lognormal(0.0, 1.0, PAIRS) - rng.lognormal(0.0, 1.0, PAIRS),
}


def ever_different(differences: NDArray[np.float64]) -> bool:
    """Somebody who looks after every pair stops with a difference."""
    return any(evidence(differences[:n].tolist()) >= 1.0 / ALPHA for n in range(LEAST_PAIRS, PAIRS + 1))


def share(noise: Noise, runs: int, seed: int) -> float:
    rng = np.random.default_rng(seed)
    return sum(ever_different(noise(rng)) for _ in range(runs)) / runs


def above(runs: int) -> float:
    """What a share of alpha is above in one of a thousand such tests."""
    return float(np.quantile(np.random.default_rng(0).binomial(runs, ALPHA, 20_000), 0.999)) / runs


@pytest.mark.parametrize("noise", NOISES)
def test_equal_laws_are_seldom_called_different(noise: str) -> None:
    assert share(NOISES[noise], 400, seed=1) <= above(400)


@pytest.mark.proof
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("seed", range(5))
def test_equal_laws_are_called_different_no_more_often_than_promised_in_20_000_runs(noise: str, seed: int) -> None:
    assert share(NOISES[noise], 4000, seed) <= above(4000)


def test_a_difference_of_two_scatters_is_mostly_clear_within_eight_pairs() -> None:
    rng = np.random.default_rng(2)
    clear = [evidence((2.0 + rng.standard_normal(8)).tolist()) >= 1.0 / ALPHA for _ in range(300)]
    assert np.mean(clear) > 0.8


def test_the_interval_excludes_zero_just_when_the_evidence_suffices() -> None:
    rng = np.random.default_rng(3)
    for n in (4, 5, 10):
        for _ in range(200):
            values = (0.8 * rng.standard_normal() + rng.standard_normal(n)).tolist()
            low, high = interval(values, ALPHA)
            assert (not low <= 0.0 <= high) == (evidence(values) > 1.0 / ALPHA)


def test_the_interval_holds_the_mean_at_every_look() -> None:
    rng, missed = np.random.default_rng(4), 0
    for _ in range(300):
        values = (0.3 + rng.standard_normal(PAIRS)).tolist()
        looks = [interval(values[:n], ALPHA) for n in range(LEAST_PAIRS, PAIRS + 1)]
        missed += not all(low <= 0.3 <= high for low, high in looks)
    assert missed / 300 <= above(300)


def test_units_do_not_matter_and_few_or_equal_numbers_give_no_answer_that_is_none() -> None:
    values = [0.3, 0.5, 0.4, 0.6, 0.2]
    assert evidence([1e6 * one for one in values]) == pytest.approx(evidence(values))
    assert evidence([]) == evidence([5.0]) == 1.0 and interval([5.0]) == (-inf, inf)
    assert evidence([0.0] * 6) < 1.0 and evidence([0.1] * 6) > 1.0 / ALPHA
    assert interval([0.1] * 6) == pytest.approx((0.1, 0.1))
