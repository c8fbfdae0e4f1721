"""Measurements taken into state and covariance, against the textbook's matrices."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.core.covariance import corrected

MEASURED = ((0, 0.3, 1e-4), (1, -2.0, 2.5e-3), (2, 0.1, 1.6e-5), (3, 0.0, 9.0))


def drawn(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((count, count))
    return rng.standard_normal(count), root @ root.T


@pytest.mark.parametrize("count", [4, 8])
@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_kalman_filters_correction(count: int, seed: int) -> None:
    x, p = drawn(seed, count)
    found_x, found_p = corrected(x, p, MEASURED)
    states, values, variances = zip(*MEASURED, strict=True)
    h = np.eye(count)[list(states)]
    # all at once, which for independent noises is one after the other
    s = h @ p @ h.T + np.diag(variances)
    k = p @ h.T @ np.linalg.inv(s)
    np.testing.assert_allclose(found_x, x + k @ (values - h @ x), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found_p, p - k @ h @ p, rtol=0.0, atol=1e-8 * np.abs(p).max())
    assert np.array_equal(found_p, found_p.T)


@pytest.mark.parametrize("seed", range(20))
def test_four_states_have_the_bits_of_any_number(seed: int) -> None:
    x, p = drawn(seed, 4)
    wide_x, wide_p = np.zeros(5), np.zeros((5, 5))
    wide_x[:4], wide_p[:4, :4] = x, p
    for one in MEASURED:
        found, expected = corrected(x, p, [one]), corrected(wide_x, wide_p, [one])
        assert np.array_equal(found[0], expected[0][:4])
        assert np.array_equal(np.triu(found[1]), np.triu(expected[1][:4, :4]))


def test_nothing_measured_changes_nothing_and_arguments_stay() -> None:
    x, p = drawn(1, 4)
    kept = x.copy(), p.copy()
    corrected(x, p, MEASURED)
    assert np.array_equal(x, kept[0]) and np.array_equal(p, kept[1])
    assert np.array_equal(corrected(x, p, [])[0], x)
