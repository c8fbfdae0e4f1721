"""Camera values that are those of an earlier frame: equal to the bit, or measured anew one row late.

Rules of this file: two equal values are a late frame only as far as chance would not make them equal: a camera that
reads in steps repeats itself when the ball hardly moves. A long stretch of equal values is a camera that has lost the
ball (or a ball at rest), no late frame.
"""

from __future__ import annotations

from math import ceil, log, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.repeated_samples import STUCK, equal_stretches

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# So rarely may late frames alone make a stretch as long as one that is called stuck, once in a hundred recordings.
RARE = 0.01
# Shares that are tried; a gain below NATS is chance.
SHARES, NATS = np.geomspace(2e-4, 0.6, 240), 3.0
# Equal distances in a row that chance hardly makes: of independent repeats every tenth stretch has two.
PERIODS = 5
# Chance is never excluded entirely, nor certain.
LEAST, MOST = 1e-6, 0.99
# Width and noise of a reading are known to a quarter.
DOUBT = 1.25


class Repeats(NamedTuple):
    """Rows whose value is that of the sample before."""

    short: Mask  # (n,) in stretches that late frames can make
    stuck: Mask  # (n,) in longer ones, the first excepted


class RepeatedFrames(NamedTuple):
    """Which of the short repeats are late frames."""

    probability: Array  # (n,)
    share: float  # of the samples that are not stuck
    error: float  # standard error of the share
    gain: float  # nats


def repeats(values: Array) -> Repeats:
    """Equal values in a row (n,), NaN where missing, told apart by the length of the stretch."""
    rows = np.flatnonzero(np.isfinite(values))
    edges, lengths = equal_stretches(values[rows])
    longest = longest_by_chance(lengths, len(rows))
    follows = np.ones(len(rows), dtype=bool)
    follows[edges[:-1]] = False
    long = np.repeat(lengths > longest, lengths)
    short, stuck = np.zeros(len(values), dtype=bool), np.zeros(len(values), dtype=bool)
    short[rows], stuck[rows] = follows & ~long, follows & long
    return Repeats(short, stuck)


def longest_by_chance(lengths: NDArray[np.int64], samples: int) -> int:
    """Longest stretch of equal values that independent repeats make: n share^(L-1) = RARE; STUCK - 1 at least."""
    if not samples:
        return STUCK - 1
    few = lengths[lengths < 3 * STUCK]
    share = min(max(float((few - 1).sum()) / samples, LEAST), 0.5)
    return max(STUCK - 1, 1 + ceil(log(RARE / samples) / log(share)))


def repeated_frames(short: Mask, candidates: int, moved: Array, sigma: float, resolution: float) -> RepeatedFrames:
    """How many of the short repeats (n,) are late frames, of `candidates` samples.

    moved: (n,) rad, how far the ball went since the row before; sigma: noise of a sample; resolution: width of one
    reading. Chance makes two readings equal with probability resolution N(moved; 0, 2 sigma^2).
    """
    # of the noise alone, without what the steps of reading add to it
    steps = resolution**2 / 12.0
    variance = 2.0 * max(sigma**2 - steps, steps, 1e-24)
    chance = resolution * np.exp(-(moved**2) / (2.0 * variance)) / sqrt(2.0 * pi * variance)
    chance = np.clip(DOUBT * chance, LEAST, MOST)
    found = _likeliest(chance[short], candidates - int(short.sum()))
    share, gain = float(SHARES[found.argmax()]), float(found.max())
    if gain < NATS:
        return RepeatedFrames(np.zeros(len(moved)), 0.0, 0.0, 0.0)
    probability = np.where(short, share / (share + (1.0 - share) * chance), 0.0)
    # of the repeats only what is surely late is counted: the rest adds its own doubt
    doubt = float((probability * (1.0 - probability)).sum())
    error = sqrt(share * (1.0 - share) / max(candidates, 1) + doubt / max(candidates, 1) ** 2)
    return RepeatedFrames(probability, share, error, gain)


def _likeliest(chance: Array, others: int) -> Array:
    """Log-likelihood of SHARES over none: sum log((l + (1 - l) c) / c) over repeats, log(1 - l) over the others."""
    likelihood = others * np.log1p(-SHARES)
    for part in np.array_split(chance, len(chance) // 1000 + 1):  # a bounded table at a time
        likelihood += np.log(SHARES[:, None] / part + 1.0 - SHARES[:, None]).sum(axis=1)
    return np.asarray(likelihood)


def slow_stretches(repeated: Mask) -> list[tuple[int, int, int]]:
    """First and last row and period of stretches in which every so many values one repeats: a slow camera.

    repeated: (n,). PERIODS equal distances of two rows or more in a row.
    """
    rows = np.flatnonzero(repeated)
    gaps = np.diff(rows)
    edges, lengths = equal_stretches(gaps.astype(float))
    found = zip(edges[:-1], lengths, strict=True)
    return [(int(rows[a]), int(rows[a + n]), int(gaps[a])) for a, n in found if n >= PERIODS and gaps[a] >= 2]
