"""How long things take while a loop is followed, and what somebody else is asked to compute for it.

Rules of this file: records and numbers with their reasons.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from hoopd.design.comparison import BALL

ALIVE_S = 1.0
PATIENCE_S = 25.0  # until a candidate has taken over
BACK_S = 5.0  # until the daemon has told that the law changed
WEIGH_S = 300.0  # until seconds are weighed, beside whatever else the machine does
ENTER_S = 3.0  # of a trial or of a new version: the filter settles, the ball comes to where it is wanted


@dataclass(frozen=True, kw_only=True)
class HealPlan:
    """How long things take, s."""

    window_s: float = 40.0  # that are diagnosed
    fresh_s: float = 20.0  # that prove it
    trial_s: float = 30.0
    round_s: float = 30.0  # of the watch over what was accepted
    pause_s: float = 300.0  # after something that came to nothing
    every_s: float = 0.0  # diagnose so often without a drift, too; 0: only then
    by: str = BALL


REMEMBER = "remember"  # of what is computed that nobody waits for
REMEMBERED = "remembered"  # in its result, and in a version's evidence: the memory has it


class HealWork(NamedTuple):
    """What is to be computed of seconds that were recorded."""

    name: str  # diagnose, prove, weigh or remember
    number: int  # of the version
    from_s: float
    to_s: float
