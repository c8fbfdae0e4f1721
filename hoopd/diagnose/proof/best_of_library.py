"""How often the best of a whole library gains as much of an error that has nothing of it.

The error is taken with random weights, block by block (wild block bootstrap: Liu 1988, Shao 2010), the same for every
effect: what the effects share, their chances share. Who looks at forty effects finds one among the rarest fortieth of
its own chance gains; so the smallest of all chances is what is counted, in the error as it is and in every draw (min P;
Westfall and Young, Resampling-based multiple testing, 1993).

What was fitted has taken its part of the error, most of it where a block has much say in a parameter: each block is
given back what it lost on average (CR2; Bell and McCaffrey, Survey Methodology 28, 2002).

Rules of this file: numbers in, numbers out; an effect is a name here, with the columns of its choices.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# The rarest of forty effects' own chances is one in DRAWS about 40 times: what is asked for must be rarer than that.
DRAWS = 9999
# Weights of mean 0 and mean square 1; of two signs alone, eight blocks have but 128 different errors (Webb 2013).
WEIGHTS = tuple(sign * sqrt(square) for sign in (-1.0, 1.0) for square in (0.5, 1.0, 1.5))
# A direction of which a block alone decides more than all but this is not given back: nothing of it is left there.
LEAST_LEFT = 0.01
# Gains that are equal but for rounding are equal.
EQUAL = 1e-6


class Choice(NamedTuple):
    """One choice of an effect's shape."""

    name: str
    vectors: Array  # (rows, m) free of the directions of the free parameters
    signed: NDArray[np.bool_]  # (m,) of which only a positive multiple counts


class BestOfAll:
    """What every effect of a library gains of such errors, the best of its choices each time."""

    def __init__(self, choices: Sequence[Choice], residual: Array, blocks: NDArray[np.int64], seed: int) -> None:
        """`blocks`: (rows,) number of each row's block, ascending; `residual` (rows,): `given_back`."""
        drawn = _gains(choices, residual, blocks, np.random.default_rng(seed))
        self._gains = {name: np.sort(gains) for name, gains in drawn.items()}
        rarest = [self._as_large(name, gains) for name, gains in drawn.items()]
        self._rarest = np.sort(np.min(rarest, axis=0)) if rarest else np.full(DRAWS, DRAWS)

    def chance(self, name: str, gain: float) -> float:
        """How often any effect gains what is as rare for it."""
        # among all errors, drawn and real, the drawn one counts itself, the real one too
        as_rare = np.searchsorted(self._rarest, 1 + float(self._as_large(name, np.array(gain))), side="right")
        return (1 + float(as_rare)) / (1 + DRAWS)

    def _as_large(self, name: str, gains: Array) -> Array:
        """(...,) draws of which an effect gains as much."""
        return np.asarray(DRAWS - np.searchsorted(self._gains[name], (1.0 - EQUAL) * gains, side="left"))


def _gains(
    choices: Sequence[Choice], residual: Array, blocks: NDArray[np.int64], random: np.random.Generator
) -> dict[str, Array]:
    """(DRAWS,) of every effect."""
    starts = np.flatnonzero(np.diff(blocks, prepend=-1))
    weights = random.choice(WEIGHTS, size=(len(starts), DRAWS))
    found = {one.name: np.zeros(DRAWS) for one in choices}
    for name, z, signed in choices:
        # z' (w r): products of each block, weighted
        right = np.add.reduceat(z * residual[:, None], starts, axis=0).T @ weights
        found[name] = np.maximum(found[name], largest(z.T @ z, right, signed))
    return found


def given_back(residual: Array, basis: Array, blocks: NDArray[np.int64]) -> Array:
    """(rows,) residual with (I - Q_b Q_b')^-1/2 of every block; basis Q (rows, k) of what is free, orthonormal."""
    out = residual.copy()
    for rows in np.split(np.arange(len(blocks)), np.flatnonzero(np.diff(blocks)) + 1):
        u, s, _ = np.linalg.svd(basis[rows], full_matrices=False)
        left = np.where(1.0 - s**2 > LEAST_LEFT, 1.0 - s**2, 1.0)
        out[rows] += u @ ((left**-0.5 - 1.0) * (u.T @ residual[rows]))
    return out


def largest(gram: Array, right: Array, signed: NDArray[np.bool_]) -> Array:
    """(k,) gain of columns z for each of k errors e, by z'z (m, m) and z'e (m, k): best subset that obeys the signs.

    A column without a sign is never worth leaving out: 2^s subsets of the s signed ones, however many phases there are.
    """
    always: list[int] = np.flatnonzero(~signed).tolist()
    best = np.zeros(right.shape[1])
    for some in _subsets(np.flatnonzero(signed)):
        subset = [*always, *some]
        if not subset:
            continue
        part = gram[np.ix_(subset, subset)]
        ridge = 1e-9 * np.trace(part) / len(subset) + 1e-300
        weight = np.linalg.solve(part + ridge * np.eye(len(subset)), right[subset])
        allowed = np.all((weight >= 0.0) | ~signed[subset, None], axis=0)
        best = np.maximum(best, np.where(allowed, np.sum(weight * right[subset], axis=0) / 2.0, 0.0))
    return best


def _subsets(of: NDArray[np.intp]) -> Iterator[tuple[int, ...]]:
    """All, the empty one first."""
    for count in range(len(of) + 1):
        yield from combinations(of.tolist(), count)
