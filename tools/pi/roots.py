"""Debian's userland in a folder, and the wheels that belong into it; both are made once and kept.

Rules of this file: a root is complete or it is made anew; wheels come from the machine's own package index, by the
lock files, and are installed without one.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from pathlib import Path

from pi.machine import ROOT, Mirror, cache, mirror
from pi.steps import demand, run

# What the steps need beside Debian's smallest system.
COMMON = ("python3", "python3-venv", "python3-pip", "ca-certificates")
INCLUDE = {
    "arm64": COMMON,
    "amd64": (*COMMON, "systemd", "systemd-sysv", "udev", "dbus", "make", "procps", "util-linux"),
}
# Unpacking takes half a minute; under emulation the packages' own scripts take 4 minutes on an idle machine.
FIRST_STAGE_S, SECOND_STAGE_S = 900.0, 1800.0
DOWNLOAD_S = 900.0
LOCKS = ("requirements.lock", "requirements-dev.lock")
# glibc of bookworm is 2.36; a wheel for an older one runs there.
MACHINE = {"arm64": "aarch64", "amd64": "x86_64"}
PYTHON = {"bookworm": "3.11", "trixie": "3.13"}


def userland(architecture: str) -> Path:
    """A complete root of this architecture, made when it is not there yet."""
    source = mirror()
    place = cache() / f"{source.suite}-{architecture}"
    recipe = " ".join((source.suite, architecture, *INCLUDE[architecture]))
    mark = place.with_suffix(".complete")
    if place.is_dir() and mark.is_file() and mark.read_text() == recipe:
        return place
    mark.unlink(missing_ok=True)
    shutil.rmtree(place, ignore_errors=True)
    place.parent.mkdir(parents=True, exist_ok=True)
    _bootstrap(place, architecture, source)
    mark.write_text(recipe)
    return place


def _bootstrap(place: Path, architecture: str, source: Mirror) -> None:
    foreign = ["--foreign"] if architecture != _own() else []
    packages = ",".join(INCLUDE[architecture])
    command = ["debootstrap", *foreign, f"--arch={architecture}", "--variant=minbase", f"--include={packages}"]
    run([*command, source.suite, place, source.address], FIRST_STAGE_S)
    if foreign:
        run(["chroot", place, "/debootstrap/debootstrap", "--second-stage"], SECOND_STAGE_S)


def _own() -> str:
    return {"x86_64": "amd64", "aarch64": "arm64"}.get(os.uname().machine, os.uname().machine)


def wheels(architecture: str) -> Path:
    """A folder with every wheel of both lock files for that architecture and Debian's own Python."""
    python = PYTHON[mirror().suite]
    text = "".join((ROOT / lock).read_text(encoding="utf-8") for lock in LOCKS)
    digest = hashlib.sha256(text.encode()).hexdigest()[:12]
    place = cache() / f"wheels-{architecture}-{python}-{digest}"
    if (place / "complete").is_file():
        return place
    machine = MACHINE[architecture]
    platforms = [f"manylinux_2_{minor}_{machine}" for minor in range(36, 16, -1)] + [f"manylinux2014_{machine}"]
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:", "--dest", place]
    command += ["--implementation", "cp", "--python-version", python, "--disable-pip-version-check"]
    command += [word for platform in platforms for word in ("--platform", platform)]
    for lock in LOCKS:
        run([*command, "-r", ROOT / lock], DOWNLOAD_S, folder=ROOT)
    names = [path.name for path in place.glob("*.whl")]
    demand(bool(names), "no wheel was downloaded")
    (place / "complete").write_text("\n".join(names))
    return place


def count_wheels(place: Path, machine: str) -> tuple[int, int]:
    """How many wheels, and how many of them were made for that machine."""
    names = [path.name for path in place.glob("*.whl")]
    return len(names), sum(machine in name for name in names)
