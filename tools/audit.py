#!/usr/bin/env python3
"""Is a locked version touched by a known advisory? Asks a database on the disk, never the network.

Rules of this file: no database is no all-clear, it is said (skipped). Advisories that do not touch us stand with the
reason in pyproject.toml (`tool.hoopd.audit.accepted`). Exit code 1 when a version is touched, 2 when the database is
not usable. Usage: tools/audit.py [DATABASE] [--json FILE]; DATABASE is a folder or a zip of OSV files.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from dataclasses import asdict
from pathlib import Path

from advisories import Advisory, DatabaseError, load
from lockfile import LOCKS, ROOT, LockError, Pin, read


def accepted() -> dict[str, str]:
    """Identifier of an advisory -> why it does not touch us."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        return tomllib.load(stream)["tool"]["hoopd"]["audit"]["accepted"]


def line(pin: Pin, advisory: Advisory) -> str:
    """One finding in one line."""
    others = f" ({', '.join(advisory.aliases)})" if advisory.aliases else ""
    fixed = f"; fixed in {', '.join(advisory.fixed)}" if advisory.fixed else "; no version repairs it"
    return f"{pin.name} {pin.version}: {advisory.id}{others}: {advisory.summary or 'no summary'}{fixed}"


def reason(advisory: Advisory, reasons: dict[str, str]) -> str:
    """Why this advisory was accepted, by any of its names; empty when it was not."""
    return next((reasons[name] for name in (advisory.id, *advisory.aliases) if name in reasons), "")


def main() -> int:
    """One line for each finding, and what was asked."""
    parser = argparse.ArgumentParser(description="Check the locked versions against a database of advisories (OSV).")
    parser.add_argument("database", nargs="?", type=Path, help="folder or zip of OSV files")
    parser.add_argument("--lock", action="append", type=Path, help="lock file (default: all)")
    parser.add_argument("--json", type=Path, help="write the findings to this file")
    options = parser.parse_args()
    if options.database is None:
        print("audit: skipped, no database (make audit AUDIT_DB=FOLDER or ZIP of OSV files)")
        return 0
    try:
        database = load(options.database)
        pins = [pin for path in options.lock or LOCKS for pin in read(path)]
    except (DatabaseError, LockError) as error:
        print(f"audit: {error}", file=sys.stderr)
        return 2
    reasons = accepted()
    findings = [(pin, advisory) for pin in pins for advisory in database.touching(pin.name, pin.version)]
    touched = [(pin, advisory) for pin, advisory in findings if not reason(advisory, reasons)]
    for pin, advisory in findings:
        why = reason(advisory, reasons)
        print(line(pin, advisory) + (f" [accepted: {why}]" if why else ""))
    if options.json:
        rows = [{"name": pin.name, "version": pin.version, **asdict(advisory)} for pin, advisory in touched]
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    told = f"{database.count} advisories, the newest of {database.newest[:10] or 'no date'}"
    print(f"audit: {len(pins)} packages, {told}: {len(touched)} touched, {len(findings) - len(touched)} accepted")
    return 1 if touched else 0


if __name__ == "__main__":
    sys.exit(main())
