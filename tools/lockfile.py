"""Lock files: one version of each package with the digests of every file that may be installed.

Rules of this file: standard library only, because the checks read it too, where nothing else is installed. The form
is pip's own, so that `pip install --require-hashes -r FILE` reads it without us.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RUNTIME = ROOT / "requirements.lock"
DEVELOPMENT = ROOT / "requirements-dev.lock"
# What the installer's --picamera2 adds on the Raspberry Pi.
PICAMERA2 = ROOT / "requirements-picamera2.lock"
LOCKS = (RUNTIME, DEVELOPMENT, PICAMERA2)
HEADER = "# Made by `make lock`, checked by `make wheels`; one set for CPython 3.11 to 3.13 on x86-64 and aarch64.\n"
_PIN = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)==(\S+)((?:\s+--hash=sha256:[0-9a-f]{64})+)")
_DIGEST = re.compile(r"sha256:([0-9a-f]{64})")


class LockError(Exception):
    """A lock file, or what it is made from, is not usable; the text is one line."""


@dataclass(frozen=True)
class Pin:
    """One package of a lock file; digests are SHA-256 in hexadecimal."""

    name: str
    version: str
    digests: tuple[str, ...]


def canonical(name: str) -> str:
    """Package name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def read(path: Path) -> list[Pin]:
    """The pins of one lock file, without those of files that it includes. Raises LockError at the first other line."""
    text = path.read_text(encoding="utf-8")
    lines = re.sub(r"\\\n", " ", text).splitlines()
    pins = []
    for line in lines:
        if not line.strip() or line.startswith(("#", "-r ")):
            continue
        match = _PIN.fullmatch(line.strip())
        if match is None:
            raise LockError(f"{path.name}: {line.strip()[:80]!r} is not NAME==VERSION with SHA-256 digests")
        pins.append(Pin(match[1], match[2], tuple(_DIGEST.findall(match[3]))))
    return pins


def versions(paths: Iterable[Path]) -> dict[str, str]:
    """Name -> version of every pin of these files."""
    return {pin.name: pin.version for path in paths for pin in read(path)}


def write(path: Path, packages: Mapping[str, str], digests: Mapping[str, Iterable[str]], *, include: str = "") -> None:
    """A lock file with these versions. Names and digests are sorted: the same set gives the same bytes."""
    pins = [_pin(name, packages[name], sorted(set(digests[name]))) for name in sorted(packages)]
    path.write_text(HEADER + (f"-r {include}\n" if include else "") + "".join(pins), encoding="utf-8")


def _pin(name: str, version: str, digests: list[str]) -> str:
    if not digests:
        raise LockError(f"{name}=={version}: no digest")
    return " \\\n".join([f"{name}=={version}", *(f"    --hash=sha256:{digest}" for digest in digests)]) + "\n"
