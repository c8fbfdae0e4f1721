#!/usr/bin/env python3
"""Does every pinned package have a wheel for the Raspberry Pi? Asks the package index; downloads nothing.

Rules of this file: standard library and pip only; source distributions do not count, because a Raspberry Pi would
compile them for hours. Exit code 1 when one wheel is missing. Usage: tools/check_wheels.py [LOCK...] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.13")
# glibc of Raspberry Pi OS: bookworm 2.36, trixie 2.41. A wheel for an older one runs on both.
PLATFORMS = (*(f"manylinux_2_{minor}_aarch64" for minor in range(36, 16, -1)), "manylinux2014_aarch64")
COLUMN = 42
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;]+)")


def pins(paths: Sequence[Path]) -> dict[str, str]:
    """Name -> version of every pinned line."""
    found: dict[str, str] = {}
    for path in paths:
        for line in path.read_text(encoding="utf-8").splitlines():
            if match := _PIN.match(line):
                found[match.group(1)] = match.group(2)
    return found


def resolve(requirements: Sequence[str], python: str) -> tuple[dict[str, str], str]:
    """Name -> wheel that pip would take for this Python on the Raspberry Pi, and pip's complaint if it found none."""
    with tempfile.TemporaryDirectory() as folder:
        platforms = [argument for platform in PLATFORMS for argument in ("--platform", platform)]
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--no-deps", "--ignore-installed"]
        command += ["--only-binary=:all:", "--implementation", "cp", "--python-version", python, *platforms]
        command += ["--target", folder, "--report", "-", "--disable-pip-version-check", *requirements]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        return {}, next((line for line in result.stderr.splitlines() if "No matching" in line), result.stderr[-300:])
    items = json.loads(result.stdout)["install"]
    return {canonical(item["metadata"]["name"]): item["download_info"]["url"].rsplit("/", 1)[1] for item in items}, ""


def wheels(packages: dict[str, str], python: str) -> dict[str, str]:
    """Name -> wheel, empty where there is none. All in one question; one by one only when something is missing."""
    requirements = [f"{name}=={version}" for name, version in packages.items()]
    found, complaint = resolve(requirements, python)
    if complaint:
        for line in requirements:
            found |= resolve([line], python)[0]
    return {name: found.get(canonical(name), "") for name in packages}


def canonical(name: str) -> str:
    """Package name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def tag(wheel: str) -> str:
    """Tags of a wheel's name: python-abi-platform, the oldest platform of several."""
    if not wheel:
        return "MISSING"
    python, abi, platform = wheel.removesuffix(".whl").split("-")[-3:]
    return f"{python}-{abi}-{sorted(platform.split('.'))[0]}"


def main() -> int:
    """Table on the terminal, exit code 1 when a wheel is missing."""
    parser = argparse.ArgumentParser(description="Check that every pinned package has wheels for the Raspberry Pi.")
    parser.add_argument("lock", nargs="*", type=Path, help="lock files (default: both)")
    parser.add_argument("--json", type=Path, help="write the result to this file")
    options = parser.parse_args()
    packages = pins(options.lock or [ROOT / "requirements.lock", ROOT / "requirements-dev.lock"])
    table = {python: wheels(packages, python) for python in PYTHONS}
    width = max(map(len, packages)) + max(map(len, packages.values())) + 3
    print("package".ljust(width) + "".join(f"cp{python} aarch64".ljust(COLUMN) for python in PYTHONS).rstrip())
    for name, version in packages.items():
        cells = "".join(tag(table[python][name]).ljust(COLUMN) for python in PYTHONS)
        print(f"{name} {version}".ljust(width) + cells.rstrip())
    missing = [f"{name} for {python}" for python in PYTHONS for name in packages if not table[python][name]]
    if options.json:
        options.json.write_text(json.dumps({"wheels": table, "missing": missing}, indent=2) + "\n", encoding="utf-8")
    print(f"{len(packages)} packages, missing: {', '.join(missing) or 'none'}")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
