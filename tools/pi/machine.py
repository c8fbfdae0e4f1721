"""What this machine offers: its rights, its tools, its mirror of Debian, and a corner in which nothing is left behind.

Rules of this file: nothing is downloaded or built here; no host is named: mirror and package index are the machine's
own. Mounts live in a name space of this program and are gone with it, and so are its processes.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from pi.steps import SkippedError, run

ROOT = Path(__file__).resolve().parents[2]
CACHE_VARIABLE = "HOOPD_PI_CACHE"
CACHE = Path("/var/cache/hoopd-pi")
# Set in the copy of this program that runs in the name spaces of its own.
INSIDE = "HOOPD_PI_INSIDE"
# Debian's package of a tool.
PACKAGES = {
    "debootstrap": "debootstrap",
    "qemu-aarch64-static": "qemu-user-static",
    "systemd-nspawn": "systemd-container",
    "nsenter": "util-linux",
}
SOURCES = Path("/etc/apt")
BINFMT = Path("/proc/sys/fs/binfmt_misc")
BINFMT_NAME = "qemu-aarch64"
BINFMT_RULES = Path("/usr/lib/binfmt.d/qemu-aarch64.conf")
_CAP_SYS_RESOURCE = 24
_ONE_LINE = re.compile(r"^deb\s+(?:\[[^]]*\]\s+)?(\S+)\s+(\S+)", re.MULTILINE)


class Mirror(NamedTuple):
    """Where this machine's own packages come from."""

    address: str
    suite: str


def cache() -> Path:
    """Where roots and wheels stay from one run to the next."""
    return Path(os.environ.get(CACHE_VARIABLE) or CACHE)


def isolate(arguments: Sequence[str]) -> None:
    """Start anew in name spaces of mounts and processes of our own: what happens there ends with this program."""
    if os.environ.get(INSIDE):
        return
    words = ["unshare", "--mount", "--propagation", "private", "--pid", "--fork", "--kill-child", "--mount-proc"]
    os.environ[INSIDE] = "1"
    os.execvp(words[0], [*words, sys.executable, str(ROOT / "tools/pi"), *arguments])


def why_not() -> str:
    """What this machine lacks for any of it; empty when it has all."""
    if os.geteuid() != 0:
        return "needs root"
    if shutil.which("unshare") is None:
        return "needs unshare (util-linux)"
    return ""


def may_raise_limits() -> bool:
    """Root may give a process more than the hard limits of today (CAP_SYS_RESOURCE); a container's systemd needs it."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("CapEff:"))
    return bool(int(line.split()[1], 16) >> _CAP_SYS_RESOURCE & 1)


def need(*tools: str) -> str:
    """SkippedError with the packages that bring the missing ones of these tools."""
    missing = [tool for tool in tools if shutil.which(tool) is None]
    if missing:
        raise SkippedError("needs apt install " + " ".join(sorted({PACKAGES[tool] for tool in missing})))
    return "tools are there"


def mirror() -> Mirror:
    """Address and suite of the machine's own Debian; SkippedError where it is another system."""
    paths = [SOURCES / "sources.list", *sorted((SOURCES / "sources.list.d").glob("*"))]
    for path in (path for path in paths if path.suffix in (".list", ".sources") and path.is_file()):
        found = parse_sources(path.read_text(encoding="utf-8", errors="replace"))
        if (
            found is not None
            and "debian" in found.address
            and (Path("/usr/share/debootstrap/scripts") / found.suite).exists()
        ):
            return found
    raise SkippedError("no Debian mirror among this machine's apt sources")


def parse_sources(text: str) -> Mirror | None:
    """The first source of a file of apt's, in either of its two forms."""
    address, suite = (re.search(rf"^{name}:\s*(\S+)", text, re.MULTILINE) for name in ("URIs", "Suites"))
    if address and suite:
        return Mirror(address[1], suite[1])
    match = _ONE_LINE.search(text)
    return Mirror(match[1], match[2]) if match else None


def need_binfmt() -> str:
    """What is missing for programs of another architecture; empty when nothing is."""
    if "binfmt_misc" not in Path("/proc/filesystems").read_text(encoding="ascii"):
        return "needs binfmt_misc in the kernel"
    return "" if BINFMT_RULES.is_file() else "needs apt install qemu-user-static binfmt-support"


@contextmanager
def arm64_runs() -> Iterator[None]:
    """The kernel hands programs of arm64 to qemu; a rule that was not there before goes again."""
    if not (BINFMT / "register").exists():
        run(["mount", "-t", "binfmt_misc", "binfmt_misc", BINFMT], 20)
    rule = BINFMT / BINFMT_NAME
    ours = not rule.exists()
    if ours:
        (BINFMT / "register").write_bytes(BINFMT_RULES.read_bytes().strip())
    try:
        yield
    finally:
        if ours:
            with contextlib.suppress(OSError):
                rule.write_text("-1")


def overlay(lower: Path, scratch: Path) -> Path:
    """A root that may be written to and forgotten, above one that stays as it is."""
    scratch.mkdir(parents=True)
    run(["mount", "-t", "tmpfs", "-o", "mode=755", "tmpfs", scratch], 20)
    upper, work, merged = (scratch / name for name in ("upper", "work", "root"))
    for folder in (upper, work, merged):
        folder.mkdir()
    run(["mount", "-t", "overlay", "overlay", "-o", f"lowerdir={lower},upperdir={upper},workdir={work}", merged], 20)
    return merged


def unmount_below(folder: Path) -> None:
    """Take away every mount below a folder, the innermost first: what is deleted then are its own files alone."""
    lines = Path("/proc/self/mounts").read_text(encoding="utf-8").splitlines()
    for place in reversed([line.split()[1] for line in lines]):
        if Path(place).is_relative_to(folder.resolve()):
            run(["umount", "--lazy", place], 20)
