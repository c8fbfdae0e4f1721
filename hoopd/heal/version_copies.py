"""Copies of versions in the daemon's folder of controllers: files that nobody else writes to, each with its model.

A daemon loads by name and hash, and the model by its name alone. The name under which a loop was found is a person's:
what is designed anew, or fitted anew, takes its place, and the version of before could not be brought back by it.

Rules of this file: a version's own bytes, laid in under a name of theirs; nothing in the folder is ever replaced.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hoopd.files.heal_versions import FOUND, VersionFolder
from hoopd.files.reading import InputError

# NAME.yaml@SHA256 of a controller and its model that are laid into the daemon's folder under a name.
LayIn = Callable[[str, Path, Path], str]


def laid_copy(folder: VersionFolder, number: int, lay_in: LayIn) -> str:
    """NAME.yaml@SHA256 of a version's copy, which is laid in where it is not there; InputError when it cannot be, or
    when the version's own files were changed."""
    folder.check(number)
    place = folder.of(number)
    return lay_in(folder.copy_name(number), place / "controller.yaml", place / "model.yaml")


def lay_copy(folder: VersionFolder, number: int, lay_in: LayIn) -> str:
    """As `laid_copy`; the version knows it from now on."""
    key = laid_copy(folder, number, lay_in)
    version = folder.read(number)
    if key not in version.keys:
        version.copy = key
        folder.keep(version, version.begun)
    return key


def lay_copies(folder: VersionFolder, lay_in: LayIn, tell: Callable[[str], None]) -> None:
    """Of every version that was found and of the one that acts, so that each can be brought back; `tell`: why not."""
    acting = folder.loop().acting
    for version in folder.every():
        if version.kind == FOUND or version.number == acting:
            try:
                lay_copy(folder, version.number, lay_in)
            except InputError as error:
                tell(f"version {version.number} has no copy in the daemon's folder of controllers: {error}")
