#!/usr/bin/env python3
"""Lists the licence of every locked package, and fails for one that has none or none that is permitted.

Rules of this file: what a package says of itself (its installed metadata) counts: an SPDX expression, a short name, a
classifier, in this order. What says nothing clear is a failure until somebody has read the licence and written it into
pyproject.toml (`tool.hoopd.licences.stated`). Exit code 1 for a failure. Usage: tools/licences.py [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from lockfile import DEVELOPMENT, PICAMERA2, ROOT, RUNTIME, Pin, read
from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

GROUPS = {"runtime": RUNTIME, "development": DEVELOPMENT, "picamera2": PICAMERA2}
# Not more than a name; longer ones are the licence's whole text.
LONGEST_NAME = 60
# "BSD" alone leaves open with how many clauses; both are permissive.
BSD = "LicenseRef-BSD"
CLASSIFIERS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": BSD,
    "Eclipse Public License 2.0 (EPL-2.0)": "EPL-2.0",
    "GNU General Public License v3 (GPLv3)": "GPL-3.0-only",
    "GNU Lesser General Public License v3 or later (LGPLv3+)": "LGPL-3.0-or-later",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
NAMES = {**CLASSIFIERS, "Apache 2.0": "Apache-2.0", "BSD": BSD, "BSD 2-Clause License": "BSD-2-Clause"}


@dataclass(frozen=True)
class Licence:
    """A package's licence: SPDX expression, empty when unclear; `trouble` says why it fails, empty when it does not."""

    name: str
    version: str
    licence: str
    trouble: str = ""


def expression(metadata: Mapping[str, str], classifiers: Sequence[str]) -> str:
    """SPDX expression of what a package says; empty when it says nothing, or two things without how they belong."""
    if text := metadata.get("License-Expression"):
        return text
    if name := spdx(metadata.get("License", "")):
        return name
    listed = [line.split("::")[-1].strip() for line in classifiers if line.startswith("License ::")]
    known = {CLASSIFIERS[line] for line in listed if line in CLASSIFIERS}
    return known.pop() if len(known) == 1 else ""


def spdx(text: str) -> str:
    """A short licence field as SPDX, empty when it is none."""
    text = text.strip()
    if not text or "\n" in text or len(text) > LONGEST_NAME:
        return ""
    try:
        return canonicalize_license_expression(text)
    except InvalidLicenseExpression:
        return NAMES.get(text, "")


def permitted(text: str, allowed: Collection[str]) -> bool:
    """Whether an SPDX expression can be met with these licences: of OR one side, of AND both; WITH only adds rights."""
    words = re.findall(r"[()]|[^\s()]+", text)

    def either() -> bool:
        left = both()
        while words and words[0].upper() == "OR":
            words.pop(0)
            left = both() or left
        return left

    def both() -> bool:
        left = single()
        while words and words[0].upper() == "AND":
            words.pop(0)
            left = single() and left
        return left

    def single() -> bool:
        word = words.pop(0)
        if word == "(":
            inner = either()
            words.pop(0)
            return inner
        if words and words[0].upper() == "WITH":
            del words[:2]
        return word in allowed

    return either()


def judge(pin: Pin, allowed: Collection[str], stated: Mapping[str, str]) -> Licence:
    """The licence of one locked package."""
    try:
        package = distribution(pin.name)
    except PackageNotFoundError:
        text = stated.get(pin.name, "")
        return Licence(pin.name, pin.version, text, verdict(text, allowed) if text else "not installed here")
    if package.version != pin.version:
        return Licence(pin.name, pin.version, "", f"{package.version} is installed: make, then again")
    classifiers = package.metadata.get_all("Classifier") or []
    fields = {key: (package.metadata.get_all(key) or [""])[0] for key in ("License-Expression", "License")}
    text = expression(fields, classifiers) or stated.get(pin.name, "")
    return Licence(pin.name, pin.version, text, verdict(text, allowed))


def verdict(text: str, allowed: Collection[str]) -> str:
    """What is wrong with a licence; empty when nothing is."""
    if not text:
        return "no clear licence"
    try:
        canonicalize_license_expression(text)
    except InvalidLicenseExpression:
        return "not an SPDX expression"
    return "" if permitted(text, allowed) else "not permitted"


def settings() -> tuple[list[str], dict[str, str]]:
    """Permitted licences, and those that somebody has read for us, from pyproject.toml."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        table = tomllib.load(stream)["tool"]["hoopd"]["licences"]
    return table["permitted"], table["stated"]


def main() -> int:
    """A table for each lock file, exit code 1 when a licence is missing or not permitted."""
    parser = argparse.ArgumentParser(description="List the licences of all dependencies.")
    parser.add_argument("--json", type=Path, help="write the list to this file")
    options = parser.parse_args()
    allowed, stated = settings()
    groups = {group: [judge(pin, allowed, stated) for pin in read(path)] for group, path in GROUPS.items()}
    for group, rows in groups.items():
        print(f"{group}: {len(rows)} packages")
        for row in rows:
            print(
                f"  {row.name:<24}{row.version:<18}{row.licence or '-'}{f'  <- {row.trouble}' if row.trouble else ''}"
            )
    if options.json:
        listed = {group: [asdict(row) for row in rows] for group, rows in groups.items()}
        options.json.write_text(json.dumps(listed, indent=2) + "\n", encoding="utf-8")
    bad = [f"{row.name}: {row.trouble}" for rows in groups.values() for row in rows if row.trouble]
    unused = sorted(set(stated) - {row.name for rows in groups.values() for row in rows})
    bad += [f"{name}: stated in pyproject.toml, but not locked" for name in unused]
    print(f"licences: {'; '.join(bad) or 'all permitted'}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
