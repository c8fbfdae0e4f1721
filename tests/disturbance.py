"""How much of the machine others had while a test ran: what came late counts only where they had less than half of it.

Rules of this file: others are all processes that are not of this run of the tests; what the run itself costs excuses
nothing. The kernel's own account is asked; where there is none, every failure counts. Only what was asserted within
`harness.timing.on_the_clock` is excused, and it is said why.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import NamedTuple

import psutil
import pytest
from harness.timing import is_late

# Of all processor time: from half on each of our processes may wait for as long as it runs.
BUSY = 0.5
ROOT = "HOOPD_TESTS_PID"  # the process that started this run, for its helpers too
LATE = "HOOPD_TESTS_LATE"  # a file: what is late while others of this run go on beside it is asked again alone
IDLE = ("idle", "iowait", "guest", "guest_nice")  # what guests took is in `user` and `nice` already


class Taken(NamedTuple):
    """Seconds of the monotonic clock, and processor time since the machine's start: of all, and of this run."""

    t: float
    all_s: float
    ours_s: float

    def others_since(self, before: Taken) -> float:
        """Share of all cores that others had in between."""
        others = (self.all_s - before.all_s) - (self.ours_s - before.ours_s)
        return others / max((self.t - before.t) * (psutil.cpu_count() or 1), 1e-9)


def taken() -> Taken:
    """The account until now; nobody takes anything where there is none."""
    try:
        times = psutil.cpu_times()._asdict()
        everyone = sum(value for name, value in times.items() if name not in IDLE)
        return Taken(time.monotonic(), everyone, _of_family(psutil.Process(int(os.environ.get(ROOT, os.getpid())))))
    except (OSError, psutil.Error):
        return Taken(time.monotonic(), 0.0, 0.0)


def _of_family(root: psutil.Process) -> float:
    """Processor time of a process and its descendants, those that have ended included."""
    total = 0.0
    for one in (root, *root.children(recursive=True)):
        try:
            times = one.cpu_times()
        except psutil.Error:  # ended since, and counted with its parent
            continue
        total += times.user + times.system + times.children_user + times.children_system
    return total


def excuse(report: pytest.TestReport, error: BaseException | None, share: float) -> None:
    """Make a failure on the clock a skip that tells of it, where others had the machine."""
    if report.failed and report.when in ("setup", "call") and is_late(error) and share >= BUSY:
        path, line, _ = report.location
        first = str(error).partition("\n")[0]
        told = f"late, but others had {share:.0%} of the machine meanwhile, so nothing can be judged: {first}"
        report.outcome, report.longrepr = "skipped", (path, line or 0, told)


def put_off(report: pytest.TestReport, error: BaseException | None) -> None:
    """Make a failure on the clock a skip where `tools/suite.py` asks the test again when nothing runs beside it."""
    place = os.environ.get(LATE)
    if place and report.failed and report.when in ("setup", "call") and is_late(error):
        with Path(place).open("a", encoding="utf-8") as file:  # one short write: lines of several processes do not mix
            file.write(f"{report.nodeid}\n")
        path, line, _ = report.location
        report.outcome, report.longrepr = "skipped", (path, line or 0, "late beside other tests: asked again alone")
