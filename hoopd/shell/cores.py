"""Cores of the machine: which ones the kernel keeps free, and who of the daemon belongs on one of those.

Rules of this file: a core is kept free by the kernel's command line (isolcpus), and given to the loop by the unit
(CPUAffinity); nothing here moves the loop.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from pathlib import Path

ISOLATED_FILE = Path("/sys/devices/system/cpu/isolated")
PRESENT_FILE = Path("/sys/devices/system/cpu/present")


def isolated_cores() -> set[int]:
    """Cores that the kernel leaves to those who ask for them (isolcpus); none where it does not say."""
    return _listed_in(ISOLATED_FILE)


def present_cores() -> set[int]:
    """Cores of the machine."""
    return _listed_in(PRESENT_FILE) or set(range(os.cpu_count() or 1))


def parse_cores(text: str) -> set[int]:
    """Numbers in a list, as the kernel (0-1,3) and systemd (0-1 3) write it."""
    spans = (part.partition("-") for part in text.replace(",", " ").split())
    return {core for first, _, last in spans for core in range(int(first), int(last or first) + 1)}


def unit_cores(unit: str = "hoopd.service") -> set[int]:
    """Cores that the unit holds its service to (CPUAffinity); none where it holds it to none, or is not there."""
    if shutil.which("systemctl") is None:
        return set()
    command = ["systemctl", "show", "--property=CPUAffinity", "--value", unit]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
    with contextlib.suppress(ValueError):
        return parse_cores(answer.stdout)
    return set()


def off_isolated_cores() -> tuple[str, ...]:
    """Prefix of a command that shall leave the loop its isolated core; empty where the loop has none.

    A child inherits the loop's cores, and on an isolated one the kernel moves nobody away.
    """
    isolated = isolated_cores()
    others = present_cores() - isolated
    if not (others and os.sched_getaffinity(0) <= isolated and shutil.which("taskset")):
        return ()
    return ("taskset", "--cpu-list", ",".join(map(str, sorted(others))))


def _listed_in(path: Path) -> set[int]:
    with contextlib.suppress(OSError, ValueError):
        return parse_cores(path.read_text(encoding="ascii"))
    return set()
