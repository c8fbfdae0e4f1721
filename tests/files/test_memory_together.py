"""Two that add to one memory: neither loses what the other has told."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from hoopd.files import memory
from hoopd.files.memory import RememberedDiagnosis, add_to_memory, load_memory

SUBJECT = "hoop rolling"


def test_two_that_add_at_once_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, reads = tmp_path / "memory.json", load_memory
    first_has_read, second_begins = threading.Event(), threading.Event()

    def slowly(place: Path, of: str | None) -> tuple[memory.Memory, str]:
        told = reads(place, of)
        first_has_read.set()
        second_begins.wait(0.3)
        return told

    monkeypatch.setattr(memory, "load_memory", slowly)
    adding = [
        threading.Thread(target=add_to_memory, args=(path, SUBJECT, RememberedDiagnosis(recordings=[name])))
        for name in ("a", "b")
    ]
    adding[0].start()
    assert first_has_read.wait(5.0)
    adding[1].start()
    second_begins.wait(0.1)
    for one in adding:
        one.join(5.0)
    assert sorted(one.recordings[0] for one in reads(path, SUBJECT)[0].diagnoses) == ["a", "b"]
