"""Timing statistics of a run in constant memory.

Rules of this file: no clock; a long run must not grow, so that values are counted in bins of equal ratio and
quantiles are exact to half a bin (1 %).
"""

from __future__ import annotations

from math import log
from typing import Any

SMALLEST_S = 1e-6
RATIO = 1.02
BINS = 950  # 1 us to 148 s
_LOG_RATIO = log(RATIO)


class Histogram:
    """Counts of durations in seconds."""

    def __init__(self) -> None:
        self.counts = [0] * BINS
        self.total, self.sum_s, self.max_s = 0, 0.0, 0.0

    def add(self, value_s: float) -> None:
        """Count one duration."""
        place = int(log(value_s / SMALLEST_S) / _LOG_RATIO) if value_s > SMALLEST_S else 0
        self.counts[min(place, BINS - 1)] += 1
        self.total += 1
        self.sum_s += value_s
        self.max_s = max(self.max_s, value_s)

    def quantile(self, share: float) -> float:
        """Duration in seconds below which this share lies; 0 without data."""
        wanted, seen = share * self.total, 0
        for place, count in enumerate(self.counts):
            seen += count
            if count and seen >= wanted:
                return min(float(SMALLEST_S * RATIO ** (place + 0.5)), self.max_s)
        return 0.0

    def summary(self) -> dict[str, float]:
        """p50, p99 and maximum in seconds."""
        return {"p50": self.quantile(0.5), "p99": self.quantile(0.99), "max": self.max_s}


class RunStatistics:
    """What the loop counts about itself."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.lateness, self.execution = Histogram(), Histogram()
        self.ticks = 0
        self.missed = 0
        self.first_t = self.last_t = 0.0
        self.first_id = self.last_id = self.before_first = 0
        self.worst_recent_s = 0.0

    def add(self, tick_id: int, t: float, lateness_s: float, execution_s: float) -> None:
        """Count one tick."""
        skipped = tick_id - self.last_id - 1
        if self.ticks <= 1:  # the very first tick comes whenever start-up is done, not at its deadline
            self.first_t, self.first_id = t, tick_id
            self.before_first += skipped
        else:
            self.missed += skipped
        self.ticks += 1
        self.last_t, self.last_id = t, tick_id
        if self.ticks > 1:  # the first tick is as late as start-up took
            self.lateness.add(lateness_s)
            self.execution.add(execution_s)
        self.worst_recent_s = max(self.worst_recent_s, lateness_s)

    def mean_period_s(self) -> float:
        """Mean time from one timer expiration to the next, missed ones included."""
        periods = self.last_id - self.first_id
        return (self.last_t - self.first_t) / periods if periods else 0.0

    def take_worst(self) -> float:
        """Worst lateness since the last call, in seconds."""
        worst, self.worst_recent_s = self.worst_recent_s, 0.0
        return worst

    def summary(self) -> dict[str, Any]:
        """Everything, for the end of a run: its length is start-up and (ticks + missed) periods."""
        return {
            "period_s": self.period_s,
            "start_up_s": self.before_first * self.period_s,
            "ticks": self.ticks,
            "missed": self.missed,
            "mean_period_s": self.mean_period_s(),
            "lateness_s": self.lateness.summary(),
            "execution_s": self.execution.summary(),
        }
