"""The recordings of one folder: which there are, what is known of each, and what people wrote about them.

Rules of this file: a name is one that the folder lists, anything else does not exist; nothing here reads a recording
(another process does, `glance`); what people write lies beside the results and never in a recording.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from hoopd.dashboard.work.background import background
from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file
from hoopd.recording.formats import EXTENSIONS

NAME_CHARACTERS = 200
MOST = 2000  # recordings that a page lists
TAGS, TAG_CHARACTERS, NOTE_CHARACTERS = 12, 40, 4000
GLANCE_S = 120.0  # a recording that takes longer to read shows no picture of itself
NOTES = "notes.json"
# A recording that is being written changes four times a second: it is looked at once it is finished, not each time.
GROWS_S = 2.0


class Listed(NamedTuple):
    """One recording of the folder."""

    name: str
    bytes: int
    changed: float  # s since 1970


class Remark(msgspec.Struct, forbid_unknown_fields=True):
    """What somebody wrote about a recording."""

    name: str
    tags: list[str] = []
    note: str = ""


class Recordings:
    """A folder, what a glance at each of its recordings showed, and remarks."""

    def __init__(self, folder: Path, results: Path) -> None:
        """`results`: where remarks are kept; both exist."""
        self.folder, self._notes = folder, results / NOTES
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._glances: dict[Listed, dict[str, Any]] = {}
        self._remarks: dict[str, Remark] = self._kept()
        self._looking: threading.Thread | None = None
        self._closed = threading.Event()

    def listed(self) -> list[Listed]:
        """Recordings that lie directly in the folder, the newest first; links that lead elsewhere are none."""
        found = []
        try:
            entries = [*self.folder.iterdir()]
        except OSError:
            return []
        for entry in entries:
            if entry.suffix.lower() not in EXTENSIONS or not _is_usable(entry.name) or entry.is_symlink():
                continue
            try:
                stat = entry.stat()
            except OSError:
                continue
            if entry.is_file():
                found.append(Listed(entry.name, stat.st_size, stat.st_mtime))
        return sorted(found, key=lambda one: (-one.changed, one.name))[:MOST]

    def path(self, name: str) -> Path:
        """Where a recording of that name lies; InputError when the folder lists none."""
        if not any(one.name == name for one in self.listed()):
            raise InputError("recording", name[:NAME_CHARACTERS], "no such recording")
        return self.folder / name

    def told(self) -> list[dict[str, Any]]:
        """Everything that is known of each; what nobody has looked at yet is looked at from now on."""
        listed = self.listed()
        with self._lock:
            self._glances = {one: glance for one, glance in self._glances.items() if one in set(listed)}
            glances, remarks = dict(self._glances), dict(self._remarks)
        finished = [one for one in listed if time.time() - one.changed > GROWS_S]
        self._look([one for one in finished if one not in glances])
        return [{**one._asdict(), "glance": glances.get(one), **_words(remarks.get(one.name))} for one in listed]

    def remark(self, remark: Remark) -> None:
        """Keep what somebody wrote; InputError for too much of it, and where it cannot be written."""
        self.path(remark.name)
        tags = [*dict.fromkeys(tag.strip() for tag in remark.tags if tag.strip())]
        if len(tags) > TAGS or any(len(tag) > TAG_CHARACTERS for tag in tags):
            raise InputError("tags", "", f"at most {TAGS} of {TAG_CHARACTERS} characters")
        if len(remark.note) > NOTE_CHARACTERS:
            raise InputError("note", "", f"at most {NOTE_CHARACTERS} characters")
        with self._writing:
            with self._lock:
                remarks = {**self._remarks, remark.name: Remark(remark.name, tags, remark.note.strip())}
            content = [one for one in remarks.values() if one.tags or one.note]
            replace_file(self._notes, msgspec.json.format(msgspec.json.encode(content)) + b"\n")
            with self._lock:
                self._remarks = {one.name: one for one in content}

    def close(self) -> None:
        """Look at nothing any more."""
        self._closed.set()

    def _kept(self) -> dict[str, Remark]:
        if not self._notes.exists():
            return {}
        try:
            return {one.name: one for one in msgspec.json.decode(self._notes.read_bytes(), type=list[Remark])}
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise InputError(self._notes, "", str(error)) from None

    def _look(self, fresh: list[Listed]) -> None:
        with self._lock:
            busy = self._looking is not None and self._looking.is_alive()
            if busy or not fresh or self._closed.is_set():
                return
            self._looking = threading.Thread(target=self._glance_at, args=(fresh,), daemon=True)
            self._looking.start()

    def _glance_at(self, fresh: list[Listed]) -> None:
        """In a process of its own, one recording after the other: a broken one costs its own picture alone."""
        for one in fresh:
            if self._closed.is_set():
                return
            command = [
                *background(waited_for=True),
                sys.executable,
                "-m",
                "hoopd.dashboard.work.glance",
                str(self.folder / one.name),
            ]
            try:
                done = subprocess.run(
                    command, capture_output=True, timeout=GLANCE_S, check=False, stdin=subprocess.DEVNULL
                )
                glance = msgspec.json.decode(done.stdout, type=dict[str, Any])
            except (OSError, subprocess.TimeoutExpired, msgspec.MsgspecError):
                glance = {"wrong": "cannot be looked at"}
            with self._lock:
                self._glances[one] = glance


def _is_usable(name: str) -> bool:
    """A name that the commands take for a file and for nothing else (an experiment of a file stands after a colon)."""
    return name.isprintable() and len(name) <= NAME_CHARACTERS and ":" not in name and not name.startswith(".")


def _words(remark: Remark | None) -> dict[str, Any]:
    return {"tags": remark.tags if remark else [], "note": remark.note if remark else ""}
