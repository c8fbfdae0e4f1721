"""Pages that plot recordings of the folder, drawn by `hoopd plot`.

Rules of this file: another process draws, one at a time, in time that nobody else wants; what was drawn is kept until
the recording changes.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from hoopd.dashboard.work.background import background
from hoopd.dashboard.work.recordings import Recordings
from hoopd.files.reading import InputError
from hoopd.shell.child import end

AT_ONCE = 6  # recordings in one plot
KEPT = 40
WAIT_S = 60.0
PLOT_S = 120.0


class Plots:
    """Pages that stand alone, in a folder."""

    def __init__(self, recordings: Recordings, folder: Path) -> None:
        self._recordings, self._folder = recordings, folder
        self._drawing = threading.Lock()
        self._child: subprocess.Popen[bytes] | None = None
        self._closed = False

    def page(self, names: Sequence[str]) -> Path:
        """The page of one recording, or of several over each other from zero; InputError with the reader's line."""
        if not 1 <= len(names) <= AT_ONCE or len(set(names)) < len(names):
            raise InputError("plot", "", f"of 1 to {AT_ONCE} different recordings")
        paths = [self._recordings.path(name) for name in names]
        page = self._folder / f"{_digest(paths)}.html"
        if not self._drawing.acquire(timeout=WAIT_S):
            raise InputError("plot", "", "others are being drawn: try again")
        try:
            if not page.is_file() and not self._closed:
                self._draw(paths, page)
        finally:
            self._drawing.release()
        if not page.is_file():
            raise InputError("plot", "", "the page's server ends")
        return page

    @property
    def busy(self) -> bool:
        """Something is being drawn."""
        return self._child is not None

    def close(self) -> None:
        """End what is being drawn: the server's end waits for nobody."""
        self._closed = True
        child = self._child
        if child is not None:
            with contextlib.suppress(OSError):
                os.killpg(child.pid, signal.SIGKILL)

    def _draw(self, paths: Sequence[Path], page: Path) -> None:
        fresh = page.with_name("fresh.html")
        command = [
            *background(waited_for=True),
            sys.executable,
            "-m",
            "hoopd",
            "plot",
            *map(str, paths),
            f"--out={fresh}",
        ]
        if len(paths) > 1:
            command.append("--compare" if len(paths) == 2 else "--from-zero")
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
        )
        self._child = child
        try:
            _, errors = child.communicate(timeout=PLOT_S)
        except subprocess.TimeoutExpired:
            raise InputError(paths[0].name, "", f"not drawn within {PLOT_S:g} s") from None
        finally:
            self._child = None
            end(child)
        if child.returncode:
            said = errors.decode("utf-8", "replace").strip().splitlines()
            reason = (said or ["cannot be drawn"])[-1].removeprefix("hoopd: ")
            raise InputError("plot", "", reason.replace(f"{paths[0].parent}/", "")[:400])
        fresh.replace(page)
        for old in sorted(self._folder.glob("*.html"), key=lambda one: one.stat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)


def _digest(paths: Sequence[Path]) -> str:
    """Of what is drawn: names, sizes, times."""
    stats = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
    return hashlib.sha256(repr(stats).encode()).hexdigest()[:32]
