"""What is made of fits to one recording and simulations of another: which pairs a name made better or worse.

Rules of this file: percent of fit in, counts out; nothing is run here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

# Windows of 2 s, each from its own start, and one run over the whole.
MEASURES = ("windows_2s", "free_run")
CHANNELS = ("theta_rate", "psi")
MOST_WORSE_PERCENT = 1.0


class Score(NamedTuple):
    """Percent of fit of a channel; None where the model could not be simulated."""

    nominal: float | None
    refitted: float | None
    named: float | None

    @property
    def gain(self) -> float:
        """Of the names over the better of the user's and the re-fitted model, in points."""
        if self.named is None:
            return -float("inf")
        return self.named - max((one for one in self[:2] if one is not None), default=-float("inf"))

    @property
    def is_worse(self) -> bool:
        """More than a point below."""
        return self.gain < -MOST_WORSE_PERCENT


class Row(NamedTuple):
    """A channel of a pair."""

    fitted: str
    simulated: str
    measure: str
    channel: str
    score: Score


class Counted(NamedTuple):
    """Pairs of recordings by what the names did to any of their channels."""

    worse: int
    better: int
    all: int


def percent(result: Mapping[str, Any] | None, measure: str, channel: str) -> float | None:
    """Of a record of `hoopd simulate`; None where there is none."""
    found = None if result is None else result[measure].get(channel)
    return None if found is None else found["nrmse_percent"]


def channels(results: Iterable[Mapping[str, Any] | None]) -> list[str]:
    """Those that any of the simulations has."""
    known = [one[MEASURES[0]] for one in results if one is not None]
    return [name for name in CHANNELS if any(name in one and one[name]["nrmse_percent"] is not None for one in known)]


def counted(rows: Iterable[Row]) -> Counted:
    """Worse: more than a point in any channel; better: not worse, and gained in one."""
    gains: dict[tuple[str, str], list[Score]] = {}
    for row in rows:
        gains.setdefault((row.fitted, row.simulated.split("@")[0]), []).append(row.score)
    worse = [any(one.is_worse for one in scores) for scores in gains.values()]
    better = [any(one.gain > 0.0 for one in scores) for scores in gains.values()]
    return Counted(sum(worse), sum(b and not w for w, b in zip(worse, better, strict=True)), len(gains))
