"""Does a version keep what it promised? What its seconds cost, beside what simulation says of the same references, and
whether its model still explains them better than the one of before: what was learned may go again.

    gone again   the model of before gains on these seconds, clearly,
                 a tenth of what the version's filter is surprised by, and half as fast as the version had gained

Two filters of one device differ by some percent in what they make of an encoder's steps and of late pictures: seconds
of rest, which scatter little, show that by five standard errors (3 % with a camera's delay exactly known). No law is
right in every regime: the model of before may be somewhat better where the reference rests. Neither is a reason.

Rules of this file: numbers in, a reason out; pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hoopd.design.comparison import BALL
from hoopd.heal.filter_evidence import FilterEvidence

# A cost of so much more than what was promised is no promise kept; of more than the law of before would have: worse.
KEPT, WORSE = 1.2, 1.05
GONE_SHARE, GONE_PACE = 0.1, 0.5
GAIN_OF_BEFORE = "gain_of_before"  # what the model of before gains over the version's on the weighed seconds
# After a version was accepted: so many rounds are weighed, and so many bad ones in a row give it up.
SETTLING_ROUNDS, BAD_ROUNDS = 4, 2


def verdict(costs: Mapping[str, Any], promise: Mapping[str, Any], by: str = BALL) -> str:
    """Why a loop is worse than it was promised to be; empty when it keeps the promise.

    What the device costs more than the model says before the trial is not the new law's fault. It is no share of a
    cost, but noise and what the model does not know, whatever the references are: errors add in squares.

        promised^2 = new^2 + max(0, measured_0^2 - before_0^2)

    Parameters
    ----------
    costs : mapping
        `measured` beside what simulation says of the new law (`new`) and of the one of before (`before`) for the same
        references: rad rms, or the cost of the design.
    promise : mapping
        The same of the minutes in which the law of before acted (`measured_0`, `before_0`); empty: nothing is added.
    by : str
        Which of the two, one of `design.comparison.MEASURES`; a cost is a square already.

    Returns
    -------
    str
        One line, or nothing.
    """
    power = 2.0 if by == BALL else 1.0
    surplus = max(0.0, promise.get("measured", 0.0) ** power - promise.get("before", 0.0) ** power)
    new, before = ((costs[name] ** power + surplus) ** (1.0 / power) for name in ("new", "before"))
    measured = costs["measured"]
    if measured > KEPT * new and measured > WORSE * before:
        return f"it costs {measured:.3g}, {new:.3g} were promised, and the law of before would cost {before:.3g}"
    return ""


def gone_again(told: Mapping[str, Any], evidence: Mapping[str, Any]) -> str:
    """Why a version's model no longer is the device's, whatever its law costs; empty where it is.

    What has gone again costs no more than was promised: both laws were simulated on a device that is no more.

    Parameters
    ----------
    told : mapping
        `GAIN_OF_BEFORE`, where it was computed: the fields of a `FilterEvidence` of the model of before over the
        version's, of the weighed seconds.
    evidence : mapping
        Of the version: `gain`, as of its proof, which is the other way round.

    Returns
    -------
    str
        One line, or nothing.
    """
    back = FilterEvidence(**told.get(GAIN_OF_BEFORE, {}))
    proof = FilterEvidence(**evidence.get("gain", {}))
    if back.is_clear and back.share >= GONE_SHARE and back.pace >= GONE_PACE * proof.pace:
        return f"the model of before explains it better: {back.nats:.0f} nats on {back.seconds:.0f} s"
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
        """Whether it was watched for long enough; a bad round at the end is followed by one more."""
        return self.count >= SETTLING_ROUNDS and self.bad == 0
