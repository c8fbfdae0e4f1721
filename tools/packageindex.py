"""Which files of a package the machine's package index offers for our targets, and their SHA-256 digests.

Rules of this file: standard library and pip only. The index is the one that pip is set up for (its configuration, its
environment, additional indexes and folders of files); no address is written down here. pip has no public call that
lists files, so its finder is taken, the one that `pip install` itself asks (tried with pip 23 and 24).
"""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass
from typing import Any

from lockfile import LockError
from pip._internal.commands import create_command
from pip._internal.models.target_python import TargetPython

PYTHONS = ((3, 11), (3, 12), (3, 13))
# glibc of Raspberry Pi OS: bookworm 2.36, trixie 2.41. A wheel for an older one runs on both.
GLIBC_MINORS = range(36, 4, -1)
LEGACY = {"x86_64": ("manylinux2014", "manylinux2010", "manylinux1"), "aarch64": ("manylinux2014",)}
CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class Target:
    """An interpreter on a machine that the lock files are made for."""

    python: tuple[int, int]
    machine: str

    def __str__(self) -> str:
        return f"cp{self.python[0]}{self.python[1]} {self.machine}"

    @property
    def platforms(self) -> list[str]:
        """Platform tags that run there, newest glibc first."""
        return [
            *(f"manylinux_2_{minor}_{self.machine}" for minor in GLIBC_MINORS),
            *(f"{name}_{self.machine}" for name in LEGACY[self.machine]),
            f"linux_{self.machine}",
        ]


TARGETS = tuple(Target(python, machine) for machine in LEGACY for python in PYTHONS)


@dataclass(frozen=True)
class IndexFile:
    """A wheel or a source distribution on an index; `sha256` in hexadecimal."""

    name: str
    sha256: str

    @property
    def wheel(self) -> bool:
        """Installs without being built."""
        return self.name.endswith(".whl")


class Index:
    """pip's own view of the package index, for one target after another."""

    def __init__(self, *arguments: str) -> None:
        """Take pip's set-up; `arguments` are options of `pip download` that come on top of it."""
        # A local index without the package is no news: pip asks every one of them.
        logging.getLogger("pip").setLevel(logging.ERROR)
        command: Any = create_command("download")
        options, _ = command.parse_args(list(arguments))
        self._session = command._build_session(options)
        self._finders = {
            target: command._build_package_finder(options, self._session, _pip_s(target)) for target in TARGETS
        }
        self._digests: dict[str, str] = {}
        self._downloads: dict[str, str] = {}

    def files(self, name: str, version: str, target: Target) -> list[IndexFile]:
        """What fits this target, best first. Raises LockError when an index offers one name with two contents."""
        candidates = self._finders[target].find_all_candidates(name)
        links = [candidate.link for candidate in reversed(candidates) if str(candidate.version) == version]
        return list(dict.fromkeys(IndexFile(link.filename, self._digest(link)) for link in links))

    def wheel(self, name: str, version: str, target: Target) -> IndexFile | None:
        """The wheel that pip would take there."""
        return next((file for file in self.files(name, version, target) if file.wheel), None)

    def _digest(self, link: Any) -> str:
        digest = link.hash if link.hash_name == "sha256" else self._download(link.url_without_fragment)
        # The same file on two indexes must be the same bytes: otherwise one of them is not the original.
        if self._digests.setdefault(link.filename, digest) != digest:
            raise LockError(f"{link.filename}: the indexes offer two files of this name that differ")
        return digest

    def _download(self, url: str) -> str:
        """Digest of a file whose index gives none; read once."""
        if url not in self._downloads:
            answer = self._session.get(url, stream=True, headers={"Accept-Encoding": "identity"})
            answer.raise_for_status()
            digest = hashlib.sha256()
            while data := answer.raw.read(CHUNK_BYTES):
                digest.update(data)
            self._downloads[url] = digest.hexdigest()
        return self._downloads[url]


def _pip_s(target: Target) -> TargetPython:
    return TargetPython(platforms=target.platforms, py_version_info=target.python, implementation="cp")
