"""Advisories in the OSV format: which versions of a package one touches, and a database of them in a folder or a zip.

Rules of this file: nothing is fetched; what cannot be compared counts as touching, because a wrong alarm is looked at
and a wrong all-clear is not; a file that cannot be read ends the audit. Versions compare as PEP 440 says.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lockfile import canonical
from packaging.version import InvalidVersion, Version

ECOSYSTEM = "PyPI"
# OSV's "0" lies before every version; PEP 440's own smallest is a development release of zero.
ZERO, BEFORE_ALL = "0", Version("0.dev0")
# Ranges that compare as versions; GIT ranges name commits, of which an installed package knows nothing.
COMPARED = ("ECOSYSTEM", "SEMVER")


class DatabaseError(Exception):
    """The database is not usable; the text is one line."""


@dataclass(frozen=True)
class Advisory:
    """One advisory about one package; `fixed` are the versions that it calls repaired."""

    id: str
    aliases: tuple[str, ...]
    summary: str
    fixed: tuple[str, ...]


@dataclass
class Database:
    """Advisories by package name; `newest` is the date of the latest change in it (ISO 8601, empty when unknown)."""

    records: dict[str, list[Mapping[str, Any]]] = field(default_factory=dict)
    count: int = 0
    newest: str = ""

    def touching(self, name: str, version: str) -> list[Advisory]:
        """What touches this version, sorted by id."""
        found = {}
        for record in self.records.get(canonical(name), []):
            entries = [entry for entry in record["affected"] if _about(entry) == canonical(name)]
            if any(touches(entry, version) for entry in entries):
                found[record["id"]] = Advisory(
                    record["id"],
                    tuple(record.get("aliases") or ()),
                    str(record.get("summary") or record.get("details") or "").strip().split("\n")[0],
                    tuple(dict.fromkeys(fix for entry in entries for fix in _fixes(entry))),
                )
        return [found[name] for name in sorted(found)]


def load(path: Path) -> Database:
    """All advisories about Python packages of a folder (.json, any depth), a zip of such files or one file."""
    database = Database()
    try:
        for name, text in _texts(path):
            _add(database, name, text)
    except (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise DatabaseError(f"{path}: {error}") from None
    if not database.records:
        raise DatabaseError(f"{path}: no advisory about a package of {ECOSYSTEM} in it")
    return database


def _texts(path: Path) -> Iterator[tuple[str, bytes]]:
    if path.is_dir():
        for file in sorted(path.rglob("*.json")):
            yield str(file), file.read_bytes()
    elif zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            for name in sorted(name for name in archive.namelist() if name.endswith(".json")):
                yield f"{path}: {name}", archive.read(name)
    else:
        yield str(path), path.read_bytes()


def _add(database: Database, name: str, text: bytes) -> None:
    """Take one file's advisory in, unless it was withdrawn or is about no Python package."""
    try:
        record = json.loads(text)
        names = {_about(entry) for entry in record.get("affected") or []} - {""}
        withdrawn = record["id"] and record.get("withdrawn")
        # Judged once, so that a file of another form is told here and by its name.
        _ = [(touches(entry, ZERO), list(_fixes(entry))) for entry in record.get("affected") or [] if _about(entry)]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise DatabaseError(f"{name}: not an advisory in the OSV format") from None
    if withdrawn or not names:
        return
    database.count += 1
    database.newest = max(database.newest, str(record.get("modified") or ""))
    for package in names:
        database.records.setdefault(package, []).append(record)


def _about(entry: Mapping[str, Any]) -> str:
    """Package that an entry of `affected` is about; empty when it is none of Python's."""
    package = entry.get("package") or {}
    return canonical(package["name"]) if package.get("ecosystem", "").split(":")[0] == ECOSYSTEM else ""


def _fixes(entry: Mapping[str, Any]) -> Iterator[str]:
    for span in entry.get("ranges") or []:
        if span.get("type") in COMPARED:
            yield from (str(event["fixed"]) for event in span.get("events") or [] if "fixed" in event)


def touches(entry: Mapping[str, Any], version: str) -> bool:
    """Whether an entry of `affected` covers this version: by name, or by one of its ranges; one without either does."""
    spans = [span for span in entry.get("ranges") or [] if span.get("type") in COMPARED]
    listed = entry.get("versions") or []
    if not spans and not listed:
        return True
    try:
        return _listed(listed, version) or any(inside(span.get("events") or [], version) for span in spans)
    except InvalidVersion:
        return True


def _listed(versions: Sequence[str], version: str) -> bool:
    wanted = Version(version)
    return version in versions or any(_same(text, wanted) for text in versions)


def _same(text: str, wanted: Version) -> bool:
    try:
        return Version(text) == wanted
    except InvalidVersion:
        return False  # a name from before PEP 440; nothing that we lock is called so


def inside(events: Sequence[Mapping[str, str]], version: str) -> bool:
    """Whether a version lies in a range of OSV events. Raises InvalidVersion when it cannot be compared.

    From `introduced` (inclusive) to the next `fixed` (exclusive) or `last_affected` (inclusive), and before one of the
    limits, if there are any.
    """
    at = Version(version)
    limits = [event["limit"] for event in events if "limit" in event]
    if limits and not any(limit == "*" or at < Version(limit) for limit in limits):
        return False
    steps = [(_position(number), kind) for event in events for kind, number in event.items() if kind != "limit"]
    affected = False
    for position, kind in sorted(steps, key=lambda step: step[0]):
        if kind == "introduced" and at >= position:
            affected = True
        elif (kind == "fixed" and at >= position) or (kind == "last_affected" and at > position):
            affected = False
    return affected


def _position(number: str) -> Version:
    return BEFORE_ALL if number == ZERO else Version(number)
