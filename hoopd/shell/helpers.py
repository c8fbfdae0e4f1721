"""Helper threads: everything beside the loop runs below it.

Rules of this file: Linux gives a new thread its maker's scheduling, so a helper lowers itself first of all; helpers are
daemon threads and are waited for with a deadline, so that none can hold the process at its end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from hoopd.shell.service import lower_thread_priority


def start_helper(name: str, run: Callable[[], None]) -> threading.Thread:
    """A started daemon thread with ordinary scheduling."""

    def lowered() -> None:
        lower_thread_priority()
        run()

    thread = threading.Thread(target=lowered, name=name, daemon=True)
    thread.start()
    return thread
