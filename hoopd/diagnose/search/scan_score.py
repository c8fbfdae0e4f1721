"""What a scan finds: a place before it is scored, and a score that knows how many places were looked at.

Rules of this file: no search here.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log
from typing import NamedTuple

from hoopd.diagnose.search.screen import Score
from hoopd.diagnose.search.surprise import log_chance
from hoopd.plants.effects.base import Effect


@dataclass(frozen=True)
class Scanned(Score):
    """A score that is the best of many."""

    freedom: int = 1  # parameters that each candidate fits
    candidates: float = 1.0  # independent ones among those looked at

    @property
    def threshold_equivalent(self) -> float:
        """Nats: on a null, it exceeds x in a share exp(-x) of all cases; below 0 where chance gives more."""
        return -log(max(self.candidates, 1.0)) - log_chance(self.gain, self.freedom)

    @property
    def looked_at(self) -> float:
        """So many independent candidates with a chance of exp(-gain) each would make this gain as likely."""
        return exp(self.gain - self.threshold_equivalent)


class ScanPlace(NamedTuple):
    """A candidate before it is scored exactly."""

    gain: float
    spread: float  # gains of the candidates around over those the model expects; not below 1
    shape: dict[str, float]
    recording: str | None = None


def scanned(score: Score, freedom: int, candidates: float) -> Scanned:
    """The same score, as the best of many."""
    return Scanned(score.member, score.gain, score.start, score.vector, score.origin, freedom, candidates)


def usual_size(effect: Effect) -> tuple[str, float, float]:
    """Name and usual value of the amplitude, and the largest multiple of its distance from neutral."""
    a = next(p for p in effect.parameters if p.role == "amplitude")
    return a.name, a.neutral + a.size, (a.high - a.neutral) / a.size
