"""Whole files in, whole files out: bounded reads, and writes that leave the old file or the new one, never a half.

Rules of this file: every fault of the disk is one `InputError`; a directory or a device is no recording.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path
from typing import BinaryIO

from hoopd.files.reading import InputError, open_regular, os_reason, read_bytes

MAX_FILE_BYTES = 2**29  # a week of a .mat file; larger ones are something else


def opened(path: Path, max_bytes: int = MAX_FILE_BYTES) -> BinaryIO:
    """An open, non-empty file of bounded size; InputError when it is none."""
    file = open_regular(path, max_bytes)
    if os.fstat(file.fileno()).st_size:
        return file
    file.close()
    raise InputError(path, "", "the file is empty")


def file_bytes(path: Path, max_bytes: int = MAX_FILE_BYTES) -> bytes:
    """Content of a non-empty file; InputError when it cannot be read."""
    data = read_bytes(path, max_bytes)
    if not data:
        raise InputError(path, "", "the file is empty")
    return data


def check_target(path: Path, option: str) -> None:
    """InputError when no file can go there: said before the work, not after it."""
    try:
        if path.is_dir():
            raise InputError(path, option, "is a directory")
        if not path.parent.is_dir():
            raise InputError(path, option, "no such folder")
        path.exists()
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(path, option, os_reason(error, "cannot be written")) from None


def begin_folder(folder: Path, option: str, wanted: str) -> None:
    """Make a folder; InputError where it cannot be, or holds something else already. `wanted`: what it will hold."""
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, option, "is no folder")
    if folder.exists() and any(folder.iterdir()):
        raise InputError(folder, option, f"holds other files and no {wanted}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, option, (error.strerror or "cannot be made").lower()) from None


def replace_file(path: Path, data: bytes) -> None:
    """Put data where path is, at once: written beside it, then renamed over it; a device or a pipe is written to."""
    try:
        if path.is_dir():
            raise InputError(path, "", "is a directory")
        if is_special(path):  # a rename would put a file in its place: /dev/null, or a link to a pipe
            _write_through(path, data)
            return
        path = Path(os.path.realpath(path))  # a link stays a link; resolve() raises where one leads to itself
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()
        handle, name = tempfile.mkstemp(prefix=f".{path.name[:100]}.", dir=path.parent)
    except (OSError, ValueError) as error:
        raise _unwritable(path, error) from None
    try:
        with os.fdopen(handle, "wb") as file:
            os.fchmod(file.fileno(), mode)
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            Path(name).unlink()
        if isinstance(error, OSError):
            raise _unwritable(path, error) from None
        raise


def new_file(path: Path, data: bytes) -> None:
    """Put data where nothing is yet, at once; FileExistsError where something is, InputError where nothing can be."""
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name[:100]}.", dir=path.parent)
    except (OSError, ValueError) as error:
        raise _unwritable(path, error) from None
    try:
        with os.fdopen(handle, "wb") as file:
            os.fchmod(file.fileno(), 0o666 & ~_umask())
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.link(name, path)
    except FileExistsError:
        raise
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        with contextlib.suppress(OSError):
            Path(name).unlink()


def is_special(path: Path) -> bool:
    """Something that bytes are sent to, no file: a device, a pipe, or what stands for an open descriptor."""
    return (path.exists() and not path.is_file()) or path.absolute().is_relative_to("/dev")


def _write_through(path: Path, data: bytes) -> None:
    """Send the bytes; a pipe that nobody reads is an error, not a wait."""
    handle = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
    os.set_blocking(handle, True)
    with os.fdopen(handle, "wb") as file:
        file.write(data)


def _unwritable(path: Path, error: Exception) -> InputError:
    return error if isinstance(error, InputError) else InputError(path, "", os_reason(error, "cannot be written"))


def _umask() -> int:
    """The process's mask; there is no call that only reads it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
