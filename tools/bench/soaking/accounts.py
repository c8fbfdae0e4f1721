"""What the follower wrote, between any two moments.

Rules of this file: times in s of CLOCK_MONOTONIC; a span is widened to the rows around it, because the kernel adds a
wait to the account only when it is over.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soaking.follower import COLUMNS

Vector = NDArray[np.float64]


class Watcher(NamedTuple):
    """A witness that nobody can displace, and when it stood still."""

    core: int
    gaps: list[tuple[float, float]]

    def still_s(self, begin: float, end: float) -> float:
        """Seconds of a span in which it stood still."""
        return sum(max(0.0, min(end, b) - max(begin, a)) for a, b in self.gaps)


class Accounts:
    """The rows of one run, beside the machine's witnesses."""

    def __init__(self, rows: Vector, watchers: list[Watcher]) -> None:
        """`rows`: (n, len(COLUMNS)), times ascending."""
        self._rows = {name: rows[:, place] for place, name in enumerate(COLUMNS)}
        self._watchers = watchers

    @property
    def span(self) -> tuple[float, float]:
        """First and last row's time."""
        t = self._rows["t"]
        return (float(t[0]), float(t[-1])) if len(t) else (float("inf"), float("-inf"))

    def grown(self, name: str, begin: float, end: float) -> float:
        """How much an account grew in a span."""
        first, last = self._around(begin, end)
        values = self._rows[name]
        return float(values[last] - values[first])

    def places(self, begin: float, end: float) -> list[int]:
        """Where the loop was seen within a span."""
        t = self._rows["t"]
        return [int(place) for place in self._rows["place"][(t >= begin) & (t <= end)]]

    def still_s(self, begin: float, end: float) -> float:
        """Seconds for which the core of the loop stood still; the longest of the cores it was seen on."""
        first, last = self._around(begin, end)
        seen = {int(core) for core in self._rows["core"][first : last + 1]}
        return max((w.still_s(begin, end) for w in self._watchers if w.core in seen), default=0.0)

    def _around(self, begin: float, end: float) -> tuple[int, int]:
        t = self._rows["t"]
        first = max(int(np.searchsorted(t, begin, side="right")) - 1, 0)
        return first, min(int(np.searchsorted(t, end, side="left")), len(t) - 1)


def read(path: Path, witnesses: list[dict[str, object]]) -> Accounts:
    """The follower's file, and the watchers of the witness's that had FIFO priority."""
    rows = np.fromfile(path).reshape(-1, len(COLUMNS))
    fifo = [row for row in witnesses if row["policy"] == "fifo"]
    return Accounts(rows, [Watcher(int(str(row["core"])), row["gaps"]) for row in fifo])  # type: ignore[arg-type]
