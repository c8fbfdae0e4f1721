"""Pages that plot recordings of the folder, drawn by `hoopd plot`.

Rules of this file: another process draws, one at a time, in time that nobody else wants; what was drawn is kept until
the recording or the way of drawing changes.
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

from hoopd import __version__, exit_codes
from hoopd.dashboard.work.background import background
from hoopd.dashboard.work.recordings import Recordings
from hoopd.files.reading import InputError
from hoopd.shell.child import end

AT_ONCE = 6  # recordings in one plot
KEPT = 40
WAIT_S = 60.0
PLOT_S = 120.0


class UndrawableError(InputError):
    """These recordings cannot be drawn this way, as `hoopd plot` says."""


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
        ways = _ways(len(paths))
        page = self._folder / f"{_digest(paths, ways)}.html"
        if not self._drawing.acquire(timeout=WAIT_S):
            raise InputError("plot", "", "others are being drawn: try again")
        try:
            if not page.is_file() and not self._closed:
                self._draw_somehow(paths, ways, page)
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

    def _draw_somehow(self, paths: Sequence[Path], ways: Sequence[Sequence[str]], page: Path) -> None:
        """By the first way that they can be drawn; InputError with the reader's line when there is none."""
        for way in ways[:-1]:
            with contextlib.suppress(UndrawableError):
                return self._draw(paths, way, page)
        return self._draw(paths, ways[-1], page)

    def _draw(self, paths: Sequence[Path], way: Sequence[str], page: Path) -> None:
        fresh = page.with_name("fresh.html")
        command = [
            *background(waited_for=True),
            sys.executable,
            "-m",
            "hoopd",
            "plot",
            *map(str, paths),
            f"--out={fresh}",
            *way,
        ]
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
            kind = UndrawableError if child.returncode == exit_codes.UNUSABLE_INPUT else InputError
            raise kind("plot", "", reason.replace(f"{paths[0].parent}/", "")[:400])
        fresh.replace(page)
        for old in sorted(self._folder.glob("*.html"), key=lambda one: one.stat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)


def _ways(count: int) -> list[list[str]]:
    """Options, best first: two are compared, or lie over each other as more do where they have no signal in common."""
    if count == 1:
        return [[]]
    return [["--compare"], ["--from-zero"]] if count == 2 else [["--from-zero"]]


def _digest(paths: Sequence[Path], ways: Sequence[Sequence[str]]) -> str:
    """Of what is drawn and how: names, sizes, times, options and the version that draws."""
    stats = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
    return hashlib.sha256(repr((stats, ways, __version__)).encode()).hexdigest()[:32]
