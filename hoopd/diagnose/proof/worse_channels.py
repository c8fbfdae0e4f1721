"""Which channels of held-out data a hypothesis simulates worse than another, beyond what blocks of windows leave open.

Both simulate the same windows; their squared errors are summed over half windows, and the loss in points of fit is
drawn again from these blocks, pair by pair (block bootstrap; Kuensch 1989). A channel is lowered when the loss is
positive in all but a few of the draws, and larger than a table shows; or when it is more than a point, sure or not.
How few is told how often it was looked: every name is asked of every channel.

Rules of this file: simulations in, points of fit out; what follows from them is decided in `confirmation`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.fit_tables import Played, series, spread_of
from hoopd.diagnose.proof.simulation import BOUND

Array = NDArray[np.float64]

# Enough for a chance of one in a thousand: five names of five channels.
DRAWS = 5000
MOST_AT_ONCE = 1_000_000
# How often chance alone may make any channel worse with any of the names.
CHANCE = 0.025
# Points of fit: what a table of one decimal shows.
LEAST_POINTS = 0.1
# More than this is no proof of a gain, however few windows carry it.
MOST_POINTS = 1.0
# Blocks of a window.
PIECES = 2


def lowered(
    before: Played, after: Played, seed: int = 0, names: int = 1, most: float = MOST_POINTS
) -> dict[str, float]:
    """Points of fit lost by the second hypothesis, by channel; only channels in which it is worse beyond noise, or by
    more than `most` points. `names`: how many hypotheses are asked so (Bonferroni)."""
    own = {name: one.by_recording() for name, one in (("before", before), ("after", after))}
    blocks = {
        recording: (_blocks(series(runs)), _blocks(series(own["after"][recording])))
        for recording, runs in own["before"].items()
    }
    channels = dict.fromkeys(channel for pair in blocks.values() for channel in pair[0])
    found, chance = {}, CHANCE / max(names * len(channels), 1)
    for channel in channels:
        pairs = [(one[channel], two[channel]) for one, two in blocks.values() if channel in one]
        lost, sure = _loss(pairs, chance, np.random.default_rng(seed))
        if lost > most or (lost > LEAST_POINTS and sure > 0.0):
            found[channel] = lost
    return found


# Squared errors (blocks,) over |y - mean y|^2.
Blocks = Mapping[str, Array]


def _blocks(parts: Mapping[str, list[tuple[Array, Array, Array]]]) -> Blocks:
    """By channel of one recording; none of a channel that never moves."""
    found = {}
    for channel, windows in parts.items():
        y = np.concatenate([one[1] for one in windows])
        spread = spread_of(y)
        if spread > 0.0:
            halves = [half for one in windows for half in np.array_split(squared_errors(one, spread), PIECES)]
            found[channel] = np.array([float(half.sum()) for half in halves])
    return found


def squared_errors(window: tuple[Array, Array, Array], spread: float) -> Array:
    """Of errors over |y - mean y|; what is no number is as bad as can be."""
    _, y, yhat = window
    error = np.abs(y - yhat) / spread
    return np.asarray(np.where(np.isnan(error), BOUND, np.minimum(error, BOUND)) ** 2)


def _loss(pairs: list[tuple[Array, Array]], chance: float, random: np.random.Generator) -> tuple[float, float]:
    """Points lost, and what is lost in all but `chance` of the draws; means over the recordings."""
    draws, lost = np.zeros(DRAWS), 0.0
    for before, after in pairs:
        draws += _drawn(before, after, random)
        lost += float(_points(after) - _points(before))
    return lost / len(pairs), float(np.quantile(draws / len(pairs), chance))


def _drawn(before: Array, after: Array, random: np.random.Generator) -> Array:
    """(DRAWS,) points lost by blocks drawn again; some draws at a time, for a long recording has many blocks."""
    parts = np.array_split(np.arange(DRAWS), 1 + DRAWS * len(before) // MOST_AT_ONCE)
    found = []
    for part in parts:
        pick = random.integers(len(before), size=(len(part), len(before)))
        found.append(_points(after[pick]) - _points(before[pick]))
    return np.concatenate(found)


def _points(blocks: Array) -> Array:
    """Of fit that errors (..., blocks) take: 100 |y - yhat| / |y - mean y|."""
    return np.asarray(100.0 * np.sqrt(blocks.sum(axis=-1)))
