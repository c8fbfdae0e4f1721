"""Logs: one event per fact, human on a terminal, JSON lines for the journal.

Rules of this file: nothing logs from the tick; facts are queued and a helper thread writes them, because a
terminal or a journal may block.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping, MutableMapping

import structlog

from hoopd.core.records import Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.shell.helpers import start_helper

# Facts that wait for the writer; a fault campaign makes a few a second.
MAX_WAITING = 1000
REFRESH_S = 0.2
TELL_EVERY = 5  # refreshes: a second
CLEAR_LINE = "\r\x1b[2K"


# sd-daemon(3): the journal takes a line's priority from its first characters, and a line without them as info.
PRIORITIES = {"critical": 2, "error": 3, "warning": 4, "info": 6, "debug": 7}


def goes_to_journal(environ: Mapping[str, str] = os.environ) -> bool:
    """Standard error is the journal's (systemd.exec(5), JOURNAL_STREAM)."""
    with contextlib.suppress(OSError):
        stream = os.fstat(2)
        return environ.get("JOURNAL_STREAM", "") == f"{stream.st_dev}:{stream.st_ino}"
    return False


class WithPriority:
    """A renderer whose lines begin with their priority for the journal."""

    def __init__(self, renderer: Callable[..., str | bytes]) -> None:
        self._renderer = renderer

    def __call__(self, logger: object, method: str, event: MutableMapping[str, object]) -> str:
        """The line; `method` is the level's name."""
        return f"<{PRIORITIES.get(method, PRIORITIES['info'])}>{self._renderer(logger, method, event)!s}"


def configure(form: str, level: str) -> None:
    """Set up structlog on standard error; `form` is auto, human or json."""
    human = form == "human" or (form == "auto" and sys.stderr.isatty())
    stamp = [structlog.processors.TimeStamper(fmt="%H:%M:%S", utc=False)] if human else []
    renderer = (
        structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty()) if human else structlog.processors.JSONRenderer()
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            *stamp,
            WithPriority(renderer) if goes_to_journal() else renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(getattr(logging, level.upper())),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=True,
    )


class Reporter:
    """Writes facts to the log and keeps the status line, on a thread of its own."""

    def __init__(self, tell: Callable[[str], object] = lambda text: None) -> None:
        """`tell` gets a short status every second (for the service manager)."""
        self._status: Callable[[], str] | None = None
        self._tell, self._turn, self._mode = tell, 0, ""
        self._waiting: deque[tuple[float, Note]] = deque(maxlen=MAX_WAITING)
        self._done = threading.Event()
        self._log = structlog.get_logger()
        self._thread: threading.Thread | None = None

    trouble = False
    t = 0.0  # run time of the newest tick, for facts of helpers

    def start(self, status: Callable[[], str]) -> None:
        """Begin writing; `status` makes the line for a terminal."""
        self._status = status if sys.stderr.isatty() else None
        self._thread = start_helper("reporter", self._run)

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """Ticks are not logged."""
        self.t, self._mode = record.t, record.mode

    def note(self, t: float, note: Note) -> None:
        """Queue one fact."""
        self._waiting.append((t, note))

    def close(self) -> None:
        """Write what waits and stop; a blocked terminal cannot hold the exit for more than a second."""
        self._done.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def _run(self) -> None:
        while not self._done.wait(REFRESH_S):
            with contextlib.suppress(OSError):  # a full disk or a closed terminal ends no log
                self._write()
            self._turn += 1
            if self._turn % TELL_EVERY == 0:
                self._tell(f"{self._mode}, {self.t:.0f} s")
        with contextlib.suppress(OSError):
            self._write()
            if self._status is not None:
                sys.stderr.write(CLEAR_LINE)

    def _write(self) -> None:
        if self._status is not None and self._waiting:
            sys.stderr.write(CLEAR_LINE)
        while self._waiting:
            t, note = self._waiting.popleft()
            getattr(self._log, note.level)(note.name, t=round(t, 4), **note.fields)
        if self._status is not None:
            width = shutil.get_terminal_size().columns - 1  # a line that wraps would scroll with every refresh
            sys.stderr.write(CLEAR_LINE + self._status()[:width])
            sys.stderr.flush()
