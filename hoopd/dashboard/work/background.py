"""What stands before a command that works beside a running loop.

Rules of this file: it gets processor time that nobody else wants, no core that the loop has for itself, and ends with
the process that started it.
"""

from __future__ import annotations

import shutil

from hoopd.shell.child import end_with_parent
from hoopd.shell.cores import off_isolated_cores

_IDLE = ("chrt", "--idle", "0")  # SCHED_IDLE: below every nice value


def background() -> tuple[str, ...]:
    """The prefix; what the system has no program for is left out."""
    idle = _IDLE if shutil.which(_IDLE[0]) else ("nice", "-n", "19") if shutil.which("nice") else ()
    return (*end_with_parent(), *off_isolated_cores(), *idle)
