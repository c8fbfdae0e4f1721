"""Helper threads: everything beside the loop runs below it.

Rules of this file: a helper settles its own scheduling first of all, a little below the loop's; helpers are
daemon threads and are waited for with a deadline, so that none can hold the process at its end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from hoopd.shell.service import settle_helper_thread


def start_helper(name: str, run: Callable[[], None]) -> threading.Thread:
    """A started daemon thread with a helper's scheduling."""

    def lowered() -> None:
        settle_helper_thread()
        run()

    thread = threading.Thread(target=lowered, name=name, daemon=True)
    thread.start()
    return thread
