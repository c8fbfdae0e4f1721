"""Where the command socket lies, and who may lay it there: one daemon of a device name on a machine.

Rules of this file: the folder is ours alone (or systemd's, for the group); a link or a stranger's folder is refused; a
lock that the kernel takes away with its holder tells a living daemon from what a dead one left.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
import stat
from collections.abc import Mapping
from pathlib import Path

from hoopd.files.reading import InputError, os_reason

SERVICE_FOLDER = Path("/run/hoopd")  # RuntimeDirectory= of the unit
PATH_BYTES = 107  # of a socket's address: sun_path less its closing zero
BACKLOG = 128  # connections that wait for the server, in the kernel: they cost the daemon no descriptor
PRIVATE, GROUP = 0o600, 0o660


def folders(environ: Mapping[str, str] | None = None) -> list[Path]:
    """Where a client looks, the service first."""
    return [SERVICE_FOLDER, _own_folder(os.environ if environ is None else environ)]


def socket_path(device: str, configured: str = "", environ: Mapping[str, str] | None = None) -> Path:
    """Where the daemon of a device listens."""
    environ = os.environ if environ is None else environ
    if configured:
        return Path(configured)
    return (_service_folder(environ) or _own_folder(environ)) / f"{device}.sock"


def listening_socket(device: str, configured: str = "", environ: Mapping[str, str] | None = None) -> ListeningSocket:
    """A bound socket that listens; InputError in one line when it cannot be, or when another daemon has it."""
    environ = os.environ if environ is None else environ
    path = socket_path(device, configured, environ)
    if len(os.fsencode(path)) > PATH_BYTES:
        raise InputError(path, "commands.socket", f"longer than the {PATH_BYTES} bytes of a socket's address")
    service = _service_folder(environ)
    try:
        if not configured and service is None:
            with contextlib.suppress(FileExistsError):
                path.parent.mkdir(mode=0o700)
            check_private(path.parent)
        return ListeningSocket(path, GROUP if service is not None else PRIVATE)
    except OSError as error:
        raise InputError(path, "commands.socket", os_reason(error, "cannot be made")) from None


class ListeningSocket:
    """The socket, its file, and the lock that says whose it is; closed, nothing of it is left."""

    def __init__(self, path: Path, mode: int) -> None:
        self.path = path
        self._lock = _locked(path)
        try:
            self.socket = _bound(path, mode)
        except BaseException:
            os.close(self._lock)
            raise

    def close(self) -> None:
        """Take the file away and let go; the lock's file stays, it is empty."""
        self.socket.close()
        with contextlib.suppress(OSError):
            self.path.unlink()
        os.close(self._lock)


def _service_folder(environ: Mapping[str, str]) -> Path | None:
    """The folder that systemd made for us."""
    given = environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(given) if given.startswith("/") else None


def _own_folder(environ: Mapping[str, str]) -> Path:
    """The folder of a daemon that a user started."""
    given = environ.get("XDG_RUNTIME_DIR", "")
    return Path(given) / "hoopd" if given.startswith("/") else Path(f"/tmp/hoopd-{os.getuid()}")


def check_private(folder: Path) -> None:
    """InputError for what is no folder of ours that nobody else may enter: a link, a stranger's, or an open one."""
    state = folder.lstat()  # of the name itself: a link to a folder of ours is somebody's trick, too
    if not stat.S_ISDIR(state.st_mode):
        raise InputError(folder, "", "is no folder (a link?): take it away")
    if state.st_uid != os.geteuid():
        raise InputError(folder, "", f"belongs to user {state.st_uid}, not to us: take it away")
    if state.st_mode & 0o077:
        raise InputError(folder, "", f"others may enter it (mode {stat.S_IMODE(state.st_mode):o}): chmod 700")


def _locked(path: Path) -> int:
    """The lock beside the socket; InputError when a living daemon holds it."""
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
    descriptor = os.open(path.with_suffix(".lock"), flags, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        reason = "another daemon of this device runs on this machine: end it, or give this one another device.name"
        raise InputError(path, "", reason) from None
    return descriptor


def _bound(path: Path, mode: int) -> socket.socket:
    """A listening socket in place of what a dead daemon left there."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
    try:
        with contextlib.suppress(FileNotFoundError):
            if not stat.S_ISSOCK(path.lstat().st_mode):
                raise InputError(path, "commands.socket", "exists and is no socket")
            path.unlink()
        os.fchmod(listener.fileno(), mode)  # never more open than it is meant to be, not even for a moment
        listener.bind(str(path))
        path.chmod(mode)  # what the umask took away
        listener.listen(BACKLOG)
    except BaseException:
        listener.close()
        raise
    return listener
