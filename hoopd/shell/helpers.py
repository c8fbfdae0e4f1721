"""Helper threads: everything beside the loop runs below it.

Rules of this file: Linux gives a new thread its maker's scheduling, so a helper lowers itself first of all; helpers are
daemon threads and are waited for with a deadline, so that none can hold the process at its end.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable


def lower_priority() -> None:
    """Give the calling thread ordinary scheduling, whatever its maker had."""
    with contextlib.suppress(OSError, AttributeError):  # not granted, or not Linux: nothing to lower then
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def start_helper(name: str, run: Callable[[], None]) -> threading.Thread:
    """A started daemon thread with ordinary scheduling."""

    def lowered() -> None:
        lower_priority()
        run()

    thread = threading.Thread(target=lowered, name=name, daemon=True)
    thread.start()
    return thread
