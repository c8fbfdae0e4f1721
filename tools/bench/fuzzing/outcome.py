"""What came of a case, and whether it is within the bounds.

Rules of this file: the bounds are those of docs/reference/recording.md; a case that was accepted may take as
long as its work.
"""

from __future__ import annotations

from typing import NamedTuple

MAX_SECONDS = 5.0  # of the processor: a machine under load makes everything slow, not dear
STILL_S = 5.0  # of the clock without any of the processor: it waits for something that never comes
MAX_BYTES = 300 * 10**6
# In a process that tries many cases: what one may add. A command that refuses takes up to 165 MB before it reads.
MAX_ADDED_BYTES = 130 * 10**6
MAX_LINE_CHARS = 2000

REFUSED, ACCEPTED, UNFORESEEN, BEYOND = "refused", "accepted", "unforeseen", "beyond"


class Outcome(NamedTuple):
    """What came of a case."""

    number: int
    kind: str
    verdict: str
    seconds: float  # of the processor
    megabytes: float  # added to what the process had, or all of it where the case had one of its own
    told: str  # the line, or why it is beyond the bounds


def judged(outcome: Outcome, limit_bytes: float) -> Outcome:
    """The outcome; a refusal that took too much is beyond the bounds."""
    if outcome.verdict != REFUSED:
        return outcome
    if outcome.seconds > MAX_SECONDS:
        return outcome._replace(verdict=BEYOND, told=f"{outcome.seconds:.1f} s for: {outcome.told}")
    if outcome.megabytes * 1e6 > limit_bytes:
        return outcome._replace(verdict=BEYOND, told=f"{outcome.megabytes:.0f} MB for: {outcome.told}")
    return outcome
