#!/usr/bin/env python3
"""Writes the lock files: every package that pyproject.toml leads to, its version, and the digests of its files.

Rules of this file: standard library and pip only. Locked with Python 3.11, the oldest that is supported, because a
package may drop it before 3.13. Every package needs a wheel for every target (packageindex.TARGETS), or nothing is
written: a Raspberry Pi would compile it for hours, with build tools that no digest covers.
  tools/lock.py              resolve anew in an environment of its own (make lock)
  tools/lock.py --keep       the same with the versions that are locked now; only what is missing is added
  tools/lock.py --from-here  write down what the running interpreter has installed
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping
from importlib.metadata import distribution
from pathlib import Path

import lockfile
from lockfile import DEVELOPMENT, LOCKS, PICAMERA2, ROOT, RUNTIME, LockError, canonical
from packageindex import TARGETS, Index
from pip._vendor.packaging.requirements import Requirement

OLDEST = (3, 11)
# `pip install --editable` asks the build backend for it.
EDITABLE = "editables"


def roots() -> dict[Path, list[str]]:
    """Lock file -> what it starts from: the daemon with its build backend, development, picamera2's own part."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        project = tomllib.load(stream)
    extras = project["project"]["optional-dependencies"]
    runtime = [*project["project"]["dependencies"], *project["build-system"]["requires"], EDITABLE]
    return {RUNTIME: runtime, DEVELOPMENT: extras["dev"], PICAMERA2: extras["picamera2"]}


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


def digests(packages: Mapping[str, str], index: Index) -> dict[str, set[str]]:
    """Name -> digests of all its files that fit a target. Raises LockError naming every wheel that is missing."""
    files = {name: index.files(name, version) for name, version in packages.items()}
    missing = [
        f"{name}=={version} for {target}"
        for name, version in packages.items()
        for target in TARGETS
        if not any(file.fits(target) for file in files[name])
    ]
    if missing:
        raise LockError(f"no wheel with a digest: {', '.join(missing)}")
    return {name: {file.sha256 for file in some} for name, some in files.items()}


def write() -> None:
    """All lock files, from the packages of the running interpreter; none of them when one package lacks a wheel."""
    packages = {path: closure(lines) for path, lines in roots().items()}
    for path in (DEVELOPMENT, PICAMERA2):
        packages[path] = {name: version for name, version in packages[path].items() if name not in packages[RUNTIME]}
    found = digests({name: version for some in packages.values() for name, version in some.items()}, Index())
    for path, versions in packages.items():
        lockfile.write(path, versions, found, include=RUNTIME.name if path == DEVELOPMENT else "")
        print(f"{path.name}: {len(versions)} packages, {sum(len(found[name]) for name in versions)} files")


def resolve(*, keep: bool) -> None:
    """The newest versions that fit, or with `keep` the locked ones, in an environment made for it."""
    with tempfile.TemporaryDirectory() as folder:
        python, kept = Path(folder) / "bin/python", Path(folder) / "kept.txt"
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        versions = lockfile.versions(LOCKS) if keep else {}
        kept.write_text("".join(f"{name}=={version}\n" for name, version in versions.items()), encoding="utf-8")
        wanted = [line for lines in roots().values() for line in lines]
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--constraint", kept, *wanted], check=True)
        subprocess.run([python, __file__, "--from-here"], check=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write the lock files.")
    parser.add_argument("--from-here", action="store_true", help="take the versions that are installed here")
    parser.add_argument("--keep", action="store_true", help="keep the versions that are locked now")
    options = parser.parse_args()
    if sys.version_info[:2] != OLDEST:
        sys.exit(f"lock: needs Python {OLDEST[0]}.{OLDEST[1]} (make lock PYTHON=python3.11)")
    try:
        write() if options.from_here else resolve(keep=options.keep)
    except LockError as error:
        sys.exit(f"lock: {error}")
    except subprocess.CalledProcessError as error:
        sys.exit(f"lock: {Path(error.cmd[0]).name} ended with exit code {error.returncode}")


if __name__ == "__main__":
    main()
