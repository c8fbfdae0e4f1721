#!/usr/bin/env python3
"""Has every pinned package a wheel for every target, and does its lock file know that wheel's digest?

Rules of this file: asks the package index and downloads nothing; source distributions do not count. Exit code 1 when
one wheel is missing or another than the locked one is offered. Usage: tools/check_wheels.py [LOCK...] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from lockfile import LOCKS, LockError, Pin, read
from packageindex import TARGETS, Index, IndexFile, Target

COLUMN = 17
MISSING, UNKNOWN = "MISSING", "NOT LOCKED"


def state(pin: Pin, target: Target, files: Sequence[IndexFile]) -> str:
    """The oldest platform of a locked wheel that runs there, or what is wrong."""
    wheels = [file for file in files if file.fits(target)]
    if not wheels:
        return MISSING
    locked = [file for file in wheels if file.sha256 in pin.digests]
    return min(locked[0].name.removesuffix(".whl").split("-")[-1].split(".")) if locked else UNKNOWN


def main() -> int:
    """Table on the terminal, exit code 1 when something is wrong."""
    parser = argparse.ArgumentParser(description="Check that every pinned package has wheels whose digests are locked.")
    parser.add_argument("lock", nargs="*", type=Path, help="lock files (default: all)")
    parser.add_argument("--json", type=Path, help="write the result to this file")
    options = parser.parse_args()
    index = Index()
    try:
        pins = [pin for path in options.lock or LOCKS for pin in read(path)]
        files = {pin: index.files(pin.name, pin.version) for pin in pins}
    except LockError as error:
        sys.exit(f"check_wheels: {error}")
    table = {pin: {target: state(pin, target, files[pin]) for target in TARGETS} for pin in pins}
    width = max(len(f"{pin.name} {pin.version}") for pin in pins) + 2
    print("package".ljust(width) + "".join(str(target).ljust(COLUMN) for target in TARGETS).rstrip())
    for pin, row in table.items():
        cells = "".join(text.removesuffix(f"_{target.machine}").ljust(COLUMN) for target, text in row.items())
        print(f"{pin.name} {pin.version}".ljust(width) + cells.rstrip())
    wrong = [
        f"{pin.name} for {target}: {text}"
        for pin, row in table.items()
        for target, text in row.items()
        if text in (MISSING, UNKNOWN)
    ]
    if options.json:
        rows = {pin.name: {str(target): text for target, text in row.items()} for pin, row in table.items()}
        options.json.write_text(json.dumps({"wheels": rows, "wrong": wrong}, indent=2) + "\n", encoding="utf-8")
    print(f"{len(pins)} packages, missing: {', '.join(wrong) or 'none'}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
