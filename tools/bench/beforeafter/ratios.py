"""The median of paired ratios, with an interval that assumes no distribution.

Rules of this file: pure. For n independent pairs the number of ratios below the true median is binomial(n, 1/2), so
the k-th smallest and k-th largest ratio hold it with probability 1 - 2 P(X < k) (the sign test's interval; Conover,
Practical Nonparametric Statistics, 3.2).
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from math import comb, nan
from typing import NamedTuple

LEVEL = 0.95


class Ratio(NamedTuple):
    """Median of ratios after / before, its interval, and how sure that is; the interval is nan below six pairs."""

    median: float
    low: float
    high: float
    level: float


def paired(before: Sequence[float], after: Sequence[float]) -> Ratio:
    """Of each pair after / before; the narrowest interval of at least 95 %."""
    ratios = sorted(new / old for old, new in zip(before, after, strict=True))
    place = _place(len(ratios))
    if place < 0:
        return Ratio(statistics.median(ratios), nan, nan, nan)
    return Ratio(statistics.median(ratios), ratios[place], ratios[-1 - place], 1.0 - 2.0 * _below(place, len(ratios)))


def _place(pairs: int) -> int:
    """How many ratios may be left out at each end; -1 when not even all of them do."""
    fitting = [place for place in range((pairs + 1) // 2) if 1.0 - 2.0 * _below(place, pairs) >= LEVEL]
    return max(fitting, default=-1)


def _below(place: int, pairs: int) -> float:
    """P(X <= place) of a binomial(pairs, 1/2)."""
    return sum(comb(pairs, k) for k in range(place + 1)) / 2.0**pairs
