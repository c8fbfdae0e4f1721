"""What is known of a device from earlier diagnoses (`hoopd.memory/1`, JSON): each by its own recordings alone.

A recording is known by the SHA-256 of its file and counts once: a diagnosis that shares one with an earlier entry takes
that entry's place.

Rules of this file: records and their bytes; what follows from them is `hoopd.diagnose.memory`'s business. The same
entries give the same bytes.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from datetime import date as calendar_date
from pathlib import Path
from typing import Literal

import msgspec

from hoopd.files.folder_lock import held_still
from hoopd.files.reading import InputError
from hoopd.files.whole_files import file_bytes, replace_file

_DATE = re.compile(r"\d{4}-\d{2}-\d{2}")


class RememberedValue(msgspec.Struct, frozen=True, kw_only=True):
    """A number by the recordings of one diagnosis alone, with its standard deviation."""

    value: float
    sd: float
    unit: str = ""


class RememberedEffect(msgspec.Struct, frozen=True, kw_only=True):
    """An effect that was confirmed: how likely it was this very law, and its parameters."""

    probability: float
    parameters: dict[str, RememberedValue] = {}


class RememberedDiagnosis(msgspec.Struct, frozen=True, kw_only=True):
    """One diagnosis. `date`: of its recordings, YYYY-MM-DD, empty where nobody told; `recordings`: SHA-256 of files."""

    date: str = ""
    recordings: list[str]
    parameters: dict[str, RememberedValue] = {}
    effects: dict[str, RememberedEffect] = {}


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """`hoopd.memory/1`. `of`: plant and structure whose parameters these are."""

    schema: Literal["hoopd.memory/1"] = "hoopd.memory/1"
    of: str
    diagnoses: list[RememberedDiagnosis] = []

    def without(self, recordings: Sequence[str]) -> Memory:
        """What is known without these recordings."""
        shared = set(recordings)
        kept = [one for one in self.diagnoses if not shared & set(one.recordings)]
        return msgspec.structs.replace(self, diagnoses=kept)

    def with_diagnosis(self, one: RememberedDiagnosis) -> Memory:
        """With one more, in the place of all that shared a recording with it."""
        return msgspec.structs.replace(self, diagnoses=[*self.without(one.recordings).diagnoses, one])


def load_memory(path: Path, of: str | None) -> tuple[Memory, str]:
    """A memory of `of` (None: of anything) and its SHA-256; an empty one, and no hash, where there is no file yet.
    InputError."""
    if not path.exists():
        return Memory(of=of or ""), ""
    data = file_bytes(path)
    try:
        memory: Memory = msgspec.json.decode(data, type=Memory, strict=True)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(path, "", f"not a hoopd.memory/1: {error}") from None
    if of is not None and memory.of != of:
        raise InputError(path, "of", f"is of {memory.of}, not of {of}: another file")
    for one in memory.diagnoses:
        check_date(path, one.date)
        values = [*one.parameters.items(), *((k, v) for e in one.effects.values() for k, v in e.parameters.items())]
        for name, value in values:
            if not value.sd > 0.0:
                raise InputError(path, name, f"a standard deviation is above 0, not {value.sd:g}")
    return memory, hashlib.sha256(data).hexdigest()


def save_memory(path: Path, memory: Memory) -> None:
    """The whole file or none."""
    replace_file(path, memory_bytes(memory))


def add_to_memory(path: Path, of: str, one: RememberedDiagnosis) -> None:
    """One more diagnosis, beside what others have added since the memory was read."""
    with held_still(path):
        save_memory(path, load_memory(path, of)[0].with_diagnosis(one))


def memory_bytes(memory: Memory) -> bytes:
    """Of the file."""
    return msgspec.json.format(msgspec.json.encode(memory, order="deterministic"), indent=2) + b"\n"


def check_date(where: object, text: str) -> None:
    """InputError for what is no day."""
    if not text:
        return
    try:
        if _DATE.fullmatch(text):
            calendar_date.fromisoformat(text)
            return
    except ValueError:
        pass
    raise InputError(where, "date", f"expected YYYY-MM-DD, not {text[:40]!r}")


def days_between(earlier: str, later: str) -> float:
    """Days from one date to another, negative where it is the other way round; 0 where either is unknown."""
    if not (earlier and later):
        return 0.0
    return float((calendar_date.fromisoformat(later) - calendar_date.fromisoformat(earlier)).days)
