"""A folder in which one process works alone, and whether one does.

    with alone_in(folder, ".watched", "another hoopd heal is at work here"): ...

The lock is the kernel's: it ends with the process, however that ends.

Rules of this file: nothing of what lies in the folder is looked at.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hoopd.files.reading import InputError


@contextmanager
def alone_in(folder: Path, name: str, taken: str, option: str = "--out") -> Iterator[None]:
    """Be the only one; InputError with these words where somebody else is. `name`: of the lock's file."""
    try:
        file = (folder / name).open("w")
    except OSError as error:
        raise InputError(folder, option, f"cannot be written: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(folder, option, taken) from None
        yield


@contextmanager
def held_still(path: Path) -> Iterator[None]:
    """Nobody else changes a file in this way meanwhile; waits for who does. The lock is its folder's: the file itself
    is replaced."""
    try:
        folder = os.open(Path(os.path.realpath(path)).parent, os.O_RDONLY)
    except OSError as error:
        raise InputError(path, "", f"cannot be written: {error.strerror}") from None
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def is_taken(folder: Path, name: str) -> bool:
    """Whether a process works in it now."""
    path = folder / name
    if not path.exists():
        return False
    with path.open("r") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
