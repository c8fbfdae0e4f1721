"""What stands before a command that works beside a running loop.

Rules of this file: it gets processor time that nobody else wants, no core that the loop has for itself, and ends with
the process that started it. What somebody waits for is short and has low priority only: on a machine with other work
the idle class may get nothing for minutes.
"""

from __future__ import annotations

import shutil

from hoopd.shell.child import end_with_parent
from hoopd.shell.cores import off_isolated_cores

_IDLE = ("chrt", "--idle", "0")  # SCHED_IDLE: below every nice value

_LOW = ("nice", "-n", "5")
_LOWEST = ("nice", "-n", "19")


def background(*, waited_for: bool = False) -> tuple[str, ...]:
    """The prefix; what the system has no program for is left out."""
    wanted = _LOW if waited_for else _IDLE if shutil.which(_IDLE[0]) else _LOWEST
    low = wanted if shutil.which(wanted[0]) else ()
    return (*end_with_parent(), *off_isolated_cores(), *low)
