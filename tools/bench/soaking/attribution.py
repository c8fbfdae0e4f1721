"""The rule: whose is the time between two moments, and whose are the ticks missed in it.

The loop's time has three owners. *machine*: its core stood still (the witness), or it could have run and something
else did (the kernel's account of waiting), or it slept on a timer that had expired. *rig*: the part of that waiting
in which the rig ran. *daemon*: all that is left: its work, collections, page faults, sleeping for a helper of its own
that holds the interpreter, or in any other call. A helper that itself waits for a core with the interpreter in hand is
the machine's. A gap of n ticks: floor(daemon's seconds / period) of them are the daemon's in any case; the rest belongs
to the owner of the largest part.
"""

from __future__ import annotations

import platform
from collections import Counter
from typing import Any, NamedTuple

from soaking.accounts import Accounts
from soaking.follower import FETCHING, RUNNABLE

# The calls in which a thread of Python sleeps for its timer and for the interpreter, by the kernel's tables.
TIMERS, LOCKS = {"x86_64": ((232, 281), (202,)), "aarch64": ((22,), (98,))}.get(platform.machine(), ((), ()))
OWNERS = ("rig", "machine", "daemon")


class Parts(NamedTuple):
    """A span by its owners, in s."""

    still: float  # the core stood still
    waited: float  # for a core, others than the rig had it
    rig: float  # for a core, the rig had it
    timer: float  # asleep although the timer had expired
    interpreter_waited: float  # for a helper that waited for a core
    interpreter: float  # for a helper that ran
    fetching: float  # a page from the disk
    asleep: float  # in another call, or nobody saw where
    work: float  # on a core
    faults_minor: int = 0
    faults_disk: int = 0
    calls: str = ""  # numbers of the system calls that it was seen asleep in

    @property
    def machine(self) -> float:
        """Seconds of the machine."""
        return self.still + self.waited + self.timer + self.interpreter_waited

    @property
    def daemon(self) -> float:
        """Seconds of the daemon."""
        return self.interpreter + self.fetching + self.asleep + self.work

    @property
    def owner(self) -> str:
        """Who has the largest part."""
        return max(OWNERS, key=lambda name: float(getattr(self, name)))


class Span(NamedTuple):
    """From `begin` to `end` the loop was late or at work; before `due` it may have slept as it should."""

    begin: float
    due: float
    end: float


class Missed(NamedTuple):
    """Ticks that are not there."""

    t: float  # s, run time
    count: int
    parts: Parts
    collection: bool  # the tick before it collected garbage

    def shares(self, period_s: float) -> dict[str, int]:
        """Owner -> ticks."""
        certain = min(self.count, int(self.parts.daemon / period_s))
        shares = dict.fromkeys(OWNERS, 0)
        shares["daemon"] = certain
        shares[self.parts.owner] += self.count - certain
        return shares


class Long(NamedTuple):
    """An execution above the limit."""

    t: float  # s, run time
    seconds: float
    parts: Parts


def split(accounts: Accounts, span: Span) -> Parts:
    """The parts of a span; they add up to its length less the sleep it was entitled to."""
    length = span.end - span.begin
    still = min(accounts.still_s(span.begin, span.end), length)
    waiting = min(accounts.grown("loop_wait_s", span.begin, span.end), length - still)
    rig = min(waiting, accounts.grown("rig_run_s", span.begin, span.end))
    work = min(accounts.grown("loop_run_s", span.begin, span.end), length - still - waiting)
    asleep = min(length - still - waiting - work, max(0.0, span.end - span.due))
    return Parts(
        still=still,
        waited=waiting - rig,
        rig=rig,
        work=work,
        faults_minor=round(accounts.grown("faults_minor", span.begin, span.end)),
        faults_disk=round(accounts.grown("faults_disk", span.begin, span.end)),
        **_asleep(accounts, span, asleep),
    )


def _asleep(accounts: Accounts, span: Span, seconds: float) -> dict[str, Any]:
    """Seconds asleep by where the loop was seen asleep after `due`; all of it elsewhere when it never was."""
    seen = Counter(place for place in accounts.places(span.due, span.end) if place != RUNNABLE)
    timer, lock, fetching = (
        seconds * sum(seen[call] for call in calls) / max(seen.total(), 1) for calls in (TIMERS, LOCKS, (FETCHING,))
    )
    waited = min(lock, accounts.grown("helpers_wait_s", span.due, span.end))
    return {
        "timer": timer,
        "interpreter_waited": waited,
        "interpreter": lock - waited,
        "fetching": fetching,
        "asleep": max(0.0, seconds - timer - lock - fetching),
        "calls": " ".join(str(call) for call, _ in seen.most_common() if call >= 0),
    }
