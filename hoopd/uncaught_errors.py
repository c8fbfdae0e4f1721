"""The last resort: a mistake of this program is one line, exit code 1 and a file with its traceback.

Rules of this file: it holds from the first import to the interpreter's end, in every thread, in asyncio and in
destructors; it never raises and never writes a traceback to the terminal; it decides nothing about the drive, which
is off by then: the loop's own end and the board's time-out see to that.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

# A mistake that repeats in every tick must not fill the disk; the first ones tell what it is.
MAX_FILES_A_PROCESS = 5
MAX_FILES_KEPT = 50
MAX_LINE_CHARS = 300
MAX_FILE_CHARS = 2**18  # a recursion of a thousand frames fits
_RESERVE_BYTES = 2**18

NO_NEWS = frozenset({"matplotlib.font_manager"})  # loggers whose warnings nobody can act on
_count = 0
_lock = threading.RLock()  # a destructor may fail while a failure is told
_reserve: bytearray | None = None  # given back when the memory is full, so that the line can still be made
_exit_code = 0


def watch() -> None:
    """From now on whatever nobody catches ends here."""
    global _reserve  # noqa: PLW0603
    _reserve = bytearray(_RESERVE_BYTES)
    sys.excepthook = lambda kind, error, trace: _uncaught(error)
    threading.excepthook = lambda told: _uncaught(told.exc_value, told.thread.name if told.thread else "")
    sys.unraisablehook = lambda told: _uncaught(told.exc_value)
    logging.lastResort = _Library(logging.WARNING)  # asyncio logs what nobody awaited
    atexit.register(_settle_exit_code)  # first in, last out


def run(main: Callable[[], None]) -> None:
    """Call a program's `main` and hand its output over; what it returns with is the process's exit code."""
    global _exit_code  # noqa: PLW0603
    try:
        main()
    except SystemExit as end:
        _exit_code = end.code if isinstance(end.code, int) else int(end.code is not None)
        if not _flushed():
            raise SystemExit(1) from None
        raise
    if not _flushed():
        raise SystemExit(1)


def describe(error: BaseException) -> str:
    """The line about a mistake; its traceback is in the file that the line names."""
    text = " ".join(str(error).split()) or ("the memory is full" if isinstance(error, MemoryError) else "")
    what = f"{type(error).__name__}: {text}".rstrip(": ")[:MAX_LINE_CHARS]
    shown = "".join(char if char.isprintable() else "?" for char in what)
    return f"a mistake of this program, {shown}; the traceback is in {_filed(error)}"


def folder() -> Path:
    """Where tracebacks go: the service's state folder, the user's, or else a temporary one."""
    service = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    if service:
        return Path(service) / "failures"
    return (state if state.is_absolute() else Path.home() / ".local/state") / "hoopd" / "failures"


def _uncaught(error: BaseException | None, thread: str = "") -> None:
    """One line for an error that came up to here."""
    global _count, _reserve  # noqa: PLW0603
    if error is None or isinstance(error, KeyboardInterrupt | SystemExit):
        return
    try:
        with _lock:
            _count += 1
            if _count > MAX_FILES_A_PROCESS:
                return
            if isinstance(error, MemoryError):
                _reserve = None
            where = f"in thread {thread}: " if thread not in ("", "MainThread") else ""
            _say(f"{where}{describe(error)}")
    except BaseException:  # there is no one left to tell
        with contextlib.suppress(BaseException):
            os.write(2, b"hoopd: a mistake of this program, and no room to write about it\n")


def _say(line: str) -> None:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"hoopd: {line}\n")
        sys.stderr.flush()


def _filed(error: BaseException) -> str:
    """Path of a new file with the traceback, in the first folder that takes it; a reason where none does."""
    text = "".join(traceback.format_exception(error))[-MAX_FILE_CHARS:]
    for make in (folder, lambda: Path(tempfile.gettempdir())):
        with contextlib.suppress(OSError, RuntimeError, ValueError):  # no such home, a full or read-only disk
            return str(_written(make(), text))
    return "no file: none can be written"


def _written(place: Path, text: str) -> Path:
    place.mkdir(mode=0o700, parents=True, exist_ok=True)
    stamp = time.strftime("%Y%m%d-%H%M%S")
    handle, name = tempfile.mkstemp(prefix=f"hoopd-failure-{stamp}-", suffix=".txt", dir=place)
    with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
        file.write(text)
    for old in sorted(place.glob("hoopd-failure-*.txt"))[:-MAX_FILES_KEPT]:
        old.unlink(missing_ok=True)
    return Path(name)


class _Library(logging.Handler):
    """What a library logs and nobody listens to: an error ends here, a warning is one line.

    A font that stands in for another one is no news: the font list is the machine's, and a picture is drawn either way.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """One record."""
        error = record.exc_info[1] if record.exc_info else None
        if error is not None:
            _uncaught(error)
        elif record.name not in NO_NEWS:
            _say(" ".join(f"{record.name}: {record.getMessage()}".split())[:MAX_LINE_CHARS])


def _flushed() -> bool:
    """What was printed has left the process; a full disk or a closed pipe is one line."""
    stream: Any = sys.stdout
    try:
        stream.flush()
    except (OSError, ValueError, AttributeError) as error:
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or the interpreter tries again at its end
        _say(f"standard output: {(getattr(error, 'strerror', None) or 'closed').lower()}")
        return False
    return True


def _settle_exit_code() -> None:
    """A mistake in a thread or at the end is one of the process, too."""
    if _count and not _exit_code:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(1)
