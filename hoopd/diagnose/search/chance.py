"""Gains of hypotheses with different numbers of columns on one scale, and what chance reaches on it.

Of r ~ N(0, I) the gain r'Z (Z'Z)^-1 Z'r / 2 of m columns has the law chi2_m / 2; its surprise is -log of the chance of
so large a gain. The largest surprise of a whole library under the null is drawn from the same law with
the same columns, so that their correlations count: exact where the whitened innovations are white.

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.kept_columns import KeptColumns, exact
from hoopd.diagnose.search.processes import computed
from hoopd.diagnose.search.surprise import log_chances

Array = NDArray[np.float64]

EULER = 0.5772156649015329
# Groups whose chance gains one task draws.
TOGETHER = 32


def surprises(gains: Array, columns: int) -> Array:
    """(...,) nats: -log of the chance of so large a gain; `surprise.surprise` of many."""
    return -log_chances(gains, columns)


class Group(NamedTuple):
    """Columns that are tried together, whitened and projected."""

    vectors: KeptColumns  # (rows, m)
    positive: bool = False  # one column of which only a positive multiple counts
    basis: Array | None = None  # (m, k) orthonormal directions among them, where these are known


def independent(z: KeptColumns, size: Array | None = None, share: float = 1e-6) -> tuple[Array, Array, Array]:
    """Directions of columns z (rows, m) that are more than rounding: size (m,), eigenvalues (k,), vectors (m, k).

    size: the columns' norms before projection, against which `share` of the squared norm is measured.
    """
    z = exact(z)
    gram = z.T @ z
    size = np.sqrt(np.diag(gram)) if size is None else size
    size = np.maximum(size, 1e-12)
    values, vectors = np.linalg.eigh(gram / size / size[:, None])
    kept = values > share
    return size, values[kept], vectors[:, kept]


class Projections(NamedTuple):
    """Gains of a group for many residuals."""

    gains: Array  # (draws,)
    columns: int

    def surprises(self) -> Array:
        """(draws,) nats"""
        return surprises(self.gains, self.columns)


def projections(groups: Sequence[Group], residuals: Array) -> Iterator[Projections]:
    """Of every group for projected or white residuals (rows, draws)."""
    for first in range(0, len(groups), TOGETHER):
        part = groups[first : first + TOGETHER]
        # of narrow groups one product with all residuals
        together = np.concatenate([one.vectors for one in part], axis=1, dtype=float)
        along, ends = together.T @ residuals, np.cumsum([0, *(one.vectors.shape[1] for one in part)])
        for one, columns in zip(part, map(slice, ends[:-1], ends[1:]), strict=True):
            yield _projected(one, along[columns])


def _projected(group: Group, along: Array) -> Projections:
    """Told the products (m, draws) of its columns (rows, m) with the residuals."""
    basis = group.basis
    if basis is None:
        size, values, turned = independent(group.vectors)
        # U = Z D^-1 V L^-1/2 is orthonormal
        basis = turned / np.sqrt(np.maximum(values, 1e-300)) / size[:, None]
    along = basis.T @ along
    if group.positive:
        along = np.maximum(along, 0.0)
    return Projections(np.sum(along**2, axis=0) / 2, basis.shape[1])


def colour(unit: Array, residual: Array, shapes: Sequence[tuple[int, int]]) -> float:
    """By how much the residual's colour inflates gains along orthonormal directions (rows, k); at least 1.

    Innovations are white where disturbances are as modelled; where they are not, their spectrum is what counts. The
    same directions shifted in time see the same spectrum and nothing else: the mean square of their products with the
    residual, over all shifts of each stretch, is the variance that chance has (a long-run variance; Andrews 1991). What
    the directions themselves explain is taken out first. rows: stretch after stretch of `shapes`, (n, channels) each.
    """
    rest, total, first = residual - unit @ (unit.T @ residual), 0.0, 0
    for n, channels in shapes:
        rows = slice(first, first + n * channels)
        first += n * channels
        u = np.fft.rfft(unit[rows].reshape(n, channels, -1), axis=0)
        r = np.fft.rfft(rest[rows].reshape(n, channels, 1), axis=0)
        # mean over shifts of (sum_t u_t-s r_t)^2, by Parseval; what is not there is as large as what is
        power = np.sum(np.abs(np.sum(np.conj(u) * r, axis=1)) ** 2, axis=1)
        total += float(2.0 * np.sum(power) - power[0] - (0.0 if n % 2 else power[-1])) / n**2
    return float(max(1.0, total / unit.shape[1]))


def drawn_maxima(groups: Sequence[Group], draws: int, seed: int) -> Array:
    """(draws,) log chance of the best group of pure noise."""
    noise = np.random.default_rng([seed, 11]).standard_normal((groups[0].vectors.shape[0], draws))
    parts = [groups[i : i + TOGETHER] for i in range(0, len(groups), TOGETHER)]
    return np.asarray(np.min(computed([partial(_best_of, part, noise) for part in parts]), axis=0))


def _best_of(groups: Sequence[Group], noise: Array) -> Array:
    best = np.zeros(noise.shape[1])
    for found in projections(groups, noise):
        best = np.minimum(best, log_chances(found.gains, found.columns))
    return best


class Null(NamedTuple):
    """What the best of a library reaches by chance: a Gumbel law of log chance with this many independent tries."""

    tries: float

    def threshold(self, chance: float) -> float:
        """Surprise (nats) that the best of all exceeds by chance with this probability."""
        return float(log(self.tries) - np.log(-np.log1p(-chance)))


def null_of(groups: Sequence[Group], draws: int = 100, seed: int = 0) -> Null:
    """Law of the largest surprise of all groups: of the best of N tries -log p is Gumbel about log N, mean + 0.577."""
    if not groups:
        return Null(1.0)
    return Null(max(1.0, float(np.exp(-np.mean(drawn_maxima(groups, draws, seed)) - EULER))))
