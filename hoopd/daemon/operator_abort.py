"""How an operator breaks off a run that was asked for on a terminal: Ctrl-C or one of the abort keys.

Rules of this file: nothing here may wait or make torque; what an abort does is the listener's own.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hoopd.shell.keys import pressed

ABORT_KEYS = "qQ \x1b"
ABORTED = "aborted by the operator"


@contextmanager
def heard_from_terminal(abort: Callable[[], None]) -> Iterator[None]:
    """Call `abort` for each Ctrl-C and abort key while the loop runs."""
    with contextlib.suppress(NotImplementedError, ValueError, RuntimeError):  # not the main thread
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, abort)
    with pressed(lambda key: abort() if key in ABORT_KEYS else None):
        yield
