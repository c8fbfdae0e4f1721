"""Who asked which device for what, when, and what the device answered: one line of JSON each.

Rules of this file: a line is written before its answer goes to the browser; a full disk stops no STOP, it is said on
standard error.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from hoopd.files.reading import InputError

SHOWN = 50  # on the page


class Audit:
    """The lines, in a file that only grows, or on standard error without one."""

    def __init__(self, path: Path | None = None) -> None:
        """InputError for a file that cannot be written, before anything could happen that belongs in it."""
        self.count = 0
        self._path, self._lock, self._writing = path, threading.Lock(), threading.Lock()
        self._latest: deque[dict[str, Any]] = deque(maxlen=SHOWN)
        if path is not None:
            try:
                path.open("ab").close()
            except OSError as error:
                raise InputError(path, "--audit", (error.strerror or str(error)).lower()) from None

    @property
    def latest(self) -> list[dict[str, Any]]:
        """The newest lines, oldest first, without the address: everybody who looks sees them."""
        with self._lock:
            return list(self._latest)

    def note(self, who: str, address: str, told: Mapping[str, Any]) -> None:
        """One line: who, from where, what, and the answer."""
        line = {"time": datetime.now(UTC).isoformat(timespec="milliseconds"), "who": who, "from": address, **told}
        text = msgspec.json.encode(line) + b"\n"
        with self._lock:
            self._latest.append({key: value for key, value in line.items() if key != "from"})
            self.count += 1
        with self._writing:  # a disk that hangs holds up nobody who looks
            try:
                if self._path is not None:
                    with self._path.open("ab") as file:
                        file.write(text)
                    return
            except OSError as error:
                sys.stderr.write(f"hoopd: {self._path}: {(error.strerror or str(error)).lower()}\n")
            sys.stderr.write(text.decode())
            sys.stderr.flush()
