"""The folder out of which a running daemon takes controllers: by name and hash, from nowhere else.

Rules of this file: a name is a plain file name; links are not followed; a file is read once, and what was read is what
the hash is of. Everything wrong is one `InputError`.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
from pathlib import Path
from typing import NamedTuple

from hoopd.files.reading import InputError, os_reason

# An excitation of five minutes, written out; as JSON in the recorded inputs it is read in a millisecond.
MAX_BYTES = 2**18
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}\.ya?ml", re.ASCII)
# Of 16 possibilities each: enough that nobody makes a second file by chance, few enough to be typed.
LEAST_DIGITS = 12
_DIGITS = re.compile(rf"[0-9a-f]{{{LEAST_DIGITS},64}}", re.ASCII)


class FileKey(NamedTuple):
    """Which file is meant."""

    name: str
    sha256: str  # of its bytes, the first `LEAST_DIGITS` digits or more


def parse_key(key: str) -> FileKey:
    """NAME.yaml@SHA256; InputError says what is wrong with it."""
    name, at, digits = key.partition("@")
    if name.endswith(".py"):
        raise InputError(name, "", "a law that is code is never loaded by a running daemon: name it in control.law")
    if not _NAME.fullmatch(name):
        raise InputError(name, "", "expected the name of a .yaml file in the daemon's folder of controllers, no path")
    if not at or not _DIGITS.fullmatch(digits):
        reason = f"expected NAME.yaml@SHA256 with {LEAST_DIGITS} to 64 digits (0-9, a-f) of the file's hash"
        raise InputError(name, "", reason)
    return FileKey(name, digits)


def key_of(path: Path) -> str:
    """NAME.yaml@SHA256 of a file as it is now; InputError when it cannot be read."""
    name = parse_key(f"{path.name}@{'0' * LEAST_DIGITS}").name
    return f"{name}@{hashlib.sha256(_read(path)).hexdigest()}"


def read_controller(folder: Path, key: FileKey) -> tuple[str, str]:
    """Text and whole hash of a file of the folder; InputError for one that is not there or another one."""
    data = _read(folder / key.name)
    sha256 = hashlib.sha256(data).hexdigest()
    if not sha256.startswith(key.sha256):
        raise InputError(key.name, "", f"its hash is {sha256[:LEAST_DIGITS]}..., not {key.sha256[:LEAST_DIGITS]}...")
    try:
        return data.decode(), sha256
    except UnicodeDecodeError as error:
        raise InputError(key.name, "", os_reason(error)) from None


def _read(path: Path) -> bytes:
    """Content of a regular file of bounded size; the message names no folder."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        reason = "is a link: name the file itself" if path.is_symlink() else os_reason(error)
        raise InputError(path.name, "", reason) from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise InputError(path.name, "", "not a file")
    with os.fdopen(handle, "rb") as file:
        try:
            data = file.read(MAX_BYTES + 1)
        except OSError as error:
            raise InputError(path.name, "", os_reason(error)) from None
    if len(data) > MAX_BYTES:
        raise InputError(path.name, "", f"larger than {MAX_BYTES} bytes: no controller of a running daemon")
    return data
