"""The folder of recordings: names, room, and which runs may go.

Rules of this file: only files that carry our name and our mark are counted or deleted, never the newest of them, never
one that is being written (whoever writes it holds its lock), never another's; the folder must exist. Raises OSError,
which the recorder takes as trouble.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
from collections import deque
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.writer import MCAP0_MAGIC

from hoopd.recording.mcap import PROFILE

_NAME = re.compile(r"^run-(\d{4,9})\.mcap$")
# Magic, opcode and length of the header record, length of the profile, profile: how every run of ours begins.
_MARK_AT, _MARK = 8 + 1 + 8, len(PROFILE).to_bytes(4, "little") + PROFILE.encode()


class Limits(NamedTuple):
    """Room that recordings may take."""

    quota_bytes: int = 2_000_000_000  # all runs of ours together; some 30 h
    min_free_bytes: int = 200_000_000  # left to the rest of the system, which fails worse than we do without


class RunFile(NamedTuple):
    """One recording of ours."""

    number: int
    path: Path
    size: int


def runs(folder: Path) -> list[RunFile]:
    """Recordings of ours in the folder, oldest first."""
    found = [(int(m[1]), path) for path in folder.iterdir() if (m := _NAME.match(path.name)) and not path.is_symlink()]
    return [RunFile(number, path, path.stat().st_size) for number, path in sorted(found) if _is_ours(path)]


def create(folder: Path) -> tuple[Path, BinaryIO]:
    """A new file with the next free number, unbuffered, its name safe on the disk."""
    taken = [int(m[1]) for path in folder.iterdir() if (m := _NAME.match(path.name))]
    path = folder / f"run-{max(taken, default=0) + 1:04d}.mcap"
    file = path.open("xb", buffering=0)
    with contextlib.suppress(OSError):  # some network folders have no locks
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    sync_folder(folder)
    return path, file


def sync_folder(folder: Path) -> None:
    """Make names in a folder survive a loss of power."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_room(folder: Path, limits: Limits, keep: Path | None = None) -> list[str]:
    """Names of the oldest runs deleted to stay inside the limits; OSError (ENOSPC) when that is not enough."""
    ours, deleted = runs(folder), list[str]()
    total, waiting = _total(ours), deque(ours[:-1])
    while waiting and (total > limits.quota_bytes or free_bytes(folder) < limits.min_free_bytes):
        oldest = waiting.popleft()
        if oldest.path != keep and not _is_written(oldest.path):
            oldest.path.unlink()
            deleted.append(oldest.path.name)
            total -= oldest.size
    if free_bytes(folder) < limits.min_free_bytes:
        raise OSError(errno.ENOSPC, f"less than {limits.min_free_bytes} bytes free", str(folder))
    return deleted


def free_bytes(folder: Path) -> int:
    """Bytes that an ordinary user may still write there."""
    state = os.statvfs(folder)
    return state.f_bavail * state.f_frsize


def _is_written(path: Path) -> bool:
    """Whether a recorder has it open."""
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
    return False


def _total(files: list[RunFile]) -> int:
    return sum(file.size for file in files)


def _is_ours(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(_MARK_AT + len(_MARK))
    return head.startswith(MCAP0_MAGIC) and head.endswith(_MARK)
