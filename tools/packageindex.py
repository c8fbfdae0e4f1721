"""Which files of a package the machine's package index offers for our targets, and their SHA-256 digests.

Rules of this file: standard library and pip only. The index is the one that pip is set up for (its configuration, its
environment, additional indexes and folders of files); no address is written down here. pip has no public call that
lists files, so its finder is taken, the one that `pip install` itself asks (tried with pip 23 and 24).
"""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lockfile import LockError
from pip._internal.commands import create_command
from pip._internal.models.target_python import TargetPython
from pip._internal.utils.compatibility_tags import get_supported
from pip._vendor.packaging.tags import Tag
from pip._vendor.packaging.utils import parse_wheel_filename

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

    @cached_property
    def tags(self) -> frozenset[Tag]:
        """Tags of the wheels that run there."""
        version = "".join(map(str, self.python))
        return frozenset(get_supported(version=version, platforms=self.platforms, impl="cp"))


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

    def fits(self, target: Target) -> bool:
        """A wheel that runs there."""
        return self.wheel and not target.tags.isdisjoint(parse_wheel_filename(self.name)[3])


class Index:
    """pip's own view of the package index."""

    def __init__(self, *arguments: str) -> None:
        """Take pip's set-up; `arguments` are options of `pip download` that come on top of it."""
        # A local index without the package is no news: pip asks every one of them.
        logging.getLogger("pip").setLevel(logging.ERROR)
        command: Any = create_command("download")
        options, _ = command.parse_args(list(arguments))
        self._session = command._build_session(options)
        self._finder = command._build_package_finder(options, self._session, _every_target())
        self._digests: dict[str, str] = {}

    def files(self, name: str, version: str) -> list[IndexFile]:
        """Source distributions, and wheels for any target. Raises LockError when two of one name differ."""
        links = [found.link for found in self._finder.find_all_candidates(name) if str(found.version) == version]
        return list(dict.fromkeys(IndexFile(link.filename, self._digest(link)) for link in links))

    def _digest(self, link: Any) -> str:
        digest = link.hash if link.hash_name == "sha256" else self._download(link.url_without_fragment)
        # The same file on two indexes must be the same bytes: otherwise one of them is not the original.
        if self._digests.setdefault(link.filename, digest) != digest:
            raise LockError(f"{link.filename}: the indexes offer two files of this name that differ")
        return digest

    def _download(self, url: str) -> str:
        """Digest of a file whose index gives none."""
        answer = self._session.get(url, stream=True, headers={"Accept-Encoding": "identity"})
        answer.raise_for_status()
        digest = hashlib.sha256()
        while data := answer.raw.read(CHUNK_BYTES):
            digest.update(data)
        return digest.hexdigest()


def _every_target() -> TargetPython:
    """pip's description of one interpreter, with the tags of all of ours: each package is asked for once."""
    union: Any = TargetPython(py_version_info=PYTHONS[0])
    union._valid_tags = list({tag for target in TARGETS for tag in target.tags})
    return union
