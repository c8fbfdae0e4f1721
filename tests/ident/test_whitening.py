"""Rows made white: what comes out is L^-1 of the rows that are there, in parts of any length."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from hoopd.ident import whitening
from hoopd.ident.residualtests import independence
from hoopd.ident.whitening import whitened_parts

COLOUR = np.array([1.0, -1.2, 0.5])


def covariance(a: np.ndarray, n: int) -> np.ndarray:
    """Of n samples of the autoregression whose innovations have variance 1."""
    into = np.vstack([-a[1:], np.eye(len(a) - 1)[:-1]])
    state = linalg.solve_discrete_lyapunov(into, np.diag([1.0, 0.0]))
    r = [(np.linalg.matrix_power(into, k) @ state)[0, 0] for k in range(n)]
    return np.asarray(linalg.toeplitz(r))


@pytest.mark.parametrize("part", [4, 7, 1000])
def test_rows_are_what_the_factor_of_their_covariance_leaves(part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gaps shorter and longer than the autoregression, one sample between two of them, none before the first row."""
    monkeypatch.setattr(whitening, "PART", part)
    rng = np.random.default_rng(0)
    columns, known = rng.standard_normal((60, 3)), np.ones(60, dtype=bool)
    known[[0, 1, 9, 11, 12, 13, 14, 30, 31, 40, 55]] = False
    columns[~known] = 1e9  # they are not asked for
    factor = np.linalg.cholesky(covariance(COLOUR, 60)[np.ix_(known, known)])
    found = np.concatenate(list(whitened_parts(COLOUR, known, lambda begin, end: columns[begin:end])))
    assert found == pytest.approx(linalg.solve_triangular(factor, columns[known], lower=True), rel=1e-6)


def test_what_is_white_comes_out_as_it_is() -> None:
    columns, known = np.arange(12.0).reshape(6, 2), np.array([True, False, True, True, False, True])
    found = np.concatenate(list(whitened_parts(np.ones(1), known, lambda begin, end: columns[begin:end])))
    assert np.array_equal(found, columns[known])


@pytest.mark.parametrize("after", [True, False])
def test_a_test_of_residuals_says_the_same_in_parts(after: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    u, e = rng.standard_normal((2, 900))
    e = np.convolve(e, [1.0, 0.8, 0.3])[:900] + 0.1 * np.roll(u, 3)
    e[rng.random(900) < 0.1] = np.nan
    whole = independence(e, u, 10, after=after)
    monkeypatch.setattr(whitening, "PART", 23)
    parts = independence(e, u, 10, after=after)
    assert parts.values == pytest.approx(whole.values, abs=1e-12)
    assert (parts.band, parts.chance) == pytest.approx((whole.band, whole.chance), rel=1e-9)
