"""Does a version keep what it promised? What its seconds cost, beside what simulation says of the same references.

Rules of this file: numbers in, a reason out; pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

# A cost of so much more than what was promised is no promise kept; of more than the law of before would have: worse.
KEPT, WORSE = 1.2, 1.05
# After a version was accepted: so many rounds are weighed, and so many bad ones in a row give it up.
SETTLING_ROUNDS, BAD_ROUNDS = 4, 2


def verdict(costs: Mapping[str, Any], promise: Mapping[str, Any]) -> str:
    """Why a loop is worse than it was promised to be; empty when it keeps the promise.

    `costs`: `measured` beside what simulation says of the new law (`new`) and of the one of before (`before`) for the
    same references; `promise`: the same of the minutes in which the law of before acted. What the device costs more
    than the model says in either is not the new law's fault.
    """
    scale = max(1.0, promise["measured"] / promise["before"]) if promise.get("before") else 1.0
    measured, new, before = costs["measured"], costs["new"] * scale, costs["before"] * scale
    if measured > KEPT * new and measured > WORSE * before:
        return f"it costs {measured:.3g}, {new:.3g} were promised, and the law of before would cost {before:.3g}"
    return ""


@dataclass
class WeighedRounds:
    """Rounds of the watch over what was accepted."""

    count: int = 0
    bad: int = 0  # in a row, up to the last

    def add(self, why: str) -> None:
        """One more; `why`: the reason of `verdict`."""
        self.count, self.bad = self.count + 1, self.bad + 1 if why else 0

    @property
    def is_given_up(self) -> bool:
        """Whether the version of before has to act again."""
        return self.bad >= BAD_ROUNDS

    @property
    def is_settled(self) -> bool:
        """Whether it was watched for long enough."""
        return self.count >= SETTLING_ROUNDS
