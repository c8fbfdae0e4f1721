#!/usr/bin/env python3
"""Runs a command inside the unit's sandbox without systemd, as far as a process can build it around itself.

Rules of this file: standard library only; what the unit says is read from the unit, nothing is repeated here.
Applied: SystemCallFilter, SystemCallErrorNumber, RestrictAddressFamilies (libseccomp), MemoryDenyWriteExecute
(PR_SET_MDWE, Linux 6.3), NoNewPrivileges. Not applied: devices, mounts, users, cgroups, IP addresses, namespaces.
Usage: tools/sandbox.py systemd/hoopd.service COMMAND [ARGUMENT...]
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import subprocess
import sys
from pathlib import Path

_PR_SET_NO_NEW_PRIVS, _PR_SET_MDWE, _MDWE_REFUSE_EXEC_GAIN = 38, 65, 1
_ACT_ALLOW, _ACT_ERRNO, _CMP_EQ = 0x7FFF0000, 0x00050000, 4
EXIT_UNAVAILABLE = 77  # as automake's tests: skipped


class UnavailableError(Exception):
    """This machine cannot build the sandbox; the text says what is missing."""


class _Comparison(ctypes.Structure):
    _fields_ = (("arg", ctypes.c_uint), ("op", ctypes.c_int), ("a", ctypes.c_uint64), ("b", ctypes.c_uint64))


def settings(unit: Path) -> dict[str, list[str]]:
    """Values of every key of a unit file, in order."""
    found: dict[str, list[str]] = {}
    for line in unit.read_text(encoding="utf-8").splitlines():
        key, equals, value = line.partition("=")
        if equals and not key.startswith(("#", "[")):
            found.setdefault(key.strip(), []).append(value.strip())
    return found


def system_calls(group: str) -> set[str]:
    """Names in a group as systemd defines it, groups in it resolved."""
    listing = subprocess.run(["systemd-analyze", "syscall-filter", group], capture_output=True, text=True, check=False)
    if listing.returncode != 0:
        raise UnavailableError(f"systemd-analyze knows no {group}")
    names = [line.strip() for line in listing.stdout.splitlines()[1:] if line.strip() and "#" not in line]
    nested = [system_calls(name) if name.startswith("@") else {name} for name in names]
    return set().union(*nested)


def allowed_calls(lines: list[str]) -> set[str]:
    """An allow list first, then lines with ~ that take away."""
    allowed: set[str] = set()
    for line in lines:
        groups = [system_calls(word) if word.startswith("@") else {word} for word in line.removeprefix("~").split()]
        calls = set().union(*groups)
        allowed = allowed - calls if line.startswith("~") else allowed | calls
    return allowed


def refuse_other_calls(allowed: set[str], families: list[str], error: int) -> None:
    """Load the filter: everything but these calls fails with `error`, sockets of other families too."""
    try:
        lib = ctypes.CDLL("libseccomp.so.2")
    except OSError:
        raise UnavailableError("libseccomp.so.2 is not installed") from None
    lib.seccomp_init.restype = ctypes.c_void_p
    context = ctypes.c_void_p(lib.seccomp_init(_ACT_ERRNO | error))
    for name in sorted(allowed - {"socket"}):
        number = lib.seccomp_syscall_resolve_name(name.encode())
        if number >= 0:  # negative: not a call of this machine
            lib.seccomp_rule_add_array(context, _ACT_ALLOW, number, 0, None)
    number = lib.seccomp_syscall_resolve_name(b"socket")
    for family in families:
        wanted = _Comparison(0, _CMP_EQ, int(getattr(socket, family)), 0)
        lib.seccomp_rule_add_array(context, _ACT_ALLOW, number, 1, ctypes.byref(wanted))
    if lib.seccomp_load(context) != 0:
        raise UnavailableError("the kernel refuses the filter")


def enter(unit: Path) -> None:
    """Build the sandbox of a unit around this process, for good."""
    keys = settings(unit)
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    if keys.get("MemoryDenyWriteExecute", [""])[-1] == "yes" and libc.prctl(
        _PR_SET_MDWE, _MDWE_REFUSE_EXEC_GAIN, 0, 0, 0
    ):
        raise UnavailableError("the kernel has no PR_SET_MDWE")
    error = int(getattr(errno, keys["SystemCallErrorNumber"][-1]))
    allowed = allowed_calls(keys["SystemCallFilter"])
    refuse_other_calls(allowed, " ".join(keys["RestrictAddressFamilies"]).split(), error)


def main() -> None:
    """Replace this process by the command."""
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    try:
        enter(Path(sys.argv[1]))
    except UnavailableError as reason:
        print(f"sandbox: {reason}", file=sys.stderr)
        sys.exit(EXIT_UNAVAILABLE)
    os.execvp(sys.argv[2], sys.argv[2:])


if __name__ == "__main__":
    main()
