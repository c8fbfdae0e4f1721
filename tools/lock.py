#!/usr/bin/env python3
"""Writes the lock files: every package that pyproject.toml leads to, with the one version that is used everywhere.

Rules of this file: standard library and pip only. Locked with Python 3.11, the oldest that is supported, because a
package may drop it before 3.13; `make wheels` then proves that 3.13 and the Raspberry Pi have the same versions.
  tools/lock.py              resolve anew in an environment of its own (make lock)
  tools/lock.py --from-here  write down what the running interpreter has installed
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from importlib.metadata import distribution
from pathlib import Path

from pip._vendor.packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
OLDEST = (3, 11)
# `pip install --editable` asks the build backend for it.
EDITABLE = "editables"
RUNTIME, DEVELOPMENT = ROOT / "requirements.lock", ROOT / "requirements-dev.lock"
HEADER = "# Made by `make lock`, checked by `make wheels`; one set for CPython 3.11 to 3.13 on x86-64 and aarch64.\n"


def roots() -> tuple[list[str], list[str]]:
    """Requirements of the daemon with its build backend, and those of development."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        project = tomllib.load(stream)
    runtime = [*project["project"]["dependencies"], *project["build-system"]["requires"], EDITABLE]
    extras = project["project"]["optional-dependencies"]
    return runtime, [line for lines in extras.values() for line in lines if not line.startswith("hoopd")]


def closure(requirements: Iterable[str]) -> dict[str, str]:
    """Name -> version of everything that these requirements lead to in this environment."""
    found: dict[str, str] = {}
    waiting = [Requirement(line) for line in requirements]
    seen: set[tuple[str, str]] = set()
    while waiting:
        requirement = waiting.pop()
        for extra in ("", *sorted(requirement.extras)):
            name = canonical(requirement.name)
            if (name, extra) in seen:
                continue
            seen.add((name, extra))
            package = distribution(requirement.name)
            found[name] = package.version
            needs = [Requirement(line) for line in package.requires or []]
            waiting += [need for need in needs if need.marker is None or need.marker.evaluate({"extra": extra})]
    return found


def canonical(name: str) -> str:
    """Package name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def write() -> None:
    """Both lock files, from the packages of the running interpreter."""
    runtime, development = (closure(lines) for lines in roots())
    RUNTIME.write_text(HEADER + lines_of(runtime), encoding="utf-8")
    tools = {name: number for name, number in development.items() if name not in runtime}
    DEVELOPMENT.write_text(HEADER + "-r requirements.lock\n" + lines_of(tools), encoding="utf-8")
    print(f"{RUNTIME.name}: {len(runtime)} packages; {DEVELOPMENT.name}: {len(tools)} more")


def lines_of(packages: dict[str, str]) -> str:
    return "".join(f"{name}=={packages[name]}\n" for name in sorted(packages))


def resolve() -> None:
    """The newest versions that fit, in an environment made for it."""
    with tempfile.TemporaryDirectory() as folder:
        python = Path(folder) / "bin/python"
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        runtime, development = roots()
        subprocess.run([python, "-m", "pip", "install", "--quiet", *runtime, *development], check=True)
        subprocess.run([python, __file__, "--from-here"], check=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write requirements.lock and requirements-dev.lock.")
    parser.add_argument("--from-here", action="store_true", help="take the versions that are installed here")
    options = parser.parse_args()
    if sys.version_info[:2] != OLDEST:
        sys.exit(f"lock: needs Python {OLDEST[0]}.{OLDEST[1]} (make lock PYTHON=python3.11)")
    (write if options.from_here else resolve)()


if __name__ == "__main__":
    main()
