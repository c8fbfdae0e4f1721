"""The Raspberry Pi's userland and service manager: `make check-pi`, or `python tools/pi [arm64] [systemd]`.

Prints a table of steps with their verdicts and times; exit code 1 when one failed. Needs root, debootstrap,
qemu-user-static and systemd-container; what a machine cannot do is skipped, and says so. Roots and wheels are kept in
$HOOPD_PI_CACHE (default /var/cache/hoopd-pi, about 1.2 GB): the first run needs the network and a quarter of an hour
more. Mounts and processes live in name spaces of this program alone and are gone with it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from pi import machine, service
from pi.arm import Emulated
from pi.steps import Row, SkippedError, StepError, perform, show

PARTS = ("arm64", "systemd")


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", metavar="PART", help=f"{' or '.join(PARTS)} (default: both)")
    options = parser.parse_args()
    wanted = options.part or list(PARTS)
    if unknown := set(wanted) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    if reason := machine.why_not():
        return show([Row(part, "skipped", 0.0, reason) for part in wanted])
    machine.isolate(sys.argv[1:])
    with tempfile.TemporaryDirectory(prefix="hoopd-pi-", ignore_cleanup_errors=True) as name:
        try:
            rows = [row for part in wanted for row in MAKERS[part](Path(name))]
        finally:
            machine.unmount_below(Path(name))
    return show(rows)


def emulated(scratch: Path) -> list[Row]:
    """Steps in arm64's userland."""
    if machine.need_binfmt():
        return [Row("arm64: emulation", "skipped", 0.0, machine.need_binfmt())]
    with machine.arm64_runs():
        return perform(Emulated(scratch).steps())


def under_systemd(scratch: Path) -> list[Row]:
    """Steps in a container with systemd."""
    begun = time.monotonic()
    try:
        with service.running(scratch) as running:
            return perform(running.steps())
    except SkippedError as reason:
        return [Row("systemd: container", "skipped", time.monotonic() - begun, str(reason))]
    except (StepError, OSError) as error:
        return [Row("systemd: container", "FAILED", time.monotonic() - begun, str(error))]


MAKERS = {"arm64": emulated, "systemd": under_systemd}
